"""`Manipulator`: one machine, with its kinematics and both dynamics behind a few calls."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from p3dof import virtual_power
from p3dof.checks import FloatArray
from p3dof.errors import InputError
from p3dof.kinematics import OnInvalid
from p3dof.kinematics.states import holdable_states, wrench_like
from p3dof.manipulator.minimal_form import Method, MovingMachine, check_method
from p3dof.motion import Motion
from p3dof.parameters import PAPER, Parameters, read_parameters
from p3dof.routes import pinocchio_route, virtual_power_route
from p3dof.routes.results import SLIDES, InverseDynamics, Solution

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


class Manipulator(MovingMachine):
    """The 3-DOF spatial parallel manipulator: parameters, model and both dynamics.

    Poses are (y [m], z [m], θ [rad]), zero at home; sliders and forces are ordered A, B, C, positive along
    +z0. Arrays may have any leading batch dimensions. The Pinocchio route works in buffers of its own: give
    each thread its own manipulator.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    """

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
        check_method(method)
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
            friction=self.parameters.friction,
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
        check_method(method)
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
                friction=self.parameters.friction,
                on_invalid=on_invalid,
                progress=progress,
            )
        else:
            solution = virtual_power_route.solve(self.parameters, *states, wrench=loads)
        actuation = self.singularity(states[0]).actuation
        return _with_evidence(method, motion, solution, loads, actuation)


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
        given - solution.dissipation - solution.energy_rate,
        solution.dissipation,
        actuation,
    )
