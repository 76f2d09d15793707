"""The path from the state of a plant to the forces on it: measurement, controller, hold, limits."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, as_floats, frozen_array
from p3dof._base.errors import ControllerError, InputError
from p3dof.runs.encoders import Encoders


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
    """The path from the state of a plant with n actuators to the forces on it.

    Parameters
    ----------
    measure : callable
        What makes the controller's input.
    controller : callable or array-like, shape (n,), optional
        What gives the forces; or forces that stay, none by default.
    period : float
        How long a force is held [s]; zero for continuous control.
    limits : ndarray, shape (n,)
        Largest forces [N or N m]; infinite for none.
    encoders : Encoders, optional
        What is measured; the joints as they are without it.

    Raises
    ------
    InputError
        If the controller is a class, or forces that do not fit.
    ControllerError
        If it cannot be reset.
    """

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
        reset = getattr(controller, "reset", None)
        if callable(reset):
            try:
                reset()
            except Exception as error:
                raise ControllerError(f"the controller failed to reset: {error}", 0.0) from error

    def __call__(
        self, time: float, positions: FloatArray, velocities: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the forces on the plant and those that the controller asked for, shape (n,).

        Raises
        ------
        InputError
            If the controller returns something else than n finite numbers.
        """
        if self._encoders is not None:
            positions, velocities = self._encoders.read(positions, velocities)
        measured = self._measure(time, self._period, positions, velocities, self._saturated)
        asked = _checked(self._controller(measured), self.size)
        if self._endless:
            self._saturated = np.zeros(self.size, dtype=bool)
            return asked, asked
        forces = np.minimum(np.maximum(asked, -self.limits), self.limits)
        self._saturated = forces != asked
        return forces, asked


def _constant(forces: ArrayLike | None, size: int) -> Callable[[Any], FloatArray]:
    held = frozen_array("controller", np.zeros(size) if forces is None else forces, (size,))
    return lambda _: held


def _checked(forces: ArrayLike, size: int) -> FloatArray:
    usual = isinstance(forces, np.ndarray) and forces.dtype.char == "d"
    given: FloatArray = np.asarray(forces) if usual else as_floats("controller", forces)
    array = given.copy()  # it may be the same array every time
    if array.shape != (size,):
        raise InputError(f"controller: expected forces of shape ({size},), got {array.shape}")
    if not all(map(math.isfinite, array.tolist())):
        raise InputError(f"controller: expected finite forces, got {array.tolist()}")
    return array
