"""`p3dof loop assemble`: the joints at values of the actuated ones."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np
import yaml

from p3dof._base.files import write_atomic, write_table
from p3dof.cli.files import OutputFile, console_beside, protect, write_results
from p3dof.cli.loop.group import AT, assembled, loop, with_robot
from p3dof.cli.output import print_plain, show
from p3dof.loops import ClosedLoopModel
from p3dof.loops.tables import assembly_table, joint_values


@loop.command()
@with_robot
@AT
@click.option(
    "--out",
    type=OutputFile("joints", stream=True),
    help="File for the values of all joints: .csv, or .yaml with a mapping as of the sidecar's 'reference'; "
    "- for CSV on the standard output.",
)
def assemble(robot: ClosedLoopModel, inputs: list[Path], values: tuple[str, ...], out: Path | None) -> int:
    """Close the loops at values of the actuated joints, and show all joints.

    Exit code 1 when the loops do not close there.
    """
    protect(inputs, [out])
    assembly = assembled(robot, values)
    found = joint_values(robot, assembly.q)

    def save(path: Path) -> Path:
        if path.suffix.lower() == ".csv":
            names = [
                name if len(row) == 1 else f"{name}.{i}"
                for name, row in found.items()
                for i in range(len(row))
            ]
            return write_table(path, names, tuple(np.array([x]) for row in found.values() for x in row))
        plain = {
            name: [float(x) for x in row] if len(row) > 1 else float(row[0]) for name, row in found.items()
        }
        return write_atomic(path, yaml.safe_dump({"reference": plain}, sort_keys=False, allow_unicode=True))

    written = write_results(save, out)
    console = console_beside(out)
    show(console, assembly_table(robot, assembly), notes=True)
    for path in written:
        print_plain(console, f"wrote {path}")
    return 0
