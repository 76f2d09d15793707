"""Reactions over a motion, or over a task: what `p3dof reactions` and `p3dof bearings` begin with."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from p3dof.analysis.reactions import AnyReactions, Choice, Stiffness
from p3dof.cli.files import InputFile, source
from p3dof.cli.kinds import POSITIVE
from p3dof.cli.options import LOAD_FRICTION, STIFFNESS, Case, load_friction_in, stiffness_in
from p3dof.cli.output import in_options, progress_bar
from p3dof.design.task_loads import reactions_of_task
from p3dof.design.tasks import Plan, read_task

SAMPLES = 1001
"""Least number of samples of a planned task."""

_OPTIONS = (
    click.option(
        "--task",
        type=InputFile(),
        help="Task file (YAML) instead of a motion: each way and wait with what the platform carries there.",
    ),
    click.option(
        "--duration",
        type=POSITIVE,
        help="Time of the whole task, dwells included [s]; not needed where all stops have one in the file.",
    ),
    STIFFNESS,
    LOAD_FRICTION,
)


@dataclass(frozen=True)
class JointLoads:
    """What loads the joints, and how they bear it, as the options name it.

    Parameters
    ----------
    case : Case
        The machine, and its motion unless there is a task.
    task : Path, optional
        A task file.
    duration : float, optional
        Of the task [s].
    stiffness_file, load_friction : Path, optional
        Files about the joints.
    """

    case: Case
    task: Path | None
    duration: float | None
    stiffness_file: Path | None
    load_friction: Path | None

    def protect(self, *outputs: Path | None) -> None:
        """Refuse to write over a file that is read, and options that exclude each other."""
        self.case.protect(*outputs, read=(self.task, self.stiffness_file, self.load_friction))
        if self.task is None and self.duration is not None:
            raise click.UsageError("--duration: it belongs to --task")
        others = {"--motion": self.case.motion_file, "--wrench": self.case.wrench_file}
        others["--on-invalid nan"] = None if self.case.on_invalid == "raise" else self.task
        for option, value in others.items():
            if self.task is not None and value is not None:
                raise click.UsageError(f"{option}: a task has its own motion and loads")

    @functools.cached_property
    def stiffness(self) -> Stiffness | None:
        """How joints and rods give way; None for guesses."""
        return stiffness_in(self.stiffness_file)

    @functools.cached_property
    def plan(self) -> Plan | None:
        """The task in time; None of a motion."""
        if self.task is None:
            return None
        with in_options({"duration: ": "--duration: "}):
            samples = SAMPLES if self.case.samples is None else self.case.samples
            return read_task(source(self.task)).plan(self.duration, samples)

    def reactions(self, joints: Choice) -> AnyReactions:
        """Return the reactions of all joints, with a progress bar."""
        friction = load_friction_in(self.load_friction)
        if self.plan is None:
            return self.case.reactions(joints, self.stiffness, friction)
        with progress_bar("reactions", len(self.plan.pieces)) as progress:
            return reactions_of_task(
                self.case.robot,
                self.plan,
                joints,
                stiffness=self.stiffness,
                load_friction=friction,
                progress=progress,
            )

    def place(self, time: float) -> str:
        """Return the way or wait of the task that a time belongs to; nothing of a motion."""
        return "" if self.plan is None else self.plan.piece_at(time).name


def with_joint_loads(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command that has a case the options of `JointLoads`, and these as its first argument."""

    @functools.wraps(command)
    def wrapped(
        case: Case,
        task: Path | None,
        duration: float | None,
        stiffness: Path | None,
        load_friction: Path | None,
        **others: Any,
    ) -> Any:
        return command(JointLoads(case, task, duration, stiffness, load_friction), **others)

    for option in reversed(_OPTIONS):
        wrapped = option(wrapped)
    return wrapped
