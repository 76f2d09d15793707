"""Torques and speeds of motors before their gears."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.loops.joint_data import JointData


class MotorSide(NamedTuple):
    """What the motors of the actuated joints do, before their gears, which lose nothing.

    Parameters
    ----------
    gear_ratio : (n_actuated,) array
        Turns of the motor per turn of the joint, or radians per metre; 1 where nothing is said.
    torque : (..., n_actuated) array
        At the rotor [N m], its own inertia included; of a slide without a gear the force [N].
    speed : (..., n_actuated) array
        Of the rotor [rad/s], or of a slide without a gear [m/s].
    """

    gear_ratio: FloatArray
    torque: FloatArray
    speed: FloatArray


def motor_side(
    actuated: Sequence[str], data: Sequence[JointData], tau: FloatArray, speed: FloatArray
) -> MotorSide:
    """Return what the motors do that give forces to joints.

    Parameters
    ----------
    actuated : sequence of str
        The joints.
    data : sequence of JointData
        What is known of them.
    tau, speed : (..., n_actuated) array
        Forces [N or N m] and speeds [m/s or rad/s] of the joints.

    Returns
    -------
    MotorSide
    """
    known = {entry.joint: entry.gear_ratio for entry in data}
    ratio = np.array([known.get(name, 1.0) for name in actuated])
    return MotorSide(ratio, np.asarray(tau / ratio), np.asarray(speed * ratio))
