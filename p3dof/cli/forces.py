"""`p3dof forces`: the actuator forces over a motion by one method."""

from __future__ import annotations

from pathlib import Path

import click
from rich.table import Table

from p3dof.cli.app import app
from p3dof.cli.files import OutputFile, console_beside, write_results
from p3dof.cli.options import FIGURE, METHOD, Case, with_case
from p3dof.cli.output import evidence_table, fixed, limits_table, print_plain, print_warnings
from p3dof.cli.payloads import print_payloads
from p3dof.cli.terminal import print_table
from p3dof.parameters import LEGS


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
    table = Table("actuator", "lowest [N]", "highest [N]", "RMS [N]", title=f"forces, {method}")
    for leg, name in enumerate(LEGS):
        values = result.forces[:, leg]  # NaN in one sample: there is no lowest and no highest
        table.add_row(name, *map(fixed, (values.min(), values.max(), result.rms_forces[leg])))
    print_table(console, table)
    print_table(console, limits_table(result, case.robot.parameters.limits))
    print_table(console, evidence_table((result, seconds)))
    print_warnings(console, result.warnings)
    for path in written:
        print_plain(console, f"wrote {path}")
    return 0 if result.possible else 1
