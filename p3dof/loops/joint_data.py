"""`JointData`: what acts in a joint by itself: spring, balance, damping, friction; and its rotor."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from p3dof._base.checks import frozen_array, shown
from p3dof._base.errors import ModelError
from p3dof.loops.constraints import checked_name

_SIGNED = ("stiffness", "force", "gear_ratio")
_POSITIVE = ("damping", "friction", "armature", "rotor_inertia")
_SEVERAL = (4, 7)
"""How many values a ball and a free joint have."""


@dataclass(frozen=True)
class JointData:
    """What acts in a joint by itself: force - stiffness (q - rest) - damping v - friction tanh(v / 0.001).

    Parameters
    ----------
    joint : str
        Name of the joint.
    stiffness : float
        Of a spring [N/m or N m/rad], in a joint with one degree of freedom, a ball or a free joint. That of a
        ball turns back about the axis of the turn from `rest`, its torque in proportion to the angle; a free
        joint has such a spring for its turn and one of the same stiffness for its shift, as in MuJoCo. With
        one degree of freedom it may be negative, as of a spring beyond its dead point.
    rest : float or tuple of float
        Value of the joint at which the spring has no force [m or rad]; of a continuous joint an angle, from
        which it turns back by the shorter way. Of a ball or free joint all its values, in Pinocchio's order
        (the quaternion x, y, z, w last); neutral by default.
    damping : float
        Viscous friction, of every freedom of the joint [N s/m or N m s/rad].
    friction : float
        Coulomb friction, likewise [N or N m]. It changes its sign smoothly over 0.001 m/s or rad/s.
    armature : float
        Inertia that a rotor adds at the joint, seen through its gear [kg or kg m²]. It belongs to the tree:
        whoever reads its file enters it there.
    rotor_inertia : float
        Inertia of the motor's rotor itself [kg m²]. It adds its product with the square of the gear ratio to
        the armature, likewise.
    gear_ratio : float
        Turns of the motor per turn of the joint, or radians per metre of a slide; not zero. Forces are those
        at the joint whatever it is: `ClosedLoopModel.motor_side` tells what is before the gear.
    force : float
        Constant force of a balance, along a joint with one degree of freedom and ends [N or N m].

    Raises
    ------
    ModelError
        If the name is empty or not text, a number is not finite, a loss or an inertia is negative, or the
        gear ratio is zero.
    """

    joint: str
    stiffness: float = 0.0
    rest: float | tuple[float, ...] = 0.0
    damping: float = 0.0
    friction: float = 0.0
    armature: float = 0.0
    rotor_inertia: float = 0.0
    gear_ratio: float = 1.0
    force: float = 0.0

    def __post_init__(self) -> None:
        checked_name("joint data: joint", self.joint)
        object.__setattr__(self, "rest", _rest(self.joint, self.rest))
        for name in (*_SIGNED, *_POSITIVE):
            where = f"joint data of {shown(self.joint)}: {name}"
            value = float(frozen_array(where, getattr(self, name), (), ModelError))
            if value < 0 and name in _POSITIVE:
                raise ModelError(f"{where}: expected zero or more, got {value:g}")
            if value == 0 and name == "gear_ratio":
                raise ModelError(f"{where}: expected a number other than zero")
            object.__setattr__(self, name, value)

    def __bool__(self) -> bool:
        given = any(getattr(self, name) for name in (*_POSITIVE, "stiffness", "force"))
        return given or self.gear_ratio != 1.0

    @property
    def reflected_inertia(self) -> float:
        """What the rotor adds at the joint, gear_ratio² rotor_inertia [kg or kg m²]."""
        return self.gear_ratio**2 * self.rotor_inertia


def _rest(joint: str, rest: object) -> float | tuple[float, ...]:
    where = f"joint data of {shown(joint)}: rest"
    if isinstance(rest, list | tuple) or (isinstance(rest, np.ndarray) and rest.ndim):
        numbers = frozen_array(where, rest, ("n",), ModelError)
        if len(numbers) not in _SEVERAL:
            raise ModelError(f"{where}: expected one number, four or seven, got {len(numbers)}")
        return tuple(float(x) for x in numbers)
    return float(frozen_array(where, rest, (), ModelError))


def checked_data(where: str, entries: Iterable[object]) -> tuple[JointData, ...]:
    """Return the entries that say anything.

    Parameters
    ----------
    where : str
        What to call them in an error.
    entries : iterable of JointData
        The entries.

    Returns
    -------
    tuple of JointData

    Raises
    ------
    ModelError
        If one is something else, or a joint is named twice.
    """
    found: dict[str, JointData] = {}
    for entry in entries:
        if not isinstance(entry, JointData):
            raise ModelError(f"{where}: expected JointData objects, got {shown(entry)}")
        if entry.joint in found:
            raise ModelError(f"{where}: the joint {shown(entry.joint)} is named twice")
        found[entry.joint] = entry
    return tuple(entry for entry in found.values() if entry)
