"""`Manipulator`: one machine, with its kinematics and both dynamics behind a few calls."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cached_property
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof import description, kinematics, virtual_power
from p3dof.checks import FloatArray
from p3dof.closed_loop import ClosedLoopModel
from p3dof.errors import InputError
from p3dof.kinematics import InverseKinematics, MechanismMotion, OnInvalid, Singularity
from p3dof.kinematics.states import holdable_states, wrench_like
from p3dof.manipulator import pinocchio_route, virtual_power_route
from p3dof.manipulator.results import SLIDES, InverseDynamics, Solution
from p3dof.motion import Motion
from p3dof.parameters import PAPER, Parameters, read_parameters

Method: TypeAlias = Literal["pinocchio", "virtual-power"]
"""The two ways to the forces; they share only the parameters."""

METHODS: tuple[str, ...] = get_args(Method)

Progress: TypeAlias = Callable[[int, int], None]
"""Called with (done, total) during long work."""


def load(parameters: Parameters | str | os.PathLike[str] | None = None) -> Manipulator:
    """Return the manipulator with the given parameters.

    Parameters
    ----------
    parameters : Parameters or path-like, optional
        The machine, or a parameter file; the paper's by default.

    Returns
    -------
    Manipulator

    Raises
    ------
    ParameterError, FileError
        If the file cannot be read or is not right.
    InputError
        If `parameters` is something else.
    """
    if parameters is None:
        return Manipulator(PAPER)
    if not isinstance(parameters, str | os.PathLike):
        return Manipulator(parameters)
    return Manipulator(read_parameters(parameters))


class Manipulator:
    """The 3-DOF spatial parallel manipulator: parameters, model and both dynamics.

    Poses are (y [m], z [m], θ [rad]), zero at home; sliders and forces are ordered A, B, C, positive along
    +z0. Arrays may have any leading batch dimensions. The Pinocchio route works in buffers of its own: give
    each thread its own manipulator.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    """

    def __init__(self, parameters: Parameters = PAPER) -> None:
        if not isinstance(parameters, Parameters):
            raise InputError(f"parameters: expected Parameters, got {type(parameters).__name__}")
        self._parameters = parameters

    @property
    def parameters(self) -> Parameters:
        """The machine; make another `Manipulator` for another one."""
        return self._parameters

    def __repr__(self) -> str:
        g = self.parameters.geometry
        return f"Manipulator(r={g.r:g}, R={g.R:g}, L={g.L:g}, moving mass {self.parameters.bodies.mass:g} kg)"

    # -- the model, for anything else -----------------------------------------------------------------

    @cached_property
    def mechanism(self) -> description.Mechanism:
        """The neutral description: links, joints, closures, solids."""
        return description.describe(self.parameters)

    @cached_property
    def urdf(self) -> str:
        """The URDF of the tree for any reader: self-contained, primitives only, every link with a mass.

        Raises
        ------
        ModelError
            If a body is too light to give its massless neighbours a mass; `exact_urdf` is then left.
        """
        return description.urdf(description.with_masses(self.mechanism))

    @cached_property
    def exact_urdf(self) -> str:
        """The URDF of the tree with the bodies just as the parameters have them, massless ones included."""
        return description.urdf(self.mechanism)

    @cached_property
    def sidecar(self) -> str:
        """The loop closures and actuated joints that belong to the URDF, as YAML."""
        return description.sidecar(self.mechanism)

    @cached_property
    def loop(self) -> ClosedLoopModel:
        """The mechanism as a general closed-loop model on Pinocchio; not for several threads at once."""
        loop = ClosedLoopModel.from_urdf(self.exact_urdf, self.sidecar)
        loop.model.gravity.linear = self.parameters.gravity  # a URDF has no place for it
        return loop

    @property
    def model(self) -> Any:
        """The tree as a plain `pinocchio.Model`."""
        return self.loop.model

    @property
    def constraint_models(self) -> Any:
        """The loop closures as Pinocchio constraint models (`pinocchio.StdVec_ConstraintModel`)."""
        return self.loop.constraint_models

    @cached_property
    def visual_model(self) -> Any:
        """The visible solids as a plain `pinocchio.GeometryModel`."""
        return pin.buildGeomFromUrdfString(self.model, self.exact_urdf, pin.GeometryType.VISUAL)

    @cached_property
    def collision_model(self) -> Any:
        """The solids for collision checks as a plain `pinocchio.GeometryModel`."""
        return pin.buildGeomFromUrdfString(self.model, self.exact_urdf, pin.GeometryType.COLLISION)

    # -- kinematics -----------------------------------------------------------------------------------

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

    def jacobian(self, pose: ArrayLike, on_invalid: OnInvalid = "raise") -> FloatArray:
        """Return J = ∂(λA, λB, λC)/∂(y, z, θ): slider velocities are J times the pose's velocity.

        Parameters
        ----------
        pose : array-like, shape (..., 3)
            y [m], z [m], θ [rad].
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

    # -- inverse dynamics -----------------------------------------------------------------------------

    def forces(
        self,
        pose: ArrayLike,
        velocity: ArrayLike,
        acceleration: ArrayLike,
        method: Method = "pinocchio",
        wrench: ArrayLike | None = None,
        on_invalid: OnInvalid = "raise",
    ) -> FloatArray:
        """Return the actuator forces at states of motion, without a time axis.

        Parameters
        ----------
        pose, velocity, acceleration : array-like, shape (..., 3)
            Of (y, z, θ) [m, m, rad] and per second, per second²; leading shapes broadcast.
        method : {"pinocchio", "virtual-power"}
            Pinocchio solves sample by sample; the paper's method is vectorised and hundreds of times faster.
        wrench : array-like, shape (..., 6), optional
            External force and moment on the platform at P, in the fixed frame [N, N m].
        on_invalid : {"raise", "nan"}
            Raise for samples that are not finite, out of reach or singular, or leave NaN in their rows.

        Returns
        -------
        ndarray, shape (..., 3)
            Forces of the actuators A, B, C on their sliders [N].

        Raises
        ------
        ReachError, SingularityError
            Naming the first bad sample and how many there are.
        InputError
            If shapes do not fit, a number is not finite, or the method is unknown.
        """
        _check_method(method)
        if method == "virtual-power":
            return virtual_power.forces(self.parameters, pose, velocity, acceleration, wrench, on_invalid)
        states = holdable_states(self.parameters, pose, velocity, acceleration, on_invalid)
        loads = None if wrench is None else wrench_like(wrench, states[0].shape[:-1], on_invalid)
        pose, velocity, acceleration = (np.reshape(array, (-1, 3)) for array in states)
        solution = pinocchio_route.solve(
            self.loop,
            self.parameters.geometry.h,
            pose,
            velocity,
            acceleration,
            wrench=None if loads is None else loads.reshape(-1, 6),
            on_invalid=on_invalid,
        )
        return solution.forces.reshape(states[0].shape)

    def inverse_dynamics(
        self,
        motion: Motion,
        method: Method = "pinocchio",
        wrench: ArrayLike | None = None,
        on_invalid: OnInvalid = "raise",
        progress: Progress | None = None,
    ) -> InverseDynamics:
        """Return the actuator forces over a motion, with joints, closure error and power balance.

        Parameters
        ----------
        motion : Motion
            The motion of the platform.
        method : {"pinocchio", "virtual-power"}
            RNEA and loop closures, or the paper's virtual powers.
        wrench : array-like, shape (6,) or (N, 6), optional
            External force and moment on the platform at P, in the fixed frame [N, N m].
        on_invalid : {"raise", "nan"}
            Raise for samples that are out of reach or singular, or leave NaN in their rows.
        progress : callable, optional
            Called with (done, total) while Pinocchio solves.

        Returns
        -------
        InverseDynamics

        Raises
        ------
        ReachError, SingularityError
            Naming the first bad sample and how many there are.
        InputError
            If the wrench does not fit, the method is unknown, or `motion` is not a `Motion`.
        """
        _check_method(method)
        if not isinstance(motion, Motion):
            raise InputError(f"motion: expected a Motion, got {type(motion).__name__}")
        states = holdable_states(
            self.parameters, motion.pose, motion.velocity, motion.acceleration, on_invalid
        )
        loads = None if wrench is None else wrench_like(wrench, motion.time.shape, on_invalid)
        if method == "pinocchio":
            solution = pinocchio_route.solve(
                self.loop,
                self.parameters.geometry.h,
                *states,
                wrench=loads,
                on_invalid=on_invalid,
                progress=progress,
            )
        else:
            solution = virtual_power_route.solve(self.parameters, *states, wrench=loads)
        actuation = self.singularity(states[0]).actuation
        return _with_evidence(method, motion, solution, loads, actuation)


def _check_method(method: str) -> None:
    if method not in METHODS:
        raise InputError(f"method: expected {' or '.join(map(repr, METHODS))}, got {method!r}")


def _with_evidence(
    method: str, motion: Motion, solution: Solution, wrench: FloatArray | None, actuation: FloatArray
) -> InverseDynamics:
    """Balance the power of actuators and wrench with the rate of change of the energy."""
    speeds = solution.joints.columns(SLIDES).v
    power = np.sum(solution.forces * speeds, axis=-1)
    given = power
    if wrench is not None:
        given = power + np.sum(wrench[:, (1, 2, 4)] * motion.velocity, axis=-1)
    return InverseDynamics(
        method,
        motion,
        solution.forces,
        solution.joints,
        solution.closure_error,
        power,
        given - solution.energy_rate,
        actuation,
    )
