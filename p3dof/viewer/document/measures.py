"""Sizes that suit any scene: of a floor's mesh, of a drawing; and points one above the other."""

from __future__ import annotations

import math

import numpy as np

from p3dof._base.checks import FloatArray

_USUAL = (0.25, 1.5)
"""Sizes of machines that are drawn as they are [m]: MeshCat's lights and near plane are made for metres."""


def enlargement(half: float) -> float:
    """Return by how much something is drawn larger than it is: 1 unless its half size is far from a metre."""
    return 1.0 if _USUAL[0] < half < _USUAL[1] else 0.6 / half


def mesh_of(half: float) -> float:
    """Return the distance between the lines of a floor: 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(half / 4))
    return power * max(step for step in (1, 2, 5) if step * power <= half / 4)


def above(points: FloatArray, height: float) -> FloatArray:
    """Return points, shape (..., 3), so much higher [m]."""
    return np.asarray(points + np.array([0.0, 0.0, height]))
