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

Joints whose axes turn within the body that they carry, as chains of joints whose axes do not.

Pinocchio has no derivatives of the dynamics of such joints: universal joints, balls by three angles,
composites. The chain has the same configurations and velocities, in the same order.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.errors import ModelError
from p3dof._base.threads import Workspace
from p3dof.loops.coordinates import cross, skew
from p3dof.loops.trees import NewJoint, with_joints

_UNKNOWN = ("Ellipsoid", "Mimic")  # kinds of joint that are no chain of simple ones


def simple_tree(model: pin.Model) -> tuple[pin.Model, NDArray[np.int_]]:
    """Return a tree of joints with fixed axes that moves alike."""
    names = [str(name) for name in model.names]
    chains = {names[i]: _chain(names[i], model.joints[i]) for i in range(1, model.njoints)}
    replaced = {name: chain for name, chain in chains.items() if chain}
    if not replaced:
        return model, np.arange(model.njoints)
    tree = with_joints(model, replaced)
    last = {name: chain[-1].name if chain else name for name, chain in chains.items()}
    return tree, np.array([0, *(tree.getJointId(last[name]) for name in names[1:])], dtype=int)


def _chain(name: str, joint: Any) -> list[NewJoint]:
    """Return the joints that take the place of one; none if it is simple."""
    parts = _parts(name, joint, pin.SE3.Identity())
    if len(parts) == 1 and parts[0][0] is joint:
        return []
    return [NewJoint(f"{name}[{k}] of {len(parts)}", *part) for k, part in enumerate(parts)]


def _parts(name: str, joint: Any, placement: pin.SE3) -> Sequence[tuple[Any, pin.SE3]]:
    """Return simple joints, each with its placement behind the one before."""
    kind, here = joint.shortname().removeprefix("JointModel"), pin.SE3.Identity()
    content = joint.extract() if isinstance(joint, pin.JointModel) else joint
    if kind.startswith("Universal"):
        first, second = (pin.JointModelRevoluteUnaligned(axis) for axis in (content.axis1, content.axis2))
        return [(first, placement), (second, here)]
    if kind.startswith("SphericalZYX"):
        return [(pin.JointModelRZ(), placement), (pin.JointModelRY(), here), (pin.JointModelRX(), here)]
    if kind.startswith("Composite"):
        each = zip(list(content.joints), list(content.jointPlacements), strict=True)
        parts = [part for one, where in each for part in _parts(name, one, where)]
        return [(parts[0][0], placement * parts[0][1]), *parts[1:]]
    if kind.startswith(_UNKNOWN):
        raise ModelError(f"the joint {name!r} ({kind}) has no derivatives: expected simple joints")
    return [(joint, placement)]


class TangentTree(Workspace):
    """Which joints carry which."""

    def __init__(self, model: pin.Model) -> None:
        self._given = model
        self.model, self.bodies = simple_tree(model)
        """Of joints with fixed axes only; and which of its joints carries what one of the given tree does."""
        model = self.model
        self.data = model.createData()
        self.joint_of = np.array([i for i in range(model.njoints) for _ in range(model.nvs[i])], dtype=int)
        """Joint of each entry of v."""
        self.parent_of = np.array(model.parents, dtype=int)[self.joint_of]  # the joint before that
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
    """The motion of all bodies, and how it changes."""

    def __init__(self, tree: TangentTree, q: FloatArray, v: FloatArray, a: FloatArray) -> None:
        self.tree, data = tree, tree.data
        self.J = np.array(pin.computeJointJacobians(tree.model, data, q)).T  # (nv, 6)
        self.M = [data.oMi[i].copy() for i in range(tree.model.njoints)]  # placements of the bodies
        moved = tree.carries.T.astype(float)
        self.V: FloatArray = moved @ (self.J * v[:, None])  # velocities of the bodies (njoints, 6)
        self._across = across(self.J)
        self.J_dot = motion_cross(self.V[tree.joint_of], self.J)  # d/dt of the joints' columns (nv, 6)
        self.A: FloatArray = moved @ (self.J * a[:, None] + self.J_dot * v[:, None])
        """Accelerations of the bodies (njoints, 6)."""

    def turned(self, motions: FloatArray) -> FloatArray:
        """Return J × (motion - that of the parent) (nv, 6, n) by entry of v, for motions (njoints, 6)."""
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
        """Return the derivative of Σ share_k J_k·F by q_j (k, j); wrenches constant at the world origin."""
        turned = F @ self._across  # (J_j × J_k)·F = J_k·turned_j
        parts = self.J @ turned.reshape(-1, 6).T
        parts = parts.reshape(len(self.J), len(self.J), len(F)) * shares.T[:, None]
        return np.asarray(parts.sum(axis=-1) * self.tree.before.T)

    def wrench_by_q(self, body: int, point: FloatArray, wrench: FloatArray) -> FloatArray:
        """Return the derivative (nv, nv) by q of the generalised force of a wrench on a body."""
        columns, force = self.columns(body), wrench[:3]
        F = np.concatenate((force, wrench[3:] + cross(point, force)))
        moved = columns[:, :3] + cross(columns[:, 3:], point)
        by_place = columns[:, 3:] @ cross(moved, force).T
        shares = self.tree.carries[:, body].astype(float)[None]
        return np.asarray(self.forces_by_q(F[None], shares) + by_place)

    def frame(self, frame: pin.Frame) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return Jacobian and classical acceleration of a frame, in world axes, and the rate of it."""
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


_HAT = _hats()  # the matrices of unit motions, (6, 16)
