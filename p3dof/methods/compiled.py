"""The compiled way: dynamics and kinematics by the kernels, with the errors of the others.

A kernel tells whether every sample is clearly good. If not, `p3dof.closed_form.kinematics` decides which
samples are refused, as it does for the virtual powers, and NumPy does those again that are not clearly good.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, Progress, Readable, shown
from p3dof._base.errors import InputError
from p3dof._base.outputs import checked_parts, in_rows
from p3dof._base.samples import OnInvalid, check_policy
from p3dof._base.time_series.wrenches import WRENCH_ROWS
from p3dof.closed_form.compiled.formulas import ACCELERATION, DERIVATIVES, POSE, VELOCITY
from p3dof.closed_form.compiled.kernels import MachineKernels, on_arrays
from p3dof.closed_form.kinematics import JOINTS, Placed, forward_kinematics, holdable, reachable
from p3dof.machine.motion.states import States
from p3dof.machine.parameters import SLIDES, Geometry
from p3dof.methods.closed_form import solve_with
from p3dof.methods.one_sample import OneSample
from p3dof.methods.solution import JointStates, Solution, later

WHOLE_STATE = ("pose", "velocity", "acceleration")
DRIVEN = ("pose", "velocity", "forces")
TURNING = ("pose", "velocity")
POSE_ONLY = ("pose",)
"""What of the states a kernel reads, before the loads."""

_RESULT = {
    "inverse_dynamics": "forces",
    "inverse_dynamics_loaded": "forces",
    "inverse_dynamics_derivatives": "forces and derivatives",
    "inverse_dynamics_derivatives_with_friction": "forces and derivatives",
    "forward_dynamics": "acceleration",
    "forward_dynamics_loaded": "acceleration",
    "inverse_dynamics_with_friction": "forces",
    "forward_dynamics_with_friction": "acceleration",
    "mass_matrix": "mass matrix",
    "coriolis_matrix": "Coriolis matrix",
    "gravity_forces": "gravity forces",
    "kinematics": "sliders",
}
"""What to call the first three outputs of a kernel."""

_NONE = np.zeros(0, dtype=np.intp)

Gate: TypeAlias = Callable[[Geometry, States], Placed]
"""Raises for the states that are refused, or leaves their rows NaN."""


def run_kernel(
    kernels: MachineKernels,
    name: str,
    states: States,
    inputs: Sequence[str],
    loads: Sequence[FloatArray] | None,
    found: Sequence[FloatArray],
    gate: Gate,
) -> None:
    """Write the outputs of a kernel at N states."""
    if states.pose.size == 3:  # one sample is quicker as plain numbers
        numbers = [number for each in inputs for number in getattr(states, each).ravel().tolist()]
        if loads is not None:
            numbers += [load.item() for load in loads]
        *row, margin = kernels.function(name)(*numbers)
        if margin > 0:
            for output, number in zip(found, row, strict=True):
                output[0] = number
            return
    rows = states.rows()
    columns = [*_columns(rows, inputs), *(loads or ())]
    if kernels.run(name, columns, [*found, None]):
        return
    if states.on_invalid == "raise":
        gate(kernels.parameters.geometry, states)
    _do_again(kernels, name, rows, inputs, columns, found, gate)
    if states.on_invalid == "raise":
        states.raise_overflow(_RESULT[name], np.stack(found[:3], axis=-1).reshape(states.pose.shape))


def _do_again(
    kernels: MachineKernels,
    name: str,
    rows: States,
    inputs: Sequence[str],
    columns: Sequence[FloatArray],
    found: Sequence[FloatArray],
    gate: Gate,
) -> NDArray[np.intp]:
    """Enter the outputs of what is not clearly good, by NumPy; NaN for what is refused. Return its rows."""
    margins = np.empty(len(rows.pose))
    kernels.run(name, columns, [*found, margins])
    doubtful = np.flatnonzero(~(margins > 0))
    again = np.empty((len(found), len(doubtful)))
    on_arrays(*kernels.prepared(name), [column[doubtful] for column in columns], [*again, None])
    checked = gate(kernels.parameters.geometry, rows.of_rows(doubtful, "nan")).states
    known = [getattr(checked, each) for each in inputs]
    good = np.all([np.isfinite(each).all(axis=-1) for each in (*known, again.T)], axis=0)
    for output, values in zip(found, again, strict=True):
        output[doubtful] = np.where(good, values, np.nan)
    return doubtful


def _columns(rows: States, names: Sequence[str]) -> list[FloatArray]:
    return [column for each in names for column in aligned(getattr(rows, each)).T]


def _evidence(
    kernels: MachineKernels, states: States, doubtful: NDArray[np.intp], name: str
) -> dict[str, Any]:
    """Return joints, or all other evidence of a solution; by NumPy where forces were not clearly good."""
    count, columns = len(states.pose), _columns(states, WHOLE_STATE)
    again = None
    if doubtful.size:
        again = solve_with(
            lambda placed: placed.states.pose, kernels.parameters, states.of_rows(doubtful, "nan")
        )
    if name == "joints":
        joints = np.empty((3, count, len(JOINTS)))
        kernels.run("joints", columns, [*(column for each in joints for column in each.T), None])
        if again is not None:
            joints[:, doubtful] = again.joints.q, again.joints.v, again.joints.a
        return {"joints": JointStates(JOINTS, *joints)}
    speeds, gap, rate, lost = np.empty((count, 3)), np.empty(count), np.empty(count), np.zeros(count)
    kernels.run("evidence", columns, [*speeds.T, gap, rate, None])
    if kernels.has_friction:
        kernels.run("dissipation", columns[:6], [lost, None])
    found = {"speeds": speeds, "closure_error": gap, "energy_rate": rate, "dissipation": lost}
    if again is not None:
        speeds[doubtful] = again.joints.columns(SLIDES).v
        for each in ("closure_error", "energy_rate", "dissipation"):
            found[each][doubtful] = getattr(again, each)
    return found


def aligned(array: FloatArray) -> FloatArray:
    """Return an array that a kernel can read: fields of records need not be."""
    return array if array.flags.aligned and array.size else array.copy()


def driven(kernels: MachineKernels, kind: str, states: States) -> tuple[str, list[FloatArray] | None]:
    """Return the kernel for a machine and its states, and the loads that it takes."""
    friction = kernels.has_friction
    if states.wrench is None and not friction:
        return kind, None
    return f"{kind}_{'with_friction' if friction else 'loaded'}", loads_on(states)


def loads_on(states: States) -> list[FloatArray]:
    """Return what the wrench is on y, z and θ, each (N,); zeros where there is none [N, N, N m]."""
    given = states.rows().wrench
    if given is None:
        return [np.broadcast_to(0.0, states.pose.size // 3)] * 3
    wrench = aligned(given)
    return [wrench[:, row] for row in WRENCH_ROWS]


class CompiledMethod:
    """Forces and equations of motion by the compiled kernels; doors as `DynamicsMethod` has them."""

    def __init__(self, kernels: MachineKernels) -> None:
        self._kernels = kernels
        self.one = OneSample(kernels)

    def forces(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the actuator forces (..., 3) [N]."""
        name, loads = driven(self._kernels, "inverse_dynamics", states)
        found = np.empty(states.pose.shape) if out is None else out
        columns = list(found.reshape(-1, 3).T)
        run_kernel(self._kernels, name, states, WHOLE_STATE, loads, columns, holdable)
        return found

    def solve(self, states: States, progress: Progress | None = None) -> Solution:  # noqa: ARG002 - it is quick
        """Return the forces at N samples, and joints and evidence when they are asked for, all by kernels."""
        kernels, count = self._kernels, len(states.pose)
        name, loads = driven(kernels, "inverse_dynamics", states)
        forces, actuation = np.empty((count, 3)), np.empty(count)
        doubtful: NDArray[np.intp] = _NONE
        columns = _columns(states, WHOLE_STATE)
        if not kernels.run(name, columns + (loads or []), [*forces.T, None]):
            if states.on_invalid == "raise":
                holdable(kernels.parameters.geometry, states)
            doubtful = _do_again(
                kernels, name, states, WHOLE_STATE, columns + (loads or []), list(forces.T), holdable
            )
        kernels.run("actuation", columns[:3], [actuation, None])
        if doubtful.size:
            checked = holdable(kernels.parameters.geometry, states.of_rows(doubtful, "nan"))
            actuation[doubtful] = checked.actuation
        find = partial(_evidence, kernels, states, doubtful)
        return later(Solution, find, forces=forces, actuation=actuation)

    def accelerate(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the acceleration (..., 3) of the platform under forces."""
        name, loads = driven(self._kernels, "forward_dynamics", states)
        found = np.empty(states.pose.shape) if out is None else out
        columns = list(found.reshape(-1, 3).T)
        run_kernel(self._kernels, name, states, DRIVEN, loads, columns, reachable)
        return found

    def jacobian(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return ∂(λA, λB, λC)/∂(y, z, θ), (..., 3, 3)."""
        found = np.empty((*states.shape, 3, 3)) if out is None else out
        rows = found.reshape(-1, 3, 3)
        positions = np.empty((len(rows), 3))
        columns = [*positions.T, *rows[:, :, 0].T, rows[:, 2, 2]]
        run_kernel(self._kernels, "kinematics", states, POSE_ONLY, None, columns, reachable)
        rows[:, :, 1], rows[:, :2, 2] = 1, 0
        rows[np.isnan(positions[:, 0])] = np.nan
        return found

    def mass_matrix(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the mass matrix in y, z, θ, (..., 3, 3)."""
        found = np.empty((*states.shape, 3, 3)) if out is None else out
        M = found.reshape(-1, 3, 3)
        upper = [M[:, 0, 0], M[:, 0, 1], M[:, 0, 2], M[:, 1, 2], M[:, 2, 2], M[:, 1, 1]]
        run_kernel(self._kernels, "mass_matrix", states, POSE_ONLY, None, upper, reachable)
        M[:, 1, 0], M[:, 2, 0], M[:, 2, 1] = M[:, 0, 1], M[:, 0, 2], M[:, 1, 2]
        return found


@dataclass(frozen=True, eq=False)
class ForceDerivatives(Readable):
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
    """Return the actuator forces and their derivatives by pose, velocity and acceleration."""
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
    name, moving = DERIVATIVES[kernels.has_friction]
    by_state = [(*POSE, *VELOCITY, *ACCELERATION).index(x) for x in moving]
    forces, *by = (array.reshape(-1, *array.shape[states.pose.ndim - 1 :]) for array in room.arrays)
    columns = [by[k // 3][:, force, k % 3] for force in range(3) for k in by_state]
    run_kernel(kernels, name, states, WHOLE_STATE, loads_on(states), [*forces.T, *columns], holdable)
    refused = np.isnan(forces[:, 0])
    for k in set(range(9)) - set(by_state):  # z changes no force but through springs
        by[k // 3][:, :, k % 3] = np.where(refused, np.nan, 0.0)[:, None]
    by[0][:, :, 1] += kernels.parameters.actuators.stiffness
    return room


def sliders(kernels: MachineKernels, states: States, out: FloatArray | None = None) -> FloatArray:
    """Return the slider positions at poses [m]."""
    found = np.empty(states.pose.shape) if out is None else out
    columns = [*found.reshape(-1, 3).T, *np.empty((4, found.size // 3))]
    run_kernel(kernels, "kinematics", states, POSE_ONLY, None, columns, reachable)
    return found


def coriolis_matrix(kernels: MachineKernels, states: States, out: FloatArray | None = None) -> FloatArray:
    """Return the matrix of centrifugal and Coriolis forces; see `equations_of_motion.coriolis_matrix`."""
    found = np.empty((*states.shape, 3, 3)) if out is None else out
    entries = found.reshape(-1, 3, 3)
    columns = [entries[:, i, j] for i in range(3) for j in (0, 2)]
    run_kernel(kernels, "coriolis_matrix", states, TURNING, None, columns, reachable)
    entries[:, :, 1] = np.where(np.isnan(columns[0]), np.nan, 0.0)[:, None]
    return found


def gravity_forces(kernels: MachineKernels, states: States, out: FloatArray | None = None) -> FloatArray:
    """Return the gradient of the potential energy; see `equations_of_motion.gravity_forces` [N, N, N m]."""
    found = np.empty(states.pose.shape) if out is None else out
    columns = list(found.reshape(-1, 3).T)
    run_kernel(kernels, "gravity_forces", states, POSE_ONLY, None, columns, reachable)
    return found


_NAME = "forward_kinematics"


def poses(
    kernels: MachineKernels, sliders: FloatArray, on_invalid: OnInvalid, out: FloatArray | None = None
) -> FloatArray:
    """Return the poses in the working mode at slider positions; ndarray, shape (..., 3)."""
    check_policy(on_invalid)
    found = np.empty(sliders.shape) if out is None else out
    given, rows = aligned(sliders.reshape(-1, 3)), found.reshape(-1, 3)
    columns = list(given.T)
    if kernels.run(_NAME, columns, [*rows.T, None]):
        return found
    margins = np.empty(len(rows))
    kernels.run(_NAME, columns, [*rows.T, margins])
    doubtful = np.flatnonzero(~(margins > 0))
    geometry = kernels.parameters.geometry
    rows[doubtful] = forward_kinematics(geometry, given[doubtful], on_invalid="nan")
    if on_invalid == "raise" and np.isnan(rows[doubtful]).any():
        forward_kinematics(geometry, sliders)  # raises, and names the first
    return found
