"""`p3dof bearings`: how long bearings and guides live, and how safe rods are."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from p3dof.analysis.reactions import how_chosen
from p3dof.cli.app import app
from p3dof.cli.files import InputFile, source
from p3dof.cli.kinds import Number
from p3dof.cli.options import with_load
from p3dof.cli.output import print_plain, print_warnings, show
from p3dof.cli.payloads import print_payloads
from p3dof.cli.task_loads import JointLoads, with_joint_loads
from p3dof.design.bearings import bearing_life, bearings_table, guides_table, read_bearings, rods_table


@app.command()
@click.argument("bearings_file", metavar="BEARINGS", type=InputFile())
@with_load
@with_joint_loads
@click.option(
    "--rest", type=Number(min=0), default=0.0, show_default=True, help="Time at rest after each motion [s]."
)
def bearings(loads: JointLoads, bearings_file: Path, rest: float) -> int:
    """Say how long bearings and guides live when a motion is repeated, and how far rods are from buckling.

    BEARINGS is a YAML file with the ratings of bearings and guides. The loads are those of elastic joints.
    """
    loads.protect()
    parts = read_bearings(source(bearings_file))
    reactions = loads.reactions("elastic")
    machine = loads.case.robot.parameters
    report = bearing_life(machine, reactions, parts, stiffness=loads.stiffness, rest=rest)
    console = Console()
    print_payloads(console, loads.case)
    print_warnings(console, report.warnings)
    place = None if loads.plan is None else loads.place
    tables = (bearings_table(report, place), guides_table(report, place), rods_table(report))
    show(console, *(table for table in tables if table.rows), notes=True)
    print_plain(console, how_chosen(reactions))
    return 0
