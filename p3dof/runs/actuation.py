"""The path from the state of a plant to the forces on it: encoders, controller, hold, limits."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, as_floats, frozen_array, not_negative, shown
from p3dof._base.errors import ControllerError, InputError


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
            object.__setattr__(self, name, not_negative(name, getattr(self, name)))
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


class Measure(Protocol):
    """What makes a controller's input from what encoders on the actuated joints tell."""

    def __call__(
        self,
        time: float,
        period: float,
        positions: FloatArray,
        velocities: FloatArray,
        saturated: NDArray[np.bool_],
        /,
    ) -> Any:
        """Return it: of a time, how long forces are held, (n,) each, and which forces were cut off."""


class Actuation:
    """The path from the state of a plant with n actuators to the forces on it."""

    def __init__(
        self,
        measure: Measure,
        controller: Callable[..., ArrayLike] | ArrayLike | None,
        period: float,
        limits: FloatArray,
        encoders: Encoders | None = None,
    ) -> None:
        self.size = len(limits)
        self._measure = measure
        if isinstance(controller, type):
            raise InputError(f"controller: expected an object, got the class {controller.__name__}")
        self._controller = controller if callable(controller) else _constant(controller, self.size)
        self._period, self.limits = period, limits
        self._endless = not np.isfinite(limits).any()
        self._encoders = encoders
        self._saturated = np.zeros(self.size, dtype=bool)
        self._saturated.setflags(write=False)
        reset = getattr(controller, "reset", None)
        if callable(reset):
            try:
                reset()
            except Exception as error:
                raise ControllerError(f"the controller failed to reset: {error}", 0.0) from error

    def __call__(
        self, time: float, positions: FloatArray, velocities: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the forces on the plant and those that the controller asked for, shape (n,)."""
        if self._encoders is not None:
            positions, velocities = self._encoders.read(positions, velocities)
        measured = self._measure(time, self._period, positions, velocities, self._saturated)
        asked = _checked(self._controller(measured), self.size)
        if self._endless:
            return asked, asked
        forces = np.minimum(np.maximum(asked, -self.limits), self.limits)
        self._saturated = forces != asked
        return forces, asked


def _constant(forces: ArrayLike | None, size: int) -> Callable[[Any], FloatArray]:
    held = constant_forces(np.zeros(size) if forces is None else forces, size)
    return lambda _: held


def constant_forces(forces: ArrayLike, size: int) -> FloatArray:
    """Return the constant forces (size,) that stand for a controller."""
    if isinstance(forces, str):
        raise InputError(
            f"controller: expected one, such as PD(robot, motion), or forces, got {forces!r:.40}"
        )
    return frozen_array("controller", forces, (size,))


def _checked(forces: ArrayLike, size: int) -> FloatArray:
    usual = isinstance(forces, np.ndarray) and forces.dtype.char == "d"
    given: FloatArray = np.asarray(forces) if usual else as_floats("controller", forces)
    array = given.copy()  # it may be the same array every time
    if array.shape == (size,) and array.dot(array) < math.inf:  # no entry is NaN or infinite
        return array
    if array.shape != (size,):
        raise InputError(f"controller: expected forces of shape ({size},), got {array.shape}")
    if not all(map(math.isfinite, array.tolist())):
        raise InputError(f"controller: expected finite forces, got {array.tolist()}")
    return array
