"""The compiled way: dynamics and kinematics by the kernels, with the errors of the others.

A kernel tells whether every sample is clearly good. If not, `p3dof.kinematics` decides which samples are
refused, as it does for the virtual powers, and NumPy does those again that are not clearly good.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from p3dof.checks import FloatArray, Progress
from p3dof.compiled.formulas import ACCELERATION, POSE, VELOCITY
from p3dof.compiled.friction import loss_derivatives, losses
from p3dof.compiled.kernels import MachineKernels, on_arrays
from p3dof.compiled.reduced import State
from p3dof.kinematics import Placed, holdable, reachable
from p3dof.methods.closed_form import solution_with
from p3dof.methods.solution import Solution
from p3dof.motion.states import States
from p3dof.motion.wrenches import WRENCH_ROWS
from p3dof.parameters import Geometry
from p3dof.samples import raise_not_finite

_BY_STATE = tuple((*POSE, *VELOCITY, *ACCELERATION).index(name) for name in State._fields)
"""Columns of pose, velocity and acceleration in a row that the forces change with."""

_MOVING = ("pose", "velocity", "acceleration")
_DRIVEN = ("pose", "velocity", "forces")
_POSE = ("pose",)

_RESULT = {
    "inverse_dynamics": "forces",
    "inverse_dynamics_loaded": "forces",
    "inverse_dynamics_derivatives": "forces and derivatives",
    "forward_dynamics": "acceleration",
    "forward_dynamics_loaded": "acceleration",
    "mass_matrix": "mass matrix",
    "kinematics": "sliders",
}
"""What to call the first three outputs of a kernel."""

_Gate: TypeAlias = Callable[[Geometry, States], Placed]
"""Raises for the states that are refused, or leaves their rows NaN."""


class CompiledMethod:
    """Forces and equations of motion by the compiled kernels; doors as `DynamicsMethod` has them.

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.
    """

    def __init__(self, kernels: MachineKernels) -> None:
        self._kernels = kernels
        self._friction = bool(kernels.parameters.friction)

    def forces(self, states: States) -> FloatArray:
        """Return the actuator forces (..., 3) [N]."""
        loads = _loads(self._kernels, states, self._friction)
        name = "inverse_dynamics" if loads is None else "inverse_dynamics_loaded"
        return _run(self._kernels, name, states, _MOVING, loads, 3, holdable).reshape(states.pose.shape)

    def solve(self, states: States, progress: Progress | None = None) -> Solution:  # noqa: ARG002 - it is quick
        """Return forces by the kernels, joints and evidence by the closed forms, at N samples."""
        parameters = self._kernels.parameters
        placed = holdable(parameters.geometry, states)
        looked_at = placed.states._replace(on_invalid="nan")
        loads = _loads(self._kernels, looked_at, self._friction)
        name = "inverse_dynamics" if loads is None else "inverse_dynamics_loaded"
        forces = _run(self._kernels, name, looked_at, _MOVING, loads, 3, None)
        return solution_with(forces, parameters, placed)

    def accelerate(self, states: States) -> FloatArray:
        """Return the acceleration (..., 3) of the platform under forces."""
        loads = _loads(self._kernels, states, self._friction)
        name = "forward_dynamics" if loads is None else "forward_dynamics_loaded"
        return _run(self._kernels, name, states, _DRIVEN, loads, 3, reachable).reshape(states.pose.shape)

    def jacobian(self, states: States) -> FloatArray:
        """Return ∂(λA, λB, λC)/∂(y, z, θ), (..., 3, 3)."""
        found = _run(self._kernels, "kinematics", states, _POSE, None, 7, reachable)
        J = np.zeros((len(found), 3, 3))
        J[:, :, 0], J[:, :, 1], J[:, 2, 2] = found[:, 3:6], 1, found[:, 6]
        J[np.isnan(found[:, 0])] = np.nan
        return J.reshape(*states.shape, 3, 3)

    def mass_matrix(self, states: States) -> FloatArray:
        """Return the mass matrix in y, z, θ, (..., 3, 3)."""
        found = _run(self._kernels, "mass_matrix", states, _POSE, None, 6, reachable)
        yy, yz, yt, zt, tt, zz = range(6)
        return found[:, [yy, yz, yt, yz, zz, zt, yt, zt, tt]].reshape(*states.shape, 3, 3)


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


def inverse_dynamics_derivatives(kernels: MachineKernels, states: States) -> ForceDerivatives:
    """Return the actuator forces and their derivatives by pose, velocity and acceleration.

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.
    states : States
        Poses, velocities, accelerations and wrench, which stays when the motion changes.

    Returns
    -------
    ForceDerivatives
    """
    name, rows, leading = "inverse_dynamics_derivatives", states.rows(), states.shape
    count = len(rows.pose)
    friction = bool(kernels.parameters.friction)
    loads = _loads(kernels, states, friction) or 3 * [np.zeros(count)]
    found = _run(kernels, name, states, _MOVING, loads, 24, holdable)
    by = np.zeros((count, 3, 9))  # z and ż change no force, but through friction
    by[:, :, _BY_STATE] = found[:, 3:].reshape(count, 3, 7)
    by[np.isnan(found[:, 0])] = np.nan
    if friction:
        by[:, :, :6] += loss_derivatives(kernels.parameters, rows.pose, rows.velocity)
    whole = by.reshape(*leading, 3, 9)
    return ForceDerivatives(
        found[:, :3].reshape(*leading, 3), whole[..., :3], whole[..., 3:6], whole[..., 6:]
    )


def sliders(kernels: MachineKernels, states: States) -> FloatArray:
    """Return the slider positions at poses.

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.
    states : States
        Poses.

    Returns
    -------
    ndarray, shape (..., 3)
        [m]
    """
    return _run(kernels, "kinematics", states, _POSE, None, 7, reachable)[:, :3].reshape(states.pose.shape)


def _run(
    kernels: MachineKernels,
    name: str,
    states: States,
    inputs: Sequence[str],
    loads: Sequence[FloatArray] | None,
    width: int,
    gate: _Gate | None,
) -> FloatArray:
    """Return the outputs (N, width) of a kernel; refused samples raise, or their rows become NaN.

    Without a gate, the states were looked at already.
    """
    if states.pose.size == 3:  # one sample is quicker as plain numbers
        numbers = [number for each in inputs for number in getattr(states, each).ravel().tolist()]
        if loads is not None:
            numbers += [load.item() for load in loads]
        *row, margin = kernels.function(name)(*numbers)
        if margin > 0:
            return np.array([row])
    rows = states.rows()
    columns = [column for each in inputs for column in _aligned(getattr(rows, each)).T]
    columns += loads or []
    found = np.empty((len(rows.pose), width))
    if kernels.run(name, columns, [*found.T, None]):
        return found
    if gate is not None and states.on_invalid == "raise":
        gate(kernels.parameters.geometry, states)
    _do_again(kernels, name, rows, inputs, columns, found, gate)
    if states.on_invalid == "raise":
        raise_not_finite(_RESULT[name], found[:, :3].reshape(states.pose.shape))
    return found


def _do_again(
    kernels: MachineKernels,
    name: str,
    rows: States,
    inputs: Sequence[str],
    columns: Sequence[FloatArray],
    found: FloatArray,
    gate: _Gate | None,
) -> None:
    """Enter the outputs of what is not clearly good, by NumPy; NaN for what is refused."""
    margins = np.empty(len(found))
    kernels.run(name, columns, [*found.T, margins])
    doubtful = np.flatnonzero(~(margins > 0))
    again = np.empty((found.shape[1], len(doubtful)))
    on_arrays(*kernels.prepared(name), [column[doubtful] for column in columns], [*again, None])
    checked = rows.of_rows(doubtful, "nan")
    if gate is not None:
        checked = gate(kernels.parameters.geometry, checked).states
    known = [getattr(checked, each) for each in inputs]
    good = np.all([np.isfinite(each).all(axis=-1) for each in (*known, again.T)], axis=0)
    found[doubtful] = np.where(good[:, None], again.T, np.nan)


def _aligned(array: FloatArray) -> FloatArray:
    """Return an array that a kernel can read: fields of records need not be."""
    return array if array.flags.aligned else array.copy()


def _loads(kernels: MachineKernels, states: States, friction: bool) -> list[FloatArray] | None:
    """Return wrench less friction on y, z and θ, each (N,), or None if there is neither."""
    if states.wrench is None and not friction:
        return None
    rows = states.rows()
    found = None
    if rows.wrench is not None:
        wrench = _aligned(rows.wrench)
        found = [wrench[:, row] for row in WRENCH_ROWS]
    if not friction:
        return found
    lost = losses(kernels.parameters, _aligned(rows.pose), _aligned(rows.velocity)).T
    return [-one for one in lost] if found is None else [w - one for w, one in zip(found, lost, strict=True)]
