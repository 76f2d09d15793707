"""The reaction of one joint over a motion, and its largest loads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p3dof.checks import FloatArray
from p3dof.closed_loop.reactions import BoolArray
from p3dof.reactions.joints import Joint


@dataclass(frozen=True, eq=False)
class JointReaction:
    """The reaction of one joint over the motion.

    Parameters
    ----------
    joint : Joint
        Which.
    axis : ndarray, shape (3,)
        Its axis; NaN if it has none.
    forces, moments : ndarray, shape (N, 3)
        What the predecessor exerts on the successor, at the origin and in the axes of the joint's frame
        [N, N m].
    determined_forces, determined_moments : ndarray of bool, shape (N, 3)
        Which components rigid bodies determine; False where the sample is invalid.
    """

    joint: Joint
    axis: FloatArray
    forces: FloatArray
    moments: FloatArray
    determined_forces: BoolArray
    determined_moments: BoolArray


@dataclass(frozen=True)
class Peak:
    """The largest loads of one joint over the valid samples of a motion; NaN where it has no axis.

    Parameters
    ----------
    joint : str
        Its name.
    force, axial, radial : float
        Resultant force, its component along the joint's axis, and the one across [N].
    moment, across : float
        Resultant moment, and its component across the joint's axis [N m].
    rms_force, rms_moment : float
        Root mean squares over time of the resultants [N, N m].
    undetermined : tuple of str
        Which of these fields contain a component that rigid bodies do not determine.
    """

    joint: str
    force: float
    axial: float
    radial: float
    moment: float
    across: float
    rms_force: float
    rms_moment: float
    undetermined: tuple[str, ...]


def peak_of(one: JointReaction, time: FloatArray, valid: BoolArray) -> Peak:
    """Return the largest loads of a joint.

    Parameters
    ----------
    one : JointReaction
        Its reaction.
    time : ndarray, shape (N,)
        Times [s].
    valid : ndarray of bool, shape (N,)
        Which samples count.

    Returns
    -------
    Peak
        NaN if no sample is valid.
    """
    time, axis = time[valid], one.axis
    force, moment = one.forces[valid], one.moments[valid]
    open_force = np.asarray(np.any(~one.determined_forces[valid], axis=0))
    open_moment = np.asarray(np.any(~one.determined_moments[valid], axis=0))
    along, across = axis != 0, axis == 0  # NaN is along: what has no axis is NaN itself
    loads = {
        "force": (largest(_length(force)), open_force.any()),
        "axial": (largest(force @ axis), open_force[along].any()),
        "radial": (largest(_length(_across(force, axis))), open_force[across].any()),
        "moment": (largest(_length(moment)), open_moment.any()),
        "across": (largest(_length(_across(moment, axis))), open_moment[across].any()),
        "rms_force": (_rms(time, _length(force)), open_force.any()),
        "rms_moment": (_rms(time, _length(moment)), open_moment.any()),
    }
    marked = tuple(name for name, (value, mark) in loads.items() if mark and np.isfinite(value))
    return Peak(one.joint.name, **{name: value for name, (value, _) in loads.items()}, undetermined=marked)


def _length(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(vectors, axis=-1))


def _across(vectors: FloatArray, axis: FloatArray) -> FloatArray:
    return vectors - np.outer(vectors @ axis, axis)


def largest(values: FloatArray) -> float:
    """Return the largest magnitude, NaN of nothing."""
    return float(np.abs(values).max()) if len(values) else float("nan")


def _rms(time: FloatArray, values: FloatArray) -> float:
    """Return the root mean square over time; of one sample its value, of none NaN."""
    if len(time) < 2:
        return largest(values)
    return float(np.sqrt(np.trapezoid(values**2, time) / (time[-1] - time[0])))
