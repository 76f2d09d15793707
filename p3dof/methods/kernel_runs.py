"""A kernel over states: what is not clearly good is looked at again, by the closed forms and NumPy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.samples import raise_not_finite
from p3dof.closed_form.compiled.friction import losses
from p3dof.closed_form.compiled.kernels import MachineKernels, on_arrays
from p3dof.closed_form.kinematics import Placed
from p3dof.machine.motion.states import States
from p3dof.machine.motion.wrenches import WRENCH_ROWS
from p3dof.machine.parameters import Geometry

MOVING = ("pose", "velocity", "acceleration")
DRIVEN = ("pose", "velocity", "forces")
TURNING = ("pose", "velocity")
POSE = ("pose",)
"""What of the states a kernel reads, before the loads."""

_RESULT = {
    "inverse_dynamics": "forces",
    "inverse_dynamics_loaded": "forces",
    "inverse_dynamics_derivatives": "forces and derivatives",
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

Gate: TypeAlias = Callable[[Geometry, States], Placed]
"""Raises for the states that are refused, or leaves their rows NaN."""


def run_kernel(
    kernels: MachineKernels,
    name: str,
    states: States,
    inputs: Sequence[str],
    loads: Sequence[FloatArray] | None,
    found: Sequence[FloatArray],
    gate: Gate | None,
) -> None:
    """Write the outputs of a kernel at N states.

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.
    name : str
        The kernel.
    states : States
        The states; those that are refused raise, or their outputs become NaN.
    inputs : sequence of str
        What of the states the kernel reads.
    loads : sequence of ndarray, shape (N,), optional
        What it reads besides.
    found : sequence of ndarray, shape (N,)
        Where to write, all outputs but the margin.
    gate : callable, optional
        What refuses states; without it, they were looked at already.
    """
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
    columns = [column for each in inputs for column in aligned(getattr(rows, each)).T]
    columns += loads or []
    if kernels.run(name, columns, [*found, None]):
        return
    if gate is not None and states.on_invalid == "raise":
        gate(kernels.parameters.geometry, states)
    _do_again(kernels, name, rows, inputs, columns, found, gate)
    if states.on_invalid == "raise":
        raise_not_finite(_RESULT[name], np.stack(found[:3], axis=-1).reshape(states.pose.shape))


def _do_again(
    kernels: MachineKernels,
    name: str,
    rows: States,
    inputs: Sequence[str],
    columns: Sequence[FloatArray],
    found: Sequence[FloatArray],
    gate: Gate | None,
) -> None:
    """Enter the outputs of what is not clearly good, by NumPy; NaN for what is refused."""
    margins = np.empty(len(rows.pose))
    kernels.run(name, columns, [*found, margins])
    doubtful = np.flatnonzero(~(margins > 0))
    again = np.empty((len(found), len(doubtful)))
    on_arrays(*kernels.prepared(name), [column[doubtful] for column in columns], [*again, None])
    checked = rows.of_rows(doubtful, "nan")
    if gate is not None:
        checked = gate(kernels.parameters.geometry, checked).states
    known = [getattr(checked, each) for each in inputs]
    good = np.all([np.isfinite(each).all(axis=-1) for each in (*known, again.T)], axis=0)
    for output, values in zip(found, again, strict=True):
        output[doubtful] = np.where(good, values, np.nan)


def aligned(array: FloatArray) -> FloatArray:
    """Return an array that a kernel can read: fields of records need not be."""
    return array if array.flags.aligned and array.size else array.copy()


def driven(kernels: MachineKernels, kind: str, states: States) -> tuple[str, list[FloatArray] | None]:
    """Return the kernel for a machine and its states, and the loads that it takes.

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.
    kind : str
        ``"inverse_dynamics"`` or ``"forward_dynamics"``.
    states : States
        The states.

    Returns
    -------
    name : str
        Of the kernel.
    loads : list of ndarray, shape (N,), or None
        The wrench on y, z and θ [N, N, N m].
    """
    friction = kernels.has_friction
    given = states.rows().wrench
    if given is None and not friction:
        return kind, None
    if given is None:
        loads = [np.broadcast_to(0.0, states.pose.size // 3)] * 3
    else:
        wrench = aligned(given)
        loads = [wrench[:, row] for row in WRENCH_ROWS]
    return f"{kind}_{'with_friction' if friction else 'loaded'}", loads


def loads_on(kernels: MachineKernels, states: States) -> list[FloatArray] | None:
    """Return wrench less friction on y, z and θ, each (N,), or None if there is neither.

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.
    states : States
        The states.

    Returns
    -------
    list of ndarray, shape (N,), or None
        [N, N, N m]
    """
    friction = kernels.has_friction
    if states.wrench is None and not friction:
        return None
    rows = states.rows()
    found = None
    if rows.wrench is not None:
        wrench = aligned(rows.wrench)
        found = [wrench[:, row] for row in WRENCH_ROWS]
    if not friction:
        return found
    lost = losses(kernels.parameters, aligned(rows.pose), aligned(rows.velocity)).T
    return [-one for one in lost] if found is None else [w - one for w, one in zip(found, lost, strict=True)]
