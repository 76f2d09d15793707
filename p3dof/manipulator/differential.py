"""How the forces of a manipulator change with its motion and its parameters, as methods."""

from __future__ import annotations

from numpy.typing import ArrayLike

from p3dof.errors import InputError
from p3dof.manipulator.minimal_form import MovingMachine
from p3dof.methods import compiled
from p3dof.methods.compiled import ForceDerivatives
from p3dof.methods.regressor import ForceRegressor, force_regressor
from p3dof.motion import Load, Motion, WrenchOverTime
from p3dof.samples import OnInvalid


class DifferentialMachine(MovingMachine):
    """A machine that knows the exact derivatives of its actuator forces."""

    def inverse_dynamics_derivatives(
        self,
        motion: Motion,
        wrench: WrenchOverTime = None,
        on_invalid: OnInvalid = "raise",
    ) -> ForceDerivatives:
        """Return the actuator forces over a motion and their derivatives by pose, velocity, acceleration.

        Parameters
        ----------
        motion : Motion
            The motion of the platform.
        wrench : array-like, shape (6,) or (N, 6), or callable, optional
            External force and moment on the platform at P, in the fixed frame [N, N m]; or a function of the
            times. It stays when the motion changes.
        on_invalid : {"raise", "nan"}
            Raise for samples that are out of reach or singular, or leave NaN in their rows.

        Returns
        -------
        ForceDerivatives
            With arrays (N, 3) and (N, 3, 3).

        Raises
        ------
        ReachError, SingularityError
            Naming the first bad sample and how many there are.
        InputError
            If the wrench does not fit, or `motion` is not a `Motion`.
        """
        if not isinstance(motion, Motion):
            raise InputError(f"motion: expected a Motion, got {type(motion).__name__}")
        loads = None if wrench is None else Load(wrench).over(motion.time, on_invalid)
        return self.force_derivatives(motion.pose, motion.velocity, motion.acceleration, loads, on_invalid)

    def force_derivatives(
        self,
        pose: ArrayLike,
        velocity: ArrayLike,
        acceleration: ArrayLike,
        wrench: ArrayLike | None = None,
        on_invalid: OnInvalid = "raise",
    ) -> ForceDerivatives:
        """Return the actuator forces and their derivatives at states of motion, without a time axis.

        Parameters
        ----------
        pose, velocity, acceleration : array-like, shape (..., 3)
            Of (y, z, θ) [m, m, rad] and per second, per second²; leading shapes broadcast.
        wrench : array-like, shape (..., 6), optional
            External force and moment on the platform at P, in the fixed frame [N, N m]; it stays when the
            motion changes.
        on_invalid : {"raise", "nan"}
            Raise for samples that are not finite, out of reach or singular, or leave NaN in their rows.

        Returns
        -------
        ForceDerivatives

        Raises
        ------
        ReachError, SingularityError
            Naming the first bad sample and how many there are.
        InputError
            If shapes do not fit or a number is not finite.
        """
        return compiled.inverse_dynamics_derivatives(
            self.kernels, pose, velocity, acceleration, wrench, on_invalid
        )

    def force_regressor(
        self,
        pose: ArrayLike,
        velocity: ArrayLike,
        acceleration: ArrayLike,
        on_invalid: OnInvalid = "raise",
    ) -> ForceRegressor:
        """Return how the actuator forces depend on the parameters, in which most of them are linear.

        Parameters
        ----------
        pose, velocity, acceleration : array-like, shape (..., 3)
            Of (y, z, θ) [m, m, rad] and per second, per second²; leading shapes broadcast.
        on_invalid : {"raise", "nan"}
            Raise for samples that are not finite, out of reach or singular, or leave NaN in their rows.

        Returns
        -------
        ForceRegressor
            By the 21 base inertial parameters, the 100 of the bodies, the lengths and gravity, with friction
            and without external loads.

        Raises
        ------
        ReachError, SingularityError
            Naming the first bad sample and how many there are.
        InputError
            If shapes do not fit or a number is not finite.
        """
        return force_regressor(self.parameters, pose, velocity, acceleration, on_invalid)
