"""Forward dynamics of a tree with loop closures.

With the notation of `p3dof.loops.inverse`, and drift c = J̇ v, unknown are a and λ of

    M a + h - f = Jᵀ λ,    J a = -c        (1)

f being the forces of actuators and everything else. From any a0 that closes the loops, a = a0 + N y with

    NᵀM N y = Nᵀ (f - h - M a0)            (2)

N comes from a partition (see `p3dof.loops.partitions`), where one is good enough. Else it is that of
the singular value decomposition of J, and a0 starts from what Pinocchio finds by its proximal method.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof._base.errors import DynamicsError
from p3dof.loops.closures import ClosurePoint, LoopKinematics, max_abs
from p3dof.loops.coordinates import ACCURACY, NO_CHANGE
from p3dof.loops.linear import lapack
from p3dof.loops.partitions import Memory, Split, Terms
from p3dof.loops.results import AcceleratedClosures, ForwardDynamics, read_only

_SOLUTIONS = 3  # solutions of (2) at most; each further one refines the one before


class Forward:
    """Forward dynamics of one model."""

    def __init__(self, terms: Terms) -> None:
        self._terms, self._kinematics, self._model = terms, terms.kinematics, terms.model
        self._memory = Memory(np.arange(terms.model.nv))
        self._data = self._model.createData()
        self._solver: _ProximalSolver | None = None

    def solve(
        self, point: ClosurePoint, v: FloatArray, force: FloatArray, stabilisation: float = 0.0
    ) -> ForwardDynamics:
        """Return the acceleration under generalised forces."""
        if not point.J.size:
            a: FloatArray = np.array(pin.aba(self._model, self._data, point.q, v, force))
            return self._checked(point, v, a, force, np.zeros(0))
        self._kinematics.move(point.q, v)
        drift = self._kinematics.acceleration()
        if stabilisation:
            drift = drift + stabilisation * (2.0 * point.J @ v + stabilisation * point.error)
        split = self._memory.at(point)
        found = None if split is None else self._partitioned(split, point, v, force, drift)
        return self._projected(point, v, force, drift) if found is None else found

    def _partitioned(
        self, split: Split, point: ClosurePoint, v: FloatArray, force: FloatArray, drift: FloatArray
    ) -> ForwardDynamics | None:
        """Return the acceleration by a partition; None if it does not reach the accuracy."""
        terms, partition, rows = self._terms, split.partition, split.rows
        N = split.motions()
        half = N.T.dot(terms.half_mass_matrix(point.q)).dot(N)
        most = _SOLUTIONS if len(half) else 0  # a structure does not move
        root, wrong = lapack().dpotrf(half + half.T) if most else (half, 0)
        if wrong:
            return None
        a = np.zeros(len(v))
        a[partition.dependent] = -split.solve(drift.take(partition.rows) if len(partition.left) else drift)
        for step in range(most + 1):
            left = terms.tree_force(point.q, v, a) - force
            lambda_ = split.solve_transpose(left.take(partition.dependent))
            borne = lambda_.dot(rows)
            missing = left - borne  # Nᵀ of it has not the rounding of JN times λ, large beside little inertia
            if step == most:
                break
            more = lapack().dpotrs(root, missing.dot(N))[0]
            if step and more.dot(more) <= NO_CHANGE**2 * a.dot(a):
                break
            a -= N.dot(more)
        opening = point.J.dot(a) + drift
        size = (force.dot(force) + borne.dot(borne)) / len(v)
        # No more than the squares of the largest ones.
        most_open = max(1.0, drift.dot(drift) / len(drift), a.dot(a) / len(a))
        fits = missing.dot(missing) <= ACCURACY**2 * size
        if not (fits and opening.dot(opening) <= ACCURACY**2 * most_open):
            return None  # also when something is not a number
        known = None if len(partition.left) else lambda_
        return ForwardDynamics(read_only(a), AcceleratedClosures(point, left, opening, known))

    def _projected(
        self, point: ClosurePoint, v: FloatArray, force: FloatArray, drift: FloatArray
    ) -> ForwardDynamics:
        """Return the acceleration by the singular value decomposition of the closures' Jacobian."""
        a = self._refined(point, v, self._estimate(point.q, v, force), force, drift)
        if not self._kinematics.plain:
            a = self._refined(point, v, a, force, drift)
        return self._checked(point, v, a, force, drift)

    def _checked(
        self, point: ClosurePoint, v: FloatArray, a: FloatArray, force: FloatArray, drift: FloatArray
    ) -> ForwardDynamics:
        """Return a result, unless it misses the accuracy."""
        left = self._terms.tree_force(point.q, v, a) - force
        evidence = AcceleratedClosures(point, left, point.J @ a + drift)
        residual, opening = evidence.residual, evidence.closure_residual
        good = (
            residual <= ACCURACY * self._terms.scale(point.q, v, a, force)
            and opening <= max(ACCURACY, point.rank_tolerance) * max(1.0, max_abs(drift), max_abs(a))
        )  # fmt: skip
        if not good:  # also when something is not a number
            raise DynamicsError(
                f"the forward dynamics did not reach its accuracy: {residual:.3g} N or N m is left in the "
                f"equation of motion, {opening:.3g} m/s² or rad/s² at the closures"
            )
        return ForwardDynamics(read_only(a), evidence)

    def _estimate(self, q: FloatArray, v: FloatArray, force: FloatArray) -> FloatArray:
        """Return an acceleration to start from: Pinocchio's where all closures are its own, else zero."""
        if not self._kinematics.plain:
            return np.zeros(self._model.nv)
        if self._solver is None:
            self._solver = _ProximalSolver(self._kinematics)
        return self._solver.acceleration(q, v, force)

    def _refined(
        self, point: ClosurePoint, v: FloatArray, a: FloatArray, force: FloatArray, drift: FloatArray
    ) -> FloatArray:
        """Improve an acceleration by one exact step: first the closures, then the free motions."""
        if not np.all(np.isfinite(a)):
            a = np.zeros(self._model.nv)  # the step below is exact from anywhere, only better from nearby
        N = point.svd.null_space
        a = a - point.svd.solve(point.J @ a + drift)
        M = self._terms.mass_matrix(point.q)
        missing = force - self._terms.tree_force(point.q, v, a)
        missing = missing - point.J.T @ point.svd.solve_transpose(missing)  # as above
        try:
            refined: FloatArray = a + N @ np.linalg.solve(N.T @ M @ N, N.T @ missing)
        except np.linalg.LinAlgError as error:
            raise DynamicsError("the mechanism has a free motion without inertia") from error
        return refined


class _ProximalSolver:
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
