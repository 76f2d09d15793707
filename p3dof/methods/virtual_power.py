"""The paper's virtual powers over arrays of states, with checks, and the evidence that a result carries."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from p3dof import kinematics
from p3dof.algebra import BLOCK, Namespace, components
from p3dof.checks import FloatArray
from p3dof.kinematics import MechanismMotion
from p3dof.kinematics.states import holdable_states, reachable_states
from p3dof.methods.results import JointStates, Solution
from p3dof.paper.formulas import Lengths
from p3dof.paper.friction import losses_of, lost_power
from p3dof.paper.inertials import inertials, numbers
from p3dof.paper.virtual_power import NO_WRENCH, Wrench, actuator_forces
from p3dof.parameters import Parameters
from p3dof.samples import OnInvalid, raise_not_finite, wrench_like


def forces(
    parameters: Parameters,
    pose: ArrayLike,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    wrench: ArrayLike | None = None,
    on_invalid: OnInvalid = "raise",
) -> FloatArray:
    """Return the actuator forces by the paper's virtual-power method.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    pose, velocity, acceleration : array-like, shape (..., 3)
        Of (y, z, θ): [m, m, rad] and per second, per second²; leading shapes broadcast.
    wrench : array-like, shape (..., 6), optional
        External force and moment on the platform at P, in the fixed frame [N, N m].
    on_invalid : {"raise", "nan"}
        Raise for samples that are not finite, out of reach or actuation-singular, or leave NaN in their rows.

    Returns
    -------
    ndarray, shape (..., 3)
        Forces of the actuators A, B, C on their sliders, positive along +z0 [N].

    Raises
    ------
    ReachError, SingularityError
        Naming the first bad sample and how many there are.
    InputError
        If shapes do not fit or a number is not finite.
    """
    states = holdable_states(parameters, pose, velocity, acceleration, on_invalid)
    shape = states[0].shape[:-1]
    table = np.concatenate([*states, wrench_like(wrench, shape, on_invalid)], axis=-1).reshape(-1, 15)
    result = np.empty((len(table), 3))
    lengths, bodies = Lengths.of(parameters.geometry), inertials(parameters.bodies)
    gravity, losses = numbers(parameters.gravity), losses_of(parameters.friction)
    for start in range(0, len(table), BLOCK):
        block = slice(start, start + BLOCK)
        # One sample runs on plain numbers, which cost a tenth of arrays of one.
        rows = list(table[block].T) if len(table) > 1 else table[0].tolist()
        xp: Namespace = np if len(table) > 1 else math
        q, v, a, force, moment = (components(rows[i : i + 3]) for i in range(0, 15, 3))
        external = NO_WRENCH if wrench is None else Wrench(force, moment)
        with np.errstate(over="ignore", invalid="ignore"):  # what overflows is told below
            f = actuator_forces(lengths, bodies, gravity, q, v, a, xp, external, losses)
        for leg in range(3):
            result[block, leg] = f[leg]
    forces_ = result.reshape(*shape, 3)
    if on_invalid == "raise":
        raise_not_finite("forces", forces_)
    return forces_


def solve(
    parameters: Parameters,
    pose: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    wrench: FloatArray | None = None,
    known: FloatArray | None = None,
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
    known : ndarray, shape (N, 3), optional
        The forces, where another method has found them already.

    Returns
    -------
    Solution
    """
    motion = kinematics.mechanism_motion(parameters.geometry, pose, velocity, acceleration, on_invalid="nan")
    if known is None:
        known = forces(parameters, pose, velocity, acceleration, wrench, on_invalid="nan")
    return Solution(
        known,
        JointStates.from_mappings(
            tuple(motion.position), motion.position, motion.velocity, motion.acceleration
        ),
        kinematics.closure_error(parameters.geometry, motion),
        energy_rate(parameters, motion),
        _dissipation(parameters, pose, velocity),
        kinematics.singularity(parameters.geometry, pose).actuation,
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
