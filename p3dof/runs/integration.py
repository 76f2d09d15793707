"""Integration in time, from event to event: Runge-Kutta of order 8 by SciPy, or 4; forces held or not."""

from __future__ import annotations

import math
import time as clock
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from p3dof._base.checks import LARGEST, FloatArray, Progress
from p3dof._base.errors import ControllerError
from p3dof.runs.actuation import Actuation
from p3dof.runs.crossings import Crossings, Watch
from p3dof.runs.drives import DrivenPlant, Lag
from p3dof.runs.fixed_steps import RungeKutta4
from p3dof.runs.margins import Margins, Stop
from p3dof.runs.plants import Plant

FAILED = "no step is small enough for the tolerances; the forces may be too large or change too fast"

_EDGE = 1e-9
"""Share of a hold below which a rest of it is rounding."""

NEAR = 1e-6
"""A run that cannot go on this near a limit has got there [m, rad, or share of a leg's length]."""

_TINY, _PATIENCE = 1e-13, 1000
"""Steps that are so small a share of the run lead nowhere, if so many of them come one after the other."""

_CRAWLING = 300
"""So many steps that are shorter than a run's own shortest one are enough."""

BEYOND = 0.1 * LARGEST
"""States and rates that are larger are no motion any more [SI]."""


class Schedule:
    """When something happens in a run: samples, control ticks, kinks of the load.

    Parameters
    ----------
    times : ndarray, shape (N,)
        Times of the samples, from 0; the last is the end of the run [s].
    period : float
        How long forces are held [s]; zero for not at all.
    kinks : ndarray, shape (K,)
        Other times at which a step must end, rising [s].
    lateness : tuple of int and float
        How many whole periods after a tick its forces act, and the rest as a share of one.
    """

    def __init__(
        self, times: FloatArray, period: float, kinks: FloatArray, lateness: tuple[int, float] = (0, 0.0)
    ) -> None:
        self.times, self.period = times, period
        self._end = float(times[-1])
        self._kinks = kinks[(kinks > 0) & (kinks < self._end)]
        self._ticks = 0
        self._whole, self._rest = lateness

    def is_tick(self, time: float) -> bool:
        """Return whether the controller acts at a time, and count it."""
        tick = self.period > 0 and abs(time - self._ticks * self.period) <= self.slack(time)
        self._ticks += tick
        return bool(tick)

    def acting(self) -> float:
        """Return when the forces of the last tick begin to act [s]."""
        return (self._ticks - 1 + self._whole + self._rest) * self.period

    def reached(self, time: float, event: float) -> bool:
        """Return whether an event is due at a time."""
        return event <= time + self.slack(time)

    def after(self, time: float, change: float = math.inf) -> float:
        """Return when a step that begins at a time must end, where forces change at another one."""
        until = self._end
        if self.period:
            tick = min(self._ticks * self.period, change)
            until = until if self._end - tick < _EDGE * self.period else tick
        later = self._kinks[self._kinks > time + self.slack(time)]
        return min(until, float(later[0])) if len(later) else until

    def slack(self, time: float) -> float:
        """Return by how much times may differ that are the same but for rounding."""
        return max(1e-15 * time, _EDGE * self.period)


class _LostStep(Exception):  # noqa: N818 - never seen outside
    """The integrator has lost its step: it is not a number."""


@dataclass(eq=False)
class Recording:
    """States at the samples, with what acted there.

    Parameters
    ----------
    times, states, rates, forces, asked, loads : list
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
    loads: list[FloatArray] = field(default_factory=list)
    stop: Stop | None = None
    evaluations: int = 0
    seconds: float = 0.0


class Tolerances(NamedTuple):
    """Relative and absolute tolerance of an integrator, its longest step [s], and which it is."""

    rtol: float
    atol: float
    max_step: float = np.inf
    scheme: str = "dop853"


class Integrator:
    """One run.

    Parameters
    ----------
    plant : Plant
        What moves.
    actuation : Actuation
        What gives the forces.
    load : callable
        Time to the load from outside, as the plant takes it, such as a wrench (6,).
    margins : Margins
        What ends the run.
    schedule : Schedule
        When samples are taken, forces change, and the load has a kink.
    tolerances : Tolerances
        Of the integrator.
    progress : callable, optional
        Called with (done, total) samples.
    watch : Watch, optional
        What is noted on the way.
    lag : Lag, optional
        Of drives behind forces that are held.
    shortest : float
        A run that takes only steps shorter than this, very many of them, leads nowhere [s].
    """

    def __init__(
        self,
        plant: Plant,
        actuation: Actuation,
        load: Callable[[float], FloatArray],
        margins: Margins,
        schedule: Schedule,
        tolerances: Tolerances,
        progress: Progress | None = None,
        watch: Watch | None = None,
        shortest: float = 0.0,
        lag: Lag | None = None,
    ) -> None:
        self._watch, self._shortest = watch, shortest
        self._plant, self._actuation, self._load = plant, actuation, load
        self._lag = lag
        self._drives = plant if isinstance(plant, DrivenPlant) else None
        self._margins, self._crossings = margins, Crossings(margins)
        self._schedule, self._times = schedule, schedule.times
        self._tolerances = tolerances
        self._progress = progress
        self._held: tuple[FloatArray, FloatArray] | None = None
        self._late: deque[tuple[float, tuple[FloatArray, FloatArray]]] = deque()
        self._next = 0
        self._step: float | None = None
        self._lost = self._crawled = 0
        self.recording = Recording()

    def run(self, state: FloatArray) -> Recording:
        """Integrate from a state to the last sample or to what ends the run.

        Raises
        ------
        ControllerError
            If the controller fails; `recording` holds the samples so far.
        """
        begun = clock.perf_counter()
        time, end = 0.0, float(self._times[-1])
        try:
            while self.recording.stop is None and time < end:
                self._tick(time, state)
                state = self._driven(time, state)
                self._sample_at(time, state)
                change = self._late[0][0] if self._late else math.inf
                time, state = self._interval(time, state, self._schedule.after(time, change))
            if self.recording.stop is None:
                self._sample_at(end, state)
        except ControllerError as error:
            self.recording.stop = Stop("controller", error.time, str(error.__cause__))
            raise
        finally:
            self.recording.seconds = clock.perf_counter() - begun
        return self.recording

    def _tick(self, time: float, state: FloatArray) -> None:
        """Let the controller act if its time has come, and the forces change that are due."""
        if self._schedule.is_tick(time):
            forces = self._forces(time, state)
            self._late.append((self._schedule.acting(), forces))
            if self._held is None:
                self._hold(time, forces)
        while self._late and self._schedule.reached(time, self._late[0][0]):
            self._hold(time, self._late.popleft()[1])

    def _hold(self, time: float, forces: tuple[FloatArray, FloatArray]) -> None:
        """Hold forces, and those asked for, from a time on."""
        self._held = forces
        if self._lag is not None:
            self._lag.follow(time, forces[0])

    def _driven(self, time: float, state: FloatArray) -> FloatArray:
        """Return the state, with the forces of the drives from the start on."""
        if self._drives is None or time > 0:
            return state
        return self._drives.begin(state, (self._held or self._forces(time, state))[0])

    def _interval(
        self, time: float, state: FloatArray, until: float, careful: bool = False
    ) -> tuple[float, FloatArray]:
        """Integrate to a time; return it, or when the run ended before, and the state then."""
        try:
            with np.errstate(all="ignore"):
                solver = self._solver(time, state, until, careful)
        except _LostStep:
            return self._failed(time, state)
        if not np.isfinite(solver.f).all() or not np.isfinite(solver.h_abs):
            return self._failed(time, state)
        while solver.status == "running":
            before = float(solver.t), np.array(solver.y)
            if not self._stepped(solver):
                equal = isinstance(solver, RungeKutta4)  # steps as they are asked for, shorter ones may do
                return self._interval(*before, until, True) if equal else self._failed(*before)
            time, state = float(solver.t), np.array(solver.y)
            dense = solver.dense_output() if self._needs_dense(*before, time, state) else None
            crossed = None if dense is None else self._crossings.first(dense, before[0], time)
            if crossed is not None and dense is not None:
                self._watched(dense, before[0], crossed[0])
                time, index = crossed
                self.recording.stop = self._margins.stop(index, time)
                self._samples(dense, time)
                state = np.asarray(dense(time))
                self._record_end(time, state)
                return time, state
            self._watched(dense, before[0], time)
            self._samples(dense, time)
        self._step = float(solver.h_abs)
        return until, state

    def _solver(self, time: float, state: FloatArray, until: float, careful: bool) -> Any:
        """Return what integrates from a time to another; carefully with adaptive steps."""
        from scipy.integrate import DOP853

        rtol, atol, max_step, scheme = self._tolerances
        if scheme == "rk4" and not careful:
            return RungeKutta4(self._rate, time, state, until, max_step)
        options: dict[str, Any] = {"rtol": rtol, "atol": atol, "max_step": max_step}
        if self._step is not None:
            options["first_step"] = min(self._step, until - time)
        return DOP853(self._rate, time, state, until, **options)

    def _watched(self, dense: Any, start: float, end: float) -> None:
        """Let the watch look at a step."""
        if self._watch is not None and end > start:
            self._watch(dense, start, end)

    def _stepped(self, solver: Any) -> bool:
        """Take a step; return whether there was one to take."""
        try:
            with np.errstate(all="ignore"):  # steps that overflow are refused
                solver.step()
        except _LostStep:
            return False
        if solver.status == "failed" or not _finite(solver.f):
            return False
        tiny = solver.t - solver.t_old < max(_TINY * self._times[-1], self._shortest)
        tiny = tiny and solver.status == "running"  # the last step to a tick may be as short as it likes
        self._crawled = self._crawled + 1 if tiny else 0
        return self._crawled < (_CRAWLING if self._shortest else _PATIENCE)

    def _failed(self, time: float, state: FloatArray) -> tuple[float, FloatArray]:
        """End the run where the integrator cannot go on."""
        margins = self._margins(time, state)
        near = int(np.argmin(margins))
        if margins[near] < NEAR:  # what keeps it from going on is a limit, beyond which nothing is defined
            self.recording.stop = self._margins.stop(near, time)
        else:
            self.recording.stop = Stop("accuracy", time, FAILED)
        self._record_end(time, state)
        return time, state

    def _needs_dense(self, start: float, before: FloatArray, end: float, after: FloatArray) -> bool:
        """Return whether a step holds samples or may cross a limit."""
        sampled = self._next < len(self._times) and self._times[self._next] < end
        return bool(sampled or self._watch is not None or self._crossings.possible(start, before, end, after))

    def _samples(self, dense: Any, last: float) -> None:
        """Take the samples up to a time, where a step reaches beyond them."""
        edge = last - self._schedule.slack(last)  # a sample at a tick belongs to the hold that begins there
        while dense is not None and self._next < len(self._times) and self._times[self._next] < edge:
            time = float(self._times[self._next])
            self._next += 1
            self._record(time, np.asarray(dense(time)))

    def _sample_at(self, time: float, state: FloatArray) -> None:
        """Take the sample that is due at a time, if one is."""
        if self._next < len(self._times):
            due = float(self._times[self._next])
            if abs(due - time) <= self._schedule.slack(time):
                self._next += 1
                self._record(due, state)

    def _record_end(self, time: float, state: FloatArray) -> None:
        """Record where a run ended early, unless that is a sample already."""
        if not self.recording.times or self.recording.times[-1] < time:
            self._record(time, state)

    def _record(self, time: float, state: FloatArray) -> None:
        forces, asked = self._held or self._forces(time, state)
        forces = forces if self._lag is None else self._lag.at(time)
        load = self._load(time)
        with np.errstate(all="ignore"):
            rate = self._plant.rate(state, forces, load)
        if not (np.abs([state, rate]) <= BEYOND).all():  # where the integrator could not go on either
            return
        if self._drives is not None:
            forces = self._drives.delivered(state, forces)
        record = self.recording
        record.times.append(time)
        record.states.append(np.array(state))
        record.rates.append(rate)
        record.forces.append(forces)
        record.asked.append(asked)
        record.loads.append(load)
        if self._progress is not None:
            self._progress(self._next, len(self._times))

    def _rate(self, time: float, state: FloatArray) -> FloatArray:
        self.recording.evaluations += 1
        if not math.isfinite(time) or self._lost > _PATIENCE:  # SciPy would look for a step for ever
            raise _LostStep
        if not _finite(state):
            self._lost += 1
            return np.full(state.shape, np.nan)
        if self._lag is not None:
            forces = self._lag.at(time)
        else:
            forces = self._held[0] if self._held is not None else self._continuous(time, state)
        rate = self._plant.rate(state, forces, self._load(time))
        self._lost = 0 if _finite(rate) else self._lost + 1
        return rate

    def _continuous(self, time: float, state: FloatArray) -> FloatArray:
        """Return the forces at a trial step; none beyond a limit, if the controller knows none there."""
        try:
            return self._forces(time, state)[0]
        except ControllerError:
            if self._margins(time, state).min() <= 0:
                return np.full(self._actuation.size, np.nan)
            raise

    def _forces(self, time: float, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        try:
            return self._actuation(time, *self._plant.actuated(state))
        except Exception as error:
            raise ControllerError(
                f"the controller failed at t = {time:.6g} s: {error}", float(time)
            ) from error


def _finite(numbers: FloatArray) -> bool:
    """Return whether all of a few numbers are finite, sooner than NumPy would."""
    return all(map(math.isfinite, numbers.tolist()))
