"""`p3dof loop info`: what a robot is and what it can do."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from p3dof._base.errors import AssemblyError
from p3dof.cli.app import FAILED
from p3dof.cli.loop.group import loop, with_robot
from p3dof.cli.output import print_warnings, show
from p3dof.loops import ClosedLoopModel
from p3dof.loops.overview import overview
from p3dof.loops.tables import closures_table, facts_table, joints_table


@loop.command()
@with_robot
@click.option("--joints/--no-joints", "listed", default=True, help="List all joints.")
def info(robot: ClosedLoopModel, inputs: list[Path], listed: bool) -> int:
    """Say what a robot is: joints, closures, mobility, and what its actuators and forces leave open.

    Exit code 1 when its loops do not close.
    """
    del inputs
    console = Console()
    problem, seen, gap = "", None, float("nan")
    try:
        assembly = robot.assemble()
    except AssemblyError as error:
        problem, gap = str(error), error.gap
    else:
        seen, gap = overview(robot, assembly.q), assembly.gap
    tables = [facts_table(robot, seen, gap)]
    if listed:
        tables.append(joints_table(robot, seen))
    if robot.constraint_rows:
        tables.append(closures_table(robot, seen))
    show(console, *tables)
    print_warnings(console, [problem] if problem else [])
    return FAILED if problem else 0
