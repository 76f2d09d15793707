"""Linear algebra on stacks of small arrays: the first axis counts samples."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from p3dof.checks import FloatArray

IndexArray = NDArray[np.int_]
BoolArray = NDArray[np.bool_]

BLOCK = 1024
"""Samples that are treated together: enough to make calls cheap, few enough for the processor's cache."""
FEW = 8
"""Fewer samples than this are treated one by one, which is as fast."""


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


def independent_rows(A: FloatArray, count: int, given: Sequence[int] | IndexArray = ()) -> IndexArray:
    """Return the indices of `count` rows of A (m, n), fewer if there are not so many, far from dependent.

    Parameters
    ----------
    A : (m, n) array
        The matrix.
    count : int
        How many rows to choose.
    given : sequence of int
        Rows that are chosen already.

    Returns
    -------
    array of int
    """
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


def blocks(count: int, size: int = BLOCK) -> Iterator[IndexArray]:
    """Return the samples in blocks of at most `size`."""
    return (np.arange(i, min(i + size, count)) for i in range(0, count, size))
