"""Mass, mass centre, inertia as components, and those of solids: a formula for numbers, arrays and symbols.

Only ``+ - * /`` is used. `p3dof.machine.parameters.solids` makes bodies of them, `p3dof.analysis.designs`
columns.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import ParameterError

Scalar: TypeAlias = Any
"""A number, an array or a symbol; as in `p3dof._base.algebra`, which Pinocchio's way must not know."""

Vector: TypeAlias = tuple[Scalar, Scalar, Scalar]
Matrix: TypeAlias = tuple[Vector, Vector, Vector]


class Inertial(NamedTuple):
    """Mass, mass centre and inertia about it, in the `Body` axes: numbers, arrays or symbols."""

    mass: Scalar
    com: Vector
    inertia: Matrix


def inertial_of_box(size: Vector, density: Scalar) -> Inertial:
    """Return mass and inertia of a solid box about its middle.

    Parameters
    ----------
    size : tuple
        Edges along x, y, z [m].
    density : number, array or symbol
        [kg/m³]

    Returns
    -------
    Inertial
    """
    x, y, z = size
    mass = density * x * y * z
    twelfth = mass / 12
    return Inertial(
        mass, (0, 0, 0), _diagonal(*(twelfth * (a * a + b * b) for a, b in ((y, z), (x, z), (x, y))))
    )


def inertial_of_cylinder(
    radius: Scalar, length: Scalar, axis: int, start: Scalar, density: Scalar
) -> Inertial:
    """Return mass and inertia of a solid cylinder along one of the axes.

    Parameters
    ----------
    radius, length : number, array or symbol
        Sizes [m].
    axis : int
        0, 1 or 2.
    start : number, array or symbol
        Coordinate of its first end on that axis [m].
    density : number, array or symbol
        [kg/m³]

    Returns
    -------
    Inertial
    """
    mass = density * math.pi * (radius * radius) * length
    across, along = mass * (3 * (radius * radius) + length * length) / 12, mass * (radius * radius) / 2
    com, moments = [0, 0, 0], [across, across, across]
    com[axis], moments[axis] = start + length / 2, along
    return Inertial(mass, (com[0], com[1], com[2]), _diagonal(*moments))


def inertial_of_plate(
    corners: FloatArray, size: Scalar, radius: Scalar, thickness: Scalar, density: Scalar
) -> Inertial:
    """Return mass and inertia of a plate: a triangle widened all round by a radius, of constant thickness.

    Parameters
    ----------
    corners : ndarray, shape (3, 2)
        Corners of the triangle of size one in the plane x, y.
    size : number, array or symbol
        What to multiply the triangle by [m].
    radius, thickness : number, array or symbol
        By how much the triangle is widened, and the thickness along z, half of it on either side [m].
    density : number, array or symbol
        [kg/m³]

    Returns
    -------
    Inertial

    Raises
    ------
    ParameterError
        If the corners are on one line.
    """
    pieces = _pieces(corners, size, radius)
    total = _sum(area for area, _, _ in pieces)
    centre = [_sum(area * point[k] for area, point, _ in pieces) / total for k in (0, 1)]
    second = [[_second(pieces, centre, i, j) for j in (0, 1)] for i in (0, 1)]  # ∫ d dᵀ dA
    across, mass = total * (thickness * thickness) / 12, density * thickness
    xx, yy, zz = second[1][1] + across, second[0][0] + across, second[0][0] + second[1][1]
    xy = -(mass * second[0][1])
    inertia = ((mass * xx, xy, 0), (xy, mass * yy, 0), (0, 0, mass * zz))
    return Inertial(mass * total, (centre[0], centre[1], 0), inertia)


_Piece = tuple[Scalar, tuple[Scalar, Scalar], "list[list[Scalar]]"]
"""Area, centroid and ∫ d dᵀ dA about it."""


def _second(pieces: list[_Piece], centre: list[Scalar], i: int, j: int) -> Scalar:
    return _sum(
        own[i][j] + area * ((point[i] - centre[i]) * (point[j] - centre[j])) for area, point, own in pieces
    )


def _pieces(corners: FloatArray, size: Scalar, radius: Scalar) -> list[_Piece]:
    """Cut the widened triangle into triangle, edge strips and corner sectors."""
    middle = corners.mean(axis=0)
    edges = np.roll(corners, -1, axis=0) - corners
    area = 0.5 * (edges[0, 0] * edges[1, 1] - edges[0, 1] * edges[1, 0])
    if area < 0:  # normals point outward on a counter-clockwise walk
        return _pieces(corners[::-1], size, radius)
    if area <= 1e-12 * float(np.abs(edges).max()) ** 2:
        raise ParameterError("corners: expected a triangle, got three points on a line")
    spokes, size2, radius2 = corners - middle, size * size, radius * radius
    core = (area / 12 * spokes.T @ spokes).tolist()
    pieces: list[_Piece] = [
        (float(area) * size2, _at(size, middle), [[size2 * size2 * m for m in row] for row in core])
    ]
    normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    for corner, edge, normal, previous in zip(
        corners, edges, normals, np.roll(normals, 1, axis=0), strict=True
    ):
        strip = float(np.linalg.norm(edge)) * (size * radius)
        along, across = np.outer(edge, edge).tolist(), np.outer(normal, normal).tolist()
        own = [[strip / 12 * (size2 * along[i][j] + radius2 * across[i][j]) for j in (0, 1)] for i in (0, 1)]
        pieces.append((strip, _at(size, corner + edge / 2, radius, normal / 2), own))
        pieces.append(_sector(size, corner, normal, previous, radius))
    return pieces


def _sector(
    size: Scalar, corner: FloatArray, normal: FloatArray, previous: FloatArray, radius: Scalar
) -> _Piece:
    """Return area, centroid and central second moments of the circular sector at a corner."""
    half = 0.5 * math.acos(float(normal @ previous))  # half the angle of the sector
    axis = (normal + previous) / np.linalg.norm(normal + previous)
    distance = 2 * math.sin(half) / (3 * half)  # all for a radius of one
    wave = math.sin(half) * math.cos(half)
    along, across = (half + wave) / 4 - half * distance**2, (half - wave) / 4
    other = np.array([-axis[1], axis[0]])
    own = (along * np.outer(axis, axis) + across * np.outer(other, other)).tolist()
    radius2 = radius * radius
    fourth = radius2 * radius2
    moments = [[fourth * m for m in row] for row in own]
    return half * radius2, _at(size, corner, radius, distance * axis), moments


def _at(
    size: Scalar, point: FloatArray, radius: Scalar = 0, beside: FloatArray | None = None
) -> tuple[Scalar, Scalar]:
    x, y = (size * float(part) for part in point)
    if beside is None:
        return x, y
    return x + radius * float(beside[0]), y + radius * float(beside[1])


def _sum(terms: Any) -> Scalar:
    first, *others = terms
    for term in others:
        first = first + term
    return first


def _diagonal(x: Scalar, y: Scalar, z: Scalar) -> Matrix:
    return (x, 0, 0), (0, y, 0), (0, 0, z)
