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
_FAR_TURN = -0.99
"""Cosine of the largest rotation whose vector is taken; beyond it is NaN."""


def rotation_vector(R: FloatArray) -> FloatArray:
    """Return log3 of rotations (..., 3, 3) as (..., 3) [rad]; NaN for those of more than 170°."""
    s = 0.5 * np.stack(
        (R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]), axis=-1
    )
    sine = np.sqrt(np.sum(s * s, axis=-1))
    cosine = 0.5 * (np.trace(R, axis1=-2, axis2=-1) - 1.0)
    angle = np.arctan2(sine, cosine)
    factor = np.where(sine > 1e-8, angle / np.maximum(sine, 1e-8), 1.0)
    return np.asarray(s * np.where(cosine > _FAR_TURN, factor, np.nan)[..., None])


def turned_rates(turn: FloatArray) -> FloatArray:
    """Return the matrices (..., 3, 3) from ω to the rate of the rotation vector of E, where dE/dt = ω × E.

    Parameters
    ----------
    turn : (..., 3) array
        The rotation vector φ of E [rad].

    Notes
    -----
    The inverse of the left Jacobian of SO(3), 1 - [φ]/2 + (1/φ² - (1 + cos φ)/(2 φ sin φ)) [φ]².
    """
    square = np.sum(turn * turn, axis=-1)
    angle = np.sqrt(np.maximum(square, 1e-4))
    exact = 1.0 / angle**2 - (1.0 + np.cos(angle)) / (2.0 * angle * np.sin(angle))
    factor = np.where(square > 1e-4, exact, 1.0 / 12.0 + square / 720.0)
    across = skew(turn)
    return np.asarray(np.eye(3) - 0.5 * across + factor[..., None, None] * (across @ across))


def skew(a: FloatArray) -> FloatArray:
    """Return the matrices (..., 3, 3) of the cross product with a (..., 3)."""
    result = np.zeros((*a.shape, 3))
    result[..., 0, 1], result[..., 0, 2] = -a[..., 2], a[..., 1]
    result[..., 1, 0], result[..., 1, 2] = a[..., 2], -a[..., 0]
    result[..., 2, 0], result[..., 2, 1] = -a[..., 1], a[..., 0]
    return result


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a × b (..., 3)."""
    x, y, z = (a[..., i] for i in range(3))
    u, v, w = (b[..., i] for i in range(3))
    return np.stack((y * w - z * v, z * u - x * w, x * v - y * u), axis=-1)


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


def blocks(count: int) -> Iterator[IndexArray]:
    """Return the samples in blocks of at most `BLOCK`."""
    return (np.arange(i, min(i + BLOCK, count)) for i in range(0, count, BLOCK))
