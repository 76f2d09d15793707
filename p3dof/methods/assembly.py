"""Forward kinematics by the kernels: `p3dof.closed_form.kinematics` decides what is not clearly good."""

from __future__ import annotations

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.samples import OnInvalid, check_policy
from p3dof.closed_form.compiled.kernels import MachineKernels
from p3dof.closed_form.kinematics import forward_kinematics
from p3dof.methods.kernel_runs import aligned

_NAME = "forward_kinematics"


def poses(
    kernels: MachineKernels, sliders: FloatArray, on_invalid: OnInvalid, out: FloatArray | None = None
) -> FloatArray:
    """Return the poses in the working mode at slider positions.

    Parameters
    ----------
    kernels : MachineKernels
        Of the machine.
    sliders : ndarray, shape (..., 3)
        λ10 of A, B, C [m].
    on_invalid : {"raise", "nan"}
        Raise for samples that do not assemble, or leave NaN.
    out : ndarray, shape (..., 3), optional
        Where to write; its rows must be rows of memory.

    Returns
    -------
    ndarray, shape (..., 3)
        y [m], z [m], θ [rad].

    Raises
    ------
    ReachError
        Naming the leg that cannot close and its margin.
    InputError
        If a number is not finite.
    """
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
