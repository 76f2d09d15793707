"""`AxisLimits`: limits of each actuator, and what a path demands of it."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, Readable, frozen_array
from p3dof._base.errors import TaskError

_ENDLESS = ("power", "jerk", "nut_force")  # limits that there may be none of
_FROM_ZERO = ("reflected_mass", "efficiency_back", "drag")
_LEAST = 1e-9


@dataclass(frozen=True, eq=False)
class AxisLimits(Readable):
    """Limits of each of the three actuators.

    Parameters
    ----------
    force : array-like, shape () or (3,)
        Largest force of A, B, C [N], that on armature and `reflected_mass` included: the torque of the motor
        by the ratio of its drive, without losses in it.
    speed : array-like, shape () or (3,)
        Largest speed of the sliders [m/s].
    power : array-like, shape () or (3,)
        Largest power that each gives, force by speed [W]; infinite by default.
    reflected_mass : array-like, shape () or (3,)
        What the turning parts of the drives add to each slider's mass [kg], see `p3dof.design.drives.Drive`,
        besides the armature of the machine.
    jerk : array-like, shape () or (3,)
        Largest jerk of the sliders [m/s³]; infinite by default: then their acceleration may jump.
    nut_force : array-like, shape () or (3,)
        Largest force that the nuts pass on to the sliders [N]: without that on `reflected_mass`, armature and
        counterweights, and with what counterbalances bear; infinite by default.
    curve : array-like, shape (N, 2) or (3, N, 2), optional
        Largest force by slider speed, as a motor's torque by its speed: rows of speed and force [m/s, N], by
        rising speed from 0, straight between them, of a force that does not rise; the last one holds beyond.
        `force` and `speed` hold, too.
    efficiency : array-like, shape () or (3,)
        Share of each motor's work that its drive passes on to the nut; 1 by default. Force and power are then
        those of the motor, losses included.
    efficiency_back : array-like, shape () or (3,), optional
        Share of the nut's work that comes back to the motor; 2 - 1/η without it, but not below zero.
    drag : array-like, shape () or (3,)
        What the drag of each drive takes of its motor, as a force at the slider [N]: it counts in the power;
        `force` and `curve` are less it already.

    Raises
    ------
    TaskError
        If a number does not fit.
    """

    force: FloatArray
    speed: FloatArray
    power: FloatArray
    reflected_mass: FloatArray
    jerk: FloatArray
    nut_force: FloatArray
    curve: FloatArray | None
    efficiency: FloatArray
    efficiency_back: FloatArray
    drag: FloatArray

    def __init__(
        self,
        force: ArrayLike,
        speed: ArrayLike,
        power: ArrayLike = np.inf,
        reflected_mass: ArrayLike = 0.0,
        jerk: ArrayLike = np.inf,
        nut_force: ArrayLike = np.inf,
        curve: ArrayLike | None = None,
        efficiency: ArrayLike = 1.0,
        efficiency_back: ArrayLike | None = None,
        drag: ArrayLike = 0.0,
    ) -> None:
        given = (force, speed, power, reflected_mass, jerk, nut_force)
        for field, value in zip(fields(self), given, strict=False):
            object.__setattr__(self, field.name, _three(field.name, value))
        object.__setattr__(self, "curve", None if curve is None else _curve(curve))
        forth = _three("efficiency", efficiency)
        back = np.maximum(2 - 1 / forth, 0.0) if efficiency_back is None else efficiency_back
        object.__setattr__(self, "efficiency", forth)
        object.__setattr__(self, "efficiency_back", _three("efficiency_back", back))
        object.__setattr__(self, "drag", _three("drag", drag))

    @property
    def straight(self) -> bool:
        """Whether no limit is one of power or of a force that falls with the speed: these are not linear."""
        return self.curve is None and not np.isfinite(self.power).any()

    def force_at(self, speed: FloatArray) -> FloatArray:
        """Return the largest force at slider speeds (..., 3), in (..., 3) or (3,) [N]."""
        if self.curve is None:
            return self.force
        found = [np.interp(np.abs(speed[..., k]), *rows.T) for k, rows in enumerate(self.curve)]
        return np.asarray(np.minimum(np.stack(found, axis=-1), self.force))


def _three(name: str, value: ArrayLike) -> FloatArray:
    """Return a limit of A, B and C."""
    endless: NDArray[np.bool_] = np.zeros(3, dtype=bool)
    if name in _ENDLESS:
        try:
            given = np.asarray(value, dtype=float)
        except (TypeError, ValueError):  # told below
            given = np.zeros(0)
        if given.shape in ((), (3,)):
            endless = np.isposinf(given)
            value = np.where(endless, 1.0, given)
    numbers = np.broadcast_to(frozen_array(name, value, (3,) if np.ndim(value) else (), TaskError), 3).copy()
    least = "zero or more" if name in _FROM_ZERO else "above zero"
    if (numbers < 0).any() or (name not in _FROM_ZERO and (numbers == 0).any()):
        raise TaskError(f"{name}: expected {least}, got {numbers.min():g}")
    if name.startswith("efficiency") and (numbers > 1).any():
        raise TaskError(f"{name}: expected at most 1, got {numbers.max():g}")
    numbers[np.broadcast_to(endless, 3)] = np.inf
    numbers.setflags(write=False)
    return numbers


def _curve(value: ArrayLike) -> FloatArray:
    """Return the rows of speed and force of A, B and C, (3, N, 2), or raise TaskError."""
    shape = (3, "N", 2) if np.ndim(value) == 3 else ("N", 2)
    rows = frozen_array("curve", value, shape, TaskError)
    if rows.shape[-2] < 2 or rows[..., 0, 0].any() or (np.diff(rows[..., 0]) <= 0).any():
        raise TaskError("curve: expected rows of speed and force by rising speed from 0, two at least")
    if (rows[..., 1] < 0).any() or (rows[..., 0, 1] == 0).any() or (np.diff(rows[..., 1]) > 0).any():
        raise TaskError("curve: expected forces above zero at standstill, which do not rise with the speed")
    return frozen_array("curve", np.broadcast_to(rows, (3, *rows.shape[-2:])), (3, "N", 2), TaskError)


class Demand(NamedTuple):
    """What a way takes of the actuators at points on it: f = mass s̈ + bias ṡ² + rest, without friction."""

    mass: FloatArray  # (P, 3): by s̈, by ṡ², and at rest
    bias: FloatArray
    rest: FloatArray
    rate: FloatArray  # (P, 3): the first three derivatives of the sliders by s
    change: FloatArray
    third: FloatArray
    own: FloatArray
    """(3,): what the drives and counterweights add to the mass of each slider, in `mass` and `bias` too
    [kg]."""
    balance: FloatArray  # (P, 3): what balances push the sliders up with, less in `rest` [N]
    turning: FloatArray | float = 0.0  # (3,): of `own`, what turns with the motors: drives and armature [kg]
    turns: NDArray[np.bool_] | bool = False  # (P, 3): whether a slider may turn round near a point


class Way(Protocol):
    """What a path takes of the actuators."""

    @property
    def lossy(self) -> bool:
        """Whether there is friction."""

    def demand(self, place: FloatArray, middle: FloatArray) -> Demand:
        """Return what is needed at parameters (P,); each is in a step whose middle is given too, (P,)."""

    def friction(self, place: FloatArray, speed: FloatArray) -> FloatArray:
        """Return what friction adds to the forces, (P, 3) [N], at parameters and speeds ṡ (P,)."""


class Used(NamedTuple):
    """One limit of one actuator at points of a way."""

    quantity: str  # what is limited
    value: FloatArray  # (P, 3): of A, B, C
    limit: FloatArray  # (3,) or (P, 3): the largest that is allowed; infinite for none

    @property
    def share(self) -> FloatArray:
        """Value by limit, (P, 3); where a curve leaves no force at all, by a billionth of its largest."""
        if self.limit.ndim == 1:
            return self.value / self.limit
        return np.asarray(self.value / np.maximum(self.limit, _LEAST * self.limit.max(axis=0)))


def used_of(
    demand: Demand, state: tuple[FloatArray, FloatArray, FloatArray], friction: FloatArray, limits: AxisLimits
) -> list[Used]:
    """Return what points of a way use of every limit."""
    square, change, rise = (part[:, None] for part in state)
    pace = np.sqrt(square)
    force = demand.mass * change + demand.bias * square + demand.rest + friction
    speed = demand.rate * pace
    acceleration = demand.rate * change + demand.change * square
    nut = force - demand.own * acceleration + demand.balance
    passed = force - demand.turning * acceleration
    forth, back = (force + (share - 1) * passed for share in (1 / limits.efficiency, limits.efficiency_back))
    either = np.where(np.abs(forth) > np.abs(back), forth, back)
    lossy = np.where(demand.turns, either, np.where(passed * speed > 0, forth, back))
    force = np.where(speed == 0, force, lossy)
    jerk = (demand.third * square + 3 * demand.change * change + demand.rate * rise) * pace
    every = [
        Used("force", np.abs(force), limits.force_at(speed)),
        Used("speed", np.abs(speed), limits.speed),
        Used("power", force * speed + limits.drag * np.abs(speed), limits.power),
        Used("jerk", np.abs(jerk), limits.jerk),
        Used("nut force", np.abs(nut), limits.nut_force),
    ]
    return [used for used in every if np.isfinite(used.limit).any()]
