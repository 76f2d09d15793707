"""`DynamicsMethod`: the shape of a way to the forces. All have these doors, which take the same states."""

from __future__ import annotations

from typing import Protocol

from p3dof._base.checks import FloatArray, Progress
from p3dof.machine.motion.states import States
from p3dof.methods.one_sample import OneSample
from p3dof.methods.solution import Solution


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
    def one(self) -> OneSample | None:
        """What answers for one plain sample at once; None where nothing does."""

    def forces(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the actuator forces that a motion takes, (..., 3) [N].

        Parameters
        ----------
        states : States
            Pose, velocity, acceleration and wrench.
        out : ndarray, shape (..., 3), optional
            Where the result may be written, here and below; whoever asks looks at what comes back.
        """

    def solve(self, states: States, progress: Progress | None = None) -> Solution:
        """Return the forces at N samples with joints and evidence.

        Parameters
        ----------
        states : States
            Pose, velocity, acceleration and wrench, shape (N,).
        progress : callable, optional
            Called with (done, total) now and then by a way that takes its time.
        """

    def accelerate(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the acceleration of (y, z, θ) under actuator forces, (..., 3) [m/s², m/s², rad/s²].

        It exists at singular poses too.

        Parameters
        ----------
        states : States
            Pose, velocity, forces and wrench.
        """

    def jacobian(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return ∂(λA, λB, λC)/∂(y, z, θ), (..., 3, 3) [1, 1, m/rad].

        Parameters
        ----------
        states : States
            Poses.
        """

    def mass_matrix(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the mass matrix in y, z, θ, (..., 3, 3) [kg, kg m, kg m²].

        Parameters
        ----------
        states : States
            Poses.
        """
