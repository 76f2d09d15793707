"""`p3dof bearings`: how long bearings and guides live, and how safe rods are."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from p3dof.bearings import bearing_life, bearings_table, guides_table, read_bearings, rods_table
from p3dof.cli.app import app
from p3dof.cli.files import InputFile, source
from p3dof.cli.options import (
    LOAD_FRICTION,
    STIFFNESS,
    Case,
    Number,
    load_friction_in,
    stiffness_in,
    with_load,
)
from p3dof.cli.output import print_plain, print_warnings, show
from p3dof.cli.payloads import print_payloads
from p3dof.reactions import how_chosen


@app.command()
@click.argument("bearings_file", metavar="BEARINGS", type=InputFile())
@with_load
@STIFFNESS
@LOAD_FRICTION
@click.option(
    "--rest", type=Number(min=0), default=0.0, show_default=True, help="Time at rest after each motion [s]."
)
def bearings(
    case: Case, bearings_file: Path, stiffness: Path | None, load_friction: Path | None, rest: float
) -> int:
    """Say how long bearings and guides live when a motion is repeated, and how far rods are from buckling.

    BEARINGS is a YAML file with the ratings of bearings and guides. The loads are those of elastic joints.
    """
    parts = read_bearings(source(bearings_file))
    given = stiffness_in(stiffness)
    reactions = case.reactions("elastic", given, load_friction_in(load_friction))
    report = bearing_life(case.robot.parameters, reactions, parts, stiffness=given, rest=rest)
    console = Console()
    print_payloads(console, case)
    print_warnings(console, report.warnings)
    tables = (bearings_table(report), guides_table(report), rods_table(report))
    show(console, *(table for table in tables if table.rows), notes=True)
    print_plain(console, how_chosen(reactions))
    return 0
