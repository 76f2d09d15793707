"""Triangles of Pinocchio's shapes, and fewer of them where there are too many."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray

_AROUND, _UP = 24, 12
"""How many corners a round shape has around its axis and along it."""
_TRIES = 40


class Triangles(NamedTuple):
    """A mesh.

    Parameters
    ----------
    corners : ndarray, shape (n, 3)
        [m]
    faces : ndarray of int, shape (m, 3)
        Counter-clockwise from outside.
    """

    corners: FloatArray
    faces: NDArray[np.int_]


def triangles_of(geometry: Any) -> Triangles | None:
    """Return the triangles of a shape that is no box, sphere, cylinder or capsule.

    Parameters
    ----------
    geometry : coal.CollisionGeometry
        A mesh as Pinocchio has loaded it, in metres, a convex body, an ellipsoid or a cone.

    Returns
    -------
    Triangles or None
        None for what has none, such as a plane without end.
    """
    kind = type(geometry).__name__
    if kind.startswith("BVHModel"):
        count = int(geometry.num_tris)
        indices = (geometry.tri_indices(i) for i in range(count))
        faces = np.array([(one[0], one[1], one[2]) for one in indices], dtype=int).reshape(-1, 3)
        return Triangles(np.array(geometry.vertices(), dtype=float).reshape(-1, 3), faces)
    if kind.startswith("Convex"):
        polygons = (geometry.polygons(i) for i in range(int(geometry.num_polygons)))
        faces = np.array([(one[0], one[1], one[2]) for one in polygons], dtype=int).reshape(-1, 3)
        return Triangles(np.array(geometry.points(), dtype=float).reshape(-1, 3), faces)
    if kind == "Ellipsoid":
        inner = [(math.sin(a), -math.cos(a)) for a in np.linspace(0.0, math.pi, _UP + 1)[1:-1]]
        ball = _turned([(0.0, -1.0), *inner, (0.0, 1.0)])
        return Triangles(ball.corners * np.ravel(geometry.radii), ball.faces)
    if kind == "Cone":
        radius, half = float(geometry.radius), float(geometry.halfLength)
        return _turned([(0.0, -half), (radius, -half), (0.0, half)])
    return None


def _turned(profile: list[tuple[float, float]]) -> Triangles:
    """Return the body that a profile of (radius, height), from below to above, makes around z."""
    angles = 2 * np.pi * np.arange(_AROUND) / _AROUND
    rings = [np.column_stack((r * np.cos(angles), r * np.sin(angles), 0 * angles + z)) for r, z in profile]
    i = np.arange(_AROUND)
    j, faces = (i + 1) % _AROUND, []
    for k in range(len(profile) - 1):
        low, high = k * _AROUND, (k + 1) * _AROUND
        faces += [
            np.column_stack((low + i, low + j, high + j)),
            np.column_stack((low + i, high + j, high + i)),
        ]
    return whole(Triangles(np.concatenate(rings), np.concatenate(faces)))


def whole(mesh: Triangles) -> Triangles:
    """Return a mesh with each corner once, and without triangles that have no area."""
    corners, places = np.unique(mesh.corners, axis=0, return_inverse=True)
    return _without_flat(corners, places.reshape(-1)[mesh.faces])


def _without_flat(corners: FloatArray, faces: NDArray[np.int_]) -> Triangles:
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    used, places = np.unique(faces, return_inverse=True)
    return Triangles(corners[used], places.reshape(-1, 3))


def reduced(mesh: Triangles, most: int) -> Triangles:
    """Return a mesh with at most so many triangles: corners that are near each other become one.

    Parameters
    ----------
    mesh : Triangles
        The mesh.
    most : int
        How many triangles it may have.

    Returns
    -------
    Triangles
        With the finest of the grids tried whose cells have one corner each.
    """
    if len(mesh.faces) <= most:
        return mesh
    size = float(np.ptp(mesh.corners, axis=0).max())
    fine, coarse = 1e-4 * size, size
    best = Triangles(np.zeros((0, 3)), np.zeros((0, 3), dtype=int))
    for _ in range(_TRIES):
        cell = math.sqrt(fine * coarse)
        found = _clustered(mesh, cell)
        if len(found.faces) <= most:
            best, coarse = found, cell
        else:
            fine = cell
        if coarse < 1.02 * fine:
            break
    return best


def _clustered(mesh: Triangles, cell: float) -> Triangles:
    """Return a mesh whose corners in a cell of a grid are one, in their mean."""
    places = np.floor(mesh.corners / cell).astype(np.int64)
    _, which, counts = np.unique(places, axis=0, return_inverse=True, return_counts=True)
    which = which.reshape(-1)
    sums = [np.bincount(which, weights=column, minlength=len(counts)) for column in mesh.corners.T]
    found = _without_flat(np.column_stack(sums) / counts[:, None], which[mesh.faces])
    _, once = np.unique(np.sort(found.faces, axis=1), axis=0, return_index=True)
    return Triangles(found.corners, found.faces[np.sort(once)])
