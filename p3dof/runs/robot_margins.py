"""What ends a run of any robot: limits of its joints, closures that become dependent, events."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError
from p3dof.loops.conditioning import closure_conditioning
from p3dof.loops.trust import Limits
from p3dof.runs.events import Event
from p3dof.runs.margins import Stop
from p3dof.runs.plants import ConstrainedPlant

JOINT_LIMIT, SINGULAR = "joint limit", "singular closures"
ROBOT_KINDS = (JOINT_LIMIT, SINGULAR)
"""What can end a run of any robot, besides its events."""

_DEPENDENT = 1e-5
"""Smallest singular value of independent closures, the largest being 1."""
_KEPT = 200
"""Most singular values that are remembered: a step asks for the same states more than once."""


class RobotMargins:
    """How far a robot is from what ends its run: positive inside.

    A joint whose lower limit is not below its upper one has none: so are files that leave limits out.

    Parameters
    ----------
    plant : ConstrainedPlant
        The robot, which tells configuration and velocity of a state.
    stop_at : sequence of str
        Which of `ROBOT_KINDS` count.
    events : sequence of Event
        Events that end the run.
    state : ndarray
        Where the run starts: events are to be crossed from its side.

    Raises
    ------
    InputError
        If a kind is unknown, or the run starts beyond a limit or at an event.
    """

    def __init__(
        self, plant: ConstrainedPlant, stop_at: Sequence[str], events: Sequence[Event], state: FloatArray
    ) -> None:
        kinds = [stop_at] if isinstance(stop_at, str) or not isinstance(stop_at, Iterable) else list(stop_at)
        if isinstance(stop_at, str) or any(kind not in ROBOT_KINDS for kind in kinds):
            raise InputError(f"stop_at: expected a list of {', '.join(ROBOT_KINDS)}, got {shown(stop_at)}")
        self._plant, self._model, self.events = plant, plant.loop.model, events
        limits = Limits(self._model)
        counted = (limits.lower < limits.upper) & (JOINT_LIMIT in kinds)
        self.limited_q = limits.q[counted]
        self.lower, self.upper = limits.lower[counted], limits.upper[counted]
        self._joints = [name for name, counts in zip(limits.names, counted, strict=True) if counts]
        q, v = plant.split(state)
        self._rank = plant.loop.rank(q) if SINGULAR in kinds else 0
        self._known: dict[bytes, float] = {}
        values = [event.at(0.0, q, v) for event in events]
        for event, value in zip(events, values, strict=True):
            if value == 0:
                raise InputError(f"event {shown(event.name)}: the run would start at it, its value is zero")
        self._signs = np.sign(values)
        margins = self(0.0, state)
        if margins.min() <= 0:
            stop = self.stop(int(np.argmin(margins)), 0.0)
            raise InputError(
                f"q: the run would start beyond a limit: {stop.kind}: {stop.reason} (see stop_at)"
            )

    def __call__(self, time: float, state: FloatArray) -> FloatArray:
        """Return the margins of a state at a time, shape (m,): lower and upper limits, closures, events."""
        return self._at(time, *self._plant.split(state))

    def trend(self, time: float, state: FloatArray, ahead: float) -> tuple[FloatArray, FloatArray]:
        """Return the margins of a state at a time, and those a short time ahead at its present velocity."""
        q, v = self._plant.split(state)
        later = np.array(pin.integrate(self._model, q, v * ahead))
        return self._at(time, q, v), self._at(time + ahead, later, v)

    def stop(self, index: int, time: float) -> Stop:
        """Return why a run ends at a margin."""
        count = len(self._joints)
        if index < 2 * count:
            at, end = index % count, "lower" if index < count else "upper"
            limit = (self.lower if index < count else self.upper)[at]
            words = f"the joint {shown(self._joints[at])} at its {end} limit, {limit:.6g}"
            return Stop(JOINT_LIMIT, time, words)
        if index == 2 * count:
            return Stop(SINGULAR, time, "the closures become dependent: their forces may grow without end")
        return Stop("event", time, self.events[index - 2 * count - 1].name)

    def _at(self, time: float, q: FloatArray, v: FloatArray) -> FloatArray:
        values = q[self.limited_q]
        happening = [event.at(time, q, v) for event in self.events]
        return np.concatenate(
            [values - self.lower, self.upper - values, [self.room(q)], self._signs * happening]
        )

    def room(self, q: FloatArray) -> float:
        """Return how far the closures are from becoming dependent."""
        if not self._rank:
            return np.inf
        key = q.tobytes()
        if key not in self._known:
            if len(self._known) >= _KEPT:
                self._known.clear()
            self._known[key] = closure_conditioning(self._plant.loop, q, self._rank) - _DEPENDENT
        return self._known[key]
