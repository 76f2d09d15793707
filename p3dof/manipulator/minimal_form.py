"""The equations of motion of a manipulator in y, z, θ, as methods."""

from __future__ import annotations

from numpy.typing import ArrayLike

from p3dof.checks import FloatArray
from p3dof.manipulator.kinematic import KinematicMachine
from p3dof.methods import compiled, equations_of_motion, pinocchio
from p3dof.methods.registry import CLOSED_FORMS, ClosedForm, Method, check_method
from p3dof.samples import OnInvalid, finite_states, wrench_like


class MovingMachine(KinematicMachine):
    """A machine that knows how it accelerates: mass matrix, Coriolis matrix, gravity, forward dynamics."""

    def mass_matrix(
        self, pose: ArrayLike, on_invalid: OnInvalid = "raise", method: ClosedForm = "virtual-power"
    ) -> FloatArray:
        """Return the mass matrix M (..., 3, 3) in y, z, θ; see `p3dof.methods`.

        Parameters
        ----------
        pose : array-like, shape (..., 3)
            y [m], z [m], θ [rad].
        on_invalid : {"raise", "nan"}
            Raise for samples out of reach, or leave NaN in their rows.
        method : {"virtual-power", "compiled"}
            The full formulas, or the kernels.

        Returns
        -------
        ndarray, shape (..., 3, 3)

        Raises
        ------
        ReachError, InputError
            Naming leg, margin and sample.
        """
        if check_method(method, CLOSED_FORMS) == "compiled":
            return compiled.mass_matrix(self.kernels, pose, on_invalid)
        return equations_of_motion.mass_matrix(self.parameters, pose, on_invalid)

    def coriolis_matrix(
        self, pose: ArrayLike, velocity: ArrayLike, on_invalid: OnInvalid = "raise"
    ) -> FloatArray:
        """Return the Coriolis matrix C (..., 3, 3) in y, z, θ, with Ṁ - 2C skew; see `p3dof.methods`.

        Parameters
        ----------
        pose, velocity : array-like, shape (..., 3)
            Of (y, z, θ) [m, m, rad] and per second.
        on_invalid : {"raise", "nan"}
            Raise for samples out of reach, or leave NaN in their rows.

        Returns
        -------
        ndarray, shape (..., 3, 3)

        Raises
        ------
        ReachError, InputError
            Naming leg, margin and sample.
        """
        return equations_of_motion.coriolis_matrix(self.parameters, pose, velocity, on_invalid)

    def gravity_forces(self, pose: ArrayLike, on_invalid: OnInvalid = "raise") -> FloatArray:
        """Return the gradient of the potential energy (..., 3) in y, z, θ; see `p3dof.methods`.

        Parameters
        ----------
        pose : array-like, shape (..., 3)
            y [m], z [m], θ [rad].
        on_invalid : {"raise", "nan"}
            Raise for samples out of reach, or leave NaN in their rows.

        Returns
        -------
        ndarray, shape (..., 3)

        Raises
        ------
        ReachError, InputError
            Naming leg, margin and sample.
        """
        return equations_of_motion.gravity_forces(self.parameters, pose, on_invalid)

    def forward_dynamics(
        self,
        pose: ArrayLike,
        velocity: ArrayLike,
        forces: ArrayLike,
        method: Method = "virtual-power",
        wrench: ArrayLike | None = None,
        on_invalid: OnInvalid = "raise",
    ) -> FloatArray:
        """Return the acceleration of the platform under actuator forces.

        Parameters
        ----------
        pose, velocity, forces : array-like, shape (..., 3)
            State of (y, z, θ) [m, m, rad] and per second, and forces of A, B, C [N].
        method : {"virtual-power", "compiled", "pinocchio"}
            The minimal form of the paper's closed forms, vectorised; the same reduced, by the kernels; or
            Pinocchio's constrained dynamics of the whole tree, sample by sample.
        wrench : array-like, shape (..., 6), optional
            External force and moment on the platform at P, in the fixed frame [N, N m].
        on_invalid : {"raise", "nan"}
            Raise for samples out of reach or not finite, or leave NaN in their rows.

        Returns
        -------
        ndarray, shape (..., 3)
            ÿ, z̈ [m/s²] and θ̈ [rad/s²].

        Raises
        ------
        ReachError, InputError
            Naming leg, margin and sample; also when shapes do not fit or the method is unknown.
        """
        check_method(method)
        if method == "compiled":
            return compiled.forward_dynamics(self.kernels, pose, velocity, forces, wrench, on_invalid)
        if method == "virtual-power":
            return equations_of_motion.forward_dynamics(
                self.parameters, pose, velocity, forces, wrench, on_invalid
            )
        poses, speeds, given = finite_states(pose, velocity, forces, on_invalid, "forces")
        leading = poses.shape[:-1]
        loads = None if wrench is None else wrench_like(wrench, leading, on_invalid)
        found = pinocchio.accelerate(
            self.loop,
            self.parameters.geometry.h,
            poses.reshape(-1, 3),
            speeds.reshape(-1, 3),
            given.reshape(-1, 3),
            None if loads is None else loads.reshape(-1, 6),
            self.parameters.friction,
            on_invalid,
            leading,
        )
        return found.reshape(poses.shape)
