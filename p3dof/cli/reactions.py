"""`p3dof reactions`: what the bearings and guides of every joint have to bear over a motion."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from p3dof.cli.app import app
from p3dof.cli.options import FIGURE, Case, with_case
from p3dof.cli.output import print_plain, print_warnings, progress_bar
from p3dof.cli.terminal import print_table
from p3dof.reactions import IDEALISATIONS, Reactions

_COLUMNS = {
    "force": "force\n[N]",
    "axial": "axial\n[N]",
    "radial": "radial\n[N]",
    "moment": "moment\n[N m]",
    "across": "across\n[N m]",
    "rms_force": "RMS\n[N]",
    "rms_moment": "RMS\n[N m]",
}


@app.command()
@with_case
@click.option(
    "--joints",
    type=click.Choice(IDEALISATIONS),
    default=IDEALISATIONS[0],
    show_default=True,
    help="What joins legs and platform, right rod and cross-bar: universal joints and a hinge, or balls.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="CSV file for the reactions of all joints in all samples.",
)
@FIGURE
def reactions(case: Case, joints: str, out: Path | None, figure: Path | None) -> None:
    """Compute the forces and moments in all joints over a motion: peaks on the screen, samples in a file."""
    case.protect(out, figure)
    with progress_bar("reactions", len(case.motion)) as progress:
        result = case.robot.reactions(
            case.motion,
            joints,  # type: ignore[arg-type]  # one of IDEALISATIONS, as the options say
            case.wrench,
            case.on_invalid,  # type: ignore[arg-type]  # likewise
            progress,
        )
    case.require_valid(result.valid)
    written = [] if out is None else [result.to_csv(out)]
    if figure is not None:
        from p3dof import plots

        written.append(plots.save(plots.reactions_figure(result), figure))
    console = Console()
    print_table(console, peaks_table(result))
    print_plain(
        console, "axial and radial: along and across the joint's axis; moment, across: all, and across it"
    )
    print_plain(
        console, "* not determined by rigid bodies: the value for the smallest forces in loop_a, _b and _c"
    )
    residual = result.residual[result.valid].max()
    print_plain(console, f"largest error of Newton's and Euler's equations: {residual:.1e} N or N m")
    known = case.robot.inverse_dynamics(
        case.motion,
        "virtual-power",
        case.wrench,
        case.on_invalid,  # type: ignore[arg-type]  # likewise
    )
    print_warnings(console, case.robot, known)
    for path in written:
        print_plain(console, f"wrote {path}")


def peaks_table(result: Reactions) -> Table:
    """Return the largest loads of every joint, undetermined ones with a star.

    Parameters
    ----------
    result : Reactions
        The reactions.

    Returns
    -------
    rich.table.Table
    """
    table = Table(title=f"largest reactions, joints as {result.idealisation}", box=SIMPLE_HEAD, padding=0)
    table.add_column("joint", no_wrap=True)
    for title in _COLUMNS.values():
        table.add_column(title, justify="right", overflow="fold")
    for peak in result.peaks():
        cells = []
        for name in _COLUMNS:
            value = getattr(peak, name)
            mark = "*" if name in peak.undetermined else " "
            cells.append("- " if np.isnan(value) else f"{value:.2f}{mark}")
        table.add_row(peak.joint, *cells)
    return table
