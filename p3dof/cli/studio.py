"""`p3dof studio`: a page with maps of a machine's indices, and designs to choose from."""

from __future__ import annotations

import csv
from contextlib import suppress
from pathlib import Path

import click
import numpy as np
from rich.console import Console

from p3dof._base.checks import FloatArray
from p3dof._base.errors import InputError
from p3dof._base.files import read_text
from p3dof.cli.app import app
from p3dof.cli.files import STREAM, InputFile, OutputFile, protect
from p3dof.cli.kinds import Whole
from p3dof.cli.options import Case, with_load
from p3dof.cli.output import print_plain
from p3dof.cli.payloads import print_payloads
from p3dof.viewer.document.studio import save_studio

_LARGEST_FILE = 50_000_000


@app.command()
@with_load
@click.option(
    "--designs",
    type=InputFile(),
    help="Table of designs to compare (CSV, units in brackets), such as 'p3dof designs --out' writes.",
)
@click.option("--small", multiple=True, metavar="COLUMN", help="Column of designs that is good if small.")
@click.option("--large", multiple=True, metavar="COLUMN", help="Column of designs that is good if large.")
@click.option("--start", type=Whole(1, 10_000_000), help="Row of the design that others are compared with.")
@click.option(
    "--index", "indices", multiple=True, metavar="NAME", help="Index of the map; several times for more."
)
@click.option("--grid", type=Whole(5, 401), default=81, show_default=True, help="Poses of the map, each way.")
@click.option("--out", type=OutputFile("animation"), required=True, help="HTML file to write.")
def studio(
    case: Case,
    designs: Path | None,
    small: tuple[str, ...],
    large: tuple[str, ...],
    start: int | None,
    indices: tuple[str, ...],
    grid: int,
    out: Path,
) -> int:
    """Write one page: maps of a machine's indices over y and θ with loci, limits and the motion; designs too.

    Designs are points over two columns and lines through all; what is selected in one picture is selected in
    the other.
    """
    protect((case.parameters, case.motion_file, case.wrench_file, designs), (out,))
    if designs is None and (small or large or start):
        raise click.UsageError("--small, --large and --start belong to --designs")
    written = save_studio(
        out,
        case.robot,
        case.motion,
        None if designs is None else _columns(designs),
        indices=indices or None,
        counts=(grid, grid),
        better={**dict.fromkeys(small, "small"), **dict.fromkeys(large, "large")},
        start=None if start is None else start - 1,
    )
    console = Console()
    print_payloads(console, case)
    print_plain(console, f"wrote {written}")
    return 0


def _columns(path: Path) -> dict[str, FloatArray]:
    """Return the columns of a table that hold numbers; empty cells are NaN."""
    if path == STREAM:
        raise click.UsageError("--designs: expected a file")
    lines = [line for line in read_text(path, _LARGEST_FILE).splitlines() if line.strip() and line[0] != "#"]
    rows = list(csv.reader(lines))
    if len(rows) < 2:
        raise InputError(f"{path}: expected a header and a row for each design")
    header, *body = rows
    for number, row in enumerate(body, start=1):
        if len(row) != len(header):
            raise InputError(f"{path}, row {number}: expected {len(header)} cells, got {len(row)}")
    found = {}
    for name, cells in zip(header, zip(*body, strict=True), strict=True):
        with suppress(ValueError):  # of words, such as a status
            found[name.strip()] = np.array([float(cell) if cell.strip() else np.nan for cell in cells])
    if not found:
        raise InputError(f"{path}: expected columns of numbers, got words only")
    return found
