"""Reactions of all joints over a motion, from the forces that Pinocchio finds."""

from __future__ import annotations

from typing import Literal, overload

from p3dof.checks import FloatArray, Progress
from p3dof.closed_loop import ClosedLoopModel, ReactionSolver, reactions_batch
from p3dof.closed_loop.reactions import LENGTH_SHARE
from p3dof.errors import SampleError
from p3dof.methods import Solution, without_crossings
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
    found = [
        of_solution(loop, parameters, motion, solution, kind, states.wrench, on_invalid) for kind in kinds
    ]
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
    solver = ReactionSolver(loop, cuts(joints), LENGTH_SHARE * parameters.geometry.L)
    states, tau = solution.joints, solution.forces
    lost = FrictionForces(loop, parameters.friction).over(states.q, states.v)
    external = lost.external_with(wrench)
    found = reactions_batch(
        solver, states.q, states.v, states.a, tau, external, lost.joint_forces, lost.external
    )
    if found.errors and on_invalid == "raise":
        i, error = next(iter(found.errors.items()))
        raise SampleError(f"sample {i}: {error}", (i,)) from error
    arrays = found.arrays()
    forces, moments = (in_fixed_axes(arrays["rotations"], arrays[name]) for name in ("forces", "moments"))
    errors = residual(parameters, motion, wrench, forces, moments, arrays["positions"])
    return Reactions(joints, solver.length, motion, **arrays, residual=errors)
