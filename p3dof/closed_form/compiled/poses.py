"""The pose at one measurement of the sliders, at once: controllers ask for it in every period."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.tracing import Number, Symbol, Tape, straight_line
from p3dof._base.tracing.python import or_nan
from p3dof.closed_form.compiled.reduced import Model, assembled
from p3dof.closed_form.kinematics import forward_kinematics
from p3dof.machine.parameters import Geometry


def pose_at(geometry: Geometry, sliders: FloatArray) -> FloatArray:
    """Return the pose in the working mode at slider positions.

    Parameters
    ----------
    geometry : Geometry
        Lengths of the mechanism.
    sliders : ndarray, shape (3,)
        λ10 of A, B, C [m].

    Returns
    -------
    ndarray, shape (3,)
        y [m], z [m], θ [rad].

    Raises
    ------
    ReachError, InputError
        As `p3dof.closed_form.kinematics.forward_kinematics`, which decides what is not clearly good.
    """
    *pose, margin = _assembly(geometry)(*sliders.tolist())
    return np.array(pose) if margin > 0 else forward_kinematics(geometry, sliders)


@lru_cache(maxsize=64)
def _assembly(geometry: Geometry) -> Callable[..., tuple[float, ...]]:
    model = Model.of_numbers((geometry.r, geometry.R, geometry.L, *33 * (0,)))

    def formula(tape: Tape, *sliders: Symbol) -> Sequence[Number]:
        pose, margin = assembled(model, (sliders[0], sliders[1], sliders[2]), tape)
        return [*pose, margin]

    return or_nan(straight_line(formula, 3), 4)
