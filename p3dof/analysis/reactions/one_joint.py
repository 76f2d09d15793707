"""The reaction of one joint over a motion, and its largest loads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.analysis.reactions.joints import Joint
from p3dof.loops.reactions import BoolArray


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
    fit : ndarray, shape (N, 2, 3)
        What a misfit of assembly adds to force and moment at worst, either way [N, N m].
    """

    joint: Joint
    axis: FloatArray
    forces: FloatArray
    moments: FloatArray
    determined_forces: BoolArray
    determined_moments: BoolArray
    fit: FloatArray


@dataclass(frozen=True)
class Peak:
    """The largest loads of one joint, over the valid samples of a motion.

    They are what rigid bodies determine, and beyond it what elastic joints bear. NaN stands for a load that
    the joint has not (without an axis nothing is along or across it) and, where no stiffness was asked for,
    for one that has an undetermined part.

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
        Which of these fields contain a component that rigid bodies do not determine: with elastic joints they
        rest on their stiffness, without they are NaN.
    fit_force, fit_moment : float
        A bound of what a misfit of assembly adds to the force and to the moment: the norm of what it adds
        at worst to each component [N, N m].
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
    fit_force: float = 0.0
    fit_moment: float = 0.0


@dataclass(frozen=True)
class OpenPeak:
    """The largest value of a load that rigid bodies do not determine, by ways to find it.

    Those of idealisations are some of many possible ones, and bound nothing.

    Parameters
    ----------
    joint : str
        Name of the joint.
    load : str
        Which of the fields of a `Peak`.
    values : mapping of str to float
        By the name of the way [N or N m]; NaN where the joint has no such load.
    """

    joint: str
    load: str
    values: Mapping[str, float]


@dataclass(frozen=True)
class JointLoad:
    """The largest value of one load of a joint, and whether it contains an undetermined component.

    Parameters
    ----------
    value : float
        NaN if there is none [N or N m].
    undetermined : bool
        Whether rigid bodies leave it open.
    """

    value: float
    undetermined: bool


_FIT = ("fit_force", "fit_moment")


def loads_of(one: JointReaction, time: FloatArray, valid: BoolArray) -> dict[str, JointLoad]:
    """Return the largest loads of a joint, by the fields of a `Peak`.

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
    dict of str to JointLoad
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
        "fit_force": (largest(_length(one.fit[valid, 0])), False),
        "fit_moment": (largest(_length(one.fit[valid, 1])), False),
    }
    return {
        name: JointLoad(value, bool(mark and np.isfinite(value))) for name, (value, mark) in loads.items()
    }


def peaks_of(joint: str, loads: Mapping[str, dict[str, JointLoad]]) -> tuple[Peak, tuple[OpenPeak, ...]]:
    """Return what all idealisations determine of a joint's loads, and apart from it the rest.

    Parameters
    ----------
    joint : str
        Its name.
    loads : mapping of str to dict
        What `loads_of` tells, by the way in which the loads were found.

    Returns
    -------
    peak : Peak
        What is determined in each of them, where they agree, and what elastic joints bear of the rest.
    open_peaks : tuple of OpenPeak
        What is open in one of them or more.
    """
    names = tuple(name for name in next(iter(loads.values())) if not name.startswith("fit_"))
    each = {name: {kind: one[name] for kind, one in loads.items()} for name in names}
    marked = tuple(name for name in names if any(load.undetermined for load in each[name].values()))
    known = {}
    for name in names:
        values = [load.value for load in each[name].values() if np.isfinite(load.value)]
        known[name] = values[0] if values and name not in marked else float("nan")
        if "elastic" in each[name]:
            known[name] = each[name]["elastic"].value
    rest = (OpenPeak(joint, name, {kind: load.value for kind, load in each[name].items()}) for name in marked)
    fit = {name: loads["elastic"][name].value for name in _FIT} if "elastic" in loads else {}
    return Peak(joint, **known, undetermined=marked, **fit), tuple(rest)


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
