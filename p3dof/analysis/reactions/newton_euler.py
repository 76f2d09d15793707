"""Newton's and Euler's equations of every body, as a check of the reactions on it."""

from __future__ import annotations

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.analysis.reactions.joints import JOINTS
from p3dof.closed_form import kinematics
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import Parameters


def residual(
    parameters: Parameters,
    motion: Motion,
    wrench: FloatArray | None,
    forces: FloatArray,
    moments: FloatArray,
    positions: FloatArray,
) -> FloatArray:
    """Return the largest error of the equations of all bodies; ndarray, shape (N,)."""
    states = motion.pose, motion.velocity, motion.acceleration
    moving = kinematics.mechanism_motion(parameters.geometry, *states, on_invalid="nan").bodies
    worst: FloatArray = np.zeros(len(motion))
    for link, body in parameters.bodies.items():
        its = moving[link]
        centre, _, acceleration = its.at(body.com)
        inertia = its.rotation @ body.inertia @ np.swapaxes(its.rotation, -1, -2)
        spin = np.einsum("...ij,...j->...i", inertia, its.omega)
        force = body.mass * (parameters.gravity - acceleration)
        moment = -np.einsum("...ij,...j->...i", inertia, its.epsilon) - np.cross(its.omega, spin)
        for i, joint in enumerate(JOINTS):
            sign = (joint.successor == link) - (joint.predecessor == link)
            if sign:
                force = force + sign * forces[:, i]
                moment = moment + sign * (moments[:, i] + np.cross(positions[:, i] - centre, forces[:, i]))
        if link == "platform" and wrench is not None:  # its frame is at P
            force = force + wrench[:, :3]
            moment = moment + wrench[:, 3:] + np.cross(its.origin - centre, wrench[:, :3])
        worst = np.maximum(worst, np.abs(np.hstack([force, moment])).max(axis=-1))
    return worst


def in_fixed_axes(rotations: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return vectors in the axes of the fixed frame; ndarray, shape (..., 3)."""
    return np.asarray(np.einsum("...ij,...j->...i", rotations, vectors))
