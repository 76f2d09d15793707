"""`p3dof workspace` and `p3dof indices`: where the machine can work, and how well."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console

from p3dof._base.errors import ParameterError
from p3dof._base.files import together, write_table
from p3dof._base.quantities import ANGLE, FORCE, LENGTH, SPEED, Quantity
from p3dof._base.tables import Table, table_of
from p3dof.analysis.indices import COLUMNS, DEFINITIONS, check_names, columns_of, indices_table, write_dataset
from p3dof.analysis.indices.definitions import DRIVE
from p3dof.analysis.reactions.stiffness import RodSection
from p3dof.analysis.workspace import Workspace, WorkspaceMargins, box_table, plain_workspace, workspace_table
from p3dof.cli.app import app
from p3dof.cli.case import Case, with_load
from p3dof.cli.files import InputFile, OutputFile, protect, save_figure, source, write_results
from p3dof.cli.kinds import FIGURE, Amount, Number
from p3dof.cli.machine import DRIVE_STIFFNESS, PARAMETERS, PAYLOAD, Pose, machine_of
from p3dof.cli.output import give, in_options, print_plain, print_written, show
from p3dof.cli.work import CLEARANCE, SURROUNDINGS, surroundings_in
from p3dof.design.clearance import Clearance, clearance_over, clearance_table
from p3dof.machine.motion import Motion, paper_motion
from p3dof.machine.parameters import Body

_OTHERS = {"m/s": ("mm/s",), "rad/s": ("deg/s", "rpm"), "m/s^2": ("mm/s^2",), "rad/s^2": ("deg/s^2",)}
"""Further units of numbers of three."""


class Triple(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # likewise
    """Three numbers, of y, z and θ, with units or in SI units."""

    name = "Y,Z,THETA"

    def __init__(self, *units: str) -> None:
        self._kinds = [Quantity("a number", unit, _OTHERS.get(unit, ())) for unit in units]

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float, float]:
        """Return the numbers."""
        if isinstance(value, tuple):
            return value
        parts = str(value).split(",")
        try:
            y, z, theta = (
                float(kind.read(part.strip(), "number"))
                for kind, part in zip(self._kinds, parts, strict=True)
            )
        except (ParameterError, ValueError):
            units = ", ".join(kind.unit for kind in self._kinds)
            self.fail(f"expected three numbers, of y, z and theta [{units}], got {value!r}", param, ctx)
        return y, z, theta


class Span(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # likewise
    """A range around zero, ``MOST`` to both sides or ``FROM,TO``, with a unit or in SI units."""

    name = "MOST|FROM,TO"

    def __init__(self, quantity: Quantity, example: str) -> None:
        self._quantity, self._example = quantity, example

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float]:
        """Return the ends."""
        if isinstance(value, tuple):
            return value
        parts = [part.strip() for part in str(value).split(",")]
        rule = f"expected one number or two such as {self._example}, got {value!r}"
        try:
            ends = [float(self._quantity.read(part, "number")) for part in parts]
        except (ParameterError, ValueError):
            self.fail(rule, param, ctx)
        if len(ends) == 1 and ends[0] > 0:
            return -ends[0], ends[0]
        if len(ends) != 2:
            self.fail(rule, param, ctx)
        return ends[0], ends[1]


_LENGTH = click.option(
    "--length",
    type=Amount(LENGTH),
    help="Characteristic length ℓ of the indices; by default r of the machine.",
)


@app.command()
@PARAMETERS
@PAYLOAD
@click.option("--travel", type=Span(LENGTH, "'200 mm' or '-150 mm,200 mm'"), help="Stroke of the sliders.")
@click.option("--tilt", type=Span(ANGLE, "'30 deg' or '-30 deg,45 deg'"), help="Range of the rotation θ.")
@click.option("--max-speed", "speed", type=Amount(SPEED), help="Limit of the slider speeds [m/s].")
@click.option("--max-force", "force", type=Amount(FORCE), help="Limit of the force of each actuator [N].")
@click.option(
    "--serial",
    type=Number(min=0, max=1),
    default=0.0,
    help="Margin from serial singularities: least S/L of each leg.",
)
@click.option(
    "--actuation",
    type=Amount(ANGLE, zero=True),
    default=0.0,
    help="Margin from parallel singularities: least angle from det J = 0, such as '15 deg'.",
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
@click.option(
    "--index", "indices", multiple=True, metavar="NAME", help="Performance index, such as lti; repeatable."
)
@_LENGTH
@SURROUNDINGS
@CLEARANCE
@click.option(
    "--motion", "motion_file", type=InputFile(), help="Motion file (CSV) whose path is drawn and checked."
)
@click.option("--paper-motion", "paper", is_flag=True, help="Draw and check the path of the paper's motion.")
@click.option(
    "--view",
    type=click.Choice(("map", "slices", "loci")),
    default="map",
    help="What --figure draws: maps of indices over (y, θ), slices over (y, z), or singularity loci.",
)
@FIGURE
@click.option(
    "--out",
    type=OutputFile("map"),
    help="NetCDF file (.nc) to write: maps of the indices, by default of all.",
)
@in_options({"index: ": "--index: "})
def workspace(
    parameters: Path | None,
    payload: Body | None,
    serial: float,
    actuation: float,
    velocity: tuple[float, float, float] | None,
    acceleration: tuple[float, float, float] | None,
    indices: tuple[str, ...],
    length: float | None,
    surroundings: Path | None,
    clearance: float | None,
    motion_file: Path | None,
    paper: bool,
    view: str,
    figure: Path | None,
    out: Path | None,
    **limits: Any,
) -> int:
    """Compute the workspace within stroke, tilt and margins: volume, areas, largest boxes.

    By default, the limits are those of the machine. Sizes are computed in closed form, not on a grid. Exit
    code 1 when the motion leaves the workspace, or parts come nearer to each other than --clearance.
    """
    protect((parameters, motion_file, surroundings), (figure, out))
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
    near = None
    if surroundings is not None or clearance is not None:
        near = clearance_over(robot, space, surroundings_in(surroundings), required=clearance or 0.0)
    console = Console()
    give(plain_workspace(space) | {"indices": means})
    apart = [] if near is None else [clearance_table(near)]
    show(console, workspace_table(space), box_table(space), *_table(means), *apart, notes=True)
    if near is not None:
        give({"clearance": _plain_clearance(near)})
        print_plain(console, near.verdict)
    if motion is not None:
        give({"motion_inside": not outside})
        print_plain(console, outside or f"the motion stays inside ({len(motion)} samples)")
    print_written(console, _written(space, names, motion, view, figure, out, options))
    return 1 if outside or not (near is None or near.fits) else 0


def _plain_clearance(near: Clearance) -> dict[str, Any]:
    """Return the nearest parts over a workspace, for JSON."""
    one = near.least
    return {
        "parts": list(one.parts),
        "distance": one.distance,
        "pose": one.pose.tolist(),
        "required": near.required,
    }


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

    def draw(plots: Any) -> Any:
        if view == "map":
            return plots.map_figure(space, *names, motion=motion, box=not names, **options)
        if view == "slices":
            return plots.slices_figure(space, *names[:1], motion=motion, **options)
        return plots.loci_figure(space, motion)

    written = []
    with together():
        if out is not None:
            written.append(write_dataset(space.map(*names, **options), out))
        written += save_figure(draw, figure)
    return written


@app.command()
@with_load
@click.option(
    "--pose",
    "poses",
    type=Pose(),
    multiple=True,
    help="Pose of the platform, '0.1,0,-30 deg'; repeatable. By default, along the motion.",
)
@click.option(
    "--index",
    "names",
    multiple=True,
    metavar="NAME",
    help=f"Performance index; repeatable. By default all: {', '.join(DEFINITIONS)}.",
)
@_LENGTH
@DRIVE_STIFFNESS
@click.option(
    "--rod-diameter",
    type=Amount(LENGTH),
    help="Diameter of legs and rods; by default from their mass, in steel.",
)
@click.option("--rigid-rods", is_flag=True, help="Rigid legs and rods.")
@click.option(
    "--out",
    type=OutputFile("table"),
    help="CSV file to write, - for the standard output: a row for each pose.",
)
@in_options({"index: ": "--index: "})
def indices(
    case: Case,
    poses: tuple[list[float], ...],
    names: tuple[str, ...],
    length: float | None,
    drive_stiffness: dict[str, float] | None,
    rod_diameter: float | None,
    rigid_rods: bool,
    out: Path | None,
) -> int:
    """Compute performance indices at poses, or their least, mean and largest values along a motion.

    Condition, accuracy, motion/force transmission, speeds and accelerations within the limits, static
    actuator forces, inertia at the actuators, natural frequencies. Those with ℓ in their definition depend on
    the characteristic length. Drives of 10 N/µm, a guess, without --drive-stiffness.
    """
    case.protect(out)
    if rigid_rods and rod_diameter is not None:
        raise click.UsageError("--rigid-rods and --rod-diameter exclude each other")
    if poses and case.motion_file is not None:
        raise click.UsageError("--pose and --motion exclude each other")
    wanted = check_names(names) or tuple(COLUMNS)
    rods = None if rigid_rods else RodSection(diameter=rod_diameter)
    where = np.array(poses, dtype=float) if poses else case.motion.pose
    drives = DRIVE if drive_stiffness is None else list(drive_stiffness.values())
    found = case.robot.indices(where, length, drive_stiffness=drives, rods=rods)
    columns = columns_of(found, wanted)
    table = ({} if poses else {"t [s]": case.motion.time}) | found.to_columns(*wanted)
    write_results(lambda path: write_table(path, list(table), tuple(table.values())), out)
    give({"length": found.length, "pose": where, "indices": columns})
    show(case.console(out), indices_table(found, columns), notes=True)
    return 0
