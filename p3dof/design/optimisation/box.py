"""`Box`: the poses that every design must reach."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p3dof._base.checks import FloatArray, frozen_array
from p3dof._base.errors import InputError

GRID = (9, 13)
"""Poses along y and θ."""


@dataclass(frozen=True)
class Box:
    """A box of poses y0 ≤ y ≤ y1, θ0 ≤ θ ≤ θ1: within it, measures of poses take the worst one.

    Height, reach and distance from singularities are those of the whole box, exactly; other measures take
    the poses of a grid with the borders of the box in it. None depends on z: all sliders move alike with it.

    Parameters
    ----------
    y : tuple of float
        Ends along y [m].
    theta : tuple of float
        Ends of the rotation [rad].
    grid : tuple of int
        How many poses along y and along θ, from 2 to 201 each.

    Raises
    ------
    InputError
        If an argument does not fit.
    """

    y: tuple[float, float]
    theta: tuple[float, float]
    grid: tuple[int, int] = GRID

    def __post_init__(self) -> None:
        for name in ("y", "theta"):
            low, high = (float(end) for end in frozen_array(f"box.{name}", getattr(self, name), (2,)))
            if not low < high:
                raise InputError(
                    f"box.{name}: expected the lower end below the upper one, got {low:g} and {high:g}"
                )
            object.__setattr__(self, name, (low, high))
        if not isinstance(self.grid, tuple | list) or len(self.grid) != 2:
            raise InputError("box.grid: expected two numbers of poses")
        for count in self.grid:
            if isinstance(count, bool) or not isinstance(count, int) or not 2 <= count <= 201:
                raise InputError(f"box.grid: expected whole numbers from 2 to 201, got {count!r}")
        object.__setattr__(self, "grid", tuple(self.grid))

    @property
    def poses(self) -> tuple[FloatArray, FloatArray]:
        """Y and θ of all poses of the grid, (G,) each."""
        y, theta = (np.linspace(*ends, n) for ends, n in zip((self.y, self.theta), self.grid, strict=True))
        found = np.meshgrid(y, theta, indexing="ij")
        return found[0].ravel(), found[1].ravel()

    @property
    def corners(self) -> tuple[FloatArray, FloatArray]:
        """Y and θ of the middle of the box and of its corners, (5,) each."""
        (y0, y1), (t0, t1) = self.y, self.theta
        middle = (y0 + y1) / 2, (t0 + t1) / 2
        return np.array([middle[0], y0, y0, y1, y1]), np.array([middle[1], t0, t1, t0, t1])

    def finer(self, times: int) -> Box:
        """Return the same box with a grid that is several times finer."""
        grid = tuple(min((count - 1) * times + 1, 201) for count in self.grid)
        return Box(self.y, self.theta, (grid[0], grid[1]))
