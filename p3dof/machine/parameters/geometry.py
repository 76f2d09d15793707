"""`Geometry`: the lengths of the mechanism."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from p3dof._base.checks import positive
from p3dof._base.errors import ParameterError

PARALLEL = 1e-6
"""Least R - r, as a share of L: half the angle between the legs A and B at home [rad]."""


@dataclass(frozen=True)
class Geometry:
    """Lengths of the mechanism [m]; the defaults are the paper's.

    Parameters
    ----------
    r : float
        Size of the platform: distance from P to each of its joints A3, B3, C5.
    R : float
        Size of the base: distance from O to each guide-way.
    L : float
        Length of the legs and of the rods of the parallelogram.
    b : float
        Half width of the parallelogram. The paper does not give it, and no force depends on it.

    Raises
    ------
    ParameterError
        Unless 0 < r < R, L > R - r >= 1e-6 L and b > 0. Were R - r smaller, the legs A and B would be
        parallel at home, and could not hold the platform sideways.
    """

    r: float = 0.1
    R: float = 0.25
    L: float = 0.4
    b: float = 0.05

    def __post_init__(self) -> None:
        for item in fields(self):
            value = positive(item.name, getattr(self, item.name), ParameterError)
            object.__setattr__(self, item.name, value)
        if self.r >= self.R:
            raise ParameterError(
                f"r, R: expected r < R (r = R is singular everywhere), got r = {self.r:g}, R = {self.R:g} m"
            )
        if not self.R - self.r >= PARALLEL * self.L:
            raise ParameterError(
                f"R - r: expected at least {PARALLEL:g} L = {PARALLEL * self.L:g} m, or the legs A and B are "
                f"parallel and cannot hold the platform; got {self.R - self.r:g} m"
            )
        if not self.R - self.r < self.L:
            raise ParameterError(
                f"L: expected more than R - r = {self.R - self.r:g} m to reach the platform, got {self.L:g} m"
            )

    @property
    def h(self) -> float:
        """Depth of the platform below the sliders at home, h = √(L² - (R-r)²) [m] (paper, eq. 7)."""
        width = self.R - self.r
        return math.sqrt((self.L - width) * (self.L + width))
