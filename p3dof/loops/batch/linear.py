"""Linear algebra on stacks of small arrays: the first axis counts samples."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray

IndexArray = NDArray[np.int_]
BoolArray = NDArray[np.bool_]

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
