"""The kinematics of a manipulator, as methods."""

from __future__ import annotations

from numpy.typing import ArrayLike

from p3dof import kinematics
from p3dof.checks import FloatArray
from p3dof.kinematics import InverseKinematics, MechanismMotion, Singularity
from p3dof.manipulator.machine import Machine
from p3dof.methods import compiled
from p3dof.methods.registry import CLOSED_FORMS, ClosedForm, check_method
from p3dof.samples import OnInvalid


class KinematicMachine(Machine):
    """A machine that knows where it is: sliders, poses, Jacobian, joints and bodies."""

    def inverse_kinematics(self, pose: ArrayLike, on_invalid: OnInvalid = "raise") -> InverseKinematics:
        """Return sliders and passive angles at poses; see `p3dof.kinematics.inverse_kinematics`.

        Parameters
        ----------
        pose : array-like, shape (..., 3)
            y [m], z [m], θ [rad].
        on_invalid : {"raise", "nan"}
            Raise for samples out of reach, or leave NaN in their rows.

        Returns
        -------
        InverseKinematics

        Raises
        ------
        ReachError, InputError
            Naming leg, margin and sample.
        """
        return kinematics.inverse_kinematics(self.parameters.geometry, pose, on_invalid)

    def forward_kinematics(
        self, sliders: ArrayLike, all_modes: bool = False, on_invalid: OnInvalid = "raise"
    ) -> FloatArray:
        """Return the pose at slider positions; see `p3dof.kinematics.forward_kinematics`.

        Parameters
        ----------
        sliders : array-like, shape (..., 3)
            Positions of A, B, C [m].
        all_modes : bool
            Return all four assembly modes, the working one first, NaN where one does not exist.
        on_invalid : {"raise", "nan"}
            Raise for samples that do not assemble, or leave NaN in their rows.

        Returns
        -------
        ndarray, shape (..., 3) or (..., 4, 3)
            y [m], z [m], θ [rad].

        Raises
        ------
        ReachError, InputError
            Naming leg, margin and sample.
        """
        return kinematics.forward_kinematics(self.parameters.geometry, sliders, all_modes, on_invalid)

    def sliders(self, pose: ArrayLike, on_invalid: OnInvalid = "raise") -> FloatArray:
        """Return the slider positions at poses by the kernels: what many calls or samples need quickly.

        Parameters
        ----------
        pose : array-like, shape (..., 3)
            y [m], z [m], θ [rad].
        on_invalid : {"raise", "nan"}
            Raise for samples out of reach, or leave NaN in their rows.

        Returns
        -------
        ndarray, shape (..., 3)
            Of A, B, C [m]; those of `inverse_kinematics`.

        Raises
        ------
        ReachError, InputError
            Naming leg, margin and sample.
        """
        return compiled.sliders(self.kernels, pose, on_invalid)

    def jacobian(
        self, pose: ArrayLike, on_invalid: OnInvalid = "raise", method: ClosedForm = "virtual-power"
    ) -> FloatArray:
        """Return J = ∂(λA, λB, λC)/∂(y, z, θ): slider velocities are J times the pose's velocity.

        Parameters
        ----------
        pose : array-like, shape (..., 3)
            y [m], z [m], θ [rad].
        on_invalid : {"raise", "nan"}
            Raise for samples out of reach, or leave NaN in their rows.
        method : {"virtual-power", "compiled"}
            The paper's formulas, or the kernels.

        Returns
        -------
        ndarray, shape (..., 3, 3)

        Raises
        ------
        ReachError, InputError
            Naming leg, margin and sample.
        """
        if check_method(method, CLOSED_FORMS) == "compiled":
            return compiled.jacobian(self.kernels, pose, on_invalid)
        return kinematics.inverse_jacobian(self.parameters.geometry, pose, on_invalid)

    def singularity(self, pose: ArrayLike) -> Singularity:
        """Return the margins of poses from both kinds of singularity.

        Parameters
        ----------
        pose : array-like, shape (..., 3)
            y [m], z [m], θ [rad].

        Returns
        -------
        Singularity
        """
        return kinematics.singularity(self.parameters.geometry, pose)

    def mechanism_motion(
        self,
        pose: ArrayLike,
        velocity: ArrayLike,
        acceleration: ArrayLike,
        on_invalid: OnInvalid = "raise",
    ) -> MechanismMotion:
        """Return the motion of every joint and body; see `p3dof.kinematics.mechanism_motion`.

        Parameters
        ----------
        pose, velocity, acceleration : array-like, shape (..., 3)
            Of (y, z, θ) [m, m, rad] and per second, per second².
        on_invalid : {"raise", "nan"}
            Raise for invalid samples, or leave NaN in their rows.

        Returns
        -------
        MechanismMotion

        Raises
        ------
        ReachError, InputError
            Naming leg, margin and sample.
        """
        return kinematics.mechanism_motion(self.parameters.geometry, pose, velocity, acceleration, on_invalid)
