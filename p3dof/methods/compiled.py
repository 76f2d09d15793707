"""Dynamics and kinematics of arrays of states by the kernels, with checks and errors as the other methods.

A kernel tells whether every sample is clearly good. If not, `p3dof.kinematics` decides which samples are
refused, as it does for the other methods, and NumPy does those again that are not clearly good.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from p3dof.checks import FloatArray, batch_of
from p3dof.compiled.formulas import ACCELERATION, POSE, VELOCITY
from p3dof.compiled.friction import loss_derivatives, losses
from p3dof.compiled.kernels import MachineKernels, on_arrays
from p3dof.compiled.reduced import State
from p3dof.errors import InputError
from p3dof.kinematics.states import forced_states, holdable_states, reachable_poses
from p3dof.motion.wrenches import WRENCH_ROWS
from p3dof.samples import OnInvalid, check_policy, raise_not_finite, wrench_like

_BY_STATE = tuple((*POSE, *VELOCITY, *ACCELERATION).index(name) for name in State._fields)
"""Columns of pose, velocity and acceleration in a row that the forces change with."""

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

_Check: TypeAlias = Callable[[Sequence[FloatArray], OnInvalid], Sequence[FloatArray]]
"""Raises for the states that are refused, or returns them with their rows NaN."""


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


def forces(
    kernels: MachineKernels,
    pose: ArrayLike,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    wrench: ArrayLike | None = None,
    on_invalid: OnInvalid = "raise",
) -> FloatArray:
    """Return the actuator forces; arguments, result and errors are those of `virtual_power.forces`.

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.
    pose, velocity, acceleration, wrench, on_invalid
        As for `p3dof.paper.virtual_power.forces`.

    Returns
    -------
    ndarray, shape (..., 3)
        [N]
    """
    states, leading = _states(
        ("pose", "velocity", "acceleration"), (pose, velocity, acceleration), on_invalid
    )
    loads = _loads(kernels, states, wrench, leading, on_invalid)
    name = "inverse_dynamics" if loads is None else "inverse_dynamics_loaded"
    found = np.empty((len(states[0]), 3))

    def check(rows: Sequence[FloatArray], policy: OnInvalid) -> Sequence[FloatArray]:
        poses, speeds, rates = rows
        return holdable_states(kernels.parameters, poses, speeds, rates, policy)

    _solve(kernels, name, states if loads is None else [*states, loads], found, check, on_invalid, leading)
    return found.reshape(*leading, 3)


def inverse_dynamics_derivatives(
    kernels: MachineKernels,
    pose: ArrayLike,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    wrench: ArrayLike | None = None,
    on_invalid: OnInvalid = "raise",
) -> ForceDerivatives:
    """Return the actuator forces and their derivatives by pose, velocity and acceleration.

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.
    pose, velocity, acceleration, wrench, on_invalid
        As for `p3dof.paper.virtual_power.forces`; the wrench stays when the motion changes.

    Returns
    -------
    ForceDerivatives
    """
    states, leading = _states(
        ("pose", "velocity", "acceleration"), (pose, velocity, acceleration), on_invalid
    )
    loads = _loads(kernels, states, wrench, leading, on_invalid)
    count = len(states[0])
    found = np.empty((count, 24))

    def check(rows: Sequence[FloatArray], policy: OnInvalid) -> Sequence[FloatArray]:
        poses, speeds, rates = rows
        return holdable_states(kernels.parameters, poses, speeds, rates, policy)

    given = [*states, np.broadcast_to(np.zeros(3), (count, 3)) if loads is None else loads]
    _solve(kernels, "inverse_dynamics_derivatives", given, found, check, on_invalid, leading)
    by = np.zeros((count, 3, 9))  # z and ż change no force, but through friction
    by[:, :, _BY_STATE] = found[:, 3:].reshape(count, 3, 7)
    by[np.isnan(found[:, 0])] = np.nan
    if kernels.parameters.friction:
        by[:, :, :6] += loss_derivatives(kernels.parameters, *states[:2])
    whole = by.reshape(*leading, 3, 9)
    return ForceDerivatives(
        found[:, :3].reshape(*leading, 3), whole[..., :3], whole[..., 3:6], whole[..., 6:]
    )


def forward_dynamics(
    kernels: MachineKernels,
    pose: ArrayLike,
    velocity: ArrayLike,
    forces: ArrayLike,
    wrench: ArrayLike | None = None,
    on_invalid: OnInvalid = "raise",
) -> FloatArray:
    """Return the acceleration of the platform; arguments, result and errors are those of `minimal`.

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.
    pose, velocity, forces, wrench, on_invalid
        As for `p3dof.methods.equations_of_motion.forward_dynamics`.

    Returns
    -------
    ndarray, shape (..., 3)
        ÿ, z̈ [m/s²], θ̈ [rad/s²].
    """
    states, leading = _states(("pose", "velocity", "forces"), (pose, velocity, forces), on_invalid)
    loads = _loads(kernels, states, wrench, leading, on_invalid)
    name = "forward_dynamics" if loads is None else "forward_dynamics_loaded"
    found = np.empty((len(states[0]), 3))

    def check(rows: Sequence[FloatArray], policy: OnInvalid) -> Sequence[FloatArray]:
        poses, speeds, given = rows
        return forced_states(kernels.parameters, poses, speeds, given, policy)

    _solve(kernels, name, states if loads is None else [*states, loads], found, check, on_invalid, leading)
    return found.reshape(*leading, 3)


def mass_matrix(kernels: MachineKernels, pose: ArrayLike, on_invalid: OnInvalid = "raise") -> FloatArray:
    """Return the mass matrix; arguments, result and errors are those of `minimal.mass_matrix`.

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.
    pose, on_invalid
        As for `p3dof.methods.equations_of_motion.mass_matrix`.

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    found, leading = _of_pose(kernels, "mass_matrix", pose, 6, on_invalid)
    yy, yz, yt, zt, tt, zz = range(6)
    return found[:, [yy, yz, yt, yz, zz, zt, yt, zt, tt]].reshape(*leading, 3, 3)


def sliders(kernels: MachineKernels, pose: ArrayLike, on_invalid: OnInvalid = "raise") -> FloatArray:
    """Return the slider positions; arguments and errors are those of `kinematics.inverse_kinematics`.

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.
    pose, on_invalid
        As for `p3dof.kinematics.inverse_kinematics`.

    Returns
    -------
    ndarray, shape (..., 3)
        [m]
    """
    found, leading = _of_pose(kernels, "kinematics", pose, 7, on_invalid)
    return found[:, :3].reshape(*leading, 3)


def jacobian(kernels: MachineKernels, pose: ArrayLike, on_invalid: OnInvalid = "raise") -> FloatArray:
    """Return ∂(λA, λB, λC)/∂(y, z, θ); arguments and errors are those of `kinematics.inverse_jacobian`.

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.
    pose, on_invalid
        As for `p3dof.kinematics.inverse_jacobian`.

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    found, leading = _of_pose(kernels, "kinematics", pose, 7, on_invalid)
    J = np.zeros((len(found), 3, 3))
    J[:, :, 0], J[:, :, 1], J[:, 2, 2] = found[:, 3:6], 1, found[:, 6]
    J[np.isnan(found[:, 0])] = np.nan
    return J.reshape(*leading, 3, 3)


def _of_pose(
    kernels: MachineKernels,
    name: str,
    pose: ArrayLike,
    width: int,
    on_invalid: OnInvalid,
) -> tuple[FloatArray, tuple[int, ...]]:
    """Return the outputs (N, width) of a kernel that takes the pose, and the shape of the batch."""
    (poses,), leading = _states(("pose",), (pose,), on_invalid)
    found = np.empty((len(poses), width))

    def check(rows: Sequence[FloatArray], policy: OnInvalid) -> Sequence[FloatArray]:
        return (reachable_poses(kernels.parameters.geometry, rows[0], policy),)

    _solve(kernels, name, [poses], found, check, on_invalid, leading)
    return found, leading


def _solve(
    kernels: MachineKernels,
    name: str,
    given: Sequence[FloatArray],
    found: FloatArray,
    check: _Check,
    on_invalid: OnInvalid,
    leading: tuple[int, ...],
) -> None:
    """Run a kernel from rows (N, 3) into rows; refused samples raise, or their rows become NaN."""
    if len(found) == 1:  # one sample is quicker as plain numbers
        *row, margin = kernels.function(name)(*(number for rows in given for number in rows[0].tolist()))
        found[0] = row
        if margin > 0:
            return
    columns, outputs = [column for rows in given for column in rows.T], list(found.T)
    if kernels.run(name, columns, [*outputs, None]):
        return
    states = given[: 1 if len(given) == 1 else 3]
    if on_invalid == "raise":
        check(_in_shape(states, leading), "raise")
    margins = np.empty(len(found))
    kernels.run(name, columns, [*outputs, margins])
    doubtful = np.flatnonzero(~(margins > 0))
    again = np.empty((found.shape[1], len(doubtful)))
    on_arrays(*kernels.prepared(name), [column[doubtful] for column in columns], [*again, None])
    checked = check([rows[doubtful] for rows in states], "nan")
    good = np.all([np.isfinite(rows).all(axis=-1) for rows in (*checked, again.T)], axis=0)
    found[doubtful] = np.where(good[:, None], again.T, np.nan)
    if on_invalid == "raise":
        raise_not_finite(_RESULT[name], found[:, :3].reshape(*leading, 3))


def _states(
    names: Sequence[str], given: Sequence[ArrayLike], on_invalid: OnInvalid
) -> tuple[list[FloatArray], tuple[int, ...]]:
    """Return what the user gave as rows (N, 3) of one length, and the shape of the batch."""
    check_policy(on_invalid)
    arrays = [batch_of(name, value, 3) for name, value in zip(names, given, strict=True)]
    leading = arrays[0].shape[:-1]
    if any(array.shape[:-1] != leading for array in arrays):
        try:
            arrays = list(np.broadcast_arrays(*arrays))
        except ValueError as error:
            shapes = ", ".join(str(array.shape) for array in arrays)
            raise InputError(
                f"{', '.join(names)}: expected shapes that fit each other, got {shapes}"
            ) from error
        leading = arrays[0].shape[:-1]
    rows = [array.reshape(-1, 3) for array in arrays]
    return [array if array.flags.aligned else array.copy() for array in rows], leading


def _in_shape(states: Sequence[FloatArray], leading: tuple[int, ...]) -> list[FloatArray]:
    return [rows.reshape(*leading, 3) for rows in states]


def _loads(
    kernels: MachineKernels,
    states: Sequence[FloatArray],
    wrench: ArrayLike | None,
    leading: tuple[int, ...],
    on_invalid: OnInvalid,
) -> FloatArray | None:
    """Return wrench less friction on y, z, θ, (N, 3), or None if there is neither."""
    found: FloatArray | None = None
    if wrench is not None:
        found = wrench_like(wrench, leading, on_invalid).reshape(-1, 6)[:, WRENCH_ROWS]
    if kernels.parameters.friction:
        lost = losses(kernels.parameters, *states[:2])
        found = -lost if found is None else found - lost
    return found
