"""Inverse dynamics of a tree with loop closures, by projection on the free motions.

With N the null space of the closures' Jacobian J, and B the matrix that puts the actuators' forces into the
tree, the equation of motion

    M(q) a + h(q, v) - Σ Jeᵀ w = B τ + Jᵀ λ        (1)

loses the multipliers λ when it is multiplied by Nᵀ, because J N = 0:

    Nᵀ B τ = Nᵀ (rnea(q, v, a) - Σ Jeᵀ w)          (2)

Redundant closures change neither N nor τ; they only leave some of λ open.

Where the joints without actuators follow from the others by a well-conditioned part Jd of J (see
`p3dof.loops.partitions`), (1) is solved row by row instead, their rows giving λ:

    Jdᵀ λ = fd,    τ = fa - Jaᵀ λ,    0 = fi - Jiᵀ λ        (3)

with passive joints i, which have to move as they must. Near singularities, with spare actuators, and wherever
the forces do not fit, (2) decides.

References
----------
R. Featherstone, Rigid Body Dynamics Algorithms, Springer 2008, chapter 8 (closed-loop systems).
A. Müller, T. Hufnagel, Model-based control of redundantly actuated parallel manipulators in redundant
coordinates, Robotics and Autonomous Systems 60 (2012) 563-571.
"""

from __future__ import annotations

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import DynamicsError, SingularityError
from p3dof.loops.closures import ClosurePoint, max_abs
from p3dof.loops.coordinates import ACCURACY, SURELY
from p3dof.loops.linear import Decomposition
from p3dof.loops.partitions import IndexArray, Memory, Partition, Terms
from p3dof.loops.results import ActuatedForces, InverseDynamics, read_only

_NEAR_SINGULAR = 1e-6  # conditioning below which a motion that no actuator can give is a singularity's


class Inverse:
    """Inverse dynamics of one model."""

    def __init__(self, terms: Terms) -> None:
        self._terms = terms
        self._actuated = terms.actuated_v
        self._passive: IndexArray = np.setdiff1d(np.arange(terms.model.nv), terms.actuated_v)
        self._memory = Memory(self._passive)
        self._of: Partition | None = None
        self._idle: IndexArray = self._passive[:0]

    def solve(
        self, point: ClosurePoint, v: FloatArray, a: FloatArray, external: FloatArray
    ) -> InverseDynamics:
        """Return the actuator forces of a motion."""
        force = self._terms.tree_force(point.q, v, a) - external  # left side of (1)
        found = self._partitioned(point, force) if point.J.size else self._of_tree(point, force)
        return self._projected(point, v, a, force) if found is None else found

    def _of_tree(self, point: ClosurePoint, force: FloatArray) -> InverseDynamics | None:
        """Return the forces in a tree without closures; None if others than the actuators' are needed."""
        tau, missing = force[self._actuated], force[self._passive]
        size = tau.dot(tau)
        if not (size < np.inf and missing.dot(missing) <= SURELY**2 * size):
            return None  # also when something is not a number
        return self._result(point, force, tau, np.zeros(0))

    def _partitioned(self, point: ClosurePoint, force: FloatArray) -> InverseDynamics | None:
        """Return the forces by (3); None where these are not certain to be those of (2)."""
        split = self._memory.at(point)
        if split is None:
            return None
        partition, rows = split.partition, split.rows
        lambda_ = split.solve_transpose(force[partition.dependent])
        tau = force[self._actuated] - lambda_ @ rows.take(self._actuated, axis=1)
        idle = self._idle_in(partition)
        if not tau.dot(tau) < np.inf:  # also when something is not a number
            return None
        if len(idle):
            missing = force[idle] - lambda_ @ rows.take(idle, axis=1)
            if not missing.dot(missing) <= SURELY**2 * force.dot(force):
                return None
        return self._result(point, force, tau, None if len(partition.left) else lambda_)

    def _idle_in(self, partition: Partition) -> IndexArray:
        """Return the joints that are neither actuated nor follow from others."""
        if self._of is not partition:
            self._of, self._idle = partition, np.setdiff1d(self._passive, partition.dependent)
        return self._idle

    def _result(
        self,
        point: ClosurePoint,
        force: FloatArray,
        tau: FloatArray,
        lambda_: FloatArray | None,
        actuation: Decomposition | None = None,
    ) -> InverseDynamics:
        left = force.copy()
        left[self._actuated] -= tau
        evidence = ActuatedForces(point, left, self._actuated, lambda_, actuation)
        return InverseDynamics(read_only(tau), evidence)

    def _projected(
        self, point: ClosurePoint, v: FloatArray, a: FloatArray, force: FloatArray
    ) -> InverseDynamics:
        """Return the forces by (2), or say why there are none."""
        evidence = ActuatedForces(point, force, self._actuated)
        actuation, N = evidence.actuation, point.svd.null_space
        A = N[self._actuated].T  # Nᵀ B (mobility, n_actuated)
        mobility, count = A.shape
        conditioning = evidence.conditioning
        free = N.T @ force
        tau = actuation.solve(free) if point.J.size else force[self._actuated]  # exact in an open tree
        rounding = 100 * np.finfo(float).eps * max_abs(A) * max_abs(tau)  # large forces near a singularity
        missing = max(0.0, max_abs(free - A @ tau) - rounding)
        enough = ACCURACY * max_abs(force)
        fits = missing <= enough or missing <= ACCURACY * self._terms.scale(point.q, v, a, force)
        near_singular = not fits and conditioning < _NEAR_SINGULAR
        if mobility <= count and (actuation.rank < mobility or near_singular):
            raise SingularityError(
                f"the actuators cannot hold the mechanism here: they resist {actuation.rank} of its "
                f"{mobility} free motions (smallest singular value {conditioning:.1e})"
            )
        if not fits:  # also when something is not a number
            way = (
                "; hybrid_dynamics() lets passive degrees of freedom move freely" if count < mobility else ""
            )
            raise DynamicsError(
                f"the motion needs a force that no actuator gives: {missing:.3g} N or N m is missing "
                f"({count} actuators, {mobility} free motions){way}"
            )
        return self._result(point, force, tau, None, actuation)
