"""`p3dof reactions`, `bearings`: what the joints bear over a motion or a task, and how long they live."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import click

from p3dof.analysis.reactions import (
    ALL,
    WAYS,
    AnyReactions,
    Choice,
    Stiffness,
    how_chosen,
    open_tables,
    reactions_table,
)
from p3dof.analysis.reactions import JOINTS as ALL_JOINTS
from p3dof.cli.app import app
from p3dof.cli.case import (
    LOAD_FRICTION,
    STIFFNESS,
    Case,
    load_friction_in,
    stiffness_in,
    with_case,
    with_load,
)
from p3dof.cli.files import InputFile, source, write_results
from p3dof.cli.kinds import DURATION, FIGURE, as_one, table_out
from p3dof.cli.output import in_options, print_plain, print_warnings, print_written, progress_bar, show
from p3dof.cli.work import LIFE, REST
from p3dof.design.bearings import (
    advice_table,
    bearing_life,
    bearings_table,
    guides_table,
    read_bearings,
    rods_table,
)
from p3dof.design.drives import required_life
from p3dof.design.forces_of_tasks import reactions_of_task
from p3dof.design.tasks import Plan, read_task

JOINTS = click.option(
    "--joint-model",
    "joints",
    type=click.Choice((ALL, *WAYS)),
    default=ALL,
    help="Model for the reactions that rigid bodies leave indeterminate: elastic joints and rods, or "
    "universal joints (paper) or spherical joints (points) between legs and platform.",
)
_KEY = "\n".join(f"  {joint.label}  {joint.name:15} {joint.meaning}" for joint in ALL_JOINTS)

SAMPLES = 1001
"""Least number of samples of a planned task."""

_OPTIONS = (
    click.option(
        "--task", type=InputFile(), help="Task file (YAML) instead of a motion: with dwells and payloads."
    ),
    DURATION,
    STIFFNESS,
    LOAD_FRICTION,
)


@dataclass(frozen=True)
class JointLoads:
    """What loads the joints, and how they bear it, as the options name it."""

    case: Case  # the machine, and its motion unless there is a task
    task: Path | None  # a task file
    duration: float | None  # of the task [s]
    stiffness: Path | None  # files about the joints
    load_friction: Path | None

    def protect(self, *outputs: Path | None) -> None:
        """Refuse to write over a file that is read, and options that exclude each other."""
        self.case.protect(*outputs, read=(self.task, self.stiffness, self.load_friction))
        if self.task is None and self.duration is not None:
            raise click.UsageError("--duration: it belongs to --task")
        others = {"--motion": self.case.motion_file, "--wrench": self.case.wrench_file}
        others["--on-invalid nan"] = None if self.case.on_invalid == "raise" else self.task
        for option, value in others.items():
            if self.task is not None and value is not None:
                raise click.UsageError(f"{option}: a task has its own motion and loads")

    @cached_property
    def elasticity(self) -> Stiffness | None:
        """How joints and rods give way; None for guesses."""
        return stiffness_in(self.stiffness)

    @cached_property
    def plan(self) -> Plan | None:
        """The task in time; None of a motion."""
        if self.task is None:
            return None
        with in_options({"duration: ": "--duration: "}):
            samples = SAMPLES if self.case.samples is None else self.case.samples
            task = read_task(source(self.task)).on(self.case.robot.parameters.geometry)
            return task.plan(self.duration, samples)

    def reactions(self, joints: Choice) -> AnyReactions:
        """Return the reactions of all joints, with a progress bar."""
        friction = load_friction_in(self.load_friction)
        if self.plan is None:
            return self.case.reactions(joints, self.elasticity, friction)
        with progress_bar("reactions", len(self.plan.pieces)) as progress:
            return reactions_of_task(
                self.case.robot,
                self.plan,
                joints,
                stiffness=self.elasticity,
                load_friction=friction,
                progress=progress,
            )

    def place(self, time: float) -> str:
        """Return the way or wait of the task that a time belongs to; nothing of a motion."""
        return "" if self.plan is None else self.plan.piece_at(time).name


with_joint_loads = as_one("loads", JointLoads, *_OPTIONS)
"""The options of `JointLoads` of a command that has a case, and these as the argument `loads`."""


@app.command(epilog=f"\b\nJoints: label in the drawing, name in tables and files, meaning\n{_KEY}")
@with_case
@with_joint_loads
@JOINTS
@table_out("reactions of all joints at all samples")
@FIGURE
def reactions(loads: JointLoads, joints: Choice, out: Path | None, figure: Path | None) -> int:
    """Compute the reaction forces and moments in all joints over a motion or a task.

    The machine is overconstrained: reactions that rigid bodies leave indeterminate (~) are those of elastic
    joints and rods, with the stiffness of --stiffness or of typical joints. The results of two rigid
    idealisations are printed beside them; they are no bounds.

    Exit code 1 when the machine cannot perform the motion; no peaks are printed then.
    """
    loads.protect(out, figure)
    case, result = loads.case, loads.reactions(joints)
    written = write_results(result.to_csv, out, figure, lambda plots: plots.reactions_figure(result))
    console = case.console(out)
    show(console, reactions_table(result), notes=True)
    show(console, *(table for table in open_tables(result) if table.rows))
    print_plain(console, how_chosen(result))
    if loads.plan is None:
        print_warnings(console, _warnings(case))
    print_written(console, written)
    return 0 if result.possible else 1


def _warnings(case: Case) -> tuple[str, ...]:
    """Return what there is to know about the motion."""
    known = case.robot.inverse_dynamics(
        case.motion, method="virtual-power", wrench=case.wrench, on_invalid=case.on_invalid
    )
    return known.warnings


@app.command()
@click.argument("bearings_file", metavar="BEARINGS", type=InputFile())
@with_load
@with_joint_loads
@REST
@LIFE
def bearings(loads: JointLoads, bearings_file: Path, rest: float, life: str | None) -> int:
    """Compute the life of bearings and guides for a repeated motion, and the buckling safety of rods.

    BEARINGS is a YAML file with the ratings of bearings and guides. The loads are the joint reactions of the
    elastic model. Exit code 1 when a life is less than is required (--life, or `life` in the file).
    """
    loads.protect()
    needed = required_life(life, "--life")
    parts = read_bearings(source(bearings_file))
    reactions = loads.reactions("elastic")
    machine = loads.case.robot.parameters
    report = bearing_life(machine, reactions, parts, stiffness=loads.elasticity, rest=rest, life=needed)
    console = loads.case.console()
    print_warnings(console, report.warnings)
    place = None if loads.plan is None else loads.place
    tables = (
        bearings_table(report, place),
        guides_table(report, place),
        rods_table(report),
        advice_table(report),
    )
    show(console, *(table for table in tables if table.rows), notes=True)
    print_plain(console, how_chosen(reactions))
    return 0 if report.lasts else 1
