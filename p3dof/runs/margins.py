"""What ends a run, or is noted on its way: limits of joints, closures that become dependent, events."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from p3dof._base.checks import FloatArray, Readable, shown
from p3dof._base.errors import InputError

if TYPE_CHECKING:  # margins of the machine need no Pinocchio, which those of other robots import
    from p3dof.runs.plants import ConstrainedPlant


@dataclass(frozen=True)
class Stop:
    """Why and when a run ended before its time.

    Parameters
    ----------
    kind : str
        What ended it, one of `p3dof.runs.KINDS` for the manipulator, of
        `p3dof.runs.ROBOT_KINDS` for any robot, ``"event"`` for an event; ``"accuracy"`` when the
        integrator could not go on, ``"controller"`` when the controller failed.
    time : float
        When [s].
    reason : str
        In words.
    """

    kind: str
    time: float
    reason: str

    def __str__(self) -> str:
        return f"{self.kind} at t = {self.time:.6g} s: {self.reason}"


class Margins(Protocol):
    """How far a plant is from everything that can end a run: m numbers, positive inside."""

    def __call__(self, time: float, state: FloatArray) -> FloatArray:
        """Return the margins of a state at a time, shape (m,); at least one."""

    def trend(self, time: float, state: FloatArray, ahead: float) -> tuple[FloatArray, FloatArray]:
        """Return the margins of a state at a time, and those a short time ahead at its present velocity."""

    def stop(self, index: int, time: float) -> Stop:
        """Return why a run ends at a margin."""


@dataclass(frozen=True)
class Event(Readable):
    """Something that happens when a function of time and state passes through zero.

    Parameters
    ----------
    name : str
        What to call it.
    value : callable
        Takes the time [s], the configuration (nq,) and the velocity (nv,), and returns a number. It should
        change smoothly; what passes through zero and back within 2 ms may be overlooked.
    stops : bool
        Whether the run ends then; else it is noted in `RobotRun.events`.

    Raises
    ------
    InputError
        If the name is no text, or the value cannot be called.
    """

    name: str
    value: Callable[[float, FloatArray, FloatArray], Any]
    stops: bool = True

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.strip():
            raise InputError(f"event: expected a name, got {shown(self.name)}")
        if not callable(self.value):
            raise InputError(f"event {shown(self.name)}: expected a function, got {shown(self.value)}")

    def at(self, time: float, q: FloatArray, v: FloatArray) -> float:
        """Return the value at a time and state.

        Raises
        ------
        InputError
            If the function raises, or returns anything but a finite number; with the time.
        """
        try:
            value = np.asarray(self.value(time, q, v), dtype=float)
        except Exception as error:
            raise InputError(f"event {shown(self.name)} failed at t = {time:.6g} s: {error}") from error
        if value.size != 1 or not np.isfinite(value).all():
            raise InputError(
                f"event {shown(self.name)}: expected a finite number at t = {time:.6g} s, "
                f"got {shown(value.tolist())}"
            )
        return float(value.reshape(()))


@dataclass(frozen=True)
class Occurrence:
    """An event that did not end the run.

    Parameters
    ----------
    name : str
        Of the event.
    time : float
        When [s].
    rising : bool
        Whether its value rose through zero.
    """

    name: str
    time: float
    rising: bool

    def __str__(self) -> str:
        return f"{self.name} at t = {self.time:.6g} s"


def checked_events(events: Sequence[Event]) -> tuple[Event, ...]:
    """Return events with different names."""
    if isinstance(events, str | Event) or not all(isinstance(event, Event) for event in events):
        raise InputError(f"events: expected a list of Event(...), got {shown(events)}")
    names = [event.name for event in events]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"events: two are called {shown(name)}")
    return tuple(events)


class EventMargins:
    """The margins of events that end a run, positive on the side where it starts."""

    def __init__(self, events: Sequence[Event], q: FloatArray, v: FloatArray) -> None:
        self._events = events
        values = [event.at(0.0, q, v) for event in events]
        for event, value in zip(events, values, strict=True):
            if value == 0:
                raise InputError(f"event {shown(event.name)}: the run would start at it, its value is zero")
        self._signs = np.sign(values)

    def __call__(self, time: float, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return the margins at a time."""
        return np.asarray(self._signs * [event.at(time, q, v) for event in self._events])

    def stop(self, index: int, time: float) -> Stop:
        """Return why a run ends at a margin."""
        return Stop("event", time, self._events[index].name)


JOINT_LIMIT, SINGULAR = "joint limit", "singular closures"
ROBOT_KINDS = (JOINT_LIMIT, SINGULAR)
"""What can end a run of any robot, besides its events."""

GROWING = "the closures become dependent: their forces may grow without end"
DEPENDENT = 1e-5  # smallest singular value of independent closures, the largest being 1
_AT = 2.5e-10  # distance up to which a start is at a limit [m or rad]
_KEPT = 200  # most singular values that are remembered: a step asks for the same states more than once


class RobotMargins:
    """How far a robot is from what ends its run; a joint has limits if the lower is below the upper."""

    def __init__(
        self, plant: ConstrainedPlant, stop_at: Sequence[str], events: Sequence[Event], state: FloatArray
    ) -> None:
        from p3dof.loops.assembly import Limits

        kinds = [stop_at] if isinstance(stop_at, str) or not isinstance(stop_at, Iterable) else list(stop_at)
        if isinstance(stop_at, str) or any(kind not in ROBOT_KINDS for kind in kinds):
            raise InputError(
                f"stop_at: expected a list of {', '.join(ROBOT_KINDS)}, got {', '.join(map(shown, kinds))}"
            )
        self._plant, self._model = plant, plant.loop.model
        limits = Limits(self._model)
        counted = (limits.lower < limits.upper) & (JOINT_LIMIT in kinds)
        self.limited_q = limits.q[counted]
        self._ends = limits.lower[counted], limits.upper[counted]
        self._joints = [name for name, counts in zip(limits.names, counted, strict=True) if counts]
        q, v = plant.split(state)
        self.start_at(q)
        self._rank = max(plant.loop.generic_rank or 0, plant.loop.rank(q)) if SINGULAR in kinds else 0
        self._known: dict[bytes, float] = {}
        self._happening = EventMargins(events, q, v) if events else None
        margins = self(0.0, state)
        if margins.min() <= 0:
            stop = self.stop(int(np.argmin(margins)), 0.0)
            told = f"beyond a limit: {stop.kind}: {stop.reason} (see stop_at)"
            if stop.kind == SINGULAR:
                told = "at a singular configuration, whose motion is not determined; p3dof loop info and "
                told += "regular_configuration give a regular one near the reference"
            raise InputError(f"q: the run would start {told}")

    def start_at(self, q: FloatArray) -> None:
        """Let runs start at limits, where configurations (..., nq) are at them, and end a little beyond."""
        off = np.abs(np.atleast_2d(q)[:, self.limited_q] - np.array(self._ends)[:, None])  # (2, N, n)
        self.lower, self.upper = self._ends + np.array([[-2.0], [2.0]]) * _AT * (off < _AT).any(axis=1)

    def __call__(self, time: float, state: FloatArray) -> FloatArray:
        """Return the margins of a state at a time, shape (m,): lower and upper limits, closures, events."""
        return self._at(time, *self._plant.split(state))

    def trend(self, time: float, state: FloatArray, ahead: float) -> tuple[FloatArray, FloatArray]:
        """Return the margins of a state at a time, and those a short time ahead at its present velocity."""
        import pinocchio as pin

        q, v = self._plant.split(state)
        later = np.array(pin.integrate(self._model, q, v * ahead))
        return self._at(time, q, v), self._at(time + ahead, later, v)

    def stop(self, index: int, time: float) -> Stop:
        """Return why a run ends at a margin."""
        count = len(self._joints)
        if index < 2 * count:
            at, end = index % count, "lower" if index < count else "upper"
            limit = self._ends[index >= count][at]
            words = f"the joint {shown(self._joints[at])} at its {end} limit, {limit:.6g}"
            return Stop(JOINT_LIMIT, time, words)
        if index == 2 * count:
            return Stop(SINGULAR, time, GROWING)
        assert self._happening is not None  # noqa: S101 - there are no other margins
        return self._happening.stop(index - 2 * count - 1, time)

    def _at(self, time: float, q: FloatArray, v: FloatArray) -> FloatArray:
        values = q[self.limited_q]
        margins = [values - self.lower, self.upper - values, [self.room(q)]]
        if self._happening is not None:
            margins.append(self._happening(time, q, v))
        return np.concatenate(margins)

    def room(self, q: FloatArray) -> float:
        """Return how far the closures are from becoming dependent."""
        if not self._rank:
            return np.inf
        key = q.tobytes()
        if key not in self._known:
            from p3dof.loops.tables import closure_conditioning

            if len(self._known) >= _KEPT:
                self._known.clear()
            self._known[key] = closure_conditioning(self._plant.loop, q, self._rank) - DEPENDENT
        return self._known[key]
