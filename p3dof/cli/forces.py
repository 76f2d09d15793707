"""`p3dof forces`: the actuator forces over a motion by one method."""

from __future__ import annotations

from pathlib import Path

import click

from p3dof.analysis.load_friction import APPLIES, additions_table, contacts_table
from p3dof.cli.app import app
from p3dof.cli.files import OutputFile, console_beside, write_results
from p3dof.cli.options import (
    FIGURE,
    LOAD_FRICTION,
    METHOD,
    STIFFNESS,
    Case,
    load_friction_in,
    stiffness_in,
    with_case,
)
from p3dof.cli.output import print_plain, print_warnings, show
from p3dof.cli.payloads import print_payloads
from p3dof.methods import evidence_table, forces_table, limits_table


@app.command()
@with_case
@METHOD
@LOAD_FRICTION
@STIFFNESS
@click.option(
    "--out",
    type=OutputFile("table", stream=True),
    help="CSV file, - for the standard output, for forces, sliders and the power balance.",
)
@FIGURE
def forces(
    case: Case,
    method: str,
    load_friction: Path | None,
    stiffness: Path | None,
    out: Path | None,
    figure: Path | None,
) -> int:
    """Compute the forces over a motion by one method: peaks on the screen, all samples in a file.

    With --load-friction, by pinocchio or virtual-power, friction and loads of joints are found together.

    Exit code 1 when the machine cannot make the motion: there are no peaks then.
    """
    case.protect(out, figure, read=(load_friction, stiffness))
    friction = load_friction_in(load_friction)
    if friction is None and stiffness is not None:
        raise click.UsageError("--stiffness decides the loads of --load-friction, which is not given")
    if friction is None:
        result, seconds = case.solve(method)
        drawn, tables = [result], []
    else:
        effect, seconds = case.load_friction(friction, method, stiffness_in(stiffness))
        result, tables = effect.result, [additions_table(effect), contacts_table(effect)]
        drawn = [result, effect.without]
    from p3dof.report import plots

    written = write_results(result.to_csv, out, lambda: plots.forces_figure(drawn), figure)
    console = console_beside(out)
    print_payloads(console, case)
    limits = limits_table(result, case.robot.parameters.limits)
    show(console, forces_table(result), limits, evidence_table(result, seconds=[seconds]))
    if tables:
        show(console, *tables, notes=True)
        print_plain(console, APPLIES)
    print_warnings(console, result.warnings)
    for path in written:
        print_plain(console, f"wrote {path}")
    return 0 if result.possible else 1
