"""`p3dof urdf` and `p3dof export`: the model as files."""

from __future__ import annotations

import sys
from pathlib import Path

import click
from rich.console import Console

from p3dof import description
from p3dof.cli.app import app
from p3dof.cli.options import PARAMETERS, protect
from p3dof.cli.output import print_plain
from p3dof.errors import MissingExtraError
from p3dof.manipulator import load

SHOWN = 20
"""Most differences that ``--check`` prints."""

OUT_FOLDER = click.option(
    "--out",
    type=click.Path(path_type=Path),
    default="urdf",
    show_default=True,
    help="Folder of the generated files.",
)
CHECK = click.option("--check", is_flag=True, help="Write nothing; exit code 1 if the files there differ.")


@app.command()
@PARAMETERS
@OUT_FOLDER
@CHECK
@click.option("--exact", is_flag=True, help="Leave massless links massless, which many readers misread.")
def urdf(parameters: Path | None, out: Path, check: bool, exact: bool) -> int:
    """Write the URDF and its sidecar (loop closures, actuated joints), or check those in a folder."""
    return _write_or_check(parameters, out, ("urdf",), check, exact)


@app.command()
@PARAMETERS
@OUT_FOLDER
@CHECK
@click.option(
    "--format",
    "formats",
    type=click.Choice(("all", *description.FORMATS)),
    multiple=True,
    default=("all",),
    show_default=True,
    help="What to write; may be given several times.",
)
def export(parameters: Path | None, out: Path, check: bool, formats: tuple[str, ...]) -> int:
    """Write the model for other tools, with its loops where the format can hold them."""
    if "all" not in formats:
        return _write_or_check(parameters, out, tuple(dict.fromkeys(formats)), check)
    return _write_or_check(parameters, out, tuple(description.FORMATS), check, skip_missing=True)


def _write_or_check(
    source: Path | None,
    out: Path,
    formats: tuple[str, ...],
    check: bool,
    exact: bool = False,
    skip_missing: bool = False,
) -> int:
    """Write or check formats; with `skip_missing` one whose library is not installed is passed over aloud."""
    console, differences = Console(), []
    if not check:
        protect((source,), [out / file for name in formats for file in description.FORMATS[name]])
    robot = load(source)
    for name in formats:
        try:
            if check:
                differences += description.check(robot.parameters, out, (name,), exact)
                continue
            for path in description.write(robot.parameters, out, (name,), exact):
                print_plain(console, f"wrote {path}")
        except MissingExtraError as error:
            if not skip_missing:
                raise
            sys.stderr.write(f"p3dof: {name} left out: {error}\n")
    for line in differences[:SHOWN]:
        print_plain(console, line)
    if len(differences) > SHOWN:
        print_plain(console, f"... and {len(differences) - SHOWN} more differences")
    if check and not differences:
        print_plain(console, f"{out}: up to date")
    return 1 if differences else 0
