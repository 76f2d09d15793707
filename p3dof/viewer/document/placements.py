"""How the joints of a document move, from its numbers alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from p3dof._base.checks import FloatArray
from p3dof.viewer.document.encoding import decoded


def motions_over(document: Mapping[str, Any], run: int = 0) -> FloatArray:
    """Return how all joints have moved from zero, in the axes of their placements, over a run.

    Parameters
    ----------
    document : mapping
        The document.
    run : int
        Number of the run.

    Returns
    -------
    ndarray, shape (N, njoints, 7)
        x, y, z [m] and the quaternion x, y, z, w, whose sign does not jump; NaN where the run has none. Of
        joints of the kind placed: where they are in their parents.
    """
    given = document["runs"][run]
    q = decoded(given["q"]).astype(float)
    joints = document["scene"]["joints"]
    found = np.empty((len(q), len(joints), 7))
    for i, joint in enumerate(joints):
        if joint["kind"] == "placed":
            found[:, i] = decoded(given["placed"][joint["name"]])
        else:
            start, count = joint["q"]
            found[:, i] = _moved(joint, q[:, start : start + count])
        found[:, i, 3:] = _without_jumps(found[:, i, 3:])
    return found


def _moved(joint: Mapping[str, Any], q: FloatArray) -> FloatArray:
    """Return how a joint has moved (N, 7) at its positions."""
    shift: FloatArray = np.zeros((len(q), 3))
    kind, axis = joint["kind"], np.asarray(joint.get("axis", (0.0, 0.0, 1.0)), dtype=float)
    known = np.asarray(np.isfinite(q).all(axis=1))
    values: FloatArray = np.where(known[:, None], q, 0.0)
    angle: FloatArray = values[:, 0] if values.shape[1] else np.zeros(len(q))
    if kind in ("continuous", "planar"):
        angle = np.arctan2(values[:, -1], values[:, -2])
    turns = np.outer(angle, axis) if kind in ("revolute", "continuous", "helical", "planar") else 0.0 * shift
    rotation = Rotation.from_rotvec(turns)
    if kind in ("prismatic", "helical"):
        shift += np.outer(angle * joint.get("pitch", 1.0), axis)
    elif kind in ("translation", "free"):
        shift += values[:, :3]
    elif kind == "planar":
        shift[:, :2] += values[:, :2]
    if kind in ("spherical", "free"):
        rotation = Rotation.from_quat(np.where(known[:, None], values[:, -4:], (0.0, 0.0, 0.0, 1.0)))
    elif kind == "universal":
        second = np.outer(values[:, 1], np.asarray(joint["axis2"], dtype=float))
        rotation = Rotation.from_rotvec(np.outer(angle, axis)) * Rotation.from_rotvec(second)
    found = np.column_stack((shift, rotation.as_quat()))
    found[~known] = np.nan
    return np.asarray(found)


def _without_jumps(turns: FloatArray) -> FloatArray:
    """Return quaternions (N, 4) each on the side of the one before; rows of NaN are passed over."""
    rows = np.flatnonzero(np.isfinite(turns).all(axis=1))
    own = turns[rows]
    signs = np.where(np.einsum("ij,ij->i", own[1:], own[:-1]) < 0, -1.0, 1.0)
    found = turns.copy()
    found[rows[1:]] *= np.cumprod(signs)[:, None]
    return found
