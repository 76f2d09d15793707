"""Joints of the machine, and where P is, at poses of its platform."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, as_floats
from p3dof._base.errors import InputError
from p3dof.closed_form import kinematics
from p3dof.viewer.document.machine import Machine


def joints_of(robot: Machine, pose: ArrayLike) -> FloatArray:
    """Return all joints at poses, in Pinocchio's order.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    pose : array-like, shape (..., 3)
        y [m], z [m], θ [rad].

    Returns
    -------
    ndarray, shape (..., 10)

    Raises
    ------
    ReachError, InputError
        Naming leg, margin and sample.
    """
    joints = kinematics.inverse_kinematics(robot.parameters.geometry, pose).joints
    return np.stack([joints[name] for name in robot.model.names[1:]], axis=-1)


def trace_of(robot: Machine, pose: ArrayLike) -> FloatArray:
    """Return where P is at poses, in the fixed frame.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    pose : array-like, shape (..., 3)
        y [m], z [m], θ [rad].

    Returns
    -------
    ndarray, shape (..., 3)
        [m].

    Raises
    ------
    InputError
        If the shape does not fit.
    """
    poses = as_floats("pose", pose)
    if poses.ndim == 0 or poses.shape[-1] != 3:
        raise InputError(f"pose: expected shape (..., 3), got {poses.shape}")
    y, z = poses[..., 0], poses[..., 1]
    return np.stack((0.0 * y, y, z - robot.parameters.geometry.h), axis=-1)
