"""Rank, null space and least-norm solutions of one small matrix; stacks of small matrices."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray

IndexArray = NDArray[np.int_]
BoolArray = NDArray[np.bool_]

RANK_TOLERANCE = 1e-9
"""Singular values below this fraction of the largest count as zero.

An assembled configuration closes its loops to 1e-12 or better, which is also the size of the singular values
that should be zero; the smallest that matter in a working machine are above 1e-4. The rows of a closure's
Jacobian mix metres and radians, so the fraction has no exact meaning: the room on either side makes that
harmless for machines of about the size of the unit of length; see `p3dof.loops.units`.
"""

UNIQUE = 1e-7  # share of an undetermined change from which on a force, or a motion, takes part in it
_REGULAR = 1e-12  # least reciprocal condition number of A Aᵀ for an A that is of full rank without doubt
_NOTHING = 1e-15  # share of the largest row below which a row is nothing


@dataclass(frozen=True, eq=False)
class Decomposition:
    """A matrix A (m, n) as U diag(s) Vᵀ, with its numerical rank."""

    U: FloatArray  # (m, m): left singular vectors; the columns from `rank` on span the null space of Aᵀ
    s: FloatArray  # (m, n): singular values, largest first
    Vt: FloatArray  # (n, n): right singular vectors; the rows from `rank` on span the null space of A
    rank: int  # the numerical rank

    @classmethod
    def of(
        cls, A: FloatArray, relative: float = RANK_TOLERANCE, largest: float | None = None
    ) -> Decomposition:
        """Decompose a matrix."""
        U, s, Vt = np.linalg.svd(A)
        reference = largest if largest is not None else (s[0] if s.size else 0.0)
        return cls(U, s, Vt, int(np.count_nonzero(s > relative * reference)))

    @property
    def null_space(self) -> FloatArray:
        """Orthonormal basis of the vectors that A maps to zero, (n, n - rank)."""
        return self.Vt[self.rank :].T

    @property
    def pseudo_inverse(self) -> FloatArray:
        """The matrix (n, m) of `solve`."""
        r = self.rank
        return (self.Vt[:r].T / self.s[:r]) @ self.U[:, :r].T

    @property
    def least(self) -> float:
        """The smallest singular value; one without any."""
        return float(self.s[-1]) if self.s.size else 1.0

    def solve(self, b: FloatArray) -> FloatArray:
        """Return the shortest x (n,) that minimises |A x - b|, for b (m,)."""
        r = self.rank
        return ((self.U[:, :r].T @ b) / self.s[:r]) @ self.Vt[:r]

    def solve_transpose(self, f: FloatArray) -> FloatArray:
        """Return the shortest y (m,) that minimises |Aᵀ y - f|; f is (n,), or (n, k) for k of them."""
        r = self.rank
        return (self.U[:, :r] / self.s[:r]) @ (self.Vt[:r] @ f)


def actuation_of(closures: Decomposition, actuated_v: NDArray[np.int_]) -> Decomposition:
    """Return Nᵀ B decomposed: what the actuators do to the orthonormal free motions N.

    All that is said of unique forces and of conditioning is read from it:

    - forces of the actuators are determined where its rank is their number: none of them can change without
      moving something, all others staying as they are or not;
    - the actuators hold the mechanism, whatever acts, where its rank is the mobility;
    - the conditioning is its smallest singular value: how much the least effective forces do, or, with more
      actuators than freedoms, how much of the least resisted motion they see. It is more than the rank
      tolerance where the former holds, or with spare actuators the latter, and nowhere else.

    Of a matrix (mobility, n_actuated).
    """
    return Decomposition.of(closures.null_space[actuated_v].T, RANK_TOLERANCE, 1.0)


def determined(
    svd: Decomposition, actuation: Decomposition | None, actuated_v: NDArray[np.int_]
) -> NDArray[np.bool_]:
    """Tell which multipliers keep their value in every solution of the equation of motion."""
    open_ = np.abs(svd.U[:, svd.rank :])
    fixed = np.all(open_ <= UNIQUE, axis=1)
    if actuation is not None and actuation.rank < len(actuated_v):
        forces = np.zeros((svd.Vt.shape[1], len(actuated_v) - actuation.rank))
        forces[actuated_v] = actuation.null_space
        effect = np.abs(svd.solve_transpose(forces))
        fixed = fixed & np.all(effect <= UNIQUE * effect.max(initial=0.0), axis=1)
    return np.asarray(fixed)


def least_norm(A: FloatArray, b: FloatArray, relative: float) -> FloatArray:
    """Return the shortest x (n,) that minimises |A x - b|, in a quarter of the time of singular values."""
    m, n = A.shape
    both = np.zeros((max(m, n), 1))
    both[:m, 0] = b
    found = lapack().dgelsy(A, both, np.zeros(n, dtype=np.int32), relative, _room(m, n), overwrite_b=1)[1]
    return np.asarray(found[:n, 0])


def orientation(A: FloatArray, B: FloatArray, relative: float) -> float:
    """Return the sign of det(Uᵀ B V), A being U diag(s) Vᵀ of A's rank; NaN if not finite."""
    if A.shape[0] > A.shape[1]:
        A, B = A.T, B.T
    if A.size:
        square = A.dot(A.T)
        root, wrong = lapack().dpotrf(square)
        # Of full rank without doubt: det(B Aᵀ) = det(Uᵀ B V) det(s), U being square.
        regular = max(_REGULAR, (10.0 * relative) ** 2)
        if not wrong and lapack().dpocon(root, lapack().dlange("1", square))[0] > regular:
            return _sign(B.dot(A.T))
        sizes = square.diagonal()
        some = np.flatnonzero(sizes > _NOTHING**2 * sizes.max())
        if 0 < len(some) < len(A):  # as across the plane of a planar loop: U has nothing there
            return orientation(A[some], B[some], relative)
    if not np.isfinite(A).all():
        return math.nan  # of a robot whose numbers are too large: SVD would not converge
    U, s, Vt = np.linalg.svd(A, full_matrices=False)
    rank = int(np.count_nonzero(s > relative * s[:1]))
    return float(np.linalg.slogdet(U[:, :rank].T @ B @ Vt[:rank].T)[0])


def _sign(A: FloatArray) -> float:
    """Return the sign of the determinant of a small matrix, zero if it is singular."""
    lu, swaps, singular = lapack().dgetrf(A)
    sign = 0.0 if singular else 1.0
    for i, (pivot, swap) in enumerate(zip(lu.diagonal().tolist(), swaps.tolist(), strict=True)):
        if (pivot < 0.0) != (i != swap):
            sign = -sign
    return sign


@cache
def lapack() -> Any:
    """Return SciPy's LAPACK, whose calls cost a tenth of NumPy's; not at start-up: it takes long to import.

    None of the functions that are used here wakes threads for matrices of less than 100 rows: those that
    solve for several right sides at once would, which stalls a busy machine for milliseconds, so that they
    are asked for one side after the other.
    """
    from types import SimpleNamespace

    from scipy.linalg import lapack as functions

    def by_columns(solve: Any) -> Any:
        def solved(*given: Any, **options: Any) -> tuple[FloatArray, int]:
            *matrix, b = given
            if b.ndim == 1:
                found: tuple[FloatArray, int] = solve(*matrix, b, **options)
                return found
            x = np.empty(b.shape, order="F")
            for i, column in enumerate(b.T):
                x[:, i], wrong = solve(*matrix, column, **options)
                if wrong:
                    return x, int(wrong)
            return x, 0

        return solved

    kept = {name: getattr(functions, name) for name in dir(functions) if not name.startswith("_")}
    return SimpleNamespace(**{**kept, **{name: by_columns(kept[name]) for name in ("dgetrs", "dpotrs")}})


@cache
def _room(m: int, n: int) -> int:
    return int(lapack().dgelsy_lwork(m, n, 1, RANK_TOLERANCE)[0])


# Stacks of small arrays: the first axis counts samples.

BLOCK = 1024  # samples that are treated together: calls are cheap, and all fits the processor's cache
PROBES = 4  # how many right sides tell how large an inverse is
_CACHE = 2**20  # bytes of one stack of matrices [B]
FEW = 8  # fewer samples than this are treated one by one, which is as fast


def apply(A: FloatArray, x: FloatArray) -> FloatArray:
    """Return A x for stacked matrices (..., m, n) and vectors (..., n)."""
    result: FloatArray = np.matmul(A, x[..., None])[..., 0]
    return result


def inverse(A: FloatArray) -> FloatArray:
    """Return the inverses of stacked matrices (n, m, m), NaN for singular ones."""
    try:
        return np.asarray(np.linalg.inv(A))
    except np.linalg.LinAlgError:
        singular = np.linalg.slogdet(A)[0] == 0.0
        K: FloatArray = np.linalg.inv(np.where(singular[:, None, None], np.eye(A.shape[-1]), A))
        K[singular] = np.nan
        return K


def solve(A: FloatArray, b: FloatArray) -> FloatArray:
    """Return the solutions of A x = b for stacked A (n, m, m) and b (n, m, k), NaN where A is singular."""
    try:
        return np.asarray(np.linalg.solve(A, b))
    except np.linalg.LinAlgError:
        singular = np.linalg.slogdet(A)[0] == 0.0
        x: FloatArray = np.linalg.solve(np.where(singular[:, None, None], np.eye(A.shape[-1]), A), b)
        x[singular] = np.nan
        return x


def with_probes(b: FloatArray) -> FloatArray:
    """Return right sides (n, m, k) with further ones before them, by which `inverse_norms` sees A⁻¹."""
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (b.shape[1], PROBES))
    return np.concatenate((np.broadcast_to(signs, (*b.shape[:2], PROBES)), b), axis=2)


def inverse_norms(x: FloatArray) -> FloatArray:
    """Return estimates (n,) of the Frobenius norms of A⁻¹ from solutions for `with_probes`.

    The mean square of A⁻¹ e over all vectors e of signs is the square of the norm; over a few of them it is
    less than a hundredth of that once in millions of matrices, for which there is room in every limit.
    """
    probes = x[:, :, :PROBES]
    return np.asarray(np.sqrt(np.einsum("nij,nij->n", probes, probes) / PROBES))


def independent_rows(A: FloatArray, count: int, given: Sequence[int] | IndexArray = ()) -> IndexArray:
    """Return the indices of `count` rows of A (m, n), fewer if there are not so many, far from dependent."""
    left, chosen = A.copy(), [int(i) for i in given]
    least = 1e-6 * np.abs(A).max(initial=0.0)
    for k in range(len(chosen) + count):
        row = chosen[k] if k < len(given) else int(np.argmax(np.sum(left**2, axis=1))) if len(left) else 0
        size = np.linalg.norm(left[row]) if len(left) else 0.0
        if size <= least:
            break
        left -= np.outer(left @ left[row], left[row]) / size**2
        if k >= len(given):
            chosen.append(row)
    return np.array(chosen[len(given) :], dtype=int)


def norms(A: FloatArray) -> FloatArray:
    """Return the Frobenius norms (n,) of stacked matrices."""
    return np.asarray(np.sqrt(np.einsum("nij,nij->n", A, A)))


def largest(values: FloatArray) -> FloatArray:
    """Return the largest absolute values (n,) of rows (n, m), zero for empty ones."""
    return np.asarray(np.abs(values).max(axis=1, initial=0.0))


def sized(rows: int, columns: int) -> int:
    """Return how many samples with matrices of such a size are treated together, for the cache's sake."""
    return max(FEW, min(BLOCK, _CACHE // max(1, 8 * rows * columns)))


def blocks(count: int, size: int = BLOCK) -> Iterator[IndexArray]:
    """Return the samples in blocks of at most `size`."""
    return (np.arange(i, min(i + size, count)) for i in range(0, count, size))
