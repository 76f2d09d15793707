"""Reactions of all joints over a motion, from the forces that Pinocchio finds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from p3dof._base.checks import FloatArray, Progress
from p3dof._base.errors import SampleError
from p3dof._base.samples import OnInvalid
from p3dof.analysis.reactions.comparison import AnyReactions, ReactionsComparison
from p3dof.analysis.reactions.results import (
    ALL,
    JOINTS,
    Choice,
    Idealisation,
    Reactions,
    Way,
    cuts,
    in_fixed_axes,
    ways_of,
)
from p3dof.analysis.reactions.stiffness import Stiffness
from p3dof.closed_form import kinematics
from p3dof.loops import ClosedLoopModel, ReactionSolver, reactions_by_each
from p3dof.loops.reactions import LENGTH_SHARE
from p3dof.machine.motion import Motion, WrenchOverTime, states_over
from p3dof.machine.parameters import Parameters
from p3dof.methods import CoulombLimits, InverseDynamics, JointStates, Solution, without_crossings
from p3dof.methods.pinocchio import FrictionForces, JointForces, PinocchioMethod, bare


def over_motion(
    loop: ClosedLoopModel,
    parameters: Parameters,
    motion: Motion,
    joints: Choice = ALL,
    wrench: WrenchOverTime = None,
    on_invalid: OnInvalid = "raise",
    progress: Progress | None = None,
    stiffness: Stiffness | None = None,
) -> AnyReactions:
    """Return the reactions of all joints over a motion; in all ways, or in the one that was asked for."""
    ways = ways_of(joints)
    states = states_over(motion, wrench, on_invalid)
    solution = PinocchioMethod(parameters, loop).solve(states, progress)
    solution, _ = without_crossings(motion, solution, on_invalid)
    found = _in_ways(
        loop, parameters, motion, solution.joints, solution.forces, ways, states.wrench, on_invalid, stiffness
    )
    return ReactionsComparison(*found) if joints == ALL else found[0]


def of_solution(
    loop: ClosedLoopModel,
    parameters: Parameters,
    motion: Motion,
    solution: Solution,
    joints: Way = "elastic",
    wrench: FloatArray | None = None,
    on_invalid: OnInvalid = "raise",
    stiffness: Stiffness | None = None,
    coulomb: CoulombLimits | None = None,
) -> Reactions:
    """Return the reactions that belong to actuator forces and joint states already found."""
    states, forces = solution.joints, solution.forces
    ways = ways_of(joints)
    given = wrench, on_invalid, stiffness, coulomb
    return _in_ways(loop, parameters, motion, states, forces, ways, *given)[0]


def of_result(
    loop: ClosedLoopModel,
    parameters: Parameters,
    result: InverseDynamics,
    joints: Choice = ALL,
    on_invalid: OnInvalid = "raise",
    stiffness: Stiffness | None = None,
) -> AnyReactions:
    """Return the reactions that belong to forces already found by Pinocchio."""
    ways = ways_of(joints)
    wrench = result.wrench if np.any(result.wrench) else None
    states, forces = result.joints, result.forces
    given = wrench, on_invalid, stiffness, result.coulomb
    found = _in_ways(loop, parameters, result.motion, states, forces, ways, *given)
    return ReactionsComparison(*found) if joints == ALL else found[0]


def _in_ways(
    loop: ClosedLoopModel,
    parameters: Parameters,
    motion: Motion,
    states: JointStates,
    tau: FloatArray,
    ways: Sequence[Way],
    wrench: FloatArray | None,
    on_invalid: OnInvalid,
    stiffness: Stiffness | None,
    coulomb: CoulombLimits | None = None,
) -> list[Reactions]:
    """Return the reactions found in several ways."""
    given, loop = Stiffness() if stiffness is None else stiffness, bare(loop)
    built: list[Idealisation] = [given.cuts if way == "elastic" else way for way in ways]
    solvers = [
        _solver(loop, parameters, kind, given if way == "elastic" else None)
        for way, kind in zip(ways, built, strict=True)
    ]
    lost = JointForces(loop, parameters).over(states.q, states.v)
    if coulomb is not None:
        lost = lost.plus(FrictionForces.of_limits(loop, coulomb).over(states.q, states.v))
    external = lost.external_with(wrench)
    batches = reactions_by_each(
        solvers, states.q, states.v, states.a, tau, external, lost.joint_forces, lost.external
    )
    results = []
    for way, kind, solver, found in zip(ways, built, solvers, batches, strict=True):
        if found.errors and on_invalid == "raise":
            i, error = next(iter(found.errors.items()))
            raise SampleError(f"sample {i}: {error}", (i,)) from error
        arrays = found.arrays()
        forces, moments = (in_fixed_axes(arrays["rotations"], arrays[name]) for name in ("forces", "moments"))
        errors = _residual(parameters, motion, wrench, forces, moments, arrays["positions"])
        results.append(Reactions(way, kind, solver.length, motion, **arrays, residual=errors))
    return results


def _solver(
    loop: ClosedLoopModel, parameters: Parameters, kind: Idealisation, stiffness: Stiffness | None
) -> ReactionSolver:
    """Return what finds reactions with cuts of a kind, of elastic joints or of rigid ones."""
    length = LENGTH_SHARE * parameters.geometry.L
    if stiffness is None:
        return ReactionSolver(loop, cuts(kind), length)
    return ReactionSolver(loop, cuts(kind), length, stiffness.compliances(parameters), stiffness.misfits())


def _residual(
    parameters: Parameters,
    motion: Motion,
    wrench: FloatArray | None,
    forces: FloatArray,
    moments: FloatArray,
    positions: FloatArray,
) -> FloatArray:
    """Return the largest error of Newton's and Euler's equations of all bodies (N,), a check of reactions."""
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
