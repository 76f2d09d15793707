"""Vectors and matrices of three, as tuples of components: one formula for numbers, arrays and symbols.

A component may be a Python number, a NumPy array of any batch shape, or a symbol of CasADi or SymPy: only
``+``, ``-`` and ``*`` are used. The Python integers 0, 1 and -1 are *structural*: a product with one of them
is not computed, so the sparse matrices of the mechanism cost what they would cost written out by hand.
"""

from __future__ import annotations

from typing import Any, Protocol, TypeAlias

import numpy as np

Scalar: TypeAlias = Any  # a number, an array of numbers (a batch), or a symbol

Vector: TypeAlias = tuple[Scalar, Scalar, Scalar]  # three components

Matrix: TypeAlias = tuple[Vector, Vector, Vector]  # three rows


class Namespace(Protocol):
    """What a formula needs beyond arithmetic: `numpy`, `casadi` and `sympy` are such namespaces."""

    def sqrt(self, x: Any, /) -> Any:
        """Square root."""

    def sin(self, x: Any, /) -> Any:
        """Sine."""

    def cos(self, x: Any, /) -> Any:
        """Cosine."""

    def tanh(self, x: Any, /) -> Any:
        """Hyperbolic tangent."""


class Ordered(Namespace, Protocol):
    """A namespace whose numbers can be compared: `numpy`, and a tape."""

    def minimum(self, a: Any, b: Any, /) -> Any:
        """Return the smaller of two numbers."""

    def atan2(self, y: Any, x: Any, /) -> Any:
        """Return the angle of the point (x, y)."""


BLOCK = 4096  # samples that a formula computes at once: its intermediate arrays stay in the processor's cache

U1: Vector = (1, 0, 0)
U2: Vector = (0, 1, 0)
U3: Vector = (0, 0, 1)
ZERO: Vector = (0, 0, 0)
IDENTITY: Matrix = (U1, U2, U3)


def times(a: Scalar, b: Scalar) -> Scalar:
    """Return a·b, skipping the arithmetic where a factor is the integer 0, 1 or -1."""
    if type(b) is int:
        a, b = b, a
    if type(a) is int:
        if a == 0:
            return 0
        if a == 1:
            return b
        if a == -1:
            return -b
    return a * b


def plus(a: Scalar, b: Scalar) -> Scalar:
    """Return a + b, skipping the arithmetic where a term is the integer 0."""
    if type(a) is int and a == 0:
        return b
    if type(b) is int and b == 0:
        return a
    return a + b


def add(*vectors: Vector) -> Vector:
    """Return the sum of vectors."""
    total = vectors[0]
    for v in vectors[1:]:
        total = (plus(total[0], v[0]), plus(total[1], v[1]), plus(total[2], v[2]))
    return total


def scale(s: Scalar, v: Vector) -> Vector:
    """Return s·v."""
    return (times(s, v[0]), times(s, v[1]), times(s, v[2]))


def subtract(v: Vector, w: Vector) -> Vector:
    """Return v - w."""
    return add(v, scale(-1, w))


def dot(v: Vector, w: Vector) -> Scalar:
    """Return vᵀw."""
    return plus(plus(times(v[0], w[0]), times(v[1], w[1])), times(v[2], w[2]))


def cross(v: Vector, w: Vector) -> Vector:
    """Return ṽw = v × w."""
    return (
        plus(times(v[1], w[2]), -times(v[2], w[1])),
        plus(times(v[2], w[0]), -times(v[0], w[2])),
        plus(times(v[0], w[1]), -times(v[1], w[0])),
    )


def transpose(A: Matrix) -> Matrix:
    """Return Aᵀ."""
    return ((A[0][0], A[1][0], A[2][0]), (A[0][1], A[1][1], A[2][1]), (A[0][2], A[1][2], A[2][2]))


def apply(A: Matrix, v: Vector) -> Vector:
    """Return A v."""
    return (dot(A[0], v), dot(A[1], v), dot(A[2], v))


def apply_transposed(A: Matrix, v: Vector) -> Vector:
    """Return Aᵀ v."""
    return apply(transpose(A), v)


def product(*matrices: Matrix) -> Matrix:
    """Return the product of matrices."""
    result = matrices[0]
    for B in matrices[1:]:
        columns = transpose(B)
        rows = [(dot(row, columns[0]), dot(row, columns[1]), dot(row, columns[2])) for row in result]
        result = (rows[0], rows[1], rows[2])
    return result


def congruent(A: Matrix, M: Matrix) -> Matrix:
    """Return A M Aᵀ: the matrix M of a quadratic form in other axes."""
    return product(A, M, transpose(A))


def steiner(m: Scalar, d: Vector) -> Matrix:
    """Return m (|d|² 1 - d dᵀ): the inertia of a point mass m at d about the origin."""
    xx, yy, zz = times(d[0], d[0]), times(d[1], d[1]), times(d[2], d[2])
    xy, xz, yz = (-times(times(m, d[i]), d[j]) for i, j in ((0, 1), (0, 2), (1, 2)))
    return (
        (times(m, plus(yy, zz)), xy, xz),
        (xy, times(m, plus(xx, zz)), yz),
        (xz, yz, times(m, plus(xx, yy))),
    )


def matrix_sum(A: Matrix, B: Matrix) -> Matrix:
    """Return A + B."""
    return (add(A[0], B[0]), add(A[1], B[1]), add(A[2], B[2]))


def components(array: Any) -> Vector:
    """Split an array of shape (..., 3), or a sequence of three, into its three components."""
    if isinstance(array, np.ndarray):
        return (array[..., 0], array[..., 1], array[..., 2])
    return (array[0], array[1], array[2])


def vector_array(v: Vector, shape: tuple[int, ...]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Join components that are numbers or arrays into an array of shape (*shape, 3)."""
    array = np.empty((*shape, 3))
    for i in range(3):
        array[..., i] = v[i]
    return array


def matrix_array(A: Matrix, shape: tuple[int, ...]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Join components that are numbers or arrays into an array of shape (*shape, 3, 3)."""
    array = np.empty((*shape, 3, 3))
    for i in range(3):
        array[..., i, :] = vector_array(A[i], shape)
    return array
