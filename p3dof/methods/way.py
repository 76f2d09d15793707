"""`DynamicsMethod`: the shape of a way to the forces. All have these doors, which take the same states."""

from __future__ import annotations

from typing import Any, Protocol

from p3dof._base.checks import FloatArray, Progress
from p3dof.machine.motion.states import States
from p3dof.methods.solution import Solution


class AtOnce(Protocol):
    """What answers for plain samples at once; None where somebody must look closer. See `OneSample`."""

    def forces(self, out: Any, q: Any, v: Any, a: Any, wrench: Any, on_invalid: str) -> FloatArray | None:
        """Return the actuator forces at a pose, velocity and acceleration."""

    def accelerate(self, out: Any, q: Any, v: Any, f: Any, wrench: Any, on_invalid: str) -> FloatArray | None:
        """Return the acceleration of the platform at a pose and velocity, under forces."""

    def jacobian(self, out: Any, pose: Any, on_invalid: str) -> FloatArray | None:
        """Return ∂(λA, λB, λC)/∂(y, z, θ)."""

    def mass_matrix(self, out: Any, pose: Any, on_invalid: str) -> FloatArray | None:
        """Return the mass matrix in y, z, θ."""

    def derivatives(self, q: Any, v: Any, a: Any, wrench: Any, on_invalid: str) -> FloatArray | None:
        """Return the actuator forces and their derivatives by pose, velocity and acceleration."""

    def sliders(self, out: Any, pose: Any, on_invalid: str) -> FloatArray | None:
        """Return the slider positions at a pose."""

    def poses(self, out: Any, sliders: Any, on_invalid: str) -> FloatArray | None:
        """Return the pose at slider positions."""


class DynamicsMethod(Protocol):
    """A way to the forces of one machine.

    Each decides by itself which states are within reach, and at which the actuators hold the platform. With
    ``states.on_invalid`` ``"nan"`` it leaves rows of NaN for the others. With ``"raise"`` every door raises:

    - `ReachError` for the first state that is out of reach, naming the leg, its margin and the sample,
    - `SingularityError` for the first at which the actuators cannot hold the platform (`forces`, `solve`),
    - `SampleError` for one that Pinocchio cannot solve for another reason,
    - `InputError` for numbers that are not finite, or where a result would not be.

    Forces and sliders are those of A, B, C, positive along +z0.
    """

    @property
    def one(self) -> AtOnce | None:
        """What answers for one plain sample at once; None where nothing does."""

    def forces(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the actuator forces that a motion takes, (..., 3) [N]."""

    def solve(self, states: States, progress: Progress | None = None) -> Solution:
        """Return the forces at N samples with joints and evidence.

        `progress`: called with (done, total) now and then by a way that takes its time.
        """

    def accelerate(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the acceleration of (y, z, θ) under actuator forces, (..., 3) [m/s², m/s², rad/s²].

        It exists at singular poses too.
        """

    def jacobian(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return ∂(λA, λB, λC)/∂(y, z, θ), (..., 3, 3) [1, 1, m/rad]."""

    def mass_matrix(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the mass matrix in y, z, θ, (..., 3, 3) [kg, kg m, kg m²]."""
