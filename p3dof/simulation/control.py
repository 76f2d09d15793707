"""What a controller sees and gives, and what stands between it and the machine: hold, limits, noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof import kinematics
from p3dof.checks import FloatArray, as_floats, frozen_array, shown
from p3dof.errors import ControllerError, InputError
from p3dof.parameters import Geometry, Parameters


@dataclass(frozen=True, eq=False)
class Measurement:
    """What a controller knows: what encoders on the sliders tell.

    Parameters
    ----------
    time : float
        Time since the start of the run [s].
    period : float
        How long the forces will be held [s]; zero if the controller acts continuously.
    sliders, slider_velocities : ndarray, shape (3,)
        Of A, B, C [m, m/s], noise included.
    saturated : ndarray of bool, shape (3,)
        Which of the forces that it gave last were cut off at the limits.
    geometry : Geometry
        Lengths of the machine, for the forward kinematics.
    """

    time: float
    period: float
    sliders: FloatArray
    slider_velocities: FloatArray
    saturated: NDArray[np.bool_]
    geometry: Geometry

    @cached_property
    def pose(self) -> FloatArray:
        """Pose by forward kinematics of the sliders, shape (3,), in the working mode.

        Sliders do not tell on which side of a singular pose (det J = 0) the platform is: behind one this is
        another pose than the machine's.
        """
        return kinematics.forward_kinematics(self.geometry, self.sliders)

    @cached_property
    def velocity(self) -> FloatArray:
        """Velocity of the pose, from that of the sliders, shape (3,)."""
        J = kinematics.inverse_jacobian(self.geometry, self.pose)
        return np.asarray(np.linalg.solve(J, self.slider_velocities))


class Controller(Protocol):
    """Anything that can be called with a `Measurement` and returns the forces of A, B, C [N], shape (3,).

    A method ``reset()`` is called before a run if there is one; an attribute ``motion`` is taken as what the
    run should follow; a true attribute ``autonomous`` says that the forces depend on the state alone, so that
    a continuous run can take steps as long as its accuracy allows. A continuous controller is also called at
    trial times that are not kept: it should not count its calls.
    """

    def __call__(self, measured: Measurement, /) -> ArrayLike:
        """Return the forces of the actuators [N]."""


ControllerLike: TypeAlias = "Controller | Callable[[Measurement], ArrayLike] | ArrayLike | None"
"""A controller, constant forces (3,), or None for none at all."""


@dataclass(frozen=True)
class Noise:
    """Normally distributed errors of what is measured.

    Parameters
    ----------
    position : float
        Standard deviation of the slider positions [m].
    velocity : float
        Standard deviation of the slider velocities [m/s].
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


class Actuation:
    """The path from the machine's state to the forces on it: measurement, controller, limits.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    controller : ControllerLike
        What gives the forces.
    period : float
        How long a force is held [s]; zero for continuous control.
    limits : ndarray, shape (3,)
        Largest forces [N]; infinite for none.
    noise : Noise, optional
        Errors of what is measured.
    """

    def __init__(
        self,
        parameters: Parameters,
        controller: ControllerLike,
        period: float,
        limits: FloatArray,
        noise: Noise | None,
    ) -> None:
        self._geometry = parameters.geometry
        if isinstance(controller, type):
            raise InputError(f"controller: expected an object, got the class {controller.__name__}")
        self._controller = controller if callable(controller) else _constant(controller)
        self._period, self._limits = period, limits
        self._noise = noise
        self._random = np.random.default_rng(0 if noise is None else noise.seed)
        self._saturated = np.zeros(3, dtype=bool)
        reset = getattr(controller, "reset", None)
        if callable(reset):
            try:
                reset()
            except Exception as error:
                raise ControllerError(f"the controller failed to reset: {error}", 0.0) from error

    def __call__(self, time: float, sliders: FloatArray, speeds: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the forces on the machine and those that the controller asked for, shape (3,) [N].

        Raises
        ------
        InputError
            If the controller returns something else than three finite numbers.
        """
        if self._noise is not None:
            sliders = sliders + self._noise.position * self._random.standard_normal(3)
            speeds = speeds + self._noise.velocity * self._random.standard_normal(3)
        measured = Measurement(time, self._period, sliders, speeds, self._saturated, self._geometry)
        asked = _three_numbers(self._controller(measured))
        forces = np.clip(asked, -self._limits, self._limits)
        self._saturated = forces != asked
        return forces, asked


def _constant(forces: ArrayLike | None) -> Callable[[Measurement], FloatArray]:
    held = frozen_array("controller", np.zeros(3) if forces is None else forces, (3,))
    return lambda _: held


def _three_numbers(forces: ArrayLike) -> FloatArray:
    array = as_floats("controller", forces).copy()  # it may be the same array every time
    if array.shape != (3,):
        raise InputError(f"controller: expected forces of shape (3,), got {array.shape}")
    if not np.isfinite(array).all():
        raise InputError(f"controller: expected finite forces, got {array.tolist()}")
    return array
