"""Inverse dynamics by the paper's method, with the evidence that a result carries."""

from __future__ import annotations

import numpy as np

from p3dof import kinematics, virtual_power
from p3dof.algebra import components
from p3dof.checks import FloatArray
from p3dof.kinematics import MechanismMotion
from p3dof.kinematics.formulas import Lengths
from p3dof.kinematics.states import reachable_states
from p3dof.losses import losses_of, lost_power
from p3dof.parameters import Parameters
from p3dof.routes.results import JointStates, Solution


def solve(
    parameters: Parameters,
    pose: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    wrench: FloatArray | None = None,
    forces: FloatArray | None = None,
) -> Solution:
    """Return forces, joints and bodies at every sample.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    pose, velocity, acceleration : ndarray, shape (N, 3)
        Motion of the platform; rows of NaN give NaN.
    wrench : ndarray, shape (N, 6), optional
        External force and moment on the platform at P [N, N m].
    forces : ndarray, shape (N, 3), optional
        The forces, where they are known already.

    Returns
    -------
    Solution
    """
    motion = kinematics.mechanism_motion(parameters.geometry, pose, velocity, acceleration, on_invalid="nan")
    if forces is None:
        forces = virtual_power.forces(parameters, pose, velocity, acceleration, wrench, on_invalid="nan")
    return Solution(
        forces,
        JointStates.from_mappings(
            tuple(motion.position), motion.position, motion.velocity, motion.acceleration
        ),
        kinematics.closure_error(parameters.geometry, motion),
        energy_rate(parameters, motion),
        _dissipation(parameters, pose, velocity),
    )


def _dissipation(parameters: Parameters, pose: FloatArray, velocity: FloatArray) -> FloatArray:
    """Return the power lost in friction (N,) [W], NaN where a sample is invalid."""
    losses = losses_of(parameters.friction)
    poses, speeds = reachable_states(parameters.geometry, pose, velocity, np.zeros(3), "nan")[:2]
    lengths = Lengths.of(parameters.geometry)
    lost = lost_power(lengths, components(poses), components(speeds), losses, np)
    return np.where(np.isfinite(poses).all(axis=-1), lost, np.nan)


def energy_rate(parameters: Parameters, motion: MechanismMotion) -> FloatArray:
    """Return the rate of change of kinetic and potential energy, Σ v·m(a-g) + ω·(Iα + ω×Iω).

    Parameters
    ----------
    parameters : Parameters
        The machine.
    motion : MechanismMotion
        The motion of its bodies.

    Returns
    -------
    ndarray, shape (...)
        [W].
    """
    total: FloatArray = np.zeros(motion.sliders.shape[:-1])
    for name, body in parameters.bodies.items():
        moving = motion.bodies[name]
        _, v, a = moving.at(body.com)
        inertia = moving.rotation @ body.inertia @ np.swapaxes(moving.rotation, -1, -2)
        spin = np.einsum("...ij,...j->...i", inertia, moving.omega)
        turning = np.einsum("...ij,...j->...i", inertia, moving.epsilon) + np.cross(moving.omega, spin)
        total = total + body.mass * np.sum(v * (a - parameters.gravity), axis=-1)
        total = total + np.sum(moving.omega * turning, axis=-1)
    return total
