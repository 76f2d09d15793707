"""What an assembly is driven to: values of the actuated joints, or components of a frame's placement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, frozen_array
from p3dof._base.errors import InputError
from p3dof.loops.closures import LoopKinematics

_ALL = (True,) * 6


@dataclass(frozen=True, eq=False)
class FrameTarget:
    """Chosen components of the placement of a frame.

    Parameters
    ----------
    frame : str
        Name of the frame.
    placement : pin.SE3
        Where the frame shall be, in the world; only the components in `mask` count.
    mask : (6,) array of bool
        Which components are prescribed: x, y, z, rx, ry, rz in world axes at the frame's origin. A mechanism
        with three degrees of freedom can be given three.

    Notes
    -----
    The error of position is p - p_target [m], that of rotation log3(R R_targetᵀ) [rad]. Velocity and
    acceleration of the target are the same components of the frame's ``LOCAL_WORLD_ALIGNED`` velocity and
    classical acceleration. If the mechanism turns the frame about axes that are not prescribed, away from
    `placement`, then the prescribed components of log3 and the time integral of the same components of the
    angular velocity are different things; where the frame's other rotations agree with `placement`, or all
    three are prescribed, they are the same.

    Raises
    ------
    InputError
        If the placement is not a finite `pin.SE3` or the mask is not six bools with at least one true.
    """

    frame: str
    placement: pin.SE3
    mask: Sequence[bool] | NDArray[np.bool_] = _ALL

    def __post_init__(self) -> None:
        if not isinstance(self.frame, str):
            raise InputError(f"frame: expected the name of a frame, got {self.frame!r}")
        if not isinstance(self.placement, pin.SE3):
            raise InputError(f"placement: expected a pinocchio.SE3, got {type(self.placement).__name__}")
        matrix = frozen_array("placement", self.placement.homogeneous, (4, 4))
        R = matrix[:3, :3]
        if np.abs(R.T @ R - np.eye(3)).max() > 1e-9 or np.linalg.det(R) < 0:
            raise InputError("placement: its rotation matrix is not a rotation")
        mask = np.array(self.mask)
        if mask.dtype != np.bool_ or mask.shape != (6,):
            raise InputError(f"mask: expected six bools, got {self.mask!r}")
        if not mask.any():
            raise InputError("mask: expected at least one prescribed component")
        mask.setflags(write=False)
        object.__setattr__(self, "mask", mask)
        object.__setattr__(self, "placement", pin.SE3(self.placement))


class Residual(Protocol):
    """What an assembly brings to zero besides its closures."""

    size: int

    def evaluate(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the error (size,) and its Jacobian (size, nv) at a configuration."""


class Target(Residual, Protocol):
    """A target that is bound to a model: its error and how velocities change it."""

    def jacobian(self, q: FloatArray) -> FloatArray:
        """Return the matrix (size, nv) from v to the target's velocity."""

    def drift(self) -> FloatArray:
        """Return the target's acceleration (size,) in the motion last given to `LoopKinematics.move`."""


class JointTarget:
    """Values of the actuated joints [m or rad]; a continuous joint is given an angle.

    Parameters
    ----------
    kinematics : LoopKinematics
        The model.
    joints : sequence of int
        Ids of the actuated joints.
    values : (n,) array
        Their values.
    """

    def __init__(self, kinematics: LoopKinematics, joints: Sequence[int], values: ArrayLike) -> None:
        model = kinematics.model
        self.size = len(joints)
        self.values = frozen_array("target", values, (self.size,))
        self._q = np.array([model.idx_qs[j] for j in joints], dtype=int)
        self._circles = np.array([model.nqs[j] == 2 for j in joints], dtype=bool)
        self._J = np.eye(model.nv)[[model.idx_vs[j] for j in joints]]

    def evaluate(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the error (size,), for a continuous joint the shorter way round, and its Jacobian."""
        error = q[self._q] - self.values
        if self._circles.any():
            cosine, sine = self._q[self._circles], self._q[self._circles] + 1
            goal = self.values[self._circles]
            c, s = np.cos(goal), np.sin(goal)
            error[self._circles] = np.arctan2(q[sine] * c - q[cosine] * s, q[cosine] * c + q[sine] * s)
        return error, self._J

    def jacobian(self, _q: FloatArray) -> FloatArray:
        """Return the matrix (size, nv) that picks the actuated joints."""
        return self._J

    def drift(self) -> FloatArray:
        """Return zeros (size,): a joint's acceleration is its entry of a."""
        return np.zeros(self.size)


class BoundFrameTarget:
    """A `FrameTarget` in a model.

    Parameters
    ----------
    kinematics : LoopKinematics
        The model.
    target : FrameTarget
        The target.

    Raises
    ------
    InputError
        If the frame does not exist.
    """

    def __init__(self, kinematics: LoopKinematics, target: FrameTarget) -> None:
        frame = kinematics.frame(target.frame, "target", InputError)
        self._kinematics = kinematics
        self._joint, self._placement = frame.parentJoint, frame.placement
        self._position, self._rotation = target.placement.translation, target.placement.rotation
        self._mask = np.asarray(target.mask)
        self._turns = bool(self._mask[3:].any())
        self.size = int(self._mask.sum())

    def evaluate(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the error (size,) and its exact Jacobian, also at large rotations."""
        J = self._full_jacobian(q)
        M = self._kinematics.data.oMi[self._joint] * self._placement
        error = np.zeros(6)
        error[:3] = M.translation - self._position
        if self._turns:
            E = M.rotation @ self._rotation.T
            error[3:] = pin.log3(E)
            # d log3(exp(ω dt) E)/dt = Jlog3(E) Eᵀ ω = Jlog3(E)ᵀ ω
            J[3:] = pin.Jlog3(E).T @ J[3:]
        J = J[self._mask]
        return error[self._mask], J

    def jacobian(self, q: FloatArray) -> FloatArray:
        """Return the prescribed rows (size, nv) of the frame's Jacobian."""
        rows: FloatArray = self._full_jacobian(q)[self._mask]
        return rows

    def drift(self) -> FloatArray:
        """Return the prescribed components (size,) of the frame's classical acceleration."""
        k = self._kinematics
        arguments = (k.model, k.data, self._joint, self._placement, pin.LOCAL_WORLD_ALIGNED)
        return np.asarray(pin.getFrameClassicalAcceleration(*arguments).vector[self._mask])

    def _full_jacobian(self, q: FloatArray) -> FloatArray:
        k = self._kinematics
        k.at(q)
        arguments = (k.model, k.data, self._joint, self._placement, pin.LOCAL_WORLD_ALIGNED)
        return np.array(pin.getFrameJacobian(*arguments))


class CombinedTarget:
    """Several targets at once, their components one after the other.

    Parameters
    ----------
    parts : sequence of Target
        The targets.
    """

    def __init__(self, parts: Sequence[Target]) -> None:
        self._parts = tuple(parts)
        self.size = sum(part.size for part in self._parts)

    def evaluate(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return all errors (size,) and their Jacobian (size, nv)."""
        errors, matrices = zip(*(part.evaluate(q) for part in self._parts), strict=True)
        return np.concatenate(errors), np.concatenate(matrices)

    def jacobian(self, q: FloatArray) -> FloatArray:
        """Return the matrix (size, nv) from v to the velocities of all."""
        return np.concatenate([part.jacobian(q) for part in self._parts])

    def drift(self) -> FloatArray:
        """Return the accelerations (size,) of all."""
        return np.concatenate([part.drift() for part in self._parts])


class ChartTarget:
    """Where a configuration is, seen along the free motions of another one.

    Parameters
    ----------
    model : pin.Model
        The tree.
    home : (nq,) array
        The other one.
    free : (nv, n) array
        Its free motions.
    q : (nq,) array
        The configuration; its difference from `home` along them is prescribed.
    """

    def __init__(self, model: pin.Model, home: FloatArray, free: FloatArray, q: FloatArray) -> None:
        self._model, self._home, self._free = model, home, free
        self.size = free.shape[1]
        self._values = free.T @ pin.difference(model, home, q)

    def evaluate(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the error (size,) and its Jacobian (size, nv)."""
        error = self._free.T @ pin.difference(self._model, self._home, q) - self._values
        return error, np.asarray(self._free.T @ pin.dDifference(self._model, self._home, q, pin.ARG1))


class NoTarget:
    """No target: only the loops are closed.

    Parameters
    ----------
    nv : int
        Degrees of freedom of the tree.
    """

    size = 0

    def __init__(self, nv: int) -> None:
        self._J = np.zeros((0, nv))

    def evaluate(self, _q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return an empty error and an empty Jacobian."""
        return np.zeros(0), self._J

    def jacobian(self, _q: FloatArray) -> FloatArray:
        """Return an empty matrix (0, nv)."""
        return self._J

    def drift(self) -> FloatArray:
        """Return an empty array."""
        return np.zeros(0)
