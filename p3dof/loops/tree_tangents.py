"""How the motion of the bodies of a tree changes with configuration and velocity; exact.

All velocities V and accelerations A are spatial: linear, then angular, of the point of the body that is at
the world's origin, in world axes. With the columns J_k of the joints there, a displacement along J_j turns
all that the joint carries, so that for a body behind the joint of j, whose parent has V_p and A_p,

    ∂V/∂q_j = J_j × (V - V_p),    ∂A/∂q_j = J_j × (A - A_p) + (V_p × J_j) × (V - V_p),    (1)
    ∂V/∂v_j = J_j,                ∂A/∂v_j = J_j × (V - V_p) + V_j × J_j.                  (2)

References
----------
J. Carpentier, N. Mansard, Analytical derivatives of rigid body dynamics algorithms, Robotics: Science and
Systems 2018.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.threads import Workspace
from p3dof.loops.rotations import cross, skew
from p3dof.loops.simple_joints import simple_tree


class Tree(Workspace):
    """Which joints carry which.

    Parameters
    ----------
    model : pin.Model
        The tree.

    Raises
    ------
    ModelError
        If a joint is of a kind that is no chain of joints with fixed axes.
    """

    def __init__(self, model: pin.Model) -> None:
        self._given = model
        self.model, self.bodies = simple_tree(model)
        """Of joints with fixed axes only; and which of its joints carries what one of the given tree does."""
        model = self.model
        self.data = model.createData()
        self.joint_of = np.array([i for i in range(model.njoints) for _ in range(model.nvs[i])], dtype=int)
        """Joint of each entry of v."""
        self.parent_of = np.array(model.parents, dtype=int)[self.joint_of]
        """The joint before that."""
        self.carries: NDArray[np.bool_] = np.zeros((model.nv, model.njoints), dtype=bool)
        """Whether an entry of v moves a body, (nv, njoints)."""
        for i in range(1, model.njoints):
            self.carries[:, i] = self.carries[:, model.parents[i]]
            self.carries[model.idx_vs[i] : model.idx_vs[i] + model.nvs[i], i] = True
        self.before: NDArray[np.bool_] = self.carries[:, self.joint_of]
        """Whether j moves the axis of k, (nv, nv); within one joint it does."""

    def refresh(self) -> None:
        """Take over the masses and the gravity that the given tree has now."""
        if self.model is not self._given:
            for i, body in enumerate(self.bodies):
                self.model.inertias[int(body)] = self._given.inertias[i]
            self.model.gravity = self._given.gravity
            self.model.armature = self._given.armature

    def mass_matrix(self, q: FloatArray) -> FloatArray:
        """Return M (nv, nv), rotors included, at a configuration."""
        upper = np.triu(np.array(pin.crba(self.model, self.data, q)))
        return np.asarray(upper + np.triu(upper, 1).T)


class TreeMotion:
    """The motion of all bodies, and how it changes.

    Parameters
    ----------
    tree : Tree
        The tree.
    q : (nq,) array
        Configuration.
    v, a : (nv,) array
        Velocity and acceleration.
    """

    def __init__(self, tree: Tree, q: FloatArray, v: FloatArray, a: FloatArray) -> None:
        self.tree, data = tree, tree.data
        self.J = np.array(pin.computeJointJacobians(tree.model, data, q)).T  # (nv, 6)
        self.M = [data.oMi[i].copy() for i in range(tree.model.njoints)]
        """Placements of the bodies."""
        moved = tree.carries.T.astype(float)
        self.V: FloatArray = moved @ (self.J * v[:, None])
        """Velocities of the bodies (njoints, 6)."""
        self._across = across(self.J)
        self.J_dot = motion_cross(self.V[tree.joint_of], self.J)
        """d/dt of the joints' columns (nv, 6)."""
        self.A: FloatArray = moved @ (self.J * a[:, None] + self.J_dot * v[:, None])
        """Accelerations of the bodies (njoints, 6)."""

    def turned(self, motions: FloatArray) -> FloatArray:
        """Return J × (motion - that of the parent) (nv, 6, n) by entry of v, for motions (njoints, 6).

        Parameters
        ----------
        motions : (njoints, 6) array
            Of all bodies; the n wanted are all.
        """
        parents = motions[self.tree.parent_of]
        return np.asarray(self._across @ motions.T - self._across @ parents[..., None])

    @cached_property
    def _velocities(self) -> FloatArray:
        """∂V/∂q (nv, 6, njoints) of all bodies, had every entry of v carried them."""
        return self.turned(self.V)

    @cached_property
    def _accelerations(self) -> FloatArray:
        """∂A/∂q of all bodies, likewise."""
        parents = self.V[self.tree.parent_of]
        carried = across(motion_cross(parents, self.J))
        return np.asarray(self.turned(self.A) + carried @ self.V.T - carried @ parents[..., None])

    def of(self, values: FloatArray, bodies: NDArray[np.int_]) -> FloatArray:
        """Return values (nv, 6, njoints) of some bodies (c, nv, 6), zero where nothing carries them."""
        found = np.moveaxis(values[..., bodies], -1, 0)
        return np.asarray(found * self.tree.carries[:, bodies].T[..., None])

    def velocities(self, bodies: NDArray[np.int_]) -> FloatArray:
        """Return ∂V/∂q (c, nv, 6) of some bodies; their ∂V/∂v is `columns`."""
        return self.of(self._velocities, bodies)

    def accelerations(self, bodies: NDArray[np.int_]) -> tuple[FloatArray, FloatArray]:
        """Return ∂A/∂q and ∂A/∂v (c, nv, 6) of some bodies."""
        by_v = self._velocities + self.J_dot[..., None]
        return self.of(self._accelerations, bodies), self.of(by_v, bodies)

    def columns(self, body: int) -> FloatArray:
        """Return the Jacobian (nv, 6) of a body, transposed."""
        return self.J * self.tree.carries[:, body, None]

    def forces_by_q(self, F: FloatArray, shares: FloatArray) -> FloatArray:
        """Return the derivative of Σ share_k J_k·F by q_j (k, j), of constant wrenches at the world's origin.

        Parameters
        ----------
        F : (c, 6) array
            The wrenches.
        shares : (c, nv) array
            How much of each acts on each entry of v.
        """
        turned = F @ self._across  # (J_j × J_k)·F = J_k·turned_j
        parts = self.J @ turned.reshape(-1, 6).T
        parts = parts.reshape(len(self.J), len(self.J), len(F)) * shares.T[:, None]
        return np.asarray(parts.sum(axis=-1) * self.tree.before.T)

    def wrench_by_q(self, body: int, point: FloatArray, wrench: FloatArray) -> FloatArray:
        """Return the derivative (nv, nv) by q of the generalised force of a wrench on a body.

        Parameters
        ----------
        body : int
            The joint that carries the body.
        point : (3,) array
            Where it acts, in the world; it moves with the body.
        wrench : (6,) array
            Force and moment, which stay in world axes.
        """
        columns, force = self.columns(body), wrench[:3]
        F = np.concatenate((force, wrench[3:] + cross(point, force)))
        moved = columns[:, :3] + cross(columns[:, 3:], point)
        by_place = columns[:, 3:] @ cross(moved, force).T
        shares = self.tree.carries[:, body].astype(float)[None]
        return np.asarray(self.forces_by_q(F[None], shares) + by_place)

    def frame(self, frame: pin.Frame) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return Jacobian and classical acceleration of a frame, in world axes, and how the latter changes.

        Parameters
        ----------
        frame : pin.Frame
            The frame.

        Returns
        -------
        J : (6, nv) array
        acceleration : (6,) array
        by_q, by_v : (6, nv) array
            Of the acceleration.
        """
        body = int(self.tree.bodies[frame.parentJoint])
        p = self.M[body].act(frame.placement.translation)
        V, A = self.V[body], self.A[body]
        J = shifted(self.columns(body), p)
        p_dot = V[:3] + cross(V[3:], p)
        acceleration = shifted(A, p)
        acceleration[:3] += cross(V[3:], p_dot)
        one = np.array([body])
        V_q, (A_q, A_v) = self.velocities(one)[0], self.accelerations(one)
        by_q, by_v = shifted(A_q[0], p), shifted(A_v[0], p)
        p_dot_q = V_q[:, :3] + cross(V_q[:, 3:], p) + cross(V[3:], J[:, :3])
        by_q[:, :3] += cross(A[3:], J[:, :3]) + cross(V_q[:, 3:], p_dot) + cross(V[3:], p_dot_q)
        by_v[:, :3] += cross(J[:, 3:], p_dot) + cross(V[3:], J[:, :3])
        return J.T, acceleration, by_q.T, by_v.T


def motion_cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a × b (..., 6) of motions: linear, then angular."""
    linear = cross(a[..., 3:], b[..., :3]) + cross(a[..., :3], b[..., 3:])
    return np.concatenate((linear, cross(a[..., 3:], b[..., 3:])), axis=-1)


def shifted(motion: FloatArray, point: FloatArray) -> FloatArray:
    """Return motions (..., 6) of the points that are at a point (3,), from those at the world's origin."""
    result = np.array(motion)
    result[..., :3] += cross(motion[..., 3:], point)
    return result


def across(motion: FloatArray) -> FloatArray:
    """Return the matrices (..., 6, 6) of the cross product with motions (..., 6)."""
    result = np.zeros((*motion.shape[:-1], 6, 6))
    result[..., :3, :3] = result[..., 3:, 3:] = skew(motion[..., 3:])
    result[..., :3, 3:] = skew(motion[..., :3])
    return result


def hat(motion: FloatArray) -> FloatArray:
    """Return the matrices (..., 4, 4) of motions (..., 6)."""
    return np.asarray(motion @ _HAT).reshape(*motion.shape[:-1], 4, 4)


def _hats() -> FloatArray:
    result = np.zeros((6, 4, 4))
    result[:3, :3, 3] = np.eye(3)
    result[3:, :3, :3] = skew(np.eye(3))
    return result.reshape(6, 16)


_HAT = _hats()
"""The matrices of unit motions, (6, 16)."""
