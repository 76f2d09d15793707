"""Reactions of all joints over a motion, from the forces that Pinocchio finds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, overload

import numpy as np

from p3dof.checks import FloatArray, Progress
from p3dof.closed_loop import ClosedLoopModel, ReactionSolver, reactions_by_each
from p3dof.closed_loop.reactions import LENGTH_SHARE
from p3dof.errors import SampleError
from p3dof.methods import InverseDynamics, JointStates, Solution, without_crossings
from p3dof.methods.pinocchio import PinocchioMethod
from p3dof.methods.pinocchio_friction import FrictionForces
from p3dof.motion import Motion, WrenchOverTime, states_over
from p3dof.parameters import Parameters
from p3dof.reactions.comparison import AnyReactions, ReactionsComparison
from p3dof.reactions.joints import BOTH, IDEALISATIONS, Choice, Idealisation, cuts
from p3dof.reactions.newton_euler import in_fixed_axes, residual
from p3dof.reactions.results import Reactions
from p3dof.samples import OnInvalid


@overload
def over_motion(
    loop: ClosedLoopModel,
    parameters: Parameters,
    motion: Motion,
    joints: Literal["both"] = ...,
    wrench: WrenchOverTime = ...,
    on_invalid: OnInvalid = ...,
    progress: Progress | None = ...,
) -> ReactionsComparison: ...
@overload
def over_motion(
    loop: ClosedLoopModel,
    parameters: Parameters,
    motion: Motion,
    joints: Idealisation,
    wrench: WrenchOverTime = ...,
    on_invalid: OnInvalid = ...,
    progress: Progress | None = ...,
) -> Reactions: ...
@overload
def over_motion(
    loop: ClosedLoopModel,
    parameters: Parameters,
    motion: Motion,
    joints: Choice,
    wrench: WrenchOverTime = ...,
    on_invalid: OnInvalid = ...,
    progress: Progress | None = ...,
) -> AnyReactions: ...
def over_motion(
    loop: ClosedLoopModel,
    parameters: Parameters,
    motion: Motion,
    joints: Choice = BOTH,
    wrench: WrenchOverTime = None,
    on_invalid: OnInvalid = "raise",
    progress: Progress | None = None,
) -> AnyReactions:
    """Return the reactions of all joints over a motion.

    Parameters
    ----------
    loop : ClosedLoopModel
        The mechanism.
    parameters : Parameters
        The machine that it is a model of.
    motion : Motion
        The motion of the platform.
    joints : {"both", "paper", "points"}
        How the cuts of the loops are built, see the module; in both ways by default.
    wrench : array-like, shape (6,) or (N, 6), or callable, optional
        External force and moment on the platform at P, in the fixed frame [N, N m]; or a function of time.
    on_invalid : {"raise", "nan"}
        Raise for samples that are out of reach or singular, or leave NaN in their rows.
    progress : callable, optional
        Called with (done, total) now and then.

    Returns
    -------
    ReactionsComparison or Reactions
        By both idealisations, or by the one that was asked for.

    Raises
    ------
    ReachError, SingularityError, SampleError
        Naming the first bad sample.
    InputError
        If the wrench does not fit, the idealisation is unknown, or `motion` is not a `Motion`.
    """
    kinds = IDEALISATIONS if joints == BOTH else (joints,)
    for kind in kinds:
        cuts(kind)  # before the long part
    states = states_over(motion, wrench, on_invalid)
    solution = PinocchioMethod(parameters, loop).solve(states, progress)
    solution, _ = without_crossings(motion.time, solution, on_invalid)
    found = _of_kinds(
        loop, parameters, motion, solution.joints, solution.forces, kinds, states.wrench, on_invalid
    )
    return ReactionsComparison(*found) if joints == BOTH else found[0]


def of_solution(
    loop: ClosedLoopModel,
    parameters: Parameters,
    motion: Motion,
    solution: Solution,
    joints: Idealisation = "paper",
    wrench: FloatArray | None = None,
    on_invalid: OnInvalid = "raise",
) -> Reactions:
    """Return the reactions that belong to actuator forces and joint states already found.

    Parameters
    ----------
    loop, parameters, motion, joints, on_invalid
        As for `over_motion`.
    solution : Solution
        Actuator forces and joints of the motion; rows of NaN are left out.
    wrench : ndarray, shape (N, 6), optional
        External force and moment on the platform at P [N, N m].

    Returns
    -------
    Reactions

    Raises
    ------
    SampleError
        If the forces of a sample do not produce its motion.
    InputError
        If the idealisation is unknown.
    """
    states, forces = solution.joints, solution.forces
    return _of_kinds(loop, parameters, motion, states, forces, (joints,), wrench, on_invalid)[0]


def of_result(
    loop: ClosedLoopModel,
    parameters: Parameters,
    result: InverseDynamics,
    joints: Choice = BOTH,
    on_invalid: OnInvalid = "raise",
) -> AnyReactions:
    """Return the reactions that belong to forces already found by Pinocchio.

    Parameters
    ----------
    loop, parameters, joints, on_invalid
        As for `over_motion`.
    result : InverseDynamics
        The forces, with their motion and load.

    Returns
    -------
    ReactionsComparison or Reactions

    Raises
    ------
    SampleError
        If the forces of a sample do not produce its motion.
    InputError
        If the idealisation is unknown.
    """
    kinds = IDEALISATIONS if joints == BOTH else (joints,)
    wrench = result.wrench if np.any(result.wrench) else None
    states, forces = result.joints, result.forces
    found = _of_kinds(loop, parameters, result.motion, states, forces, kinds, wrench, on_invalid)
    return ReactionsComparison(*found) if joints == BOTH else found[0]


def _of_kinds(
    loop: ClosedLoopModel,
    parameters: Parameters,
    motion: Motion,
    states: JointStates,
    tau: FloatArray,
    kinds: Sequence[Idealisation],
    wrench: FloatArray | None,
    on_invalid: OnInvalid,
) -> list[Reactions]:
    """Return the reactions by several idealisations."""
    solvers = [ReactionSolver(loop, cuts(kind), LENGTH_SHARE * parameters.geometry.L) for kind in kinds]
    lost = FrictionForces(loop, parameters.friction).over(states.q, states.v)
    external = lost.external_with(wrench)
    batches = reactions_by_each(
        solvers, states.q, states.v, states.a, tau, external, lost.joint_forces, lost.external
    )
    results = []
    for kind, solver, found in zip(kinds, solvers, batches, strict=True):
        if found.errors and on_invalid == "raise":
            i, error = next(iter(found.errors.items()))
            raise SampleError(f"sample {i}: {error}", (i,)) from error
        arrays = found.arrays()
        forces, moments = (in_fixed_axes(arrays["rotations"], arrays[name]) for name in ("forces", "moments"))
        errors = residual(parameters, motion, wrench, forces, moments, arrays["positions"])
        results.append(Reactions(kind, solver.length, motion, **arrays, residual=errors))
    return results
