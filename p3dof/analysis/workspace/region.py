"""A region of (y, θ) as ranges of θ at each y, and points to integrate over it by."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof.analysis.workspace.closed_forms import (
    Sizes,
    aspect_range,
    height,
    offsets,
    reach_range,
    stroke_range,
    theta_of,
)
from p3dof.analysis.workspace.margins import HORIZON, WorkspaceMargins
from p3dof.machine.parameters import Limits

Condition: TypeAlias = Callable[[FloatArray, FloatArray], FloatArray]
"""Takes y and θ (n,), returns a number that is 0 or more where the condition holds; NaN where it does not."""

Switches: TypeAlias = Callable[[FloatArray], FloatArray]
"""Takes y (n,), returns numbers (k, n) that change their signs at kinks."""

_SEARCHED = 65
"""Points of a range at which a condition is looked at: what begins and ends between two of them is missed."""
_ACROSS = 257  # the same for y
_HALVINGS = 44
_PANELS, _MORE, _POINTS = 4, 24, 10
"""Panels of each smooth piece of y, where a condition may have kinks of its own, and Gauss points in each."""
_ALONG = 20  # Gauss points along each smooth piece of a range of θ


class Ranges(NamedTuple):
    """Ranges of one variable in rows of another; a row may have any number of them."""

    row: NDArray[np.intp]  # (n,): to which row each belongs
    low: FloatArray  # (n,): their ends
    high: FloatArray


class Points(NamedTuple):
    """Points in (y, θ), and weights by which values there sum up to integrals."""

    y: FloatArray  # (n,): the points [m, rad]
    theta: FloatArray
    area: FloatArray  # (n,): weights for an integral over dy dθ [m rad]
    volume: FloatArray  # (n,): weights for an integral over dy dz dθ [m² rad]: the same times the height H


def ranges_where(
    condition: Condition, rows: FloatArray, low: FloatArray, high: FloatArray, samples: int = _SEARCHED
) -> Ranges:
    """Return where a condition holds between ends in each row, exact to rounding."""
    t = np.linspace(0, 1, samples)
    grid = low[:, None] + (high - low)[:, None] * t
    good = _holds(condition, np.broadcast_to(rows[:, None], grid.shape), grid)
    edges = np.diff(good.astype(np.int8), axis=1, prepend=0, append=0)
    begins, ends = np.argwhere(edges == 1), np.argwhere(edges == -1)
    row = begins[:, 0]
    starts = _border(condition, rows[row], grid, row, begins[:, 1], begins[:, 1] - 1)
    stops = _border(condition, rows[row], grid, row, ends[:, 1] - 1, ends[:, 1])
    return Ranges(row, starts, stops)


def _holds(condition: Condition, rows: FloatArray, values: FloatArray) -> NDArray[np.bool_]:
    found = np.asarray(condition(rows.ravel(), values.ravel())) >= 0  # NaN is no
    return found.reshape(values.shape)


def _border(
    condition: Condition,
    rows: FloatArray,
    grid: FloatArray,
    row: NDArray[np.intp],
    inner: NDArray[np.intp],
    outer: NDArray[np.intp],
) -> FloatArray:
    """Bisect between a point of the grid where the condition holds and its neighbour where it does not."""
    last = grid.shape[1] - 1
    at_end = (outer < 0) | (outer > last)
    good, bad = grid[row, inner], grid[row, np.clip(outer, 0, last)]
    for _ in range(_HALVINGS if not at_end.all() else 0):
        middle = (good + bad) / 2
        holds = _holds(condition, rows, middle)
        good, bad = np.where(holds, middle, good), np.where(holds, bad, middle)
    return good


class Region:
    """Poses (y, θ) of home's aspect within stroke, tilt and margins, and a further condition."""

    def __init__(
        self, sizes: Sizes, limits: Limits, margins: WorkspaceMargins, condition: Condition | None = None
    ) -> None:
        self.sizes, self.limits, self.margins, self.condition = sizes, limits, margins, condition
        self.travel = limits.travel[1] - limits.travel[0]
        self.tilt = max(limits.tilt[0], -HORIZON), min(limits.tilt[1], HORIZON)

    @property
    def reach(self) -> float:
        """Largest |y| that the legs A and B leave [m]; may be negative: then nothing is left."""
        rest = self.sizes.L * np.sqrt((1 - self.margins.serial) * (1 + self.margins.serial))
        return float(rest - self.sizes.width)

    def within(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return least and largest θ at each y, whatever the stroke (N,) [rad]; NaN where none."""
        lower, upper = aspect_range(self.sizes, y, self.margins.serial, self.margins.actuation)
        lower, upper = np.maximum(lower, self.tilt[0]), np.minimum(upper, self.tilt[1])
        empty = ~(lower <= upper)
        return np.where(empty, np.nan, lower), np.where(empty, np.nan, upper)

    def ranges(self, y: FloatArray) -> Ranges:
        """Return the ranges of θ at each y, within the stroke and where the condition holds."""
        lower, upper = stroke_range(self.sizes, y, *self.within(y), self.travel)
        if self.condition is None:
            row = np.flatnonzero(np.isfinite(lower))
            return Ranges(row, lower[row], upper[row])
        return ranges_where(self.condition, y, lower, upper)

    def contains(self, y: FloatArray, theta: FloatArray) -> FloatArray:
        """Return 0 or more where poses are within the region, for some z, (n,)."""
        lower, upper = self.within(y)
        found = np.minimum(np.minimum(theta - lower, upper - theta), self.height(y, theta))
        if self.condition is not None:
            found = np.minimum(found, self.condition(y, theta))
        return np.asarray(found)

    def height(self, y: FloatArray, theta: FloatArray) -> FloatArray:
        """Return the height that the stroke leaves, negative where it leaves none [m]."""
        found: FloatArray = height(self.sizes, y, theta, self.travel)
        return found

    def rows(self, condition: Condition, switches: Switches) -> tuple[FloatArray, FloatArray]:
        """Return y and weights (N,) [m] for integrals over y where a condition of (any, y) holds.

        Where one of `switches` changes its sign, the integrand may have a kink: there it is cut into pieces.
        """
        edge = np.array([self.reach])
        if not edge[0] > 0:
            return np.empty(0), np.empty(0)
        found = ranges_where(condition, np.zeros(1), -edge, edge, _ACROSS)
        pieces = [_cut(switches, low, high) for low, high in zip(found.low, found.high, strict=True)]
        low = np.concatenate([np.empty(0), *(ends[:-1] for ends in pieces)])
        high = np.concatenate([np.empty(0), *(ends[1:] for ends in pieces)])
        return _gauss_of_cosines(low, high, _PANELS if self.condition is None else _MORE)

    def switches(self, y: FloatArray) -> FloatArray:
        """Return what changes its sign where the ranges of θ, or H at their ends, have kinks (k, N)."""
        raw = aspect_range(self.sizes, y, self.margins.serial, self.margins.actuation)
        ends = reach_range(self.sizes, y, self.margins.serial)  # the aspect may end where leg C's reach does
        found = [raw[0] - self.tilt[0], raw[1] - self.tilt[1], y, raw[0] + ends, ends - raw[1]]
        for theta in self.within(y):
            found += [*self.crossings(y, theta), self.height(y, theta)]
        return np.stack(found)

    def crossings(self, y: FloatArray, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ℓC less ℓA and ℓB: where they change their sign, H has a kink."""
        a, b, c = offsets(self.sizes, y, theta)
        return c - a, c - b

    def points(self) -> Points:
        """Return points and weights to integrate over the region by."""
        y, weights = self.rows(lambda _, y: self._exists(y), self.switches)
        row, low, high = self.ranges(y)
        a, b, _ = offsets(self.sizes, y[row], low)
        kinks = []
        for value in (np.minimum(a, b), np.maximum(a, b)):  # where ℓC passes ℓA or ℓB, H has a kink
            above = offsets(self.sizes, y[row], (low + high) / 2)[2] > value
            kink = theta_of(self.sizes, y[row], value)
            kinks.append(np.clip(np.where(np.isnan(kink), np.where(above, low, high), kink), low, high))
        ends = np.stack([low, *kinks, high])
        t, w = _gauss(_ALONG)
        theta = ends[:-1, :, None] + (ends[1:] - ends[:-1])[:, :, None] * t
        area = weights[row][:, None] * (ends[1:] - ends[:-1])[:, :, None] * w
        across = np.broadcast_to(y[row][:, None], theta.shape).ravel()
        theta, area = theta.ravel(), area.ravel()
        rise = np.maximum(np.nan_to_num(self.height(across, theta)), 0.0)
        return Points(across, theta, area, area * rise)

    def _exists(self, y: FloatArray) -> FloatArray:
        """Return 0 where there is some range of θ at y, less where there is none."""
        lower, upper = stroke_range(self.sizes, y, *self.within(y), self.travel)
        found = np.isfinite(lower)
        if self.condition is not None:
            grid = lower[:, None] + (upper - lower)[:, None] * np.linspace(0, 1, _SEARCHED)
            found &= _holds(self.condition, np.broadcast_to(y[:, None], grid.shape), grid).any(axis=1)
        return np.where(found, 0.0, -1.0)


def _gauss(order: int) -> tuple[FloatArray, FloatArray]:
    """Return points and weights on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(order)
    return (x + 1) / 2, w / 2


def _cut(switches: Switches, low: float, high: float) -> FloatArray:
    """Return the ends of a piece and the places between at which a switch changes its sign, sorted."""
    grid = np.asarray(np.linspace(low, high, _ACROSS), dtype=np.float64)
    positive = np.nan_to_num(switches(grid), nan=-1.0) > 0
    which, where = np.nonzero(positive[:, 1:] != positive[:, :-1])
    left, right, sign = grid[where], grid[where + 1], positive[which, where]
    if not len(which):
        return np.array([low, high])
    for _ in range(_HALVINGS):
        middle = (left + right) / 2
        same = (np.nan_to_num(switches(middle), nan=-1.0) > 0)[which, np.arange(len(which))] == sign
        left, right = np.where(same, middle, left), np.where(same, right, middle)
    ends = np.sort(np.concatenate([[low], left, [high]]))
    apart = np.concatenate([[True], np.diff(ends) > 1e-9 * (high - low)])
    return np.asarray(ends[apart])


def _gauss_of_cosines(low: FloatArray, high: FloatArray, panels: int) -> tuple[FloatArray, FloatArray]:
    """Return points and weights for pieces, closer at their ends, where ranges may close like a root."""
    x, w = _gauss(_POINTS)
    phi = (np.pi / panels * (np.arange(panels)[:, None] + x)).ravel()
    weight = np.tile(np.pi / panels * w, panels) * np.sin(phi)
    half = (high - low)[:, None] / 2
    y = (low + high)[:, None] / 2 - half * np.cos(phi)
    return y.ravel(), (half * weight).ravel()
