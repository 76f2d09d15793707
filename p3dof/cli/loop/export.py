"""`p3dof loop export`: any robot as URDF and sidecar."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from p3dof.cli.files import OutputFile, protect
from p3dof.cli.loop.group import loop, with_robot
from p3dof.cli.output import print_plain
from p3dof.closed_loop import ClosedLoopModel
from p3dof.closed_loop.writers.urdf import texts
from p3dof.files import together, write_atomic


@loop.command()
@with_robot
@click.option(
    "--out",
    type=OutputFile("urdf"),
    required=True,
    help="URDF file; the sidecar is written beside it, with the ending .yaml.",
)
def export(robot: ClosedLoopModel, inputs: list[Path], out: Path) -> int:
    """Write a robot as URDF and sidecar, both or none: what was read, with all loops in the sidecar.

    Meshes are not written.
    """
    beside = out.with_suffix(".yaml")
    protect(inputs, [out, beside])
    urdf, sidecar = texts(robot)
    with together():
        written = [write_atomic(out, urdf), write_atomic(beside, sidecar)]
    console = Console()
    for path in written:
        print_plain(console, f"wrote {path}")
    return 0
