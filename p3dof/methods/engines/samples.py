"""What an engine says of a state of motion, and where its simulation ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.machine.motion import Motion


@dataclass(frozen=True, eq=False)
class FrameMotion:
    """How an engine finds a frame to stand and move, in the axes of the fixed frame.

    Parameters
    ----------
    position : ndarray, shape (3,)
        Its origin [m].
    rotation : ndarray, shape (3, 3)
        Its axes, as columns.
    velocity, acceleration : ndarray, shape (6,)
        Of the origin, then of the turning [m/s, rad/s, m/s², rad/s²].
    """

    position: FloatArray
    rotation: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


@dataclass(frozen=True, eq=False)
class Sample:
    """What an engine says of one state of motion: ``load = B u + Jᵀ λ``, and how far its loops are open.

    Parameters
    ----------
    load : ndarray, shape (n,)
        Generalised forces that the motion takes without its constraints, the wrench taken off.
    B : ndarray, shape (n, 3)
        Generalised forces of a unit force of each actuator.
    J : ndarray, shape (m, n)
        Jacobian of the engine's constraints; rows may be redundant.
    gap, slip, pull : ndarray, shape (k,)
        By how much constraints are violated in position, velocity and acceleration [m, m/s, m/s²].
    platform : FrameMotion
        The platform at P.
    """

    load: FloatArray
    B: FloatArray
    J: FloatArray
    gap: FloatArray
    slip: FloatArray
    pull: FloatArray
    platform: FrameMotion


@dataclass(frozen=True, eq=False)
class FinalState:
    """Where a simulation ended.

    Parameters
    ----------
    engine : str
        Name of the engine.
    duration, step : float
        Simulated time and its step [s].
    positions : mapping of str to float
        Position of every joint of the description at the end [m or rad].
    seconds : float
        Time that the integration took on the clock, without building the model [s].
    """

    engine: str
    duration: float
    step: float
    positions: Mapping[str, float]
    seconds: float

    @property
    def speed(self) -> float:
        """Simulated time by time on the clock: 2 is twice as fast as reality."""
        return self.duration / self.seconds


def platform_motion(motion: Motion, k: int, depth: float) -> FrameMotion:
    """Return the frame at P at a sample of a motion.

    Parameters
    ----------
    motion : Motion
        The motion.
    k : int
        The sample.
    depth : float
        h, depth of the platform below the sliders at home [m].

    Returns
    -------
    FrameMotion
    """
    y, z, theta = motion.pose[k]
    c, s = np.cos(theta), np.sin(theta)
    rates = []
    for dy, dz, turning in (motion.velocity[k], motion.acceleration[k]):
        rates.append(np.array([0.0, dy, dz, 0.0, turning, 0.0]))
    rotation = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return FrameMotion(np.array([0.0, y, z - depth]), rotation, *rates)
