"""Integration in time, from event to event: Runge-Kutta of order 8 by SciPy, 5 where that does, or 4."""

from __future__ import annotations

import math
import time as clock
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from p3dof._base.checks import LARGEST, FloatArray, Progress
from p3dof._base.errors import ControllerError
from p3dof.runs.actuation import Actuation
from p3dof.runs.margins import Event, Margins, Occurrence, Stop
from p3dof.runs.plants import DrivenPlant, Lag, Plant
from p3dof.runs.settings import EDGE

CHECKED = 2e-3  # the limits are looked at this often at least, also where a margin may turn around [s]

_NEARBY = 1e-6  # share of a step over which a margin's rate is taken

Dense: TypeAlias = Callable[[float], FloatArray]  # time to state, within one step


def pieces(start: float, end: float) -> FloatArray:
    """Return the ends of the pieces of a step, none of which is longer than `CHECKED`."""
    return np.asarray(np.linspace(start, end, int(np.ceil((end - start) / CHECKED)) + 1))


class Watch:
    """Notes when events happen, and lets the run go on; `seen` are configuration and velocity of a state."""

    def __init__(
        self, events: Sequence[Event], seen: Callable[[FloatArray], tuple[FloatArray, FloatArray]]
    ) -> None:
        self._events, self._seen = events, seen
        self._changes: list[tuple[float, int, bool]] = []

    @classmethod
    def of(
        cls, events: Sequence[Event], seen: Callable[[FloatArray], tuple[FloatArray, FloatArray]]
    ) -> Watch | None:
        """Return what notes those events that do not end the run; None if there are none."""
        noted = [event for event in events if not event.stops]
        return cls(noted, seen) if noted else None

    @property
    def occurrences(self) -> tuple[Occurrence, ...]:
        """What happened, in its order."""
        return tuple(Occurrence(self._events[i].name, time, rose) for time, i, rose in self._changes)

    def _values(self, time: float, state: FloatArray) -> FloatArray:
        q, v = self._seen(state)
        return np.array([event.at(time, q, v) for event in self._events])

    def __call__(self, dense: Dense, start: float, end: float) -> None:
        """Look at a step, or at its beginning."""
        from scipy.optimize import brentq

        before = self._values(start, dense(start))
        for low, high in pairwise(pieces(start, end)):
            after = self._values(high, dense(high))
            changed = np.flatnonzero((before != 0) & (np.sign(before) * after <= 0))
            found = [
                (
                    float(brentq(lambda t, i=i: self._values(t, dense(t))[i], low, high)),
                    int(i),
                    bool(before[i] < 0),
                )
                for i in changed
            ]
            self._changes += sorted(found)
            before = after


class Crossings:
    """Finds the first limit that a step crosses."""

    def __init__(self, margins: Margins) -> None:
        self._margins = margins

    def possible(self, start: float, before: FloatArray, end: float, after: FloatArray) -> bool:
        """Return whether a limit may be crossed in a step between two states: what costs a dense output."""
        step = end - start
        if step > CHECKED:
            return True
        first, falling = self._trend(start, before, step)
        last, rising = self._trend(end, after, step)
        return bool(last.min() <= 0 or _turning(first, falling, last, rising).any())

    def first(self, dense: Dense, start: float, end: float) -> tuple[float, int] | None:
        """Return time [s] and index of the margin that is crossed first in a step; None if none is."""
        from scipy.optimize import brentq

        before = start
        for time in self._looked_at(dense, start, end):
            crossed = np.flatnonzero(self._margins(time, dense(time)) <= 0)
            if len(crossed):
                inside = self._margins(before, dense(before))
                found = [
                    (
                        brentq(lambda t, i=i: self._margins(t, dense(t))[i], before, time)
                        if inside[i] > 0
                        else before,
                        i,
                    )
                    for i in crossed
                ]
                when, index = min(found)
                return float(when), int(index)
            before = time
        return None

    def _looked_at(self, dense: Dense, start: float, end: float) -> list[float]:
        """Return the ends of the pieces of a step, and where a margin is least in between."""
        from scipy.optimize import minimize_scalar

        ends = pieces(start, end)
        found: list[float] = []
        for low, high in pairwise(ends):
            first, falling = self._trend(low, dense(low), high - low)
            last, rising = self._trend(high, dense(high), high - low)
            for i in np.flatnonzero(_turning(first, falling, last, rising) & (last > 0)):
                least = minimize_scalar(
                    lambda t, i=i: self._margins(t, dense(t))[i], bounds=(low, high), method="bounded"
                )
                found.append(float(least.x))
            found.append(float(high))
        return sorted(found)

    def _trend(self, time: float, state: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
        """Return the margins of a state, and how much they would change in a step at their present rate."""
        here, near = self._margins.trend(time, state, _NEARBY * step)
        with np.errstate(invalid="ignore"):
            change = np.where(np.isfinite(here) & np.isfinite(near), (near - here) / _NEARBY, 0.0)
        return here, change


def _turning(
    first: FloatArray, falling: FloatArray, last: FloatArray, rising: FloatArray
) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return which margins fall at the start and rise at the end, so steeply that they may reach zero."""
    deep = np.minimum(first + falling, last - rising)  # where the tangents lead
    return np.asarray((falling < 0) & (rising > 0) & (deep <= 0))


Rate: TypeAlias = Callable[[float, FloatArray], FloatArray]  # time and state to the derivative of the state


class RungeKutta4:
    """From one time to another in equal steps."""

    def __init__(self, rate: Rate, time: float, state: FloatArray, until: float, step: float) -> None:
        self._rate, self._begin, self._until = rate, time, until
        self._count = max(1, math.ceil((until - time) / step - EDGE))
        self._done = 0
        self.t, self.y, self.f = time, state, rate(time, state)
        self.t_old: float | None = None
        self.h_abs = (until - time) / self._count
        self._before = state, self.f
        self.status = "running"

    def step(self) -> None:
        """Take a step."""
        h, half, t, y = self.h_abs, self.h_abs / 2, self.t, self.y
        k1 = self.f
        k2 = self._rate(t + half, y + half * k1)
        k3 = self._rate(t + half, y + half * k2)
        k4 = self._rate(t + h, y + h * k3)
        self._before = y, k1
        self._done += 1
        last = self._done == self._count
        self.t_old, self.t = t, self._until if last else self._begin + self._done * h
        self.y = y + h / 6 * (k1 + 2 * (k2 + k3) + k4)
        self.f = self._rate(self.t, self.y)
        self.status = "finished" if last else "running"

    def dense_output(self) -> Callable[[float], FloatArray]:
        """Return the states of the last step: cubic in time, of order 4 as the method."""
        start, end = self.t_old, self.t
        if start is None:
            raise RuntimeError("no step was taken")
        (y0, f0), y1, f1, h = self._before, self.y, self.f, end - start

        def dense(time: float) -> FloatArray:
            s = (time - start) / h
            r = 1 - s
            inner = (1 - 2 * s) * (y1 - y0) + h * ((s - 1) * f0 + s * f1)
            return r * y0 + s * y1 - s * r * inner

        return dense


_SHARE, _WAIT = 0.015, 63
"""How much of the tolerance the error of a step taken at once may be; how many intervals to wait at most."""

_STAGES = (
    (0.2, np.array([0.2])),
    (0.3, np.array([3 / 40, 9 / 40])),
    (0.6, np.array([0.3, -0.9, 1.2])),
    (1.0, np.array([-11 / 54, 2.5, -70 / 27, 35 / 27])),
    (0.875, np.array([1631 / 55296, 175 / 512, 575 / 13824, 44275 / 110592, 253 / 4096])),
)
_END = np.array([37 / 378, 0, 250 / 621, 125 / 594, 0, 512 / 1771])
_ERROR = _END - [2825 / 27648, 0, 18575 / 48384, 13525 / 55296, 277 / 14336, 1 / 4]


class AtOnce:
    """One step of order 5 from where SciPy's DOP853 begins to its end, as `at_once` of `dop853.h`.

    Its end is taken if `good`; what is in between is that of a step of DOP853.
    """

    def __init__(self, solver: Any, rate: Rate) -> None:
        self._solver, self.status = solver, "running"
        self.t, self.y, self.f = solver.t, solver.y, solver.f
        h = solver.t_bound - solver.t
        self.h_abs = 10 * h
        slopes = np.empty((6, len(self.y)))
        slopes[0] = solver.f
        for stage, (time, row) in enumerate(_STAGES, 1):
            slopes[stage] = rate(self.t + time * h, self.y + h * (row @ slopes[:stage]))
        self._end = self.y + h * (_END @ slopes)
        scale = solver.atol + np.maximum(np.abs(self.y), np.abs(self._end)) * solver.rtol
        error = h * np.linalg.norm(_ERROR @ slopes / scale)
        self.good = bool(error < _SHARE * math.sqrt(len(scale)))

    def step(self) -> None:
        """Take the step."""
        self.t_old, self.t, self.y, self.status = self.t, self._solver.t_bound, self._end, "finished"

    def dense_output(self) -> Dense:
        """Return the states of the step: those of DOP853, made now, but for its end."""
        solver = self._solver
        solver.atol = solver.h_abs = solver.max_step = np.inf  # in one step, whatever its error
        solver.step()
        solver.y = self._end
        return solver.dense_output()  # type: ignore[no-any-return]


FAILED = "no step is small enough for the tolerances; the forces may be too large or change too fast"

NEAR = 1e-6  # a run that cannot go on this near a limit has got there [m, rad, or share of a leg's length]

_TINY, _PATIENCE = 1e-13, 1000
"""Steps that are so small a share of the run lead nowhere, if so many of them come one after the other."""

_CRAWLING = 300  # so many steps that are shorter than a run's own shortest one are enough

BEYOND = 0.1 * LARGEST  # states and rates that are larger are no motion any more [SI]


class Schedule:
    """When something happens in a run: samples, control ticks, kinks of the load."""

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
            until = until if self._end - tick < EDGE * self.period else tick
        later = self._kinks[self._kinks > time + self.slack(time)]
        return min(until, float(later[0])) if len(later) else until

    def slack(self, time: float) -> float:
        """Return by how much times may differ that are the same but for rounding."""
        return max(1e-15 * time, EDGE * self.period)


class _LostStep(Exception):  # noqa: N818 - never seen outside
    """The integrator has lost its step: it is not a number."""


@dataclass(eq=False)
class Recording:
    """States at the samples, with what acted there."""

    times: list[float] = field(default_factory=list)  # one entry a sample
    states: list[FloatArray] = field(default_factory=list)
    rates: list[FloatArray] = field(default_factory=list)
    forces: list[FloatArray] = field(default_factory=list)
    asked: list[FloatArray] = field(default_factory=list)
    loads: list[FloatArray] = field(default_factory=list)
    stop: Stop | None = None  # what ended the run
    evaluations: int = 0  # of the equations of motion
    seconds: float = 0.0  # on the clock


class Tolerances(NamedTuple):
    """Relative and absolute tolerance of an integrator, its longest step [s], and which it is."""

    rtol: float
    atol: float
    max_step: float = np.inf
    scheme: str = "dop853"


class Integrator:
    """One run."""

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
        self._lost = self._crawled = self._waiting = self._refused = 0
        self.recording = Recording()

    def run(self, state: FloatArray) -> Recording:
        """Integrate from a state to the last sample or to what ends the run."""
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
                solver = self._at_once(self._solver(time, state, until, careful))
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

    def _at_once(self, solver: Any) -> Any:
        """Return what takes one step for all of an interval, where that is cheaper and good enough."""
        if isinstance(solver, RungeKutta4) or not _finite(solver.f):
            return solver
        h = solver.t_bound - solver.t
        if h > CHECKED or self._watch is not None or self._samples_before(solver.t_bound):
            return solver  # it is looked into anyway
        if self._waiting:
            self._waiting -= 1
            return solver
        if not (solver.h_abs >= h and solver.max_step >= h):
            return solver
        whole = AtOnce(solver, self._rate)
        self._waiting = self._refused = 0 if whole.good else min(2 * self._refused + 1, _WAIT)
        return whole if whole.good else solver

    def _samples_before(self, time: float) -> bool:
        """Return whether a step that ends at a time has samples in it: one at a tick is of the next hold."""
        due = self._times[self._next] if self._next < len(self._times) else math.inf
        return bool(due < time - self._schedule.slack(time))

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
        sampled = self._samples_before(end)
        return bool(sampled or self._watch is not None or self._crossings.possible(start, before, end, after))

    def _samples(self, dense: Any, last: float) -> None:
        """Take the samples up to a time, where a step reaches beyond them."""
        while dense is not None and self._samples_before(last):
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
