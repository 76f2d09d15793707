"""`p3dof forces`: the actuator forces over a motion by one method."""

from __future__ import annotations

from pathlib import Path

import click

from p3dof.cli.app import app
from p3dof.cli.files import OutputFile, console_beside, write_results
from p3dof.cli.options import FIGURE, METHOD, Case, with_case
from p3dof.cli.output import print_plain, print_warnings, show
from p3dof.cli.payloads import print_payloads
from p3dof.methods import evidence_table, forces_table, limits_table


@app.command()
@with_case
@METHOD
@click.option(
    "--out",
    type=OutputFile("table", stream=True),
    help="CSV file, - for the standard output, for forces, sliders and the power balance.",
)
@FIGURE
def forces(case: Case, method: str, out: Path | None, figure: Path | None) -> int:
    """Compute the forces over a motion by one method: peaks on the screen, all samples in a file.

    Exit code 1 when the machine cannot make the motion: there are no peaks then.
    """
    case.protect(out, figure)
    result, seconds = case.solve(method)
    from p3dof import plots

    written = write_results(result.to_csv, out, lambda: plots.forces_figure([result]), figure)
    console = console_beside(out)
    print_payloads(console, case)
    limits = limits_table(result, case.robot.parameters.limits)
    show(console, forces_table(result), limits, evidence_table(result, seconds=[seconds]))
    print_warnings(console, result.warnings)
    for path in written:
        print_plain(console, f"wrote {path}")
    return 0 if result.possible else 1
