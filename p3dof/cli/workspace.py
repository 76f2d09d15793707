"""`p3dof workspace`: where the machine can work, and how well."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console

from p3dof._base.files import together
from p3dof._base.tables import Table, table_of
from p3dof.analysis.indices import COLUMNS, check_names, write_dataset
from p3dof.analysis.workspace import Workspace, WorkspaceMargins, box_table, plain_workspace, workspace_table
from p3dof.cli.app import app
from p3dof.cli.files import JSON, InputFile, OutputFile, protect, source
from p3dof.cli.kinds import Number, Payload, Span, Triple
from p3dof.cli.machine import PARAMETERS, machine_of
from p3dof.cli.options import FIGURE, Amount
from p3dof.cli.output import print_plain, show
from p3dof.machine.motion import Motion, paper_motion
from p3dof.machine.parameters import Body
from p3dof.machine.parameters.quantities import ANGLE, FORCE, LENGTH, SPEED


@app.command()
@PARAMETERS
@click.option("--payload", type=Payload(), help="Point mass on the platform [kg], at P or at x,y,z [m].")
@click.option("--travel", type=Span(LENGTH, "'200 mm' or '-150 mm,200 mm'"), help="Stroke of the sliders.")
@click.option("--tilt", type=Span(ANGLE, "'30 deg' or '-30 deg,45 deg'"), help="Range of the rotation θ.")
@click.option("--speed", type=Amount(SPEED), help="Largest slider speed.")
@click.option("--force", type=Amount(FORCE), help="Largest force of each actuator.")
@click.option(
    "--serial", type=Number(min=0, max=1), default=0.0, help="Least S/L of each leg; 0 is its singularity."
)
@click.option(
    "--actuation",
    type=Amount(ANGLE, zero=True),
    default=0.0,
    help="Least angle from det J = 0, such as '15 deg'.",
)
@click.option(
    "--velocity",
    type=Triple("m/s", "m/s", "rad/s"),
    help="Velocities along y, z and θ, each alone, that the speed limit must allow.",
)
@click.option(
    "--acceleration",
    type=Triple("m/s^2", "m/s^2", "rad/s^2"),
    help="Accelerations along y, z and θ, each alone from rest, that the force limit must allow.",
)
@click.option("--index", "indices", multiple=True, help="Index to tell of and to draw, such as lti; several.")
@click.option("--length", type=Amount(LENGTH), help="Characteristic length of indices; r without it.")
@click.option("--motion", "motion_file", type=InputFile(), help="Motion file whose path to draw and check.")
@click.option("--paper-motion", "paper", is_flag=True, help="Draw and check the path of the paper's motion.")
@click.option(
    "--view",
    type=click.Choice(("map", "slices", "loci")),
    default="map",
    show_default=True,
    help="What --figure draws: indices over (y, θ), one over (y, z), or singularities all around.",
)
@FIGURE
@click.option(
    "--out", type=OutputFile("map"), help="netCDF file (.nc) for the map of the indices, or of all."
)
@JSON
def workspace(
    parameters: Path | None,
    payload: Body | None,
    serial: float,
    actuation: float,
    velocity: tuple[float, float, float] | None,
    acceleration: tuple[float, float, float] | None,
    indices: tuple[str, ...],
    length: float | None,
    motion_file: Path | None,
    paper: bool,
    view: str,
    figure: Path | None,
    out: Path | None,
    as_json: bool,
    **limits: Any,
) -> int:
    """Say where the machine can work within stroke, tilt and margins: volume, areas, largest boxes.

    Limits are the machine's own where none are given. Nothing is counted on a grid: sizes come from closed
    forms. Exit code 1 when the motion leaves the workspace.
    """
    protect((parameters, motion_file), (figure, out))
    names = check_names(indices)
    robot = machine_of(parameters, payload)
    if paper and motion_file is not None:
        raise click.UsageError("--motion and --paper-motion exclude each other")
    motion = paper_motion(401) if paper else None
    motion = motion if motion_file is None else Motion.from_csv(source(motion_file))
    given = {name: value for name, value in limits.items() if value is not None}
    margins = WorkspaceMargins(serial, actuation, velocity, acceleration)
    space = robot.workspace(replace(robot.parameters.limits, **given), margins)
    options = {} if length is None else {"length": length}
    means = {name: _over(space, name, options) for name in names}
    outside = "" if motion is None else _leaves(space, motion)
    console = Console(stderr=as_json)
    if as_json:
        found = plain_workspace(space) | {"indices": means}
        found |= {} if motion is None else {"motion_inside": not outside}
        sys.stdout.write(json.dumps(found) + "\n")
    else:
        show(console, workspace_table(space), box_table(space), *_table(means), notes=True)
        if motion is not None:
            print_plain(console, outside or f"the motion stays inside ({len(motion)} samples)")
    for path in _written(space, names, motion, view, figure, out, options):
        print_plain(console, f"wrote {path}")
    return 1 if outside else 0


def _over(space: Workspace, name: str, options: dict[str, Any]) -> dict[str, float | None]:
    """Return mean, least and largest value of an index over a workspace; null for what does not exist."""
    points = space.points
    poses = np.stack([points.y, 0 * points.y, points.theta], axis=-1)
    values = space.indices(poses, **options).column(name)
    known = values[np.isfinite(values)]
    ends = (float(known.min()), float(known.max())) if len(known) else (float("nan"), float("nan"))
    numbers = {"mean": space.mean(name, **options), "least": ends[0], "largest": ends[1]}
    if COLUMNS[name].name == "lti":
        numbers["share from 0.7"] = space.share(name, 0.7, **options)
    return {key: None if np.isnan(value) else value for key, value in numbers.items()}


def _table(means: dict[str, dict[str, float | None]]) -> list[Table]:
    if not means:
        return []
    rows = {
        name: (*(float("nan") if one[key] is None else one[key] for key in ("mean", "least", "largest")),
               COLUMNS[name].unit_of(name))
        for name, one in means.items()
    }  # fmt: skip
    shares = [one["share from 0.7"] for one in means.values() if "share from 0.7" in one]
    note = "The mean is weighed by volume; least and largest are those of the points of the quadrature."
    note += (
        f" LTI is at least 0.7 in {shares[0]:.1%} of the volume." if shares and shares[0] is not None else ""
    )
    header = ("index", "mean", "about the least", "about the largest", "unit")
    return [table_of("Indices over the workspace", header, rows, note)]  # type: ignore[arg-type]


def _leaves(space: Workspace, motion: Motion) -> str:
    """Return where a motion leaves a workspace first, and why; empty if nowhere."""
    margin = space.margin(motion.pose)
    bad = np.flatnonzero(~margin.inside)
    if not len(bad):
        return ""
    first = int(bad[0])
    reason = str(margin.reason[first])
    by = float(margin.columns[reason][first])
    return (
        f"the motion leaves the workspace at t = {motion.time[first]:g} s: {reason} by {-by:.4g} "
        f"({len(bad)} of {len(motion)} samples)"
    )


def _written(
    space: Workspace,
    names: tuple[str, ...],
    motion: Motion | None,
    view: str,
    figure: Path | None,
    out: Path | None,
    options: dict[str, Any],
) -> list[Path]:
    """Write the figure and the map, both or none."""
    written = []
    with together():
        if out is not None:
            written.append(write_dataset(space.map(*names, **options), out))
        if figure is not None:
            from p3dof.report import plots

            if view == "map":
                drawn = plots.map_figure(space, *names, motion=motion, box=not names, **options)
            elif view == "slices":
                drawn = plots.slices_figure(space, *names[:1], motion=motion, **options)
            else:
                drawn = plots.loci_figure(space, motion)
            written.append(plots.save(drawn, figure))
    return written
