"""The platform's skin: one mesh around its solids, without their seams."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof.machine.parameters import Dimensions

_PROUD = 1.04
"""How much larger the platform's skin is than its solids."""


def skin_of(r: float, size: Dimensions) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return vertices and faces of the plate: the triangle A3 B3 C5 about P, widened by the corner radius."""
    corners = np.array([(0.0, r), (-r, 0.0), (0.0, -r)])  # B3, C5, A3, counter-clockwise
    turns = [(0.0, 3 / 4), (3 / 4, 5 / 4), (5 / 4, 2.0)]  # π times where the edges beside them face
    angles = np.concatenate([np.linspace(start * np.pi, end * np.pi, 13) for start, end in turns])
    around = np.repeat(corners, 13, axis=0)
    rim = around + size.corner_radius * _PROUD * np.stack((np.cos(angles), np.sin(angles)), axis=-1)
    half = size.plate_thickness / 2 * _PROUD
    low, high = (np.column_stack((rim, np.full(len(rim), z))) for z in (-half, half))
    vertices = np.concatenate((low, high, low, high))  # the walls, then the covers: edges stay sharp
    n = len(rim)
    i = np.arange(n)
    j, fan = (i + 1) % n, np.arange(1, n - 1)
    walls = np.concatenate((np.stack((i, j, n + j), axis=1), np.stack((i, n + j, n + i), axis=1)))
    cover = np.stack((np.zeros_like(fan), fan, fan + 1), axis=1)
    return vertices, np.concatenate((walls, 2 * n + cover[:, ::-1], 3 * n + cover))
