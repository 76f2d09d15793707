"""Which coordinates of a tree are lengths, and how exact coordinates can be."""

from __future__ import annotations

from types import EllipsisType

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray

_LENGTHS: dict[str, slice | EllipsisType] = {
    "JointModelP": ...,
    "JointModelTranslation": ...,
    "JointModelFreeFlyer": slice(0, 3),
    "JointModelPlanar": slice(0, 2),
    "JointModelR": slice(0, 0),
    "JointModelSpherical": slice(0, 0),
    "JointModelUniversal": slice(0, 0),
}
"""Which coordinates of a joint are lengths, by the beginning of its name in Pinocchio; the longest counts."""
_ROUNDING = 16 * np.finfo(float).eps
"""Share of the largest coordinate by which the place of a body is uncertain."""


def length_coordinates(model: pin.Model) -> tuple[NDArray[np.bool_], NDArray[np.bool_], bool]:
    """Return which of q and of v are lengths.

    Parameters
    ----------
    model : pin.Model
        The tree.

    Returns
    -------
    q : (nq,) array of bool
    v : (nv,) array of bool
    known : bool
        False if a joint is of a kind that is not known here: its coordinates are not marked.
    """
    q, v, known = np.zeros(model.nq, dtype=bool), np.zeros(model.nv, dtype=bool), True
    for i in range(1, model.njoints):
        name = model.joints[i].shortname()
        kinds = [kind for kind in _LENGTHS if name.startswith(kind)]
        known = known and bool(kinds)
        lengths = _LENGTHS[max(kinds, key=len)] if kinds else slice(0, 0)
        q[model.idx_qs[i] : model.idx_qs[i] + model.nqs[i]][lengths] = True
        v[model.idx_vs[i] : model.idx_vs[i] + model.nvs[i]][lengths] = True
    return q, v, known


def rounding(q: FloatArray) -> FloatArray:
    """Return how far rounding of configurations (n, nq) may leave loops open, (n,) [m or rad]."""
    return np.asarray(_ROUNDING * np.abs(q).max(axis=1, initial=0.0))
