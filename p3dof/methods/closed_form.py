"""What the closed forms know of a motion besides its forces: joints, and the evidence of a result."""

from __future__ import annotations

import numpy as np

from p3dof import kinematics
from p3dof.algebra import components
from p3dof.checks import FloatArray
from p3dof.kinematics import MechanismMotion, Placed
from p3dof.methods.solution import JointStates, Solution
from p3dof.paper.friction import losses_of, lost_power
from p3dof.parameters import Parameters


def solution_with(forces: FloatArray, parameters: Parameters, placed: Placed) -> Solution:
    """Return forces together with joints, closure error, energy rate, losses and angles from the singularity.

    Parameters
    ----------
    forces : ndarray, shape (N, 3)
        However they were found [N].
    parameters : Parameters
        The machine.
    placed : Placed
        The states, shape (N,), which were looked at.

    Returns
    -------
    Solution
    """
    motion = kinematics.motion_at(parameters.geometry, placed)
    return Solution(
        forces=forces,
        joints=JointStates.from_mappings(
            tuple(motion.position), motion.position, motion.velocity, motion.acceleration
        ),
        closure_error=kinematics.closure_error(parameters.geometry, motion),
        energy_rate=energy_rate(parameters, motion),
        dissipation=_dissipation(parameters, placed),
        actuation=placed.actuation,
    )


def _dissipation(parameters: Parameters, placed: Placed) -> FloatArray:
    """Return the power lost in friction (N,) [W], NaN where a sample is invalid."""
    states, lengths, x = placed
    lost = lost_power(lengths, x, components(states.velocity), losses_of(parameters.friction), np)
    return np.where(np.isfinite(states.pose).all(axis=-1), lost, np.nan)


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
