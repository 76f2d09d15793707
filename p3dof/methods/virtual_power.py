"""The way of the paper: virtual powers, and the equations of motion that follow from them, over arrays."""

from __future__ import annotations

import math

import numpy as np

from p3dof._base.algebra import BLOCK, Namespace, components
from p3dof._base.checks import FloatArray, Progress
from p3dof._base.outputs import written
from p3dof.closed_form import kinematics
from p3dof.closed_form.kinematics import Placed
from p3dof.closed_form.paper import friction
from p3dof.closed_form.paper.friction import actuation_of, losses_of
from p3dof.closed_form.paper.virtual_power import NO_WRENCH, Wrench, actuator_forces
from p3dof.machine.motion.states import States
from p3dof.machine.parameters import Parameters
from p3dof.machine.parameters.body import inertials, numbers
from p3dof.methods import closed_form
from p3dof.methods.closed_form import placed_in_blocks, solve_with
from p3dof.methods.solution import CoulombLimits, Solution


class VirtualPowerMethod:
    """Forces and equations of motion by the paper's virtual powers; doors as `DynamicsMethod` has them."""

    one = None

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters

    def forces(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the actuator forces (..., 3) [N]."""
        found = np.empty(states.pose.shape)
        rows = found.reshape(-1, 3)
        for block, placed in placed_in_blocks(self._parameters, states):
            rows[block] = forces_at(self._parameters, placed)
        if states.on_invalid == "raise":
            states.raise_overflow("forces", found)
        return written(found, out)

    def solve(self, states: States, progress: Progress | None = None) -> Solution:  # noqa: ARG002 - it is quick
        """Return forces, joints and evidence at N samples."""
        return solve_with(lambda placed: forces_at(self._parameters, placed), self._parameters, states)

    def accelerate(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the acceleration (..., 3) of the platform under forces."""
        with np.errstate(over="ignore", invalid="ignore"):  # what overflows is told below
            found = closed_form.forward_dynamics(self._parameters, states)
        if states.on_invalid == "raise":
            states.raise_overflow("acceleration", found)
        return written(found, out)

    def jacobian(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return ∂(λA, λB, λC)/∂(y, z, θ), (..., 3, 3)."""
        return written(kinematics.jacobian_at(kinematics.reachable(self._parameters.geometry, states)), out)

    def mass_matrix(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the mass matrix in y, z, θ, (..., 3, 3)."""
        return written(closed_form.mass_matrix(self._parameters, states), out)


def forces_at(parameters: Parameters, placed: Placed) -> FloatArray:
    """Return the actuator forces at states that were looked at; ndarray, shape (..., 3)."""
    states = placed.states
    shape, wrench = states.shape, states.wrench
    loads = np.zeros((*shape, 6)) if wrench is None else wrench
    motion = states.pose, states.velocity, states.acceleration
    table = np.concatenate([*motion, loads], axis=-1).reshape(-1, 15)
    result = np.empty((len(table), 3))
    lengths, bodies = placed.lengths, inertials(parameters.bodies)
    gravity, losses = numbers(parameters.gravity), losses_of(parameters.friction)
    actuation = actuation_of(parameters.actuators, parameters.gravity)
    for start in range(0, len(table), BLOCK):
        block = slice(start, start + BLOCK)
        # One sample runs on plain numbers, which cost a tenth of arrays of one.
        rows = list(table[block].T) if len(table) > 1 else table[0].tolist()
        xp: Namespace = np if len(table) > 1 else math
        q, v, a, force, moment = (components(rows[i : i + 3]) for i in range(0, 15, 3))
        external = NO_WRENCH if wrench is None else Wrench(force, moment)
        with np.errstate(over="ignore", invalid="ignore"):  # what overflows is told by the caller
            f = actuator_forces(lengths, bodies, gravity, q, v, a, xp, external, losses, actuation)
        for leg in range(3):
            result[block, leg] = f[leg]
    return result.reshape(*shape, 3)


def forces_against(
    parameters: Parameters, states: States, coulomb: CoulombLimits
) -> tuple[FloatArray, FloatArray]:
    """Return what actuators need more because of Coulomb friction that differs from sample to sample."""
    forces, power = np.empty((len(states.pose), 3)), np.empty(len(states.pose))
    for block, placed in placed_in_blocks(parameters, states):
        limits = {name: tuple(values[block].T) for name, values in coulomb.limits.items()}
        velocity = components(placed.states.velocity)
        found, lost = friction.forces_against(
            placed.lengths, placed.x, velocity, limits, coulomb.smoothing, np
        )
        invalid = ~np.isfinite(placed.states.pose).all(axis=-1)
        for leg in range(3):
            forces[block, leg] = np.where(invalid, np.nan, found[leg])
        power[block] = np.where(invalid, np.nan, lost)
    return forces, power
