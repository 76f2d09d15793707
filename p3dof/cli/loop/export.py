"""`p3dof loop export`: any robot in other formats."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import click
from rich.console import Console

from p3dof.checks import one_line
from p3dof.cli.files import OutputFile, protect
from p3dof.cli.loop.group import loop, with_robot
from p3dof.cli.output import print_plain
from p3dof.closed_loop import ClosedLoopModel
from p3dof.closed_loop.writers.files import SUFFIX, contents
from p3dof.errors import ModelWarning
from p3dof.files import together, write_atomic


@loop.command()
@with_robot
@click.option(
    "--format",
    "format_",
    type=click.Choice(list(SUFFIX)),
    help="By default what the name of the file ends in: .urdf, .xml (MJCF), .sdf. Drake reads SDF with "
    "loops in elements of its own.",
)
@click.option(
    "--out",
    type=OutputFile("robot"),
    required=True,
    help="The file; the sidecar of a URDF is written beside it, with the ending .yaml.",
)
def export(robot: ClosedLoopModel, inputs: list[Path], format_: str | None, out: Path) -> int:
    """Write a robot as URDF and sidecar, MJCF or SDF, with all its loops.

    The forces of all motions stay the same. What a format cannot hold is an error that names it. Meshes are
    not written.
    """
    protect(inputs, [out, *([out.with_suffix(".yaml")] if out.suffix.lower() == SUFFIX["urdf"] else [])])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ModelWarning)
        texts = contents(robot, out, format_)
    for warning in caught:
        if issubclass(warning.category, ModelWarning):
            sys.stderr.write(f"p3dof: {one_line(str(warning.message))}\n")
    with together():
        written = [write_atomic(path, text) for path, text in texts.items()]
    console = Console()
    for path in written:
        print_plain(console, f"wrote {path}")
    return 0
