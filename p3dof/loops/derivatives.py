"""Exact derivatives of the dynamics of any robot by independent coordinates, on its constraint manifold.

Each function is given the dynamics whose derivatives it returns, and linearises them in the robot's own unit
of length, see `p3dof.loops.derivatives`.

Equations of motion of a closed mechanism, linearised at one motion in independent coordinates; exact.

With v = N ẏ and the equation of motion (1) of `p3dof.loops.inverse`, a change dy of the coordinates
and dẏ of their speeds changes the tree's motion by

    dq = N dy,    dv = N dẏ - C ∂(J v)/∂q dq,    da = N dÿ - C (∂α/∂q dq + ∂α/∂v dv),        (1)

where α = J a + J̇ v, and C takes what the closures are to do to the motion that does it, coordinates at rest.
The multipliers enter, because closures turn with the bodies:

    Nᵀ B dτ = Nᵀ (∂f/∂q - ∂(Jᵀ λ)/∂q) dq + Nᵀ (∂f/∂v dv + M da)        (2)

with f = rnea(q, v, a) less all forces but those of the actuators. Any λ that satisfies the equation of motion
does, as dNᵀ Jᵀ = -Nᵀ dJᵀ on the manifold.

References
----------
J. Carpentier, N. Mansard, Analytical derivatives of rigid body dynamics algorithms, Robotics: Science and
Systems 2018.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, Readable
from p3dof._base.errors import DynamicsError, InputError, SingularityError
from p3dof.loops.closed_tree import Asked, External
from p3dof.loops.closure_tangents import ClosureTangents
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.hybrid import ByName, joint_freedoms
from p3dof.loops.linear import RANK_TOLERANCE, Decomposition, actuation_of, determined
from p3dof.loops.minimal import Independent, IndexArray, Names, Setting
from p3dof.loops.results import ForwardDynamics, HybridDynamics, InverseDynamics
from p3dof.loops.sidecar import Coupling
from p3dof.loops.tree_tangents import TangentTree, TreeMotion


@dataclass(frozen=True, eq=False)
class Acting:
    """What acts besides the actuators."""

    by_q: FloatArray  # (nv, nv): how the forces in the joints change with small motions of them
    by_v: FloatArray  # (nv, nv): how they change with the speeds
    wrenches: Sequence[tuple[pin.Frame, FloatArray]] = ()
    """(6,): wrenches on frames, in world axes at their origins."""


@dataclass(frozen=True, eq=False)
class ForcedMotion:
    """A motion with the forces that belong to it."""

    v: FloatArray  # (nv,): velocity and acceleration of the tree
    a: FloatArray
    tau: FloatArray  # (n_actuated,): forces of the actuators
    lambda_: FloatArray  # (rows,): multipliers that satisfy the equation of motion


class Linearised:
    """The equations of motion, linearised."""

    def __init__(
        self,
        kinematics: LoopKinematics,
        couplings: Sequence[Coupling],
        tree: TangentTree,
        actuated_v: IndexArray,
        independent: Independent,
        motion: ForcedMotion,
        acting: Acting,
    ) -> None:
        self.N, self._closing = independent.N, independent.closing
        self._svd, self._actuated, q = independent.point.svd, actuated_v, independent.point.q
        v, a, N = motion.v, motion.a, self.N
        self.bodies = TreeMotion(tree, q, v, a)
        self._closures = ClosureTangents(kinematics, couplings, self.bodies, q, v, a)
        self.v_by_q = -self._closing @ (self._closures.velocity_by_q(v) @ N)
        by_q, by_v = self._closures.acceleration
        self.a_by_q = -self._closing @ (by_q @ N + by_v @ self.v_by_q)
        self.a_by_v = -self._closing @ (by_v @ N)
        f_q, f_v, self.M = _tree_derivatives(tree, q, v, a)
        f_q = f_q - self._closures.force_by_q(motion.lambda_) - acting.by_q
        f_v = f_v - acting.by_v
        for frame, wrench in acting.wrenches:
            body = int(tree.bodies[frame.parentJoint])
            at = self.bodies.M[body].act(frame.placement.translation)
            f_q = f_q - self.bodies.wrench_by_q(body, at, wrench)
        self.force = np.concatenate(
            (f_q @ N + f_v @ self.v_by_q + self.M @ self.a_by_q, f_v @ N + self.M @ self.a_by_v), axis=1
        )
        """Change of the left side of the equation of motion with y and ẏ at resting ÿ, (nv, 2 n)."""
        self._motion = motion

    def inverse(self) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of a (nv, 3 n) and of τ (m, 3 n) by y, ẏ and ÿ."""
        N, actuated = self.N, self._actuated
        n, m = N.shape[1], len(actuated)
        if m < n:
            raise DynamicsError(
                f"{m} actuators cannot give any acceleration of {n} coordinates: "
                "hybrid_dynamics_derivatives() lets passive degrees of freedom move freely"
            )
        a = np.concatenate((self.a_by_q, self.a_by_v, N), axis=1)
        force = np.concatenate((self.force, self.M @ N), axis=1)
        actuation = actuation_of(self._svd, actuated)
        if actuation.rank < n:
            raise SingularityError(
                f"the actuators cannot hold the mechanism here: they resist {actuation.rank} of its {n} free "
                f"motions (smallest singular value {actuation.least:.1e})"
            )
        tau: FloatArray = actuation.pseudo_inverse @ (self._svd.null_space.T @ force)
        tau[:, :n] += self._least(actuation)
        return a, tau

    def hybrid(self, S: FloatArray, drift: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of a (nv, 2 n + k) and of τ (m, 2 n + k) by y, ẏ and the prescription."""
        N, n, k, nv = self._svd.null_space, self.N.shape[1], len(S), len(self.M)
        rest = np.concatenate((self.a_by_q, self.a_by_v), axis=1)
        drift_y = np.concatenate(
            (drift[:, :nv] @ self.N + drift[:, nv:] @ self.v_by_q, drift[:, nv:] @ self.N), axis=1
        )
        wanted = np.concatenate((-drift_y - S @ rest, np.eye(k)), axis=1)
        seen = Decomposition.of(S @ N, RANK_TOLERANCE, max(1.0, float(np.abs(S).max(initial=0.0))))
        added: FloatArray = N @ (seen.pseudo_inverse @ wanted)
        a = np.concatenate((rest, np.zeros((nv, k))), axis=1) + added
        force = np.concatenate((self.force, np.zeros((nv, k))), axis=1) + self.M @ added
        Z = N @ seen.null_space
        idle = np.linalg.inv(Z.T @ self.M @ Z)
        P = N @ seen.Vt[: seen.rank].T
        T = P - Z @ (idle @ (Z.T @ (self.M @ P)))
        actuation = Decomposition.of(T[self._actuated].T, RANK_TOLERANCE, float(np.linalg.norm(T)))
        tau = actuation.pseudo_inverse @ (T.T @ force)
        tau[:, :n] += self._least(actuation)
        force[self._actuated] -= tau
        return a - Z @ (idle @ (Z.T @ force)), tau

    def forward(self) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of a (nv, 2 n + m) and of ÿ (n, 2 n + m) by y, ẏ and τ."""
        N, m = self.N, len(self._actuated)
        right = np.concatenate((-(N.T @ self.force), N[self._actuated].T), axis=1)
        try:
            accelerations = np.asarray(np.linalg.solve(N.T @ self.M @ N, right), dtype=float)
        except np.linalg.LinAlgError as error:
            raise DynamicsError("the mechanism has a free motion without inertia") from error
        rest = np.concatenate((self.a_by_q, self.a_by_v, np.zeros((len(N), m))), axis=1)
        return rest + N @ accelerations, accelerations

    def multipliers(self, a: FloatArray, tau: FloatArray) -> FloatArray:
        """Return the derivatives (rows, k) of the multipliers, from those of a (nv, k) and of τ (m, k)."""
        n = self.N.shape[1]
        rest = np.concatenate((self.a_by_q, self.a_by_v), axis=1)
        force = self.M @ a
        force[:, : 2 * n] += self.force - self.M @ rest
        force[self._actuated] -= tau
        return self._svd.solve_transpose(force)

    def _least(self, actuation: Decomposition) -> FloatArray:
        """Return how the smallest forces turn with y (m, n), among those of the same effect.

        With Nᵀ B of m columns and rank r < m, they are Bᵀ N μ, and (1 - P) Bᵀ dN μ is what leaves the range.
        """
        actuated, N = self._actuated, self.N
        if actuation.rank == len(actuated):
            return np.zeros((len(actuated), N.shape[1]))
        mu = np.linalg.lstsq(N[actuated], self._motion.tau, rcond=None)[0]
        turned = -self._closing @ (self._closures.velocity_by_q(N @ mu) @ N)
        free = actuation.null_space
        return np.asarray(free @ (free.T @ turned[actuated]))


def _tree_derivatives(
    tree: TangentTree, q: FloatArray, v: FloatArray, a: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the derivatives (nv, nv) of rnea(q, v, a) by q, v and a."""
    by_q, by_v, _ = pin.computeRNEADerivatives(tree.model, tree.data, q, v, a)
    by_q, by_v = np.array(by_q), np.array(by_v)
    return by_q, by_v, tree.mass_matrix(q)


@dataclass(frozen=True, eq=False)
class ByMotion(Readable):
    """Derivatives by coordinates, their speeds and their accelerations, (size, n) each."""

    by_coordinates: FloatArray
    by_speeds: FloatArray
    by_accelerations: FloatArray


@dataclass(frozen=True, eq=False)
class ByPrescription(Readable):
    """Derivatives by coordinates and speeds, (size, n), and by the prescribed accelerations, (size, k)."""

    by_coordinates: FloatArray
    by_speeds: FloatArray
    by_prescribed: FloatArray


@dataclass(frozen=True, eq=False)
class ByForces(Readable):
    """Derivatives by coordinates and speeds, (size, n), and by the actuators' forces, (size, m)."""

    by_coordinates: FloatArray
    by_speeds: FloatArray
    by_forces: FloatArray


@dataclass(frozen=True, eq=False)
class Kinematics(Readable):
    """How the motion of the tree changes with independent coordinates."""

    coordinates: tuple[str, ...]
    """Names of the coordinates: joints, or single freedoms of joints that have several, such as `base[2]`.
    A displacement of those is one along the velocity, `pinocchio.integrate`."""
    motion: FloatArray
    """(nv, n): N: derivative of the configuration, as a tangent vector, by the coordinates, and of v by
    their speeds."""
    v_by_coordinates: FloatArray
    """(nv, n): derivative of the velocity by the coordinates, their speeds being kept."""


@dataclass(frozen=True, eq=False)
class InverseDynamicsDerivatives(Kinematics):
    """Derivatives of the actuators' forces by the motion, on the constraint manifold; exact.

    Parameters
    ----------
    coordinates, motion, v_by_coordinates
        As in `Kinematics`.
    dynamics : InverseDynamics
        The forces at the motion.
    tau : ByMotion
        Of the actuators' forces (m); of the smallest ones, where they are not unique.
    a : ByMotion
        Of the acceleration of the tree (nv).
    lambda_ : ByMotion
        Of the multipliers (rows); NaN where they are not unique.
    """

    dynamics: InverseDynamics
    tau: ByMotion
    a: ByMotion
    lambda_: ByMotion


@dataclass(frozen=True, eq=False)
class HybridDynamicsDerivatives(Kinematics):
    """Derivatives of forces and motion by the state and the prescribed accelerations; exact.

    Parameters
    ----------
    coordinates, motion, v_by_coordinates
        As in `Kinematics`.
    dynamics : HybridDynamics
        Forces and motion.
    tau, a, lambda_ : ByPrescription
        As of `InverseDynamicsDerivatives`.
    """

    dynamics: HybridDynamics
    tau: ByPrescription
    a: ByPrescription
    lambda_: ByPrescription


@dataclass(frozen=True, eq=False)
class ForwardDynamicsDerivatives(Kinematics):
    """Derivatives of the acceleration by the state and the actuators' forces; exact.

    Parameters
    ----------
    coordinates, motion, v_by_coordinates
        As in `Kinematics`.
    dynamics : ForwardDynamics
        The acceleration.
    accelerations : ByForces
        Of the accelerations of the coordinates (n).
    a : ByForces
        Of the acceleration of the tree (nv).
    lambda_ : ByForces
        Of the multipliers (rows); NaN where they are not unique.
    """

    dynamics: ForwardDynamics
    accelerations: ByForces
    a: ByForces
    lambda_: ByForces

    @property
    def Fx(self) -> FloatArray:  # noqa: N802
        """Derivative (2n, 2n) of the rate of the state, coordinates and then their speeds, by the state."""
        by, n = self.accelerations, len(self.coordinates)
        above = np.concatenate([np.zeros((n, n)), np.eye(n)], axis=1)
        return np.concatenate([above, np.concatenate([by.by_coordinates, by.by_speeds], axis=1)])

    @property
    def Fu(self) -> FloatArray:  # noqa: N802
        """Derivative (2n, m) of the rate of the state by the forces of the actuators."""
        return np.concatenate([np.zeros_like(self.accelerations.by_forces), self.accelerations.by_forces])


def of_inverse_dynamics(
    setting: Setting,
    found: InverseDynamics,
    motion: tuple[ArrayLike, ArrayLike, ArrayLike],
    coordinates: Names,
    external: External | None,
) -> InverseDynamicsDerivatives:
    """Return the derivatives of the forces of a motion q, v, a."""
    q, v = setting.robot.state(*motion[:2])
    with setting.open():
        at = setting.independent(q, coordinates, v)
        given = v, np.asarray(motion[2], dtype=float), found.tau, found.lambda_
        linear = _linearised(setting, at, given, external)
        by_a, by_tau = linear.inverse()
        by_lambda = _where_unique(linear.multipliers(by_a, by_tau), found.unique)
    columns = np.tile(setting.v[at.v], 3)

    def by(units: FloatArray, values: FloatArray) -> ByMotion:
        return ByMotion(*_parts(units[:, None] * values / columns, len(at.v)))

    told = by(setting.motors, by_tau), by(setting.v, by_a), by(setting.rows, by_lambda)
    return InverseDynamicsDerivatives(*_moved(setting, at, linear), found, *told)


def of_hybrid_dynamics(
    setting: Setting,
    found: HybridDynamics,
    state: tuple[ArrayLike, ArrayLike],
    asked: Asked,
    coordinates: Names,
    external: External | None,
) -> HybridDynamicsDerivatives:
    """Return the derivatives of the forces of a state q, v with prescribed joints and frames."""
    robot, (q, v), (joints, frames) = setting.robot, setting.robot.state(*state), asked
    by_joint = joints is None or isinstance(joints, Mapping)
    names = list(cast("ByName", joints or {})) if by_joint else robot.actuated
    index = np.array([k for name in names for k in joint_freedoms(robot.model, name)], dtype=int)
    with setting.open():
        at = setting.independent(q, coordinates, v)
        linear = _linearised(setting, at, (v, found.a, found.tau, found.lambda_), external)
        S, drift, twists = _prescription(setting, linear, index, frames or {})
        by_a, by_tau = linear.hybrid(S, drift)
        by_lambda = _where_unique(linear.multipliers(by_a, by_tau), found.unique)
    columns = np.concatenate((setting.v[at.v], setting.v[at.v], setting.v[index], twists))

    def by(units: FloatArray, values: FloatArray) -> ByPrescription:
        return ByPrescription(*_parts(units[:, None] * values / columns, len(at.v)))

    told = by(setting.motors, by_tau), by(setting.v, by_a), by(setting.rows, by_lambda)
    return HybridDynamicsDerivatives(*_moved(setting, at, linear), found, *told)


def of_forward_dynamics(
    setting: Setting,
    found: ForwardDynamics,
    state: tuple[ArrayLike, ArrayLike],
    tau: ArrayLike,
    coordinates: Names,
    external: External | None,
) -> ForwardDynamicsDerivatives:
    """Return the derivatives of the acceleration of a state q, v under the actuators' forces."""
    q, v = setting.robot.state(*state)
    with setting.open():
        at = setting.independent(q, coordinates, v)
        motion = v, found.a, np.asarray(tau, dtype=float), found.lambda_
        linear = _linearised(setting, at, motion, external)
        by_a, by_y = linear.forward()
        m, n = len(setting.actuated_v), len(at.v)
        unique = determined(at.point.svd, None, setting.actuated_v)
        given = np.concatenate((np.zeros((m, 2 * n)), np.eye(m)), axis=1)
        by_lambda = _where_unique(linear.multipliers(by_a, given), unique)
    units = setting.v[at.v]
    columns = np.concatenate((units, units, setting.motors))

    def by(units: FloatArray, values: FloatArray) -> ByForces:
        return ByForces(*_parts(units[:, None] * values / columns, n))

    told = by(units, by_y), by(setting.v, by_a), by(setting.rows, by_lambda)
    return ForwardDynamicsDerivatives(*_moved(setting, at, linear), found, *told)


def _linearised(
    setting: Setting,
    at: Independent,
    motion: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    external: External | None,
) -> Linearised:
    """Return the linearised equations of motion in the robot's own units."""
    v, a, tau, lambda_ = motion
    by_q, by_v = setting.robot.passive.derivatives(at.point.q * setting.q, v)
    by_q, by_v = (by * setting.v / setting.force[:, None] for by in (by_q, by_v))
    wrenches = [
        (setting.kinematics.frame(name, "external", InputError), np.asarray(wrench) / setting.wrench)
        for name, wrench in (external or {}).items()
    ]
    return Linearised(
        setting.kinematics,
        setting.couplings,
        setting.tree,
        setting.actuated_v,
        at,
        ForcedMotion(v / setting.v, a / setting.v, tau / setting.motors, lambda_ / setting.rows),
        Acting(by_q, by_v, wrenches),
    )


def _prescription(
    setting: Setting, linear: Linearised, index: IndexArray, frames: ByName
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the matrix of prescribed accelerations, their derivatives by q and v, and frames' units."""
    nv = int(setting.robot.model.nv)
    matrices, drifts, units = [np.eye(nv)[index]], [np.zeros((len(index), 2 * nv))], [np.zeros(0)]
    for name, value in frames.items():
        mask = np.isfinite(np.asarray(value, dtype=float))
        J, _, by_q, by_v = linear.bodies.frame(setting.kinematics.frame(name, "frames", InputError))
        matrices.append(J[mask])
        drifts.append(np.concatenate((by_q, by_v), axis=1)[mask])
        units.append(setting.twist[mask])
    return np.concatenate(matrices), np.concatenate(drifts), np.concatenate(units)


def _moved(
    setting: Setting, at: Independent, linear: Linearised
) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
    """Return the fields of `Kinematics`."""
    return at.names, setting.motion(at), setting.v[:, None] * linear.v_by_q / setting.v[at.v]


def _parts(values: FloatArray, n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return columns (size, 2 n + k) as those by coordinates, by speeds, and by the rest; read-only."""
    values.setflags(write=False)
    return values[:, :n], values[:, n : 2 * n], values[:, 2 * n :]


def _where_unique(values: FloatArray, unique: NDArray[np.bool_]) -> FloatArray:
    """Return rows, NaN where they are not unique."""
    return np.where(unique[:, None], values, np.nan)
