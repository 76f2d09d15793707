"""The compiled way: dynamics and kinematics by the kernels, with the errors of the others.

A kernel tells whether every sample is clearly good. If not, `p3dof.closed_form.kinematics` decides which
samples are refused, as it does for the virtual powers, and NumPy does those again that are not clearly good.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p3dof._base.checks import FloatArray, Progress, shown
from p3dof._base.errors import InputError
from p3dof._base.outputs import checked_parts, in_rows
from p3dof.closed_form.compiled.formulas import ACCELERATION, POSE, VELOCITY
from p3dof.closed_form.compiled.friction import loss_derivatives
from p3dof.closed_form.compiled.kernels import MachineKernels
from p3dof.closed_form.compiled.reduced import MOVING
from p3dof.closed_form.kinematics import Placed, holdable, reachable
from p3dof.machine.motion.states import States
from p3dof.methods import kernel_runs
from p3dof.methods.closed_form import solve_with
from p3dof.methods.kernel_runs import aligned, driven, loads_on, run_kernel
from p3dof.methods.one_sample import OneSample
from p3dof.methods.solution import Solution

_BY_STATE = tuple((*POSE, *VELOCITY, *ACCELERATION).index(name) for name in MOVING)
"""Columns of pose, velocity and acceleration in a row that the forces change with."""


class CompiledMethod:
    """Forces and equations of motion by the compiled kernels; doors as `DynamicsMethod` has them.

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.
    """

    def __init__(self, kernels: MachineKernels) -> None:
        self._kernels = kernels
        self.one = OneSample(kernels)

    def forces(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the actuator forces (..., 3) [N]."""
        name, loads = driven(self._kernels, "inverse_dynamics", states)
        found = np.empty(states.pose.shape) if out is None else out
        columns = list(found.reshape(-1, 3).T)
        run_kernel(self._kernels, name, states, kernel_runs.MOVING, loads, columns, holdable)
        return found

    def solve(self, states: States, progress: Progress | None = None) -> Solution:  # noqa: ARG002 - it is quick
        """Return forces by the kernels, joints and evidence by the closed forms, at N samples."""
        return solve_with(self._forces_at, self._kernels.parameters, states)

    def _forces_at(self, placed: Placed) -> FloatArray:
        """Return the forces (n, 3) at states that were looked at."""
        states = placed.states._replace(on_invalid="nan")
        name, loads = driven(self._kernels, "inverse_dynamics", states)
        forces = np.empty(states.pose.shape)
        run_kernel(self._kernels, name, states, kernel_runs.MOVING, loads, list(forces.T), None)
        return forces

    def accelerate(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the acceleration (..., 3) of the platform under forces."""
        name, loads = driven(self._kernels, "forward_dynamics", states)
        found = np.empty(states.pose.shape) if out is None else out
        columns = list(found.reshape(-1, 3).T)
        run_kernel(self._kernels, name, states, kernel_runs.DRIVEN, loads, columns, reachable)
        return found

    def jacobian(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return ∂(λA, λB, λC)/∂(y, z, θ), (..., 3, 3)."""
        found = np.empty((*states.shape, 3, 3)) if out is None else out
        rows = found.reshape(-1, 3, 3)
        positions = np.empty((len(rows), 3))
        columns = [*positions.T, *rows[:, :, 0].T, rows[:, 2, 2]]
        run_kernel(self._kernels, "kinematics", states, kernel_runs.POSE, None, columns, reachable)
        rows[:, :, 1], rows[:, :2, 2] = 1, 0
        rows[np.isnan(positions[:, 0])] = np.nan
        return found

    def mass_matrix(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the mass matrix in y, z, θ, (..., 3, 3)."""
        found = np.empty((*states.shape, 3, 3)) if out is None else out
        M = found.reshape(-1, 3, 3)
        upper = [M[:, 0, 0], M[:, 0, 1], M[:, 0, 2], M[:, 1, 2], M[:, 2, 2], M[:, 1, 1]]
        run_kernel(self._kernels, "mass_matrix", states, kernel_runs.POSE, None, upper, reachable)
        M[:, 1, 0], M[:, 2, 0], M[:, 2, 1] = M[:, 0, 1], M[:, 0, 2], M[:, 1, 2]
        return found


@dataclass(frozen=True, eq=False)
class ForceDerivatives:
    """Actuator forces, and how they change with the motion; exact.

    Parameters
    ----------
    forces : ndarray, shape (..., 3)
        Of A, B, C [N].
    by_pose, by_velocity, by_acceleration : ndarray, shape (..., 3, 3)
        ∂f/∂x: rows A, B, C; columns y, z [N/m] and θ [N/rad], or their rates.
    """

    forces: FloatArray
    by_pose: FloatArray
    by_velocity: FloatArray
    by_acceleration: FloatArray

    @property
    def arrays(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """The four arrays, in the order above."""
        return self.forces, self.by_pose, self.by_velocity, self.by_acceleration


def inverse_dynamics_derivatives(
    kernels: MachineKernels, states: States, out: ForceDerivatives | None = None
) -> ForceDerivatives:
    """Return the actuator forces and their derivatives by pose, velocity and acceleration.

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.
    states : States
        Poses, velocities, accelerations and wrench, which stays when the motion changes.
    out : ForceDerivatives, optional
        A result of the same shape, which is written again; NaN after an error in the states.

    Returns
    -------
    ForceDerivatives

    Raises
    ------
    InputError
        If `out` does not fit.
    """
    if out is None:
        return _derivatives_in(_room_for(states.shape), kernels, states)
    if not isinstance(out, ForceDerivatives):
        raise InputError(f"out: expected ForceDerivatives, got {shown(out)}")
    shapes = states.pose.shape, *3 * [(*states.shape, 3, 3)]
    checked_parts(out.arrays, ("forces", "by_pose", "by_velocity", "by_acceleration"), shapes, states)
    direct = all(in_rows(array, array.ndim - states.pose.ndim + 1) for array in out.arrays)
    try:
        found = _derivatives_in(out if direct else _room_for(states.shape), kernels, states)
        if found is not out:
            for array, values in zip(out.arrays, found.arrays, strict=True):
                array[...] = values
    except BaseException:
        for array in out.arrays:
            array.fill(np.nan)
        raise
    return out


def _room_for(shape: tuple[int, ...]) -> ForceDerivatives:
    """Return an empty result for states of a shape."""
    whole = np.empty((*shape, 3, 9))
    return ForceDerivatives(np.empty((*shape, 3)), whole[..., :3], whole[..., 3:6], whole[..., 6:])


def _derivatives_in(room: ForceDerivatives, kernels: MachineKernels, states: States) -> ForceDerivatives:
    name, rows = "inverse_dynamics_derivatives", states.rows()
    forces, *by = (array.reshape(-1, *array.shape[states.pose.ndim - 1 :]) for array in room.arrays)
    loads = loads_on(kernels, states) or 3 * [np.zeros(len(rows.pose))]
    columns = [by[k // 3][:, force, k % 3] for force in range(3) for k in _BY_STATE]
    run_kernel(kernels, name, states, kernel_runs.MOVING, loads, [*forces.T, *columns], holdable)
    refused = np.isnan(forces[:, 0])
    for k in set(range(9)) - set(_BY_STATE):  # z and ż change no force, but through springs and friction
        by[k // 3][:, :, k % 3] = np.where(refused, np.nan, 0.0)[:, None]
    by[0][:, :, 1] += kernels.parameters.actuators.stiffness
    if kernels.has_friction:
        lost = loss_derivatives(kernels.parameters, aligned(rows.pose), aligned(rows.velocity))
        by[0] += lost[..., :3]
        by[1] += lost[..., 3:]
    return room


def sliders(kernels: MachineKernels, states: States, out: FloatArray | None = None) -> FloatArray:
    """Return the slider positions at poses.

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.
    states : States
        Poses.
    out : ndarray, shape (..., 3), optional
        Where to write.

    Returns
    -------
    ndarray, shape (..., 3)
        [m]
    """
    found = np.empty(states.pose.shape) if out is None else out
    columns = [*found.reshape(-1, 3).T, *np.empty((4, found.size // 3))]
    run_kernel(kernels, "kinematics", states, kernel_runs.POSE, None, columns, reachable)
    return found


def coriolis_matrix(kernels: MachineKernels, states: States, out: FloatArray | None = None) -> FloatArray:
    """Return the matrix of centrifugal and Coriolis forces; see `equations_of_motion.coriolis_matrix`.

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.
    states : States
        Poses and velocities.
    out : ndarray, shape (..., 3, 3), optional
        Where to write.

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    found = np.empty((*states.shape, 3, 3)) if out is None else out
    entries = found.reshape(-1, 3, 3)
    columns = [entries[:, i, j] for i in range(3) for j in (0, 2)]
    run_kernel(kernels, "coriolis_matrix", states, kernel_runs.TURNING, None, columns, reachable)
    entries[:, :, 1] = np.where(np.isnan(columns[0]), np.nan, 0.0)[:, None]
    return found


def gravity_forces(kernels: MachineKernels, states: States, out: FloatArray | None = None) -> FloatArray:
    """Return the gradient of the potential energy; see `equations_of_motion.gravity_forces`.

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.
    states : States
        Poses.
    out : ndarray, shape (..., 3), optional
        Where to write.

    Returns
    -------
    ndarray, shape (..., 3)
        [N, N, N m]
    """
    found = np.empty(states.pose.shape) if out is None else out
    columns = list(found.reshape(-1, 3).T)
    run_kernel(kernels, "gravity_forces", states, kernel_runs.POSE, None, columns, reachable)
    return found
