"""Values and ranges of the actuated joints of a robot."""

from __future__ import annotations

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.loops import ClosedLoopModel
from p3dof.loops.tables import is_slide, joint_values

_UNLIMITED = 1e3
"""A joint whose limits are farther apart has none worth a slider [m or rad]."""


def values_of(robot: ClosedLoopModel, q: FloatArray) -> FloatArray:
    """Return the values (n,) of the actuated joints at a configuration (nq,) [m or rad]."""
    found = joint_values(robot, q)
    return np.array([float(found[name][0]) for name in robot.actuated])


def slider_ranges(robot: ClosedLoopModel, q: FloatArray, half: float) -> list[tuple[float, float]]:
    """Return how far the sliders of the actuated joints go.

    That is to their limits; where there are none, half a turn to either side of zero, or half the robot's
    size to either side of where it is.

    Parameters
    ----------
    robot : ClosedLoopModel
        The robot.
    q : ndarray, shape (nq,)
        Where it is.
    half : float
        Half its size [m].

    Returns
    -------
    list of (float, float)
        [m or rad]
    """
    model, ranges = robot.model, []
    for name, value in zip(robot.actuated, values_of(robot, q).tolist(), strict=True):
        joint = model.getJointId(name)
        low, high = (value - half, value + half) if is_slide(robot, joint) else (-np.pi, np.pi)
        if model.nqs[joint] == 1:
            limits = (model.lowerPositionLimit, model.upperPositionLimit)
            least, most = (float(limit[model.idx_qs[joint]]) for limit in limits)
            low, high = (least, most) if 0 < most - least < _UNLIMITED else (low, high)
        ranges.append((min(low, value), max(high, value)))
    return ranges
