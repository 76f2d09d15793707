"""What a controller of the manipulator sees and gives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray
from p3dof.closed_form import kinematics
from p3dof.closed_form.compiled.poses import pose_at
from p3dof.machine.parameters import Geometry


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
        return pose_at(self.geometry, self.sliders)

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
