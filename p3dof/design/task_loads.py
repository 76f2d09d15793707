"""What is asked of a whole task at once: its forces as one result, and the reactions of all joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Literal, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import Progress, shown
from p3dof._base.errors import InputError, SampleError
from p3dof.analysis.load_friction import LoadFriction
from p3dof.analysis.reactions import (
    AnyReactions,
    Choice,
    Reactions,
    ReactionsComparison,
    Stiffness,
    Way,
    of_result,
    ways_of,
)
from p3dof.design.forces_of_tasks import TaskForces, machines_of
from p3dof.design.tasks import Plan
from p3dof.design.tasks.plan import JUMP
from p3dof.machine.motion import Motion
from p3dof.manipulator import Manipulator
from p3dof.methods import InverseDynamics, JointStates
from p3dof.methods.coulomb import CoulombLimits

_WHOLE = ("crossings", "armature")
"""Arrays that do not go by sample."""
_Result = TypeVar("_Result", InverseDynamics, Reactions)


def joined(found: TaskForces) -> InverseDynamics:
    """Return the forces over a task as one result over the motion of its plan, such as for a page.

    Parameters
    ----------
    found : TaskForces
        The forces over the task.

    Returns
    -------
    InverseDynamics
        With what the platform carries on each piece. Where two pieces meet, the sample is the latter's: just
        after a payload was picked up or put down.

    Raises
    ------
    InputError
        If `found` is something else.
    """
    if not isinstance(found, TaskForces):
        raise InputError(f"found: expected TaskForces, got {shown(found)}")
    time = np.concatenate([result.time for result in found.results])
    last = np.append(np.diff(time) > 0, True)  # the latter of two samples of one time
    one = _stacked(found.results, found.plan.motion, last)
    crossings = np.concatenate([result.crossings for result in found.results])
    return replace(one, crossings=crossings, examine=None)


@overload
def reactions_of_task(
    robot: Manipulator,
    plan: Plan,
    joints: Way = ...,
    *,
    stiffness: Stiffness | None = ...,
    load_friction: LoadFriction | None = ...,
    progress: Progress | None = ...,
) -> Reactions: ...
@overload
def reactions_of_task(
    robot: Manipulator,
    plan: Plan,
    joints: Literal["all"],
    *,
    stiffness: Stiffness | None = ...,
    load_friction: LoadFriction | None = ...,
    progress: Progress | None = ...,
) -> ReactionsComparison: ...
@overload
def reactions_of_task(
    robot: Manipulator,
    plan: Plan,
    joints: Choice,
    *,
    stiffness: Stiffness | None = ...,
    load_friction: LoadFriction | None = ...,
    progress: Progress | None = ...,
) -> AnyReactions: ...
def reactions_of_task(
    robot: Manipulator,
    plan: Plan,
    joints: Choice = "elastic",
    *,
    stiffness: Stiffness | None = None,
    load_friction: LoadFriction | None = None,
    progress: Progress | None = None,
) -> AnyReactions:
    """Return the reactions of all joints over a planned task.

    Parameters
    ----------
    robot : Manipulator
        The machine; what it carries already stays on it.
    plan : Plan
        Of `Task.plan`.
    joints : {"elastic", "paper", "points", "all"}
        How loads are found that rigid bodies leave open; see `p3dof.analysis.reactions`.
    stiffness : Stiffness, optional
        How joints and rods give way; guesses without it.
    load_friction : LoadFriction, optional
        Friction that grows with the loads of the joints.
    progress : callable, optional
        Called with (done, total) pieces.

    Returns
    -------
    Reactions or ReactionsComparison
        Over the motion of the plan, each piece with its own payload and wrench. Where these change, there are
        two samples, the latter a billionth of the whole time later: loads may jump.

    Raises
    ------
    InputError
        If an argument is something else.
    ReachError
        If the task leaves the reach of the machine.
    SingularityError
        If the actuators cannot hold the machine somewhere on the way.
    """
    ways_of(joints)
    results: list[AnyReactions] = []
    for done, (machine, piece) in enumerate(zip(machines_of(robot, plan), plan.pieces, strict=True), 1):
        given = {"wrench": piece.wrench, "stiffness": stiffness, "load_friction": load_friction}
        try:
            found = machine.reactions(piece.motion, joints, **given)  # type: ignore[call-overload]
        except SampleError as error:
            error.args = (f"{piece.name}: {error}", *error.args[1:])
            raise
        results.append(found)
        if progress is not None:
            progress(done, len(plan.pieces))
    return _with_jumps(results, plan)


def reactions_under(robot: Manipulator, found: TaskForces, stiffness: Stiffness | None = None) -> Reactions:
    """Return the reactions of elastic joints under forces over a task that were already found.

    Parameters
    ----------
    robot : Manipulator
        The machine that they were found of.
    found : TaskForces
        The forces, with friction by load if they have any.
    stiffness : Stiffness, optional
        How joints and rods give way.

    Returns
    -------
    Reactions
        As of `reactions_of_task`.
    """
    results = [
        of_result(machine.loop, machine.parameters, result, "elastic", "raise", stiffness)
        for machine, result in zip(machines_of(robot, found.plan), found.results, strict=True)
    ]
    return _with_jumps(results, found.plan).each[0]


def without_jumps(reactions: Reactions, plan: Plan) -> Reactions:
    """Return reactions over a task at the samples of its plan, as `joined` returns forces, for a page.

    Parameters
    ----------
    reactions : Reactions
        As `reactions_of_task` returns them.
    plan : Plan
        Of the task.

    Returns
    -------
    Reactions
        Of two samples where a load jumps, the latter.
    """
    rows, jumps = _samples(plan)
    return _stacked([reactions], plan.motion, ~jumps[rows])


def _samples(plan: Plan) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which samples of all pieces count, one after the other, and after which of them a load jumps."""
    time = np.concatenate([piece.motion.time for piece in plan.pieces])
    last, jumps = np.append(np.diff(time) > 0, True), np.zeros(len(time), dtype=bool)
    ends = np.cumsum([len(piece.motion) for piece in plan.pieces])[:-1]
    for former, latter, k in zip(plan.pieces[:-1], plan.pieces[1:], ends.tolist(), strict=True):
        jumps[k - 1] = former.payload is not latter.payload or (former.wrench != latter.wrench).any()
    return last | jumps, jumps


def _with_jumps(results: Sequence[AnyReactions], plan: Plan) -> AnyReactions:
    """Return the reactions of all pieces as one, with two samples wherever the load changes."""
    rows, jumps = _samples(plan)
    time = np.concatenate([piece.motion.time for piece in plan.pieces])
    for k in (np.flatnonzero(jumps) + 1).tolist():
        later = time[k + 1] if k + 1 < len(time) else np.inf
        time[k] = min(time[k] + JUMP * plan.duration, (time[k] + later) / 2)
    pose, velocity, acceleration = (
        np.concatenate([getattr(piece.motion, name) for piece in plan.pieces])[rows]
        for name in ("pose", "velocity", "acceleration")
    )
    motion = Motion(time[rows], pose, velocity, acceleration, check=False, start=0.0)
    each = [_stacked(ways, motion, rows) for ways in zip(*(one.each for one in results), strict=True)]
    return each[0] if len(each) == 1 else ReactionsComparison(*each)


def _stacked(results: Sequence[_Result], motion: Motion, rows: NDArray[np.bool_]) -> _Result:
    """Return some samples of the results of all pieces as one over a motion."""
    changed: dict[str, object] = {"motion": motion}
    for field in fields(results[0]):
        parts = [getattr(result, field.name) for result in results]
        if isinstance(parts[0], JointStates):
            columns = (np.concatenate([getattr(part, name) for part in parts])[rows] for name in "qva")
            changed[field.name] = JointStates(parts[0].names, *columns)
        elif isinstance(parts[0], CoulombLimits):
            changed[field.name] = _stacked_limits(parts, rows)
        elif isinstance(parts[0], np.ndarray) and field.name not in _WHOLE:
            changed[field.name] = np.concatenate(parts)[rows]
    return replace(results[0], **changed)  # type: ignore[arg-type]  # by their names


def _stacked_limits(parts: Sequence[CoulombLimits], rows: NDArray[np.bool_]) -> CoulombLimits:
    limits = {name: np.concatenate([part.limits[name] for part in parts])[rows] for name in parts[0].limits}
    lost = [part.screws for part in parts if part.screws is not None]
    screws = np.concatenate(lost)[rows] if len(lost) == len(parts) else None
    return replace(parts[0], limits=limits, screws=screws)
