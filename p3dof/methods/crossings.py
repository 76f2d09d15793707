"""Motions through the actuation singularity: where they cross it between samples, and what that spoils.

At the singularity the forces grow beyond all bounds. Samples on either side of it have finite ones, which
tell nothing about what the motion takes: they and all samples near by are invalid. Every method finds its own
angles from the singularity, so that each decides this by itself.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.errors import SingularityError
from p3dof._base.samples import OnInvalid
from p3dof.methods.solution import JointStates, Solution

NEAR = 0.1
"""Angle from a singularity that a motion crosses within which its samples are invalid [rad].

There the forces are more than about ten times what the same motion takes elsewhere, and depend on where the
samples happen to lie.
"""


def crossings_of(actuation: FloatArray) -> tuple[NDArray[np.int_], NDArray[np.bool_]]:
    """Return where a motion crosses the actuation singularity, and which samples that spoils.

    Parameters
    ----------
    actuation : ndarray, shape (N,)
        Angle from the singularity, positive on home's side [rad]; NaN where a sample is invalid.

    Returns
    -------
    after : ndarray of int, shape (K,)
        The valid samples after which the next valid one is on the other side.
    spoilt : ndarray of bool, shape (N,)
        The samples on either side of a crossing; and those less than `NEAR` from the singularity, up to
        these or up to an invalid sample.
    """
    known = np.flatnonzero(np.isfinite(actuation))
    other_side = actuation[known[:-1]] * actuation[known[1:]] < 0
    after, before = known[:-1][other_side], known[1:][other_side]
    near = np.abs(actuation) < NEAR
    near[after] = near[before] = True
    begins = near & ~np.concatenate([[False], near[:-1]])
    stretch = np.cumsum(begins)  # which stretch of near samples each belongs to
    invalid = ~np.isfinite(np.pad(actuation, 1))  # nothing is amiss before the first and after the last
    reason = near & (invalid[:-2] | invalid[2:])
    reason[after] = reason[before] = True
    return after, near & np.isin(stretch, stretch[reason])


def crossing_told(time: float) -> str:
    """Return the words for a crossing after the sample at a time [s]."""
    return f"after t = {time:g} s the motion crosses an actuation singularity: no force can do that"


def without_crossings(
    time: FloatArray, solution: Solution, on_invalid: OnInvalid
) -> tuple[Solution, FloatArray]:
    """Return a solution whose samples near a crossing are NaN, or raise for a crossing.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Times of the samples [s].
    solution : Solution
        What a method found.
    on_invalid : {"raise", "nan"}
        What to do with a crossing.

    Returns
    -------
    solution : Solution
        Its angles from the singularity stay.
    crossings : ndarray, shape (K,)
        Times of the samples after which a singularity is crossed [s].

    Raises
    ------
    SingularityError
        Naming the time of the first crossing, and how many there are.
    """
    after, spoilt = crossings_of(solution.actuation)
    if len(after) and on_invalid == "raise":
        told = f"{crossing_told(time[after[0]])} (sample {after[0]}, the first of {len(after)} such)"
        raise SingularityError(told, (int(after[0]),), len(after))
    if not spoilt.any():
        return solution, np.asarray(time[after])
    names = ("forces", "closure_error", "energy_rate", "dissipation")
    cut = {name: _cut(getattr(solution, name), spoilt) for name in names}
    joints = solution.joints
    states = JointStates(joints.names, *(_cut(each, spoilt) for each in (joints.q, joints.v, joints.a)))
    return replace(solution, joints=states, **cut), np.asarray(time[after])


def _cut(values: FloatArray, spoilt: NDArray[np.bool_]) -> FloatArray:
    """Return values over samples, (N,) or (N, k), with NaN where they are spoilt."""
    return np.where(spoilt if values.ndim == 1 else spoilt[:, None], np.nan, values)
