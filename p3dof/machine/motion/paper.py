"""The motion of the paper's example."""

from __future__ import annotations

import math

import numpy as np

from p3dof.machine.motion.core import Motion
from p3dof.machine.motion.times import evenly, sample_count


def paper_motion(samples: int = 1001) -> Motion:
    """Return the motion of the paper's example, eq. (5), with exact derivatives.

    y = -t²(t² - 1.3t + .3), z = .2t²(2t² - t - 1), θ = .4 sin 4πt, for t from 0 to 1 s. It neither starts nor
    ends at rest: θ̇(0) = 5.03 rad/s, ẏ(1) = -.7 m/s, ż(1) = .6 m/s.

    Parameters
    ----------
    samples : int
        Number of samples, evenly spaced; one is t = 0 alone.

    Returns
    -------
    Motion

    Raises
    ------
    MotionError
        If `samples` is not a whole number of one or more.
    """
    t = evenly(0.0, 1.0, sample_count(samples, least=1))
    w = 4 * math.pi
    swing = w * t
    pose = [-(t**2) * (t**2 - 1.3 * t + 0.3), 0.2 * t**2 * (2 * t**2 - t - 1), 0.4 * np.sin(swing)]
    velocity = [-t * (4 * t**2 - 3.9 * t + 0.6), 0.2 * t * (8 * t**2 - 3 * t - 2), 0.4 * w * np.cos(swing)]
    acceleration = [
        -(12 * t**2 - 7.8 * t + 0.6),
        0.2 * (24 * t**2 - 6 * t - 2),
        -0.4 * w**2 * np.sin(swing),
    ]
    return Motion(
        t, np.column_stack(pose), np.column_stack(velocity), np.column_stack(acceleration), check=False
    )
