"""What is asked of a whole task at once: its forces as one result, and the reactions of all joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import TypeVar

import numpy as np

from p3dof.checks import Progress, shown
from p3dof.errors import InputError, SampleError
from p3dof.manipulator.facade import Manipulator
from p3dof.manipulator.tasks import TaskForces, machines_of
from p3dof.methods import InverseDynamics, JointStates
from p3dof.methods.coulomb import CoulombLimits
from p3dof.reactions import Reactions, Stiffness, Way
from p3dof.tasks import Plan

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
    one = _stacked(found.results, found.plan)
    crossings = np.concatenate([result.crossings for result in found.results])
    return replace(one, crossings=crossings, examine=None)


def reactions_of_task(
    robot: Manipulator,
    plan: Plan,
    joints: Way = "elastic",
    *,
    stiffness: Stiffness | None = None,
    progress: Progress | None = None,
) -> Reactions:
    """Return the reactions of all joints over a planned task.

    Parameters
    ----------
    robot : Manipulator
        The machine; what it carries already stays on it.
    plan : Plan
        Of `Task.plan`.
    joints : {"elastic", "paper", "points"}
        How loads are found that rigid bodies leave open; see `p3dof.reactions`.
    stiffness : Stiffness, optional
        How joints and rods give way; guesses without it.
    progress : callable, optional
        Called with (done, total) pieces.

    Returns
    -------
    Reactions
        Over the motion of the plan. Where two pieces meet, the sample is the latter's.

    Raises
    ------
    InputError
        If an argument is something else.
    ReachError
        If the task leaves the reach of the machine.
    SingularityError
        If the actuators cannot hold the machine somewhere on the way.
    """
    results = []
    for done, (machine, piece) in enumerate(zip(machines_of(robot, plan), plan.pieces, strict=True), 1):
        try:
            found = machine.reactions(piece.motion, joints, wrench=piece.wrench, stiffness=stiffness)
        except SampleError as error:
            error.args = (f"{piece.name}: {error}", *error.args[1:])
            raise
        results.append(found)
        if progress is not None:
            progress(done, len(plan.pieces))
    return _stacked(results, plan)


def _stacked(results: Sequence[_Result], plan: Plan) -> _Result:
    """Return the results of all pieces as one over the motion of the plan."""
    time = np.concatenate([result.time for result in results])
    last = np.append(np.diff(time) > 0, True)  # the latter of two samples of one time
    changed: dict[str, object] = {"motion": plan.motion}
    for field in fields(results[0]):
        parts = [getattr(result, field.name) for result in results]
        if isinstance(parts[0], JointStates):
            columns = (np.concatenate([getattr(part, name) for part in parts])[last] for name in "qva")
            changed[field.name] = JointStates(parts[0].names, *columns)
        elif isinstance(parts[0], CoulombLimits):
            limits = {
                name: np.concatenate([part.limits[name] for part in parts])[last] for name in parts[0].limits
            }
            changed[field.name] = replace(parts[0], limits=limits)
        elif isinstance(parts[0], np.ndarray) and field.name not in _WHOLE:
            changed[field.name] = np.concatenate(parts)[last]
    return replace(results[0], **changed)  # type: ignore[arg-type]  # by their names
