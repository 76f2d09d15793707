"""What the live page is told once, and how far its sliders go."""

from __future__ import annotations

import numpy as np

from p3dof.checks import FloatArray
from p3dof.manipulator import Manipulator
from p3dof.methods import InverseDynamics
from p3dof.viewer.connections import Message
from p3dof.viewer.player import FASTEST, SLOWEST
from p3dof.viewer.scenery import COLOURS, LEGS
from p3dof.viewer.states import States

AXES = ("y", "z", "theta")
"""What the sliders move, in the order of a pose."""

_BEYOND_REACH = 1.1
"""How far the slider of y goes, as a share of the reach: its border is to be felt."""


def setup_message(robot: Manipulator, result: InverseDynamics | None, states: States) -> Message:
    """Return what a page needs to know before the first state.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    result : InverseDynamics, optional
        The motion that can be played.
    states : States
        Of both.

    Returns
    -------
    dict
        Plain data.
    """
    limits = robot.parameters.limits
    time, curves = states.curves()
    warnings = [] if result is None else [f"limit exceeded: {one}" for one in result.exceedances(limits)]
    if result is not None:
        warnings += [f"crosses an actuation singularity after t = {t:g} s" for t in result.crossings]
    return {
        "type": "setup",
        "motion": None if result is None else [float(result.time[0]), float(result.time[-1])],
        "ranges": slider_ranges(robot),
        "speeds": [SLOWEST, FASTEST],
        "colours": [[round(255 * part) for part in COLOURS[leg][:3]] for leg in LEGS],
        "limits": {"travel": limits.travel, "force": limits.force},
        "warnings": warnings,
        "time": time.tolist(),
        "curves": {case: [plain(column) for column in rows.T] for case, rows in curves.items()},
    }


def slider_ranges(robot: Manipulator) -> list[tuple[float, float]]:
    """Return how far the page's sliders of y, z and θ go: a little beyond reach, the travel, and the tilt.

    Parameters
    ----------
    robot : Manipulator
        The machine.

    Returns
    -------
    list of tuple of float
        Lowest and highest value [m, m, rad].
    """
    geometry, limits = robot.parameters.geometry, robot.parameters.limits
    reach = _BEYOND_REACH * (geometry.L - (geometry.R - geometry.r))
    return [(-reach, reach), limits.travel, limits.tilt]


def plain(values: FloatArray) -> list[float | None]:
    """Return numbers for JSON, which has no NaN.

    Parameters
    ----------
    values : ndarray, shape (N,)
        The numbers.

    Returns
    -------
    list of float or None
    """
    return [float(value) if np.isfinite(value) else None for value in values]
