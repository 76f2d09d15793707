"""Equations of motion of a closed mechanism in independent coordinates y, and Jacobians from their speeds.

With v = N ẏ, where J N = 0, the equation of motion (1) of `p3dof.loops.inverse` becomes

    Nᵀ M N ÿ + Nᵀ (C N + M Ṅ) ẏ + Nᵀ g = Nᵀ B τ + Nᵀ (passive and external forces),        (1)

with M, C, g of the tree. Ṁ - 2 C of the tree is skew-symmetric, and so it is here.

References
----------
R. Featherstone, Rigid Body Dynamics Algorithms, Springer 2008, section 3.2 (explicit constraints).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar, cast

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof.loops.closure_tangents import ClosureTangents
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.constraints import Coupling
from p3dof.loops.independent import Independent
from p3dof.loops.tree_tangents import Tree, TreeMotion


@dataclass(frozen=True, eq=False)
class MinimalDynamics:
    """Equations of motion in n independent coordinates y, at one state or (leading axis N) at many.

    mass_matrix ÿ + coriolis_matrix ẏ + gravity_forces = actuation τ + passive_forces + external_forces

    Parameters
    ----------
    coordinates : tuple of str
        Names of the coordinates: joints, or single freedoms of joints that have several, such as ``base[2]``,
        whose speeds are those in `v` (those of a floating base are in its own axes).
    speeds : (..., n) array
        ẏ of the velocity.
    motion : (..., nv, n) array
        N: the velocity of the whole tree is N ẏ.
    motion_rate : (..., nv, n) array
        Ṅ: the acceleration of the whole tree is N ÿ + Ṅ ẏ.
    mass_matrix : (..., n, n) array
        Symmetric, positive definite; rotors included.
    coriolis_matrix : (..., n, n) array
        C, with Ṁ - 2 C skew-symmetric.
    gravity_forces : (..., n) array
        Gradient of the potential energy of the bodies [N or N m].
    actuation : (..., n, m) array
        Forces along the coordinates of unit forces of the actuators, Nᵀ B.
    passive_forces : (..., n) array
        Of springs, damping and friction in the joints [N or N m].
    external_forces : (..., n) array
        Of the external wrenches and joint forces [N or N m].
    """

    coordinates: tuple[str, ...]
    speeds: FloatArray
    motion: FloatArray
    motion_rate: FloatArray
    mass_matrix: FloatArray
    coriolis_matrix: FloatArray
    gravity_forces: FloatArray
    actuation: FloatArray
    passive_forces: FloatArray
    external_forces: FloatArray

    @property
    def coriolis_forces(self) -> FloatArray:
        """C ẏ (..., n), Coriolis and centrifugal forces [N or N m]."""
        return np.asarray((self.coriolis_matrix @ self.speeds[..., None])[..., 0])


@dataclass(frozen=True, eq=False)
class FrameJacobian:
    """How a frame moves with independent coordinates, at one state or (leading axis N) at many.

    Parameters
    ----------
    coordinates : tuple of str
        As in `MinimalDynamics`.
    jacobian : (..., 6, n) array
        Velocity of the frame at unit speed of each coordinate: linear, then angular, in world axes at the
        frame's origin (``LOCAL_WORLD_ALIGNED``).
    drift : (..., 6) array
        Classical acceleration of the frame at zero ÿ, likewise; that of a motion is jacobian ÿ + drift.
    """

    coordinates: tuple[str, ...]
    jacobian: FloatArray
    drift: FloatArray


def motion_rate(
    kinematics: LoopKinematics,
    couplings: Sequence[Coupling],
    tree: Tree,
    independent: Independent,
    v: FloatArray,
) -> FloatArray:
    """Return Ṅ (nv, n).

    Parameters
    ----------
    kinematics : LoopKinematics
        The model.
    couplings : sequence of Coupling
        Its couplings.
    tree : Tree
        Its tree.
    independent : Independent
        The coordinates at the configuration.
    v : (nv,) array
        Velocity of the tree.
    """
    q, rest = independent.point.q, np.zeros(len(v))
    closures = ClosureTangents(kinematics, couplings, TreeMotion(tree, q, v, rest), q, v, rest)
    return -independent.closing @ (closures.jacobian_rate() @ independent.N)


ResultT = TypeVar("ResultT")


def stacked(results: Sequence[ResultT], same: Sequence[str] = ()) -> ResultT:
    """Return the results of many states as one, whose arrays have a leading axis.

    Parameters
    ----------
    results : sequence of dataclass
        The results.
    same : sequence of str
        Fields that all have in common, besides `coordinates`.
    """
    first = results[0]
    arrays: dict[str, Any] = {
        field.name: np.stack([getattr(one, field.name) for one in results])
        for field in fields(cast("Any", first))
        if field.name not in ("coordinates", *same)
    }
    return cast("ResultT", replace(cast("Any", first), **arrays))


def frame_motion(
    tree: Tree, independent: Independent, N_dot: FloatArray, v: FloatArray, frame: pin.Frame
) -> tuple[FloatArray, FloatArray]:
    """Return the Jacobian (6, n) of a frame and its drift (6,); parameters as in `motion_rate`."""
    bodies = TreeMotion(tree, independent.point.q, v, N_dot @ v[independent.v])
    J, acceleration, _, _ = bodies.frame(frame)
    return J @ independent.N, acceleration
