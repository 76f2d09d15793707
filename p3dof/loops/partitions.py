"""Partitions: which joints follow from which, and the one LU decomposition that all dynamics then needs.

As many independent rows of the closures' Jacobian J as its rank, and as many columns, the dependent joints d
for which they are a regular matrix Jd, give every motion that the closures allow:

    v_d = -Jd⁻¹ Jf v_f,    N = [1; -Jd⁻¹ Jf] over [f; d]

A choice is good in a whole region. It is remembered, and every use of it is checked: Jd must be far from
singular, and the rows that were left out must follow from the others. Then the rank is what it was. Where
that fails, another choice is made; where none is good enough, singular value decompositions decide.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import sqrt
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.threads import Workspace
from p3dof.loops.closures import ClosurePoint, LoopKinematics, max_abs
from p3dof.loops.coordinates import WELL
from p3dof.loops.linear import lapack

IndexArray: TypeAlias = NDArray[np.int_]

_NEARLY_TIGHT = 1e-7  # largest gap at which rows that follow from others are known to [m or rad]


@dataclass(frozen=True, eq=False)
class Partition:
    """A choice of independent rows and dependent joints."""

    rows: IndexArray  # (rank,): the rows
    left: IndexArray  # (n - rank,): all others, which follow from these
    dependent: IndexArray  # (rank,): indices in v of the joints that follow
    free: IndexArray  # (nv - rank,): all others

    @cached_property
    def units(self) -> FloatArray:
        """The matrix (nv, k) from rates of the free joints to these among all joints."""
        matrix = np.zeros((len(self.dependent) + len(self.free), len(self.free)))
        matrix[self.free, range(len(self.free))] = 1.0
        return matrix

    @classmethod
    def choose(cls, J: FloatArray, rank: int, columns: IndexArray) -> Partition | None:
        """Return the rows and joints that are farthest from dependent; None if there are too few."""
        if not 0 < rank <= len(columns):
            return None
        rows = np.sort(_pivots(J[:, columns].T)[:rank])
        dependent = np.sort(columns[_pivots(J[np.ix_(rows, columns)])[:rank]])
        n, nv = J.shape
        left, free = (np.setdiff1d(np.arange(size), chosen) for size, chosen in ((n, rows), (nv, dependent)))
        return cls(rows, left, dependent, free)


class Split:
    """A matrix J split by a partition, decomposed."""

    def __init__(self, partition: Partition, J: FloatArray) -> None:
        self.partition = partition
        self.rows: FloatArray = J.take(partition.rows, axis=0) if len(partition.left) else J
        """The independent rows (rank, nv)."""
        flat = J.ravel()
        self.norm = sqrt(flat.dot(flat))
        Jd = self.rows.take(partition.dependent, axis=1)
        self._lu, self._pivots, _ = lapack().dgetrf(Jd.T, overwrite_a=1)
        self.condition: float = lapack().dgecon(self._lu, self.norm)[0]
        """1 / (|J| |Jd⁻¹|), zero where Jd is singular, NaN where it is not finite."""
        self.weights: FloatArray = np.zeros((len(Jd), 0))
        """How the rows that were left out follow from the others, (rank, n - rank), after `good`."""

    def solve(self, b: FloatArray) -> FloatArray:
        """Return Jd⁻¹ b, for b (rank,) or (rank, k)."""
        return np.asarray(lapack().dgetrs(self._lu, self._pivots, b, trans=1)[0])

    def solve_transpose(self, f: FloatArray) -> FloatArray:
        """Return Jd⁻ᵀ f, for f (rank,) or (rank, k)."""
        return np.asarray(lapack().dgetrs(self._lu, self._pivots, f)[0])

    def good(self, J: FloatArray, tolerance: float) -> bool:
        """Whether the matrix has the rank of the partition beyond doubt, and Jd is far from singular."""
        if not self.condition >= max(WELL, 10.0 * tolerance):
            return False
        left = self.partition.left
        if not len(left):
            return True
        others = J.take(left, axis=0)
        self.weights = self.solve_transpose(others.take(self.partition.dependent, axis=1).T)
        apart = (others - self.weights.T.dot(self.rows)).ravel()
        return bool(apart.dot(apart) <= (tolerance * self.norm) ** 2 / max(1, len(J)))

    def motions(self) -> FloatArray:
        """Return the free motions N (nv, k), whose rows of the free joints are those of 1."""
        N = self.partition.units.copy()
        N[self.partition.dependent] = -self.solve(self.rows.take(self.partition.free, axis=1))
        return N


class Memory:
    """Remembers the partition that was good last."""

    def __init__(self, columns: IndexArray) -> None:
        self._columns = columns
        self._partition: Partition | None = None

    def at(self, point: ClosurePoint) -> Split | None:
        """Return closures split by the partition remembered, or a new one; None if none is good or known."""
        known = self._partition
        if known is not None:
            if not _told(known, point):
                return None
            split = Split(known, point.J)
            if split.good(point.J, point.rank_tolerance):
                return split
        self._partition = fresh = Partition.choose(point.J, point.svd.rank, self._columns)
        if fresh is None or not _told(fresh, point):
            return None
        split = Split(fresh, point.J)
        return split if split.good(point.J, point.rank_tolerance) else None


def _told(partition: Partition, point: ClosurePoint) -> bool:
    """Whether loops are closed well enough to tell which rows follow from others."""
    return not len(partition.left) or point.tight or point.gap <= _NEARLY_TIGHT


def _pivots(A: FloatArray) -> IndexArray:
    """Return the columns of a matrix (m, n), those first that are farthest from dependent on ones before."""
    return np.asarray(lapack().dgeqp3(A)[1]) - 1


class Terms(Workspace):
    """Terms of the equation of motion of one model."""

    def __init__(self, kinematics: LoopKinematics, actuated_v: np.ndarray) -> None:
        self.kinematics = kinematics
        self.model = kinematics.model
        self.actuated_v = actuated_v
        self._data = self.model.createData()
        nv = self.model.nv
        self._upper = np.triu(np.ones((nv, nv), dtype=bool))
        self._halved = np.triu(np.ones((nv, nv))) - np.eye(nv) / 2

    def tree_force(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return M a + h (nv,), what the motion of the tree takes [N or N m]."""
        return np.array(pin.rnea(self.model, self._data, q, v, a))

    def mass_matrix(self, q: FloatArray) -> FloatArray:
        """Return M (nv, nv), that of the tree, at a configuration (nq,)."""
        M = np.array(pin.crba(self.model, self._data, q))
        return np.where(self._upper, M, M.T)

    def half_mass_matrix(self, q: FloatArray) -> FloatArray:
        """Return the upper triangle of M with half the diagonal: M is this and its transpose."""
        return np.asarray(pin.crba(self.model, self._data, q) * self._halved)

    def external(self, wrenches: list[tuple[pin.Frame, FloatArray]]) -> FloatArray:
        """Return the generalised force (nv,) of wrenches at frames, at the last configuration evaluated."""
        k = self.kinematics
        force = np.zeros(self.model.nv)
        for frame, wrench in wrenches:
            ends = (frame.parentJoint, frame.placement, pin.LOCAL_WORLD_ALIGNED)
            force += pin.getFrameJacobian(k.model, k.data, *ends).T @ wrench
        return force

    def residual(
        self,
        point: ClosurePoint,
        v: FloatArray,
        a: FloatArray,
        external: FloatArray,
        tau: FloatArray,
        lambda_: FloatArray,
    ) -> float:
        """Return the largest error of the full equation of motion under given forces [N or N m]."""
        left = self.tree_force(point.q, v, a) - external - point.J.T @ lambda_
        left[self.actuated_v] -= tau
        return max_abs(left)

    def scale(self, q: FloatArray, v: FloatArray, a: FloatArray, force: FloatArray) -> float:
        """Return the size of the forces that cancel in the equation of motion [N or N m]."""
        h = np.array(pin.nle(self.model, self._data, q, v))
        inertial = pin.rnea(self.model, self._data, q, v, a) - h
        gravity = pin.computeGeneralizedGravity(self.model, self._data, q)
        return max(max_abs(h), max_abs(inertial), max_abs(force), max_abs(gravity))
