"""`p3dof indices`: how well the machine moves, holds and withstands, at poses or along a motion."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console

from p3dof._base.files import write_table
from p3dof.analysis.indices import COLUMNS, DEFINITIONS, check_names, columns_of, indices_table
from p3dof.analysis.indices.elasticity import DRIVE
from p3dof.analysis.reactions.stiffness import RodSection
from p3dof.cli.app import app
from p3dof.cli.files import JSON, OutputFile, console_beside, write_results
from p3dof.cli.kinds import POSITIVE, Pose
from p3dof.cli.options import Amount, Case, with_load
from p3dof.cli.output import show
from p3dof.cli.payloads import print_payloads
from p3dof.machine.parameters.quantities import LENGTH


@app.command()
@with_load
@click.option(
    "--at",
    "poses",
    type=Pose(),
    multiple=True,
    help="Pose of the platform, '0.1,0,-30 deg'; several times for more. Without it, along the motion.",
)
@click.option(
    "--index",
    "names",
    multiple=True,
    help=f"Index to tell of, several times for more; all without it: {', '.join(DEFINITIONS)}.",
)
@click.option("--length", type=Amount(LENGTH), help="Characteristic length ℓ; r of the machine without it.")
@click.option(
    "--drive-stiffness", type=POSITIVE, default=DRIVE, show_default=True, help="Of each drive [N/m]: a guess."
)
@click.option(
    "--rod-diameter", type=Amount(LENGTH), help="Of legs and rods; by their mass in steel without it."
)
@click.option("--rigid-rods", is_flag=True, help="Take legs and rods as rigid.")
@click.option(
    "--out",
    type=OutputFile("table", stream=True),
    help="CSV file, - for the standard output, with a row for each pose.",
)
@JSON
def indices(
    case: Case,
    poses: tuple[list[float], ...],
    names: tuple[str, ...],
    length: float | None,
    drive_stiffness: float,
    rod_diameter: float | None,
    rigid_rods: bool,
    out: Path | None,
    as_json: bool,
) -> int:
    """Compute performance indices at poses, or their least, mean and largest values along a motion.

    Condition, accuracy, motion/force transmission, what the limits allow, holding forces, inertia at the
    actuators, natural frequencies. Those with ℓ in their definition depend on the characteristic length.
    """
    case.protect(out)
    if rigid_rods and rod_diameter is not None:
        raise click.UsageError("--rigid-rods and --rod-diameter exclude each other")
    if poses and case.motion_file is not None:
        raise click.UsageError("--at and --motion exclude each other")
    if as_json and out is not None and str(out) == "-":
        raise click.UsageError("--json and --out - both take the standard output")
    wanted = check_names(names) or tuple(COLUMNS)
    rods = None if rigid_rods else RodSection(diameter=rod_diameter)
    where = np.array(poses, dtype=float) if poses else case.motion.pose
    found = case.robot.indices(where, length, drive_stiffness=drive_stiffness, rods=rods)
    columns = columns_of(found, wanted)
    table = {"y [m]": where[:, 0], "z [m]": where[:, 1], "theta [rad]": where[:, 2]}
    if not poses:
        table = {"t [s]": case.motion.time, **table}
    table |= {f"{name} [{COLUMNS[name].unit_of(name)}]": values for name, values in columns.items()}
    write_results(lambda path: write_table(path, list(table), tuple(table.values())), out)
    console = Console(stderr=True) if as_json else console_beside(out)
    if as_json:
        plain: dict[str, Any] = {"length": found.length, "pose": where.tolist()}
        plain["indices"] = {
            name: [None if np.isnan(v) else float(v) for v in values] for name, values in columns.items()
        }
        sys.stdout.write(json.dumps(plain) + "\n")
    else:
        print_payloads(console, case)
        show(console, indices_table(found, columns), notes=True)
    return 0
