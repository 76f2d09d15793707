"""Surfaces of the shapes of a document: triangles, and normals where they are round."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof.viewer.document.encoding import decoded

AROUND = 24
"""Corners around a round shape."""
_ARC = 6
"""Rings of a quarter of a circle."""


class Surface(NamedTuple):
    """A surface of triangles.

    Parameters
    ----------
    corners : ndarray, shape (n, 3)
        [m]
    normals : ndarray, shape (n, 3), or None
        At the corners; None where faces are flat.
    faces : ndarray of int, shape (m, 3)
        Counter-clockwise from outside.
    """

    corners: FloatArray
    normals: FloatArray | None
    faces: NDArray[np.int_]


def surface_of(shape: Mapping[str, Any]) -> Surface:
    """Return the surface of a shape of a document.

    Parameters
    ----------
    shape : mapping
        A box, sphere, cylinder, capsule or mesh.

    Returns
    -------
    Surface
    """
    kind = shape["kind"]
    if kind == "box":
        return _box(np.asarray(shape["size"], dtype=float) / 2)
    if kind == "mesh":
        corners = decoded(shape["positions"]).astype(float)
        if "scale" in shape:
            corners = corners * shape["scale"] + np.asarray(shape["offset"])
        return Surface(corners, None, decoded(shape["indices"]).astype(int))
    radius, half = float(shape["radius"]), float(shape.get("length", 0.0)) / 2
    if kind == "cylinder":
        below, above = (0.0, -1.0), (0.0, 1.0)
        side = ((radius, -half, 1.0, 0.0), (radius, half, 1.0, 0.0))
        lid, bottom = (
            ((radius, half, *above), (0.0, half, *above)),
            ((0.0, -half, *below), (radius, -half, *below)),
        )
        return turned([*bottom, *side, *lid])
    angles = np.linspace(-math.pi / 2, math.pi / 2, 2 * _ARC + 1)
    rings = [(math.cos(a), math.sin(a)) for a in angles]
    rings[0], rings[-1] = (0.0, -1.0), (0.0, 1.0)
    middle = _ARC if half == 0.0 else _ARC + 1  # the equator of a capsule is there twice
    lower = [(radius * c, radius * s - half, c, s) for c, s in rings[:middle]]
    return turned([*lower, *((radius * c, radius * s + half, c, s) for c, s in rings[_ARC:])])


def turned(profile: Sequence[tuple[float, float, float, float]], around: int = AROUND) -> Surface:
    """Return the surface that a profile makes around z.

    Parameters
    ----------
    profile : sequence of (radius, height, radial normal, axial normal)
        From below to above, outside on the right.
    around : int
        Corners around the axis.

    Returns
    -------
    Surface
        Without triangles that have no area.
    """
    angles = 2 * np.pi * np.arange(around) / around
    cos, sin, one = np.cos(angles), np.sin(angles), np.ones(around)
    corners = np.concatenate([np.column_stack((r * cos, r * sin, z * one)) for r, z, _, _ in profile])
    normals = np.concatenate([np.column_stack((r * cos, r * sin, z * one)) for _, _, r, z in profile])
    i = np.arange(around)
    j = (i + 1) % around
    faces: list[NDArray[np.int_]] = [np.zeros((0, 3), dtype=int)]
    for k, (low, high) in enumerate(pairwise(profile)):
        here, there = k * around, (k + 1) * around
        if low[:2] == high[:2]:
            continue
        if low[0] > 0:
            faces.append(np.column_stack((here + i, here + j, there + j)))
        if high[0] > 0:
            faces.append(np.column_stack((here + i, there + j, there + i)))
    return Surface(corners, normals, np.concatenate(faces))


def _box(half: FloatArray) -> Surface:
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
    return Surface(signs * half, None, np.array(faces))
