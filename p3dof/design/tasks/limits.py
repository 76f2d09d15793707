"""`AxisLimits`: limits of each actuator, and what a path demands of it."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, Readable, frozen_array
from p3dof._base.errors import TaskError

_ENDLESS = ("power", "jerk", "nut_force")  # limits that there may be none of


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

    def __init__(
        self,
        force: ArrayLike,
        speed: ArrayLike,
        power: ArrayLike = np.inf,
        reflected_mass: ArrayLike = 0.0,
        jerk: ArrayLike = np.inf,
        nut_force: ArrayLike = np.inf,
    ) -> None:
        given = (force, speed, power, reflected_mass, jerk, nut_force)
        for field, value in zip(fields(self), given, strict=True):
            object.__setattr__(self, field.name, _three(field.name, value))


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
    least = "zero or more" if name == "reflected_mass" else "above zero"
    if (numbers < 0).any() or (name != "reflected_mass" and (numbers == 0).any()):
        raise TaskError(f"{name}: expected {least}, got {numbers.min():g}")
    numbers[np.broadcast_to(endless, 3)] = np.inf
    numbers.setflags(write=False)
    return numbers


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
    limit: FloatArray  # (3,): the largest that is allowed; infinite for none


def used_of(
    demand: Demand, state: tuple[FloatArray, FloatArray, FloatArray], friction: FloatArray, limits: AxisLimits
) -> list[Used]:
    """Return what points of a way use of every limit."""
    square, change, rise = (part[:, None] for part in state)
    pace = np.sqrt(square)
    force = demand.mass * change + demand.bias * square + demand.rest + friction
    speed = demand.rate * pace
    acceleration = demand.rate * change + demand.change * square
    jerk = (demand.third * square + 3 * demand.change * change + demand.rate * rise) * pace
    every = [
        Used("force", np.abs(force), limits.force),
        Used("speed", np.abs(speed), limits.speed),
        Used("power", force * speed, limits.power),
        Used("jerk", np.abs(jerk), limits.jerk),
        Used("nut force", np.abs(force - demand.own * acceleration + demand.balance), limits.nut_force),
    ]
    return [used for used in every if np.isfinite(used.limit).any()]
