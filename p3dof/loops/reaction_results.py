"""The reactions at one state of motion, and what their algebra needs of it; (1), (2): see `reactions`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray

BoolArray: TypeAlias = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class JointReactions:
    """The wrench that every joint and closure transmits at one state of motion.

    Tree joints come first, in Pinocchio's order, then the closures in the sidecar's. A reaction is what the
    predecessor exerts on the successor: at a joint of the tree the parent's side on the child's, at the
    joint's origin and in the joint's axes, those of the child's link; at a closure the body of `frame1` on
    the body of `frame2`, at the origin and in the axes of `frame1` (as the multipliers of `InverseDynamics`).
    It is the total: along the freedoms of a joint lie the forces of its actuator, of couplings and of
    `joint_forces`, less what its rotor (`model.armature`) takes.

    Parameters
    ----------
    names : tuple of str
        Names of the joints, then of the closures (``frame1/frame2``).
    forces, moments : (n, 3) array
        The reactions [N, N m]; of undetermined ones those that make (2) smallest.
    determined_forces, determined_moments : (n, 3) array of bool
        Which components every solution has in common.
    rotations : (n, 3, 3) array
        The axes of each reaction, as columns, in the world frame.
    positions : (n, 3) array
        Where each reaction acts, in the world frame [m].
    undetermined : int
        How many independent changes of the closures' wrenches leave the motion as it is.
    residual : float
        Largest error of (1) [N or N m].
    fit : (2, n, 2, 3) array
        What misfits of assembly may add to forces and moments, at worst and at random [N, N m]; zero unless
        the solver knows any.
    """

    names: tuple[str, ...]
    forces: FloatArray
    moments: FloatArray
    determined_forces: BoolArray
    determined_moments: BoolArray
    rotations: FloatArray
    positions: FloatArray
    undetermined: int
    residual: float
    fit: FloatArray


@dataclass(frozen=True, eq=False)
class State:
    """What the algebra needs of one state of motion; see `p3dof.loops.reaction_algebra.Loads`."""

    missing: FloatArray
    tree: FloatArray
    J: FloatArray
    placements: FloatArray
    coupled: FloatArray
    rank: int
    tolerance: float
    scale: float
    own: FloatArray

    def __iter__(self) -> Iterator[FloatArray | float]:
        return (getattr(self, name) for name in self.__dataclass_fields__)
