"""`JointData`: what acts in a joint by itself: a spring, damping, friction; and the inertia of its rotor."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from p3dof.checks import frozen_array, shown
from p3dof.closed_loop.constraints import checked_name
from p3dof.errors import ModelError

_POSITIVE = ("stiffness", "damping", "friction", "armature")


@dataclass(frozen=True)
class JointData:
    """What acts in a joint by itself: -stiffness (q - rest) - damping v - friction tanh(v / 0.001).

    Parameters
    ----------
    joint : str
        Name of the joint.
    stiffness : float
        Of a spring [N/m or N m/rad]; only of a joint with one degree of freedom.
    rest : float
        Value of the joint at which the spring has no force [m or rad]; of a continuous joint an angle, from
        which it turns back by the shorter way.
    damping : float
        Viscous friction, of every freedom of the joint [N s/m or N m s/rad].
    friction : float
        Coulomb friction, likewise [N or N m]. It changes its sign smoothly over 0.001 m/s or rad/s.
    armature : float
        Inertia of the rotor behind the gear, the rotor's own times the square of the gear ratio [kg or
        kg m²]. It belongs to the tree: whoever reads its file enters it there.

    Raises
    ------
    ModelError
        If the name is empty or not text, or a number is not finite or, but for `rest`, negative.
    """

    joint: str
    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    armature: float = 0.0

    def __post_init__(self) -> None:
        checked_name("joint data: joint", self.joint)
        for name in (*_POSITIVE, "rest"):
            where = f"joint data of {shown(self.joint)}: {name}"
            value = float(frozen_array(where, getattr(self, name), (), ModelError))
            if value < 0 and name != "rest":
                raise ModelError(f"{where}: expected zero or more, got {value:g}")
            object.__setattr__(self, name, value)

    def __bool__(self) -> bool:
        return any(getattr(self, name) for name in _POSITIVE)


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
