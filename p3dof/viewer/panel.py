"""What the live page is told once, and how far its sliders go."""

from __future__ import annotations

import numpy as np

from p3dof.checks import FloatArray
from p3dof.methods import InverseDynamics
from p3dof.page.machine import Machine
from p3dof.page.room import COLOURS, LEGS
from p3dof.viewer.connections import Message
from p3dof.viewer.player import FASTEST, SLOWEST
from p3dof.viewer.scale import ArrowScale
from p3dof.viewer.stage import number
from p3dof.viewer.states import States

AXES = ("y", "z", "theta")
"""What the sliders move, in the order of a pose."""

_BEYOND_REACH = 1.1
"""How far the slider of y goes, as a share of the reach: its border is to be felt."""


def setup_message(robot: Machine, result: InverseDynamics | None, states: States) -> Message:
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
    return {
        "type": "setup",
        "motion": None if result is None else [float(result.time[0]), float(result.time[-1])],
        "ranges": slider_ranges(robot),
        "speeds": [SLOWEST, FASTEST],
        "colours": [[round(255 * part) for part in COLOURS[leg][:3]] for leg in LEGS],
        "limits": {"travel": limits.travel, "force": limits.force},
        "warnings": [] if result is None else list(result.warnings),
        "time": time.tolist(),
        "curves": {case: [plain(column) for column in rows.T] for case, rows in curves.items()},
    }


def arrow_scales(
    robot: Machine, result: InverseDynamics | None, states: States
) -> tuple[ArrowScale, ArrowScale]:
    """Return the scales of the arrows in a motion, for all load cases, and for a platform moved by hand.

    They are the same unless the motion takes less than holding the platform at rest where it can be moved to.

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
    tuple of ArrowScale
    """
    at_rest = ArrowScale.at_rest(robot)
    if result is None:
        return at_rest, at_rest
    _, cases = states.curves(len(result.time))
    more = [forces for case, forces in cases.items() if case != "total"]
    moving = ArrowScale.of_motion(robot, result, *more).by_hand(robot)
    return moving, max(moving, at_rest, key=lambda scale: scale.newtons)


def off_scale(scale: ArrowScale, forces: FloatArray) -> list[str]:
    """Return in words which arrows do not tell their force: what is cut off, and what is missing.

    Parameters
    ----------
    scale : ArrowScale
        Of the arrows.
    forces : ndarray, shape (3,)
        Of the actuators [N].

    Returns
    -------
    list of str
    """
    longest = number(scale.newtons)
    words = [
        f"{leg.upper()} is cut off: its {number(float(force))} N are beyond the longest arrow, {longest} N"
        for leg, force in zip(LEGS, forces, strict=True)
        if scale.beyond(float(force))
    ]
    if np.isnan(forces).any():
        missing = ", ".join(leg.upper() for leg, force in zip(LEGS, forces, strict=True) if np.isnan(force))
        words.append(f"none for {missing}: the forces are not determined here")
    return words


def slider_ranges(robot: Machine) -> list[tuple[float, float]]:
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
