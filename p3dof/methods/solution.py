"""What a way to the forces finds over samples: forces, joints, evidence.

Motions through the actuation singularity: where they cross it between samples, and what that spoils.

At the singularity the forces grow beyond all bounds. Samples on either side of it have finite ones, which
tell nothing about what the motion takes: they and all samples near by are invalid. Every method finds its own
angles from the singularity, so that each decides this by itself.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, Readable
from p3dof._base.errors import SingularityError
from p3dof._base.samples import OnInvalid, unit_hint
from p3dof.machine.motion import Motion


class Later(Readable):
    """A dataclass, some fields of which are found when they are first asked for; see `later`."""

    if not TYPE_CHECKING:  # which would know no wrong name then

        def __getattr__(self, name: str) -> Any:
            find = vars(self).get("_find")
            if find is None or name not in type(self).__dataclass_fields__:
                return super().__getattr__(name)
            vars(self).update(find(name))
            return vars(self)[name]

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *type(self).__dataclass_fields__})  # type: ignore[attr-defined]


_LaterT = TypeVar("_LaterT", bound=Later)


def later(kind: type[_LaterT], find: Callable[[str], Mapping[str, Any]], **known: Any) -> _LaterT:
    """Return an object with fields that are known; `find` returns others, at least the one asked for."""
    made = kind.__new__(kind)
    vars(made).update(known, _find=find)
    return made


@dataclass(frozen=True, eq=False)
class JointStates(Readable):
    """Every joint of the mechanism over a motion, in the order of the URDF's joints in Pinocchio.

    Parameters
    ----------
    names : tuple of str
        Joint names.
    q, v, a : ndarray, shape (N, 10)
        Positions [m or rad], velocities and accelerations.
    """

    names: tuple[str, ...]
    q: FloatArray
    v: FloatArray
    a: FloatArray

    @classmethod
    def from_mappings(
        cls,
        names: tuple[str, ...],
        q: Mapping[str, FloatArray],
        v: Mapping[str, FloatArray],
        a: Mapping[str, FloatArray],
    ) -> JointStates:
        """Stack values by joint name.

        Parameters
        ----------
        names : tuple of str
            The order of the columns.
        q, v, a : mapping of str to ndarray, shape (N,)
            Values of every joint.
        """
        return cls(names, *(np.stack([values[name] for name in names], axis=-1) for values in (q, v, a)))

    def columns(self, names: tuple[str, ...]) -> JointStates:
        """Return the states of some joints only, in the given order."""
        index = [self.names.index(name) for name in names]
        return JointStates(names, self.q[..., index], self.v[..., index], self.a[..., index])


@dataclass(frozen=True, eq=False)
class Solution(Later):
    """What a method finds over samples, rows of NaN where a sample was invalid."""

    forces: FloatArray  # (N, 3): actuator forces [N]
    joints: JointStates  # all joints
    closure_error: FloatArray  # (N,): largest gap of the loops [m]
    energy_rate: FloatArray  # (N,): rate of change of kinetic and potential energy, summed body by body [W]
    dissipation: FloatArray  # (N,): power lost in friction [W]
    actuation: FloatArray  # (N,): angle from the actuation singularity [rad]
    speeds: FloatArray | None = field(default_factory=lambda: None)
    """(N, 3): velocities of the sliders [m/s], where a method has them before all joints."""


@dataclass(frozen=True, eq=False)
class CoulombLimits(Readable):
    """Coulomb friction of joints at N samples, besides what `Friction` says of the machine."""

    limits: Mapping[str, FloatArray]
    """(N, axes): largest force [N] or moment [N m] against each axis of a joint, by the names of
    `Friction`: one axis, or two of a universal joint (x0, then y0)."""
    smoothing: float  # the rate at which tanh(rate / smoothing) turns its sign [m/s, rad/s]
    screws: FloatArray | None = None
    """(N, 3): what of those of the slides screws lose, between motor and nut [N]."""


NEAR = 0.1
"""Angle from a singularity that a motion crosses within which its samples are invalid [rad].

There the forces are more than about ten times what the same motion takes elsewhere, and depend on where the
samples happen to lie.
"""


def crossings_of(actuation: FloatArray) -> tuple[NDArray[np.int_], NDArray[np.bool_]]:
    """Return where a motion crosses the actuation singularity, and which samples that spoils."""
    known = np.flatnonzero(np.isfinite(actuation))
    other_side = actuation[known[:-1]] * actuation[known[1:]] < 0
    after, before = known[:-1][other_side], known[1:][other_side]
    near = np.abs(actuation) < NEAR
    near[after] = near[before] = True
    begins = near & ~np.concatenate([[False], near[:-1]])
    stretch = np.cumsum(begins)  # which stretch of near samples each belongs to
    invalid = ~np.isfinite(np.pad(actuation, 1))  # nothing is amiss before the first and after the last
    reason = near & (invalid[:-2] | invalid[2:])
    reason[after] = reason[before] = True
    return after, near & np.isin(stretch, stretch[reason])


def crossing_told(time: float) -> str:
    """Return the words for a crossing after the sample at a time [s]."""
    return f"after t = {time:g} s the motion crosses an actuation singularity: no force can do that"


def without_crossings(
    motion: Motion, solution: Solution, on_invalid: OnInvalid
) -> tuple[Solution, FloatArray]:
    """Return a solution whose samples near a crossing are NaN, or raise for a crossing."""
    angles = solution.actuation
    if angles.min() > 0 or angles.max() < 0:  # all on one side, none invalid
        return solution, np.zeros(0)
    (after, spoilt), time = crossings_of(angles), motion.time
    if len(after) and on_invalid == "raise":
        told = f"{crossing_told(time[after[0]])} (sample {after[0]}, the first of {len(after)} such)"
        told += unit_hint(motion.pose)
        raise SingularityError(told, (int(after[0]),), len(after))
    if not spoilt.any():
        return solution, np.asarray(time[after])
    names = ("forces", "closure_error", "energy_rate", "dissipation")
    cut = {name: _cut(getattr(solution, name), spoilt) for name in names}
    joints = solution.joints
    states = JointStates(joints.names, *(_cut(each, spoilt) for each in (joints.q, joints.v, joints.a)))
    return replace(solution, joints=states, speeds=None, **cut), np.asarray(time[after])


def _cut(values: FloatArray, spoilt: NDArray[np.bool_]) -> FloatArray:
    """Return values over samples, (N,) or (N, k), with NaN where they are spoilt."""
    return np.where(spoilt if values.ndim == 1 else spoilt[:, None], np.nan, values)
