"""Equations of motion of a closed mechanism, linearised at one motion in independent coordinates; exact.

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

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof._base.errors import DynamicsError, SingularityError
from p3dof.loops.closure_tangents import ClosureTangents
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.constraints import Coupling
from p3dof.loops.independent import Independent, IndexArray
from p3dof.loops.linear import RANK_TOLERANCE, Decomposition, actuation_of
from p3dof.loops.tree_tangents import Tree, TreeMotion


@dataclass(frozen=True, eq=False)
class Acting:
    """What acts besides the actuators.

    Parameters
    ----------
    by_q : (nv, nv) array
        How the forces in the joints change with small motions of them.
    by_v : (nv,) array
        How the force in each freedom of the joints changes with its own speed.
    wrenches : sequence of (pin.Frame, (6,) array)
        Wrenches on frames, in world axes at their origins.
    """

    by_q: FloatArray
    by_v: FloatArray
    wrenches: Sequence[tuple[pin.Frame, FloatArray]] = ()


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion with the forces that belong to it.

    Parameters
    ----------
    v, a : (nv,) array
        Velocity and acceleration of the tree.
    tau : (n_actuated,) array
        Forces of the actuators.
    lambda_ : (rows,) array
        Multipliers that satisfy the equation of motion.
    """

    v: FloatArray
    a: FloatArray
    tau: FloatArray
    lambda_: FloatArray


class Linearised:
    """The equations of motion, linearised.

    Parameters
    ----------
    kinematics : LoopKinematics
        The model.
    couplings : sequence of Coupling
        Its couplings.
    tree : Tree
        Its tree.
    actuated_v : (m,) array of int
        The actuated freedoms.
    independent : Independent
        Coordinates at the configuration.
    motion : Motion
        The motion.
    acting : Acting
        What acts besides the actuators.
    """

    def __init__(
        self,
        kinematics: LoopKinematics,
        couplings: Sequence[Coupling],
        tree: Tree,
        actuated_v: IndexArray,
        independent: Independent,
        motion: Motion,
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
        f_v = f_v - np.diag(acting.by_v)
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
        """Return the derivatives of a (nv, 3 n) and of τ (m, 3 n) by y, ẏ and ÿ.

        Raises
        ------
        DynamicsError
            If there are fewer actuators than coordinates.
        SingularityError
            If the actuators cannot hold the mechanism.
        """
        N, actuated = self.N, self._actuated
        n, m = N.shape[1], len(actuated)
        if m < n:
            raise DynamicsError(
                f"{m} actuators cannot give any acceleration of {n} coordinates: "
                "hybrid_dynamics_derivatives() lets idle freedoms move as they must"
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
        """Return the derivatives of a (nv, 2 n + k) and of τ (m, 2 n + k) by y, ẏ and the prescription.

        Parameters
        ----------
        S : (k, nv) array
            Matrix of the prescribed accelerations.
        drift : (k, 2 nv) array
            Derivatives of the prescribed accelerations by q and v of the tree.
        """
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
    tree: Tree, q: FloatArray, v: FloatArray, a: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the derivatives (nv, nv) of rnea(q, v, a) by q, v and a."""
    by_q, by_v, _ = pin.computeRNEADerivatives(tree.model, tree.data, q, v, a)
    by_q, by_v = np.array(by_q), np.array(by_v)
    return by_q, by_v, tree.mass_matrix(q)
