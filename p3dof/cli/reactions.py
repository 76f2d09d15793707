"""`p3dof reactions`: what the bearings and guides of every joint have to bear over a motion."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from p3dof.cli.app import app
from p3dof.cli.files import OutputFile, console_beside, write_results
from p3dof.cli.options import FIGURE, JOINTS, Case, with_case
from p3dof.cli.output import print_plain, print_warnings
from p3dof.cli.payloads import print_payloads
from p3dof.cli.terminal import print_table
from p3dof.reactions import JOINTS as ALL_JOINTS
from p3dof.reactions import UNDECIDED, AnyReactions, Choice, how_chosen

_COLUMNS = {
    "force": "force\n[N]",
    "axial": "axial\n[N]",
    "radial": "radial\n[N]",
    "moment": "moment\n[N m]",
    "across": "across\n[N m]",
    "rms_force": "RMS\n[N]",
    "rms_moment": "RMS\n[N m]",
}
_OPEN = {
    "forces that rigid bodies leave open": ("force", "axial", "radial", "rms_force"),
    "moments that rigid bodies leave open": ("moment", "across", "rms_moment"),
}
_NAMES = {joint.name: f"{joint.label} {joint.name}" for joint in ALL_JOINTS}
_KEY = "\n".join(f"  {joint.label}  {joint.name:15} {joint.meaning}" for joint in ALL_JOINTS)


@app.command(epilog=f"\b\nJoints: in the drawing, in tables and files, and what they are\n{_KEY}")
@with_case
@JOINTS
@click.option(
    "--out",
    type=OutputFile("table", stream=True),
    help="CSV file, - for the standard output, for the reactions of all joints in all samples.",
)
@FIGURE
def reactions(case: Case, joints: Choice, out: Path | None, figure: Path | None) -> int:
    """Compute the forces and moments in all joints over a motion: peaks on the screen, samples in a file.

    Loads that rigid bodies leave open are shown apart from those to size the joints for.

    Exit code 1 when the machine cannot make the motion: there are no peaks then.
    """
    case.protect(out, figure)
    result = case.reactions(joints)
    from p3dof import plots

    written = write_results(result.to_csv, out, lambda: plots.reactions_figure(result), figure)
    console = console_beside(out)
    print_payloads(console, case)
    print_table(console, peaks_table(result))
    print_plain(
        console,
        "axial and radial: along and across the joint's axis; moment, across: all, and across it; open: see "
        "below; A1 to C7: names in the drawing (see --help)",
    )
    tables = open_tables(result)
    for table in tables:
        print_table(console, table)
    if tables:
        print_plain(console, f"{UNDECIDED} {how_chosen(result)}")
    residual = result.residual[result.valid].max()
    print_plain(console, f"largest error of Newton's and Euler's equations: {residual:.1e} N or N m")
    known = case.robot.inverse_dynamics(
        case.motion,
        "virtual-power",
        case.wrench,
        case.on_invalid,  # type: ignore[arg-type]  # one of two, as the options say
    )
    print_warnings(console, known.warnings)
    for path in written:
        print_plain(console, f"wrote {path}")
    return 0 if result.possible else 1


def peaks_table(result: AnyReactions) -> Table:
    """Return the largest loads of every joint that rigid bodies determine.

    Parameters
    ----------
    result : Reactions or ReactionsComparison
        The reactions.

    Returns
    -------
    rich.table.Table
        ``open`` stands for a load that is not determined.
    """
    table = _table("largest reactions that rigid bodies determine: to size joints for")
    for title in _COLUMNS.values():
        table.add_column(title, justify="right", overflow="fold")
    for peak in result.peaks():
        loads = ("open" if name in peak.undetermined else _shown(getattr(peak, name)) for name in _COLUMNS)
        table.add_row(_NAMES[peak.joint], *loads)
    return table


def open_tables(result: AnyReactions) -> list[Table]:
    """Return the loads that rigid bodies leave open, by idealisations.

    Parameters
    ----------
    result : Reactions or ReactionsComparison
        The reactions.

    Returns
    -------
    list of rich.table.Table
        Of forces and of moments; none where nothing is open.
    """
    values = {(peak.joint, peak.load): peak.values for peak in result.open_peaks()}
    tables = []
    for title, loads in _OPEN.items():
        table = _table(title)
        for load in loads:
            for kind in result.idealisations:
                table.add_column(f"{_COLUMNS[load]}\n{kind}", justify="right", overflow="fold")
        for joint in result.joints:
            cells = [values.get((joint, load)) for load in loads]
            shown = [
                "" if cell is None else _shown(cell[kind]) for cell in cells for kind in result.idealisations
            ]
            if any(shown):
                table.add_row(_NAMES[joint], *shown)
        if table.row_count:
            tables.append(table)
    return tables


def _table(title: str) -> Table:
    table = Table(title=title, box=SIMPLE_HEAD, padding=0)
    table.add_column("joint", no_wrap=True)
    return table


def _shown(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.2f}"
