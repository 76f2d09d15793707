"""The largest box of poses within a workspace: of all boxes, or of those that are symmetric about home.

A smaller box in a box that fits fits too. So all boxes between the lines of a grid are looked at, and those
of the largest ones that are not near to each other are where the optima begin: sequential quadratic programs
in the ends and the height of the box, whose conditions are the pieces of `box_pieces`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, Readable
from p3dof._base.errors import InputError
from p3dof.analysis.workspace.margins import box_margins, box_pieces
from p3dof.analysis.workspace.region import Points, Region

_LINES = {1: 161, 2: 61, 4: 21}  # of the grid in each direction, by how many numbers make a box
_STARTS, _APART = 8, 2.5
"""How many boxes of the grid optima begin at, and how many lines they are apart in one number at least."""
_SEEN, _LOOKS = 81, 17  # points in each direction at which a condition is looked at over all, and in each box
_PRECISION = 1e-13


@dataclass(frozen=True)
class Box(Readable):
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


class _Family(NamedTuple):
    """Boxes by few numbers: their ends (y0, y1, θ0, θ1) are linear in these."""

    by: FloatArray  # (4, k): ends by numbers
    ends: FloatArray  # (4,): where all numbers are 0
    low: FloatArray  # (k,): bounds of the numbers
    high: FloatArray
    first: FloatArray  # (k,): between which boxes are that have poses in them
    last: FloatArray
    flat: bool  # whether the area in (y, z) counts, at a given range of θ, and not the volume

    def boxes(self, numbers: FloatArray) -> FloatArray:
        """Return the ends of boxes (..., 4) of numbers (..., k)."""
        return np.asarray(numbers @ self.by.T + self.ends)


def largest_box(region: Region, points: Points, tilt: tuple[float, float] | None, symmetric: bool) -> Box:
    """Return the box of the largest volume, or of the largest area for one range of θ."""
    family = _family(region, points, tilt, symmetric)
    numbers, step = _grid(family)
    boxes = family.boxes(numbers)
    sizes = np.where(_holding(region, points, boxes), _sizes(region, family, boxes), -1.0)
    best, largest = None, 0.0
    for start in _apart(numbers, sizes, step):
        ends = _pulled_in(region, family, start, _optimum(region, family, start))
        size = float(_sizes(region, family, ends[None])[0])
        if size > largest:
            best, largest = ends, size
    if best is None:
        where = "around y = 0, theta = 0 " if symmetric else ""
        raise InputError(f"no box of poses {where}is within the limits and margins")
    y, theta = (float(best[0]), float(best[1])), (float(best[2]), float(best[3]))
    found = box_margins(region.sizes, y, theta, region.travel)
    low, high = region.limits.travel
    return Box(y, (float(low - found.lowest), float(high - found.highest)), theta)


def _family(region: Region, points: Points, tilt: tuple[float, float] | None, symmetric: bool) -> _Family:
    most = np.array([(-region.reach, region.reach), region.tilt])
    seen = np.array([(values.min(), values.max()) for values in (points.y, points.theta)])
    each = np.eye(2)
    if symmetric:
        each = np.array([[-1.0], [1.0]])
        most = np.array([(0.0, min(-low, high)) for low, high in most])
        seen = np.array(
            [(0.0, min(max(-low, high), end)) for (low, high), end in zip(seen, most[:, 1], strict=True)]
        )
    count, none = each.shape[1], np.zeros_like(each)
    by = np.block([[each, none], [none, each]])
    low, high, first, last = (np.repeat(ends, count) for ends in (*most.T, *seen.T))
    if tilt is None:
        return _Family(by, np.zeros(4), low, high, first, last, False)
    one = slice(count)
    return _Family(by[:, one], np.array([0, 0, *tilt]), low[one], high[one], first[one], last[one], True)


def _grid(family: _Family) -> tuple[FloatArray, FloatArray]:
    """Return the numbers of boxes whose ends are lines of a grid (m, k), and its steps (k,)."""
    count = _LINES[len(family.low)]
    axes = [np.linspace(*ends, count) for ends in zip(family.first, family.last, strict=True)]
    numbers = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=-1)
    ends = family.boxes(numbers)
    proper = (ends[:, 0] < ends[:, 1]) & ((ends[:, 2] < ends[:, 3]) | family.flat)
    return numbers[proper], (family.last - family.first) / (count - 1)


def _sizes(region: Region, family: _Family, ends: FloatArray) -> FloatArray:
    """Return the volumes (m,) of boxes [m² rad], or areas [m²]; negative where they do not fit."""
    y, theta = (ends[:, 0], ends[:, 1]), (ends[:, 2], ends[:, 3])
    found = box_margins(region.sizes, y, theta, region.travel)
    margins = region.margins
    good = (found.serial >= margins.serial) & (found.actuation >= margins.actuation) & (found.height >= 0)
    size = found.height * (y[1] - y[0]) * (1.0 if family.flat else theta[1] - theta[0])
    return np.where(good, size, -1.0)


def _holding(region: Region, points: Points, ends: FloatArray) -> NDArray[np.bool_]:
    """Return in which boxes a condition holds at all points of a grid that lie within (m,)."""
    if region.condition is None:
        return np.ones(len(ends), bool)
    axes = [np.linspace(values.min(), values.max(), _SEEN) for values in (points.y, points.theta)]
    y, theta = np.meshgrid(*axes, indexing="ij")
    bad = ~(region.condition(y.ravel(), theta.ravel()) >= 0).reshape(y.shape)  # NaN is bad
    total = np.pad(bad.astype(np.int64), ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    i0, j0 = (np.searchsorted(axis, ends[:, k]) for axis, k in zip(axes, (0, 2), strict=True))
    i1, j1 = (np.searchsorted(axis, ends[:, k], "right") for axis, k in zip(axes, (1, 3), strict=True))
    i1, j1 = np.maximum(i0, i1), np.maximum(j0, j1)
    return np.asarray(total[i1, j1] - total[i0, j1] - total[i1, j0] + total[i0, j0] == 0)


def _apart(numbers: FloatArray, sizes: FloatArray, step: FloatArray) -> Iterator[FloatArray]:
    """Yield the largest boxes, none near to one before it."""
    left = sizes.copy()
    for _ in range(_STARTS):
        best = int(np.argmax(left))
        if not left[best] > 0:
            return
        yield numbers[best]
        left[(np.abs(numbers - numbers[best]) < _APART * step).all(axis=1)] = -1.0


def _optimum(region: Region, family: _Family, start: FloatArray) -> FloatArray:
    """Return the numbers of the largest box near one, by a sequential quadratic program.

    Its unknowns are the numbers, and the height as a share of the travel.
    """
    from scipy.optimize import minimize

    def room(x: FloatArray) -> FloatArray:
        ends = family.boxes(x[:-1])
        found = box_pieces(region.sizes, (ends[0], ends[1]), (ends[2], ends[3]))
        free = [1 - (top - low) / region.travel - x[-1] for top in found.highest for low in found.lowest]
        rows = [free, np.subtract(found.serial, region.margins.serial)]
        rows.append(np.subtract(found.actuation, region.margins.actuation))
        if region.condition is not None:
            rows.append(region.condition(*_within(ends, _LOOKS)))
        return np.asarray(np.nan_to_num(np.concatenate(rows), nan=-1.0))

    def size(x: FloatArray) -> float:
        ends = family.boxes(x[:-1])
        return float(-x[-1] * (ends[1] - ends[0]) * (1.0 if family.flat else ends[3] - ends[2]) / at_start)

    at_start = 1.0
    x = np.append(start, 0.0)
    x[-1] = room(x)[: 3 * 6].min()
    at_start = -size(x)
    found = minimize(
        size,
        x,
        method="SLSQP",
        bounds=[*zip(family.low, family.high, strict=True), (0.0, 1.0)],
        constraints={"type": "ineq", "fun": room},
        options={"ftol": _PRECISION, "maxiter": 200},
    )
    return np.asarray(np.clip(found.x[:-1], family.low, family.high))


def _within(ends: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Return y and θ of a grid over a box, its borders among them."""
    found = np.meshgrid(
        np.linspace(ends[0], ends[1], count), np.linspace(ends[2], ends[3], count), indexing="ij"
    )
    return found[0].ravel(), found[1].ravel()


def _pulled_in(region: Region, family: _Family, start: FloatArray, numbers: FloatArray) -> FloatArray:
    """Return the ends of an optimum, moved toward where it began as far as rounding demands."""
    for back in (0.0, *10.0 ** np.arange(-13, 1)):
        ends = family.boxes(numbers + back * (start - numbers))
        if _sizes(region, family, ends[None])[0] > 0 and (
            region.condition is None or (region.condition(*_within(ends, _SEEN)) >= 0).all()
        ):
            return ends
    return family.boxes(start)
