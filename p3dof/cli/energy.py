"""`p3dof energy`: energy, work and drive loads over a motion."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np
from rich.markup import escape
from rich.table import Table

from p3dof.cli.app import app
from p3dof.cli.files import OutputFile, console_beside, write_results
from p3dof.cli.options import FIGURE, METHOD, Case, with_case
from p3dof.cli.output import fixed, limits_table, print_plain, print_warnings
from p3dof.cli.payloads import print_payloads
from p3dof.cli.terminal import print_table
from p3dof.energy import Energy
from p3dof.manipulator import InverseDynamics
from p3dof.parameters import LEGS

ROUNDING = 1e-9
"""Share of the whole energy below which nothing moves."""


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
    from p3dof import plots

    written = write_results(found.to_csv, out, lambda: plots.energy_figure(found), figure)
    console = console_beside(out)
    print_payloads(console, case)
    limits = limits_table(result, case.robot.parameters.limits)
    for table in (bodies_table(found), drives_table(found), limits, balance_table(found, result)):
        print_table(console, table)
    print_warnings(console, result.warnings)
    for path in written:
        print_plain(console, f"wrote {path}")
    return 0 if result.possible else 1


def bodies_table(energy: Energy) -> Table:
    """Return the largest kinetic energy of each body, and its part in the largest of all together.

    Parameters
    ----------
    energy : Energy
        Over a motion; at least one sample is valid.

    Returns
    -------
    rich.table.Table
    """
    if not energy.valid.all():
        table = Table("body", "peak kinetic energy [J]", title="kinetic energy: not known in all samples")
        for name in energy.bodies:
            table.add_row(name, "-")
        return table
    total = energy.kinetic_total
    most = int(np.argmax(total))
    table = Table(
        "body",
        "peak kinetic energy [J]",
        f"share at t = {energy.time[most]:.4g} s",
        title=f"kinetic energy, all bodies at most {total[most]:.4f} J",
    )
    for k, name in enumerate(energy.bodies):
        share = energy.kinetic[most, k] / total[most] if total[most] > 0 else 0.0
        table.add_row(name, f"{energy.kinetic[:, k].max():.4f}", f"{share:.1%}")
    return table


def drives_table(energy: Energy) -> Table:
    """Return what the motion asks of each actuator.

    Parameters
    ----------
    energy : Energy
        Over a motion.

    Returns
    -------
    rich.table.Table
    """
    drives = energy.drives
    rows = {
        "peak force [N]": drives.peak_force,
        "RMS force [N]": drives.rms_force,
        "peak speed [m/s]": drives.peak_speed,
        "peak power [W]": drives.peak_power,
        "peak braking power [W]": drives.peak_braking,
        "mean power [W]": drives.mean_power,
        "work given [J]": drives.positive_work,
        "work taken back [J]": drives.negative_work,
    }
    table = Table("drive load", *(f"actuator {leg}" for leg in LEGS), title="what the drives must do")
    for name, values in rows.items():
        table.add_row(escape(name), *map(fixed, values))
    return table


def balance_table(energy: Energy, result: InverseDynamics) -> Table:
    """Return the evidence: change of the energy against the work done, and its rate against the power.

    Parameters
    ----------
    energy : Energy
        Over a motion; at least one sample is valid.
    result : InverseDynamics
        The forces that it comes from.

    Returns
    -------
    rich.table.Table
    """
    table = Table("forces by", "work done [J]", "balance", "power residual [W]")
    table.title = "change of the energy less the work done"
    error = np.abs(energy.balance[energy.valid]).max()
    rounding = ROUNDING * np.abs(energy.total[energy.valid]).max()
    share = (
        f"{error / energy.scale:.1e} of {energy.scale:.4g} J" if energy.scale > rounding else f"{error:.1e} J"
    )
    residual = np.abs(result.power_residual[result.valid]).max()
    done = energy.work_done[-1] if result.possible else np.nan
    table.add_row(result.method, fixed(done), share, f"{residual:.1e}")
    return table
