"""What encoders on the actuated joints tell: noise, counts, velocities by differencing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p3dof._base.checks import FloatArray, frozen_array, shown
from p3dof._base.errors import InputError


@dataclass(frozen=True)
class Noise:
    """Normally distributed errors of what is measured.

    Parameters
    ----------
    position : float
        Standard deviation of the positions of the actuated joints, such as sliders [m or rad].
    velocity : float
        Standard deviation of their velocities [m/s or rad/s].
    seed : int
        Of the random numbers: equal seeds give equal runs.

    Raises
    ------
    InputError
        If a deviation is negative or not finite, or the seed is not a whole number of zero or more.
    """

    position: float = 1e-6
    velocity: float = 1e-4
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("position", "velocity"):
            value = float(frozen_array(name, getattr(self, name), ()))
            if value < 0:
                raise InputError(f"{name}: expected zero or more, got {value:g}")
            object.__setattr__(self, name, value)
        whole = isinstance(self.seed, int | np.integer) and not isinstance(self.seed, bool)
        if not whole or self.seed < 0:
            raise InputError(f"seed: expected a whole number of zero or more, got {shown(self.seed)}")
        object.__setattr__(self, "seed", int(self.seed))


class Encoders:
    """Encoders of n joints during one run: noise is added, then counts are rounded, then differences taken.

    Parameters
    ----------
    period : float
        Time between two readings [s]; zero for continuous ones.
    noise : Noise, optional
        Errors of what is measured.
    resolution : ndarray, shape (n,)
        Length or angle of a count [m or rad]; zero for any number.
    differencing : bool
        Whether velocities are differences of positions; of the first reading they are those of the joints.
    """

    def __init__(
        self, period: float, noise: Noise | None, resolution: FloatArray, differencing: bool = False
    ) -> None:
        self._period, self._noise = period, noise
        self._counts = np.where(resolution > 0, resolution, 1.0)
        self._counting = resolution > 0
        self._differencing = differencing
        self._random = np.random.default_rng(0 if noise is None else noise.seed)
        self._last: FloatArray | None = None

    def read(self, positions: FloatArray, velocities: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what they tell of positions and velocities of the joints, (n,) each."""
        size = len(positions)
        if self._noise is not None:
            positions = positions + self._noise.position * self._random.standard_normal(size)
            seen = velocities + self._noise.velocity * self._random.standard_normal(size)
        else:
            seen = velocities
        if self._counting.any():
            rounded = np.rint(positions / self._counts) * self._counts
            positions = np.where(self._counting, rounded, positions)
        if not self._differencing:
            return positions, seen
        last, self._last = self._last, positions
        return positions, velocities if last is None else (positions - last) / self._period
