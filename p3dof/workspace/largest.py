"""The largest box of poses |y| ≤ Y, |θ| ≤ Θ, of a height in z, within a workspace."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from p3dof.checks import FloatArray
from p3dof.errors import InputError
from p3dof.workspace.boxes import box_margins
from p3dof.workspace.region import Region

_GRID, _ROUNDS = 41, 14
"""Points of each search in each direction, and how often it looks five times closer."""
_SEEN = 161
"""Points in each direction at which a condition is looked at."""


@dataclass(frozen=True)
class Box:
    """A box of poses: any y, z, θ of these ranges at once.

    Parameters
    ----------
    y, z : tuple of two floats
        From and to [m].
    theta : tuple of two floats
        From and to [rad].
    """

    y: tuple[float, float]
    z: tuple[float, float]
    theta: tuple[float, float]

    @property
    def height(self) -> float:
        """In z [m]."""
        return self.z[1] - self.z[0]

    @property
    def area(self) -> float:
        """In y and z [m²]."""
        return (self.y[1] - self.y[0]) * self.height

    @property
    def volume(self) -> float:
        """In y, z and θ [m² rad]."""
        return self.area * (self.theta[1] - self.theta[0])


def largest_box(region: Region, tilt: float | None) -> Box:
    """Return the box of the largest volume, or of the largest area for one tilt.

    Parameters
    ----------
    region : Region
        Stroke, tilt, margins and a condition.
    tilt : float, optional
        Θ [rad]; the best one without it.

    Returns
    -------
    Box

    Raises
    ------
    InputError
        If no box around home's y and θ is left.
    """
    most = min(-region.tilt[0], region.tilt[1])
    turned = (0.0, most) if tilt is None else (tilt, tilt)
    fits = _condition(region)
    across = (0.0, region.reach)
    best, y, theta = -1.0, 0.0, 0.0
    for _ in range(_ROUNDS):
        Y = _between(across, _GRID)[:, None]
        T = _between(turned, _GRID if tilt is None else 1)[None, :]
        found = box_margins(region.sizes, (-Y, Y), (-T, T), region.travel)
        margins = region.margins
        good = (found.serial >= margins.serial) & (found.actuation >= margins.actuation) & (found.height >= 0)
        size = np.where(good & fits(Y, T), found.height * Y * (T if tilt is None else 1.0), -1.0)
        i, k = np.unravel_index(int(np.argmax(size)), size.shape)
        if size[i, k] >= best:
            best, y, theta = float(size[i, k]), float(Y[i, 0]), float(T[0, k])
        across, turned = _closer(across, y, region.reach), _closer(turned, theta, most)
    if not best > 0:
        raise InputError("largest_box: no box around y = 0, theta = 0 is within the limits and margins")
    last = box_margins(region.sizes, (-y, y), (-theta, theta), region.travel)
    low, high = region.limits.travel
    return Box((-y, y), (float(low - last.lowest), float(high - last.highest)), (-theta, theta))


def _between(ends: tuple[float, float], count: int) -> FloatArray:
    return np.asarray(np.linspace(*ends, count), dtype=np.float64)


def _closer(ends: tuple[float, float], best: float, most: float) -> tuple[float, float]:
    """Return a range of a fifth of the length around the best place, within 0 and the most."""
    half = (ends[1] - ends[0]) / 10
    return max(best - half, 0.0), min(best + half, most)


def _condition(region: Region) -> Callable[[FloatArray, FloatArray], NDArray[np.bool_]]:
    """Return a function of Y (n, 1) and Θ (1, m): whether a condition holds in all of the box.

    It is looked at on a grid, and its least value over a box taken as linear between the boxes of the grid.
    """
    if region.condition is None:
        return lambda Y, T: np.ones(np.broadcast_shapes(Y.shape, T.shape), dtype=bool)
    from scipy.interpolate import RegularGridInterpolator

    Y, T = (np.linspace(0, most, _SEEN) for most in (region.reach, max(-region.tilt[0], region.tilt[1])))
    least: FloatArray = np.full((_SEEN, _SEEN), np.inf)
    for side in (-1, 1):
        for turn in (-1, 1):
            y, theta = (g.ravel() for g in np.meshgrid(side * Y, turn * T, indexing="ij"))
            values = np.nan_to_num(region.condition(y, theta), nan=-1.0)
            least = np.minimum(least, values.reshape(least.shape))
    worst = np.minimum.accumulate(np.minimum.accumulate(least, axis=0), axis=1)
    between = RegularGridInterpolator((Y, T), worst, bounds_error=False, fill_value=-1.0)
    return lambda Y, T: np.asarray(between(tuple(np.broadcast_arrays(Y, T))) >= 0)
