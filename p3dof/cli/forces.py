"""`p3dof forces`: the actuator forces over a motion by one method."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np
from rich.table import Table

from p3dof.cli.app import app
from p3dof.cli.files import OutputFile, console_beside, write_results
from p3dof.cli.options import FIGURE, METHOD, Case, with_case
from p3dof.cli.output import evidence_table, limits_table, print_plain, print_warnings
from p3dof.cli.payloads import print_payloads
from p3dof.cli.terminal import print_table
from p3dof.methods import LEGS


@app.command()
@with_case
@METHOD
@click.option(
    "--out",
    type=OutputFile("table", stream=True),
    help="CSV file, - for the standard output, for forces, sliders and the power balance.",
)
@FIGURE
def forces(case: Case, method: str, out: Path | None, figure: Path | None) -> None:
    """Compute the forces over a motion by one method: peaks on the screen, all samples in a file."""
    case.protect(out, figure)
    result, seconds = case.solve(method)
    from p3dof import plots

    written = write_results(result.to_csv, out, lambda: plots.forces_figure([result]), figure)
    console = console_beside(out)
    print_payloads(console, case)
    table = Table("actuator", "lowest [N]", "highest [N]", "RMS [N]", title=f"forces, {method}")
    for leg, name in enumerate(LEGS):
        values = result.forces[result.valid, leg]
        low, high = (values.min(), values.max()) if len(values) else (np.nan, np.nan)
        table.add_row(name, f"{low:.4f}", f"{high:.4f}", f"{result.rms_forces[leg]:.4f}")
    print_table(console, table)
    print_table(console, limits_table(result, case.robot.parameters.limits))
    print_table(console, evidence_table((result, seconds)))
    print_warnings(console, case.robot, result)
    for path in written:
        print_plain(console, f"wrote {path}")
