"""Inverse and forward dynamics of a tree with loop closures, by projection on the free motions.

With N the null space of the closures' Jacobian J, and B the matrix that puts the actuators' forces into the
tree, the equation of motion

    M(q) a + h(q, v) - Σ Jeᵀ w = B τ + Jᵀ λ        (1)

loses the multipliers λ when it is multiplied by Nᵀ, because J N = 0:

    Nᵀ B τ = Nᵀ (rnea(q, v, a) - Σ Jeᵀ w)          (2)

Redundant closures change neither N nor τ; they only leave some of λ open.

References
----------
R. Featherstone, Rigid Body Dynamics Algorithms, Springer 2008, chapter 8 (closed-loop systems).
A. Müller, T. Hufnagel, Model-based control of redundantly actuated parallel manipulators in redundant
coordinates, Robotics and Autonomous Systems 60 (2012) 563-571.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from p3dof.checks import FloatArray
from p3dof.closed_loop.closures import ClosurePoint, LoopKinematics, max_abs
from p3dof.closed_loop.linear import RANK_TOLERANCE, Decomposition
from p3dof.errors import DynamicsError, SingularityError

_ACCURACY = 1e-9
"""Largest error of an equation of motion, relative to the forces in it."""
_NEAR_SINGULAR = 1e-6
"""Conditioning below which a motion that no actuator can give is put down to the singularity."""
_UNIQUE = 1e-7
"""Size of the undetermined part of a multiplier from which on it is not unique."""


@dataclass(frozen=True, eq=False)
class InverseDynamics:
    """Actuator forces that produce a motion, and the evidence for them.

    Parameters
    ----------
    tau : (n_actuated,) array
        Forces of the actuated joints [N or N m]; the smallest possible if they are not unique.
    lambda_ : (rows,) array
        Multipliers of closures and couplings, in their order. ``3d`` and ``6d``: force [N], then moment
        [N m], that the closure exerts on the body of `frame2`, in the axes of `frame1` at their common
        origin; the body of `frame1` gets the opposite. The same for those rows of the other kinds that
        prescribe a position or a rotation, see `p3dof.closed_loop.closure_kinds`; the force acts at the
        origin of `frame2`. A coupling: the force [N or N m] that it exerts in the joint that follows; `on`
        gets that times -p'(q_on), each of `others` times -f. The smallest possible where not unique.
    unique : (rows,) array of bool
        Which multipliers are determined.
    tau_unique : bool
        Whether `tau` is determined; not so if the mechanism has more actuators than mobility.
    rank, mobility : int
        Rank of the closures' Jacobian, and nv - rank.
    conditioning : float
        Smallest singular value of Nᵀ B, between 0 and 1, N being orthonormal: how much of the least resisted
        free motion is seen by the actuators. It is 0 where they cannot hold the mechanism.
    residual : float
        Largest error of the full equation of motion [N or N m].
    gap : float
        Largest closure error of the configuration [m or rad].
    """

    tau: FloatArray
    lambda_: FloatArray
    unique: np.ndarray
    tau_unique: bool
    rank: int
    mobility: int
    conditioning: float
    residual: float
    gap: float


@dataclass(frozen=True, eq=False)
class ForwardDynamics:
    """Acceleration that actuator forces produce, and the evidence for it.

    Parameters
    ----------
    a : (nv,) array
        Acceleration of the whole tree.
    lambda_ : (rows,) array
        Multipliers of closures and couplings, as in `InverseDynamics`.
    residual : float
        Largest error of the full equation of motion [N or N m].
    closure_residual : float
        Largest relative acceleration that is left at a closure, J a + J̇ v [m/s² or rad/s²], besides what the
        stabilisation puts there.
    gap : float
        Largest closure error of the configuration [m or rad].
    """

    a: FloatArray
    lambda_: FloatArray
    residual: float
    closure_residual: float
    gap: float


class Dynamics:
    """Inverse and forward dynamics of one model.

    Parameters
    ----------
    kinematics : LoopKinematics
        The model and its closures.
    actuated_v : (n_actuated,) array of int
        Indices of the actuated joints in v.
    """

    def __init__(self, kinematics: LoopKinematics, actuated_v: np.ndarray) -> None:
        self.kinematics = kinematics
        self.model = kinematics.model
        self.actuated_v = actuated_v
        self._data = self.model.createData()
        self._upper = np.triu(np.ones((self.model.nv, self.model.nv), dtype=bool))
        self._solver: _ForwardSolver | None = None

    def inverse(
        self, point: ClosurePoint, v: FloatArray, a: FloatArray, external: FloatArray
    ) -> InverseDynamics:
        """Return the actuator forces of a motion.

        Parameters
        ----------
        point : ClosurePoint
            The closures at the configuration.
        v, a : (nv,) array
            Velocity and acceleration.
        external : (nv,) array
            Generalised force of the external wrenches.

        Returns
        -------
        InverseDynamics

        Raises
        ------
        SingularityError
            If there are enough actuators but they cannot hold the mechanism.
        DynamicsError
            If the motion needs a force that no actuator gives.
        """
        q = point.q
        f = np.array(pin.rnea(self.model, self._data, q, v, a)) - external  # left side of (1)
        N = point.svd.null_space
        A = N[self.actuated_v].T  # Nᵀ B (mobility, n_actuated)
        actuation = Decomposition.of(A, RANK_TOLERANCE, 1.0)
        mobility, count = A.shape
        conditioning = 1.0 if not mobility else 0.0 if count < mobility else float(actuation.s[-1])
        free = N.T @ f
        tau = actuation.solve(free) if point.J.size else f[self.actuated_v]  # (2); exact in an open tree
        rounding = 100 * np.finfo(float).eps * max_abs(A) * max_abs(tau)  # large forces near a singularity
        missing = max(0.0, max_abs(free - A @ tau) - rounding)
        fits = missing <= _ACCURACY * max_abs(f) or missing <= _ACCURACY * self.scale(q, v, a, f)
        near_singular = not fits and conditioning < _NEAR_SINGULAR
        if mobility <= count and (actuation.rank < mobility or near_singular):
            raise SingularityError(
                f"the actuators cannot hold the mechanism here: they resist {actuation.rank} of its "
                f"{mobility} free motions (smallest singular value {conditioning:.1e})"
            )
        if not fits:  # also when something is not a number
            raise DynamicsError(
                f"the motion needs a force that no actuator gives: {missing:.3g} N or N m is missing "
                f"({count} actuators, {mobility} free motions){self._other_way(count, mobility)}"
            )
        constraint = f.copy()
        constraint[self.actuated_v] -= tau
        lambda_ = point.svd.solve_transpose(constraint)
        return InverseDynamics(
            tau=read_only(tau),
            lambda_=read_only(lambda_),
            unique=read_only(self.determined(point.svd, actuation)),
            tau_unique=actuation.rank == count,
            rank=point.svd.rank,
            mobility=mobility,
            conditioning=conditioning,
            residual=self.residual(point, v, a, external, tau, lambda_),
            gap=point.gap,
        )

    def residual(
        self,
        point: ClosurePoint,
        v: FloatArray,
        a: FloatArray,
        external: FloatArray,
        tau: FloatArray,
        lambda_: FloatArray,
    ) -> float:
        """Return the largest error of the full equation of motion (1) under given forces.

        Parameters
        ----------
        point : ClosurePoint
            The closures at the configuration.
        v, a : (nv,) array
            Velocity and acceleration.
        external : (nv,) array
            Generalised force of the external wrenches.
        tau : (n_actuated,) array
            Forces of the actuated joints.
        lambda_ : (rows,) array
            Multipliers of the closures.

        Returns
        -------
        float
            [N or N m]
        """
        left = np.array(pin.rnea(self.model, self._data, point.q, v, a)) - external - point.J.T @ lambda_
        left[self.actuated_v] -= tau
        return max_abs(left)

    def forward(
        self, point: ClosurePoint, v: FloatArray, force: FloatArray, stabilisation: float = 0.0
    ) -> ForwardDynamics:
        """Return the acceleration under generalised forces.

        Parameters
        ----------
        point : ClosurePoint
            The closures at the configuration.
        v : (nv,) array
            Velocity.
        force : (nv,) array
            Generalised force of actuators and external wrenches.
        stabilisation : float
            β of Baumgarte's stabilisation [1/s].

        Returns
        -------
        ForwardDynamics

        Raises
        ------
        DynamicsError
            If no acceleration satisfies closures and equation of motion to relative 1e-9.
        """
        q = point.q
        drift: FloatArray = np.zeros(0)
        if not point.J.size:
            a: FloatArray = np.array(pin.aba(self.model, self._data, q, v, force))
        else:
            a = self._estimate(q, v, force)
            self.kinematics.move(q, v)
            drift = self.kinematics.acceleration()
            if stabilisation:
                drift = drift + stabilisation * (2.0 * point.J @ v + stabilisation * point.error)
            a = self._refined(point, v, a, force, drift)
            if not self.kinematics.plain:
                a = self._refined(point, v, a, force, drift)
        constraint = np.array(pin.rnea(self.model, self._data, q, v, a)) - force
        lambda_ = point.svd.solve_transpose(constraint)
        residual = max_abs(constraint - point.J.T @ lambda_)
        opening = max_abs(point.J @ a + drift)
        good = (
            residual <= _ACCURACY * self.scale(q, v, a, force)
            and opening <= max(_ACCURACY, point.rank_tolerance) * max(1.0, max_abs(drift), max_abs(a))
        )  # fmt: skip
        if not good:  # also when something is not a number
            raise DynamicsError(
                f"the forward dynamics did not reach its accuracy: {residual:.3g} N or N m is left in the "
                f"equation of motion, {opening:.3g} m/s² or rad/s² at the closures"
            )
        return ForwardDynamics(read_only(a), read_only(lambda_), residual, opening, point.gap)

    def external(self, wrenches: list[tuple[pin.Frame, FloatArray]]) -> FloatArray:
        """Return the generalised force (nv,) of wrenches at frames, at the last configuration evaluated.

        Parameters
        ----------
        wrenches : list of (pin.Frame, (6,) array)
            Force [N] and moment [N m] in world axes at the frame's origin.

        Returns
        -------
        (nv,) array
        """
        k = self.kinematics
        force = np.zeros(self.model.nv)
        for frame, wrench in wrenches:
            ends = (frame.parentJoint, frame.placement, pin.LOCAL_WORLD_ALIGNED)
            force += pin.getFrameJacobian(k.model, k.data, *ends).T @ wrench
        return force

    def _estimate(self, q: FloatArray, v: FloatArray, force: FloatArray) -> FloatArray:
        """Return an acceleration to start from: Pinocchio's where all closures are its own, else zero."""
        if not self.kinematics.plain:
            return np.zeros(self.model.nv)
        if self._solver is None:
            self._solver = _ForwardSolver(self.kinematics)
        return self._solver.acceleration(q, v, force)

    def _refined(
        self, point: ClosurePoint, v: FloatArray, a: FloatArray, force: FloatArray, drift: FloatArray
    ) -> FloatArray:
        """Improve an acceleration by one exact step: first the closures, then the free motions."""
        if not np.all(np.isfinite(a)):
            a = np.zeros(self.model.nv)  # the step below is exact from anywhere, only better from nearby
        N = point.svd.null_space
        a = a - point.svd.solve(point.J @ a + drift)
        M = self.mass_matrix(point.q)
        missing = force - pin.rnea(self.model, self._data, point.q, v, a)
        try:
            refined: FloatArray = a + N @ np.linalg.solve(N.T @ M @ N, N.T @ missing)
        except np.linalg.LinAlgError as error:
            raise DynamicsError("the mechanism has a free motion without inertia") from error
        return refined

    def _other_way(self, count: int, mobility: int) -> str:
        way = "; hybrid_dynamics() lets idle freedoms move as they must"
        return way if count < mobility else ""

    def determined(self, svd: Decomposition, actuation: Decomposition) -> np.ndarray:
        """Tell which multipliers keep their value in every solution of (1).

        Parameters
        ----------
        svd : Decomposition
            Of the closures' Jacobian.
        actuation : Decomposition
            Of a matrix that maps forces of the actuators to their effect.

        Returns
        -------
        (rows,) array of bool
        """
        open_ = np.abs(svd.U[:, svd.rank :])
        fixed = np.all(open_ <= _UNIQUE, axis=1)
        if actuation.rank < len(self.actuated_v):
            forces = np.zeros((self.model.nv, len(self.actuated_v) - actuation.rank))
            forces[self.actuated_v] = actuation.null_space
            effect = np.abs(svd.solve_transpose(forces))
            fixed = fixed & np.all(effect <= _UNIQUE * effect.max(initial=0.0), axis=1)
        return np.asarray(fixed)

    def tree_force(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return M a + h (nv,), what the motion of the tree takes [N or N m].

        Parameters
        ----------
        q : (nq,) array
            Configuration.
        v, a : (nv,) array
            Velocity and acceleration.

        Returns
        -------
        (nv,) array
        """
        return np.array(pin.rnea(self.model, self._data, q, v, a))

    def mass_matrix(self, q: FloatArray) -> FloatArray:
        """Return M (nv, nv), that of the tree, at a configuration (nq,)."""
        M = np.array(pin.crba(self.model, self._data, q))
        return np.where(self._upper, M, M.T)

    def scale(self, q: FloatArray, v: FloatArray, a: FloatArray, force: FloatArray) -> float:
        """Return the size of the forces that cancel in the equation of motion.

        Parameters
        ----------
        q : (nq,) array
            Configuration.
        v, a : (nv,) array
            Velocity and acceleration.
        force : (nv,) array
            Generalised force of actuators and external wrenches.

        Returns
        -------
        float
            [N or N m]
        """
        h = np.array(pin.nle(self.model, self._data, q, v))
        inertial = pin.rnea(self.model, self._data, q, v, a) - h
        gravity = pin.computeGeneralizedGravity(self.model, self._data, q)
        return max(max_abs(h), max_abs(inertial), max_abs(force), max_abs(gravity))


class _ForwardSolver:
    """Pinocchio's constrained forward dynamics: the one place where anchors become rigid constraints."""

    def __init__(self, kinematics: LoopKinematics) -> None:
        self._model = kinematics.model
        self._data = self._model.createData()
        self._models = pin.StdVec_RigidConstraintModel()
        self._datas = pin.StdVec_RigidConstraintData()
        for constraint in kinematics.constraint_models:
            rigid = pin.convertToRigidConstraintModel(self._model, constraint.extract())
            self._models.append(rigid)
            self._datas.append(rigid.createData())
        pin.initConstraintDynamics(self._model, self._data, self._models, self._datas)

    def acceleration(self, q: FloatArray, v: FloatArray, force: FloatArray) -> FloatArray:
        # Without mu, redundant closures give NaN; with these, relative errors are 4e-14 to 5e-11.
        settings = pin.ProximalSettings(1e-12, 1e-12, 1e-8, 50)
        arguments = (self._model, self._data, q, v, force, self._models, self._datas, settings)
        return np.array(pin.constraintDynamics(*arguments))


def read_only(array: np.ndarray) -> np.ndarray:
    """Return an array that nobody can write to any more."""
    array.setflags(write=False)
    return array
