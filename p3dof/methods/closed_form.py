"""What the closed forms know of a motion besides its forces: joints, and the evidence of a result.

Samples are looked at block by block: what a block takes in between stays in the processor's cache, and of a
long motion no more than the result is in memory.

The equations of motion in the minimal coordinates x = (y, z, θ), from the paper's closed forms.

    M(x) ẍ + C(x, ẋ) ẋ + g(x) + d(x, ẋ) = J(x)ᵀ f + Eᵀ w

with the actuator forces f, friction d, the external wrench w on the platform and E, which picks
(F_y, F_z, M_y) of it.
All terms stay finite where det J = 0: forward dynamics is defined at actuation-singular poses too. C is that
of Christoffel's symbols, so that Ṁ - 2C is skew; the derivatives of M are exact, by complex steps through the
formulas.

References
----------
R. M. Murray, Z. Li, S. S. Sastry, A Mathematical Introduction to Robotic Manipulation, CRC Press 1994, 4.2.
W. Squire, G. Trapp, Using Complex Variables to Estimate Derivatives of Real Functions, SIAM Review 40 (1998).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

import numpy as np

from p3dof._base.algebra import Vector, components, vector_array
from p3dof._base.checks import FloatArray
from p3dof._base.errors import P3dofError
from p3dof._base.outputs import written
from p3dof._base.time_series.wrenches import WRENCH_ROWS
from p3dof.closed_form import kinematics
from p3dof.closed_form.kinematics import Placed, jacobian_at, reachable
from p3dof.closed_form.paper.evidence import evidence
from p3dof.closed_form.paper.evidence import joints as all_joints
from p3dof.closed_form.paper.formulas import Lengths, accelerations, velocities
from p3dof.closed_form.paper.friction import NO_LOSSES, Actuation, Losses, actuation_of, losses_of, lost_power
from p3dof.closed_form.paper.virtual_power import generalized_forces
from p3dof.machine.motion.states import States
from p3dof.machine.parameters import Parameters
from p3dof.machine.parameters.body import inertials, numbers
from p3dof.methods.solution import JointStates, Solution

_BLOCK = 2048
"""Most samples that are looked at at once; each takes about 3 kB."""

ForcesAt: TypeAlias = Callable[[Placed], FloatArray]
"""Returns the forces (n, 3) at states that were looked at."""


def solve_with(forces_at: ForcesAt, parameters: Parameters, states: States) -> Solution:
    """Return forces with joints, closure error, energy rate, losses and angles from the singularity."""
    count, names = len(states.pose), kinematics.JOINTS
    forces, joints = np.empty((count, 3)), np.empty((3, count, len(names)))
    found = np.empty((4, count))
    bodies, gravity = inertials(parameters.bodies), numbers(parameters.gravity)
    actuation = _actuation(parameters)
    for block, placed in placed_in_blocks(parameters, states):
        forces[block] = forces_at(placed)
        at = placed.states
        lengths, x, velocity = placed.lengths, placed.x, components(at.velocity)
        v = velocities(lengths, x, velocity)
        a = accelerations(lengths, x, v, velocity, components(at.acceleration))
        for rows, values in zip(joints, all_joints(lengths, x, v, a, at.pose[..., 2], np), strict=True):
            for k, value in enumerate(values):
                rows[block, k] = value
        found[0, block], found[1, block] = evidence(lengths, bodies, gravity, actuation, x, v, a, np)
        found[2, block] = _dissipation(parameters, placed)
        found[3, block] = placed.actuation
    return Solution(forces, JointStates(names, *joints), *found)


def placed_in_blocks(parameters: Parameters, states: States) -> Iterator[tuple[slice, Placed]]:
    """Look at states block by block: where they are, and their configuration."""
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


_STEP = 1e-100
"""Complex step: nothing is subtracted, so it can be as small as one likes."""

_REST: Vector = (0, 0, 0)
_AXES: tuple[Vector, Vector, Vector] = ((1, 0, 0), (0, 1, 0), (0, 0, 1))


def mass_matrix(parameters: Parameters, states: States) -> FloatArray:
    """Return the mass matrix M(x), symmetric and positive definite [kg, kg m, kg m²]."""
    poses = reachable(parameters.geometry, states).states.pose
    return _mass_matrix(parameters, components(poses), poses.shape[:-1])


def coriolis_matrix(parameters: Parameters, states: States, out: FloatArray | None = None) -> FloatArray:
    """Return the matrix C(x, ẋ) of centrifugal and Coriolis forces, by Christoffel's symbols.

    C ẋ are forces [N, N, N m]; Ṁ - 2C is skew.
    """
    found = reachable(parameters.geometry, states).states
    D = np.stack([_mass_derivative(parameters, found.pose, k) for k in range(3)], axis=-1)  # ∂M_ij/∂x_k
    gamma = 0.5 * (D + np.swapaxes(D, -1, -2) - np.moveaxis(D, -1, -3))  # Γ_ijk
    return written(np.asarray(np.einsum("...ijk,...k->...ij", gamma, found.velocity)), out)


def gravity_forces(parameters: Parameters, states: States, out: FloatArray | None = None) -> FloatArray:
    """Return g(x), the gradient of the potential energy: what holds the machine against gravity.

    Less what counterbalances at the sliders bear.
    """
    poses = reachable(parameters.geometry, states).states.pose
    gravity, actuation = numbers(parameters.gravity), _actuation(parameters)
    found = _generalized(parameters, gravity, components(poses), _REST, _REST, actuation)
    return written(vector_array(found, poses.shape[:-1]), out)


def forward_dynamics(parameters: Parameters, states: States) -> FloatArray:
    """Return the acceleration of the platform under actuator forces; ndarray, shape (..., 3)."""
    placed = reachable(parameters.geometry, states)
    found, shape = placed.states, states.shape
    x, gravity = components(found.pose), numbers(parameters.gravity)
    losses = losses_of(parameters.friction)
    v = components(found.velocity)
    bias = vector_array(_generalized(parameters, gravity, x, v, _REST, _actuation(parameters), losses), shape)
    acting = np.einsum("...ij,...i->...j", jacobian_at(placed), found.forces) - bias
    if found.wrench is not None:
        acting = acting + found.wrench[..., WRENCH_ROWS]
    M = _mass_matrix(parameters, x, shape)
    valid = np.isfinite(acting).all(axis=-1) & np.isfinite(M).all(axis=(-2, -1))
    acceleration = np.full(found.pose.shape, np.nan)
    acceleration[valid] = np.linalg.solve(M[valid], acting[valid][..., None])[..., 0]
    return acceleration


def _generalized(
    parameters: Parameters,
    gravity: Vector,
    x: Vector,
    v: Vector,
    a: Vector,
    actuation: Actuation,
    losses: Losses = NO_LOSSES,
) -> Vector:
    lengths, bodies = Lengths.of(parameters.geometry), inertials(parameters.bodies)
    return generalized_forces(lengths, bodies, gravity, x, v, a, np, losses=losses, actuation=actuation)


def _actuation(parameters: Parameters) -> Actuation:
    return actuation_of(parameters.actuators, parameters.gravity)


def _columns(parameters: Parameters, x: Vector) -> list[Vector]:
    """Return M column by column: what unit accelerations take, without gravity and at rest."""
    inertia = _actuation(parameters).resting
    return [_generalized(parameters, _REST, x, _REST, axis, inertia) for axis in _AXES]


def _mass_matrix(parameters: Parameters, x: Vector, shape: tuple[int, ...]) -> FloatArray:
    M = np.stack([vector_array(column, shape) for column in _columns(parameters, x)], axis=-1)
    return np.asarray((M + np.swapaxes(M, -1, -2)) / 2)  # symmetric but for rounding


def _mass_derivative(parameters: Parameters, poses: FloatArray, k: int) -> FloatArray:
    """Return ∂M/∂x_k (..., 3, 3), by a complex step."""
    x: list[Any] = list(components(poses))
    x[k] = x[k] + 1j * _STEP
    with np.errstate(invalid="ignore"):  # rows of NaN, which complex division tells about
        columns = _columns(parameters, (x[0], x[1], x[2]))
    shape = poses.shape[:-1]
    imaginary = [tuple(np.imag(entry) / _STEP for entry in column) for column in columns]
    D = np.stack([vector_array((c[0], c[1], c[2]), shape) for c in imaginary], axis=-1)
    return np.asarray((D + np.swapaxes(D, -1, -2)) / 2)
