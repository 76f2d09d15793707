"""`p3dof energy`: energy, work and drive loads over a motion."""

from __future__ import annotations

from pathlib import Path

import click

from p3dof.analysis.energy import balance_table, bodies_table, drives_table
from p3dof.cli.app import app
from p3dof.cli.files import OutputFile, console_beside, write_results
from p3dof.cli.options import FIGURE, METHOD, Case, with_case
from p3dof.cli.output import print_plain, print_warnings, show
from p3dof.cli.payloads import print_payloads
from p3dof.methods import evidence_table, limits_table


@app.command()
@with_case
@METHOD
@click.option(
    "--out",
    type=OutputFile("table", stream=True),
    help="CSV file, - for the standard output, for energies, momenta, power and work.",
)
@FIGURE
def energy(case: Case, method: str, out: Path | None, figure: Path | None) -> int:
    """Compute energy and work over a motion: what moves most, and what the drives must give and take.

    Exit code 1 when the machine cannot make the motion: there are no peaks and no sums then.
    """
    case.protect(out, figure)
    result, _ = case.solve(method)
    found = case.robot.energy(result)
    from p3dof.report import plots

    written = write_results(found.to_csv, out, lambda: plots.energy_figure(found), figure)
    console = console_beside(out)
    print_payloads(console, case)
    show(console, bodies_table(found), notes=True)
    show(console, drives_table(found), limits_table(result, case.robot.parameters.limits))
    show(console, balance_table(found), evidence_table(result))
    print_warnings(console, result.warnings)
    for path in written:
        print_plain(console, f"wrote {path}")
    return 0 if result.possible else 1
