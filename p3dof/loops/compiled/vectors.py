"""Vectors of three and 3 x 3 matrices of numbers that may be symbols; rows first."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from p3dof._base.tracing import Number

Vector: TypeAlias = tuple[Number, Number, Number]
Matrix: TypeAlias = tuple[Vector, Vector, Vector]

_SNAP = 1e-14
"""Entries below this part of a size are rounding of angles in a file, and become zero."""

ZERO: Vector = (0.0, 0.0, 0.0)
IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
NOTHING: Matrix = (ZERO, ZERO, ZERO)


def numbers(values: Sequence[float], size: float = 1.0) -> Vector:
    """Return three known numbers; those that are nothing beside a size become zero."""
    x, y, z = (_snapped(float(value), size) for value in values)
    return x, y, z


def matrix_of(values: np.ndarray, size: float = 1.0) -> Matrix:
    """Return a known matrix; entries that are nothing beside a size become zero."""
    a, b, c = (numbers(row, size) for row in np.asarray(values))
    return a, b, c


def _snapped(value: float, size: float) -> float:
    if abs(value) <= _SNAP * size:
        return 0.0
    for whole in (1.0, -1.0):
        if abs(value - whole) < _SNAP:
            return whole
    return value


def plus(a: Vector, *others: Vector) -> Vector:
    """Return a sum."""
    x, y, z = a
    for b in others:
        x, y, z = x + b[0], y + b[1], z + b[2]
    return x, y, z


def minus(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def times(factor: Number, a: Vector) -> Vector:
    """Return a multiple."""
    return factor * a[0], factor * a[1], factor * a[2]


def dot(a: Sequence[Number], b: Sequence[Number]) -> Number:
    """Return a · b."""
    total: Number = 0.0
    for x, y in zip(a, b, strict=True):
        total = total + x * y
    return total


def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def turned(R: Matrix, a: Vector) -> Vector:
    """Return R a."""
    return dot(R[0], a), dot(R[1], a), dot(R[2], a)


def transposed(R: Matrix) -> Matrix:
    """Return the transposed matrix."""
    return (
        (R[0][0], R[1][0], R[2][0]),
        (R[0][1], R[1][1], R[2][1]),
        (R[0][2], R[1][2], R[2][2]),
    )


def back(R: Matrix, a: Vector) -> Vector:
    """Return Rᵀ a."""
    return turned(transposed(R), a)


def product(A: Matrix, B: Matrix) -> Matrix:
    """Return A B."""
    columns = transposed(B)
    x, y, z = ((dot(row, columns[0]), dot(row, columns[1]), dot(row, columns[2])) for row in A)
    return x, y, z


def added(A: Matrix, B: Matrix) -> Matrix:
    """Return A + B."""
    return plus(A[0], B[0]), plus(A[1], B[1]), plus(A[2], B[2])


def outer(a: Vector, b: Vector) -> Matrix:
    """Return a bᵀ."""
    return times(a[0], b), times(a[1], b), times(a[2], b)


def rate_matrix(omega: Vector, alpha: Vector) -> Matrix:
    """Return [α]x + [ω]x [ω]x: what the acceleration of points of a body has by their places."""
    x, y, z = omega
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    return (
        (-(yy + zz), xy - alpha[2], xz + alpha[1]),
        (xy + alpha[2], -(xx + zz), yz - alpha[0]),
        (xz - alpha[1], yz + alpha[0], -(xx + yy)),
    )


def axial(A: Matrix) -> Vector:
    """Return the vector of A - Aᵀ: that of [a]x is 2 a."""
    return A[2][1] - A[1][2], A[0][2] - A[2][0], A[1][0] - A[0][1]
