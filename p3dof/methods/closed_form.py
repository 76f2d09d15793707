"""What the closed forms know of a motion besides its forces: joints, and the evidence of a result.

Samples are looked at block by block: what a block takes in between stays in the processor's cache, and of a
long motion no more than the result is in memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeAlias

import numpy as np

from p3dof._base.algebra import components
from p3dof._base.checks import FloatArray
from p3dof._base.errors import P3dofError
from p3dof.closed_form import kinematics
from p3dof.closed_form.kinematics import MechanismMotion, Placed
from p3dof.closed_form.paper.friction import losses_of, lost_power
from p3dof.machine.motion.states import States
from p3dof.machine.parameters import Parameters
from p3dof.methods.solution import JointStates, Solution

_BLOCK = 2048
"""Most samples that are looked at at once; each takes about 3 kB."""

ForcesAt: TypeAlias = Callable[[Placed], FloatArray]
"""Returns the forces (n, 3) at states that were looked at."""


def solve_with(forces_at: ForcesAt, parameters: Parameters, states: States) -> Solution:
    """Return forces together with joints, closure error, energy rate, losses and angles from the singularity.

    Parameters
    ----------
    forces_at : callable
        However they are found.
    parameters : Parameters
        The machine.
    states : States
        What the user gave, shape (N,).

    Returns
    -------
    Solution

    Raises
    ------
    ReachError, SingularityError, InputError
        As `p3dof.closed_form.kinematics.holdable` of all states.
    """
    count, geometry, names = len(states.pose), parameters.geometry, kinematics.JOINTS
    forces, joints = np.empty((count, 3)), np.empty((3, count, len(names)))
    evidence = np.empty((4, count))
    for block, placed in placed_in_blocks(parameters, states):
        motion = kinematics.motion_at(geometry, placed)
        forces[block] = forces_at(placed)
        for found, known in zip(joints, (motion.position, motion.velocity, motion.acceleration), strict=True):
            for k, name in enumerate(names):
                found[block, k] = known[name]
        evidence[0, block] = kinematics.closure_error(geometry, motion)
        evidence[1, block] = energy_rate(parameters, motion)
        evidence[2, block] = _dissipation(parameters, placed)
        evidence[3, block] = placed.actuation
    return Solution(forces, JointStates(names, *joints), *evidence)


def placed_in_blocks(parameters: Parameters, states: States) -> Iterator[tuple[slice, Placed]]:
    """Look at states block by block: where they are, and their configuration.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    states : States
        What the user gave, of any shape.

    Yields
    ------
    block : slice
        Rows of the states.
    placed : Placed
        These, of shape (n,).

    Raises
    ------
    ReachError, SingularityError, InputError
        As `p3dof.closed_form.kinematics.holdable` of all states: naming the first bad one of all, and how
        many there are.
    """
    rows = states.rows()
    count = len(rows.pose)
    parts = max(1, -(-count // _BLOCK))
    for part in range(parts):
        block = slice(count * part // parts, count * (part + 1) // parts)
        try:
            placed = kinematics.holdable(parameters.geometry, rows.of_rows(block, states.on_invalid))
        except P3dofError:
            kinematics.holdable(parameters.geometry, states)
            raise
        yield block, placed


def _dissipation(parameters: Parameters, placed: Placed) -> FloatArray:
    """Return the power lost in friction (N,) [W], NaN where a sample is invalid."""
    states, lengths, x = placed
    lost = lost_power(lengths, x, components(states.velocity), losses_of(parameters.friction), np)
    return np.where(np.isfinite(states.pose).all(axis=-1), lost, np.nan)


def energy_rate(parameters: Parameters, motion: MechanismMotion) -> FloatArray:
    """Return the rate of change of kinetic and potential energy, Σ v·m(a-g) + ω·(Iα + ω×Iω).

    With that of motors and screws, and less what balances give.

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
    actuators = parameters.actuators
    balance = actuators.balance_at_home(parameters.gravity) - actuators.stiffness * motion.sliders
    net = actuators.inertia * motion.slider_accelerations - balance
    total: FloatArray = np.sum(motion.slider_velocities * net, axis=-1)
    for name, body in parameters.bodies.items():
        moving = motion.bodies[name]
        _, v, a = moving.at(body.com)
        inertia = moving.rotation @ body.inertia @ np.swapaxes(moving.rotation, -1, -2)
        spin = np.einsum("...ij,...j->...i", inertia, moving.omega)
        turning = np.einsum("...ij,...j->...i", inertia, moving.epsilon) + np.cross(moving.omega, spin)
        total = total + body.mass * np.sum(v * (a - parameters.gravity), axis=-1)
        total = total + np.sum(moving.omega * turning, axis=-1)
    return total
