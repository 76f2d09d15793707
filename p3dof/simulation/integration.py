"""Integration in time, from event to event: adaptive Runge-Kutta of order 8 by SciPy, forces held or not."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from p3dof.checks import FloatArray
from p3dof.errors import ControllerError
from p3dof.simulation.control import Actuation
from p3dof.simulation.limits import Margins, Stop
from p3dof.simulation.plants import Plant

CHECKED = 2e-3
"""The limits are looked at this often at least [s]."""

_EDGE = 1e-9
"""Share of a hold below which a rest of it is rounding."""

Progress = Callable[[int, int], None]


@dataclass(eq=False)
class Recording:
    """States at the samples, with what acted there.

    Parameters
    ----------
    times, states, rates, forces, asked, wrenches : list
        One entry a sample.
    stop : Stop, optional
        What ended the run.
    evaluations : int
        Of the equations of motion.
    seconds : float
        On the clock.
    """

    times: list[float] = field(default_factory=list)
    states: list[FloatArray] = field(default_factory=list)
    rates: list[FloatArray] = field(default_factory=list)
    forces: list[FloatArray] = field(default_factory=list)
    asked: list[FloatArray] = field(default_factory=list)
    wrenches: list[FloatArray] = field(default_factory=list)
    stop: Stop | None = None
    evaluations: int = 0
    seconds: float = 0.0


class Tolerances(NamedTuple):
    """Relative and absolute tolerance of an integrator, by step and component of the state."""

    rtol: float
    atol: float


class Integrator:
    """One run.

    Parameters
    ----------
    plant : Plant
        The machine.
    actuation : Actuation
        What gives the forces.
    wrench : callable
        Time to external wrench (6,).
    margins : Margins
        What ends the run.
    times : ndarray, shape (N,)
        When samples are taken, from 0 to the end of the run [s].
    period : float
        How long forces are held [s]; zero for not at all.
    tolerances : Tolerances
        Of the integrator.
    progress : callable, optional
        Called with (done, total) samples.
    """

    def __init__(
        self,
        plant: Plant,
        actuation: Actuation,
        wrench: Callable[[float], FloatArray],
        margins: Margins,
        times: FloatArray,
        period: float,
        tolerances: Tolerances,
        progress: Progress | None,
    ) -> None:
        self._plant, self._actuation, self._wrench = plant, actuation, wrench
        self._margins, self._times, self._period = margins, times, period
        self._tolerances = tolerances._asdict()
        self._progress = progress
        self._held: tuple[FloatArray, FloatArray] | None = None
        self._next = 0
        self._step: float | None = None
        self.recording = Recording()

    def run(self, state: FloatArray) -> Recording:
        """Integrate from a state to the last sample or to what ends the run.

        Raises
        ------
        ControllerError
            If the controller fails; `recording` holds the samples so far.
        """
        begun = clock.perf_counter()
        end = float(self._times[-1])
        time, ticks = 0.0, 0
        try:
            while self.recording.stop is None and time < end:
                until = end
                if self._period:
                    self._held = self._forces(time, state)
                    ticks += 1
                    until = min(end, ticks * self._period)
                    until = end if end - until < _EDGE * self._period else until
                self._sample_at(time, state)
                state = self._interval(time, state, until)
                time = until
            if self.recording.stop is None:
                self._sample_at(end, state)
        finally:
            self.recording.seconds = clock.perf_counter() - begun
        return self.recording

    def _interval(self, time: float, state: FloatArray, until: float) -> FloatArray:
        """Integrate over one hold, or over the whole run; return the state at its end."""
        from scipy.integrate import DOP853

        first = None if self._step is None else min(self._step, until - time)
        solver = DOP853(self._rate, time, state, until, first_step=first, **self._tolerances)
        while solver.status == "running":
            message = solver.step()
            if solver.status == "failed":
                self.recording.stop = Stop("accuracy", float(solver.t), str(message))
                break
            dense = solver.dense_output() if self._needs_dense(solver) else None
            self.recording.stop = self._crossed(solver, dense)
            last = solver.t if self.recording.stop is None else self.recording.stop.time
            self._samples(dense, last)
            if self.recording.stop is not None and dense is not None:
                self._record(last, dense(last))
                break
        self._step = float(solver.h_abs)
        return np.asarray(solver.y)

    def _needs_dense(self, solver: Any) -> bool:
        """Return whether a step holds samples or is too long to look at its end alone."""
        sampled = self._next < len(self._times) and self._times[self._next] < solver.t
        long = solver.t - solver.t_old > CHECKED
        return bool(sampled or long or self._margins_of(solver.y).min() <= 0)

    def _crossed(self, solver: Any, dense: Any) -> Stop | None:
        """Return the first limit that a step crosses."""
        if dense is None:
            return None
        from scipy.optimize import brentq

        def margins(time: float) -> FloatArray:
            return self._margins_of(dense(time))

        pieces = int(np.ceil((solver.t - solver.t_old) / CHECKED))
        before = float(solver.t_old)
        for time in np.linspace(solver.t_old, solver.t, pieces + 1)[1:]:
            crossed = np.flatnonzero(margins(time) <= 0)
            if len(crossed):
                found = []
                for index in crossed:
                    inside = margins(before)[index] > 0
                    root = brentq(lambda t, i=index: margins(t)[i], before, time) if inside else before
                    found.append((float(root), int(index)))
                when, index = min(found)
                return self._margins.stop(index, when)
            before = float(time)
        return None

    def _margins_of(self, state: FloatArray) -> FloatArray:
        return self._margins(self._plant.pose(state)[0], self._plant.drops(state))

    def _samples(self, dense: Any, last: float) -> None:
        """Take the samples up to a time, where a step reaches beyond them."""
        while dense is not None and self._next < len(self._times) and self._times[self._next] < last:
            time = float(self._times[self._next])
            self._sample_at(time, dense(time))

    def _sample_at(self, time: float, state: FloatArray) -> None:
        """Take the sample that is due at a time, if one is."""
        if self._next < len(self._times) and abs(self._times[self._next] - time) <= 1e-12 * max(1.0, time):
            self._next += 1
            self._record(time, state)
            if self._progress is not None:
                self._progress(self._next, len(self._times))

    def _record(self, time: float, state: FloatArray) -> None:
        forces, asked = self._held or self._forces(time, state)
        wrench = self._wrench(time)
        record = self.recording
        record.times.append(time)
        record.states.append(np.array(state))
        record.rates.append(self._plant.rate(state, forces, wrench))
        record.forces.append(forces)
        record.asked.append(asked)
        record.wrenches.append(wrench)

    def _rate(self, time: float, state: FloatArray) -> FloatArray:
        self.recording.evaluations += 1
        if not np.isfinite(state).all():
            return np.full(state.shape, np.nan)
        forces = self._held[0] if self._held is not None else self._continuous(time, state)
        return self._plant.rate(state, forces, self._wrench(time))

    def _continuous(self, time: float, state: FloatArray) -> FloatArray:
        try:
            self._plant.sliders(state)
        except (ValueError, ArithmeticError):  # a trial step beyond reach, where there are no sliders
            return np.full(3, np.nan)
        return self._forces(time, state)[0]

    def _forces(self, time: float, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        try:
            return self._actuation(time, *self._plant.sliders(state))
        except Exception as error:
            raise ControllerError(f"the controller failed at t = {time:.6g} s: {error}", time) from error
