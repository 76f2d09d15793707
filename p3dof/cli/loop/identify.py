"""`p3dof loop calibrate`: any robot from what was measured of it."""

from __future__ import annotations

from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import click
import numpy as np

from p3dof._base.checks import FloatArray, is_number, shown
from p3dof._base.errors import InputError, ParameterError
from p3dof._base.files import write_table
from p3dof._base.quantities import ANGLE, LENGTH
from p3dof.cli.files import InputFile, OutputFile, console_beside, protect, write_results
from p3dof.cli.kinds import FIGURE
from p3dof.cli.loop import loop
from p3dof.cli.loop.robot import numbers_of, with_robot
from p3dof.cli.measuring import MEASURING, parted, poses_in, require_plan, rms, tell_noise
from p3dof.cli.output import in_options, print_plain, print_warnings, print_written, show
from p3dof.loops import ClosedLoopModel, Measurements, plan_measurements
from p3dof.loops import calibrate as calibrate_robot
from p3dof.loops.identification.calibration import COMPONENTS, candidate_readings, plan_table
from p3dof.loops.identification.displacements import DEVICE, OFFSET
from p3dof.loops.tables import units_of_actuated

_WORDS = {"tolerances": "--sigma", "combined": "--combine", "frame:": "--frame:"}
_COLUMNS = {name: name[0] != "r" for name in COMPONENTS}
"""What may be measured, and what of it is a length."""
_CANDIDATES = 1000  # random poses that a plan is chosen from


@loop.command()
@with_robot
@click.option(
    "--measured",
    "data",
    type=InputFile(),
    help="Measured poses (CSV: names of the actuated joints, as their encoders read; some of x, y, z, rx, "
    "ry, rz, distance, as measured; with units if not SI: 'x [mm]').",
)
@click.option("--frame", required=True, help="Frame that is measured.")
@click.option(
    "--base",
    default=DEVICE,
    help="Frame that it is seen from: one of the robot, or a name for what measures, at the world's origin.",
)
@click.option(
    "--point", metavar="X,Y,Z", help="Point that distances are measured from, in axes of --base [m]."
)
@MEASURING
@click.option(
    "--combine",
    "combined",
    multiple=True,
    metavar="NAME=PART,...",
    help="Parameter that changes several at once: 'rods=rod_a.length,rod_b.length', with factors 0.5*a.x.",
)
@click.option(
    "--out",
    type=OutputFile("calibrated"),
    help="File to write: the calibrated robot (.urdf with its sidecar, .xml, .sdf); of --plan poses (.csv).",
)
@FIGURE
def calibrate(
    robot: ClosedLoopModel,
    inputs: list[Path],
    data: Path | None,
    frame: str,
    base: str,
    point: str | None,
    accuracy: float,
    angle_accuracy: float,
    sigmas: tuple[tuple[str, Any], ...],
    hold_out: int | None,
    leave_out: bool,
    plan: int | None,
    combined: tuple[str, ...],
    out: Path | None,
    figure: Path | None,
) -> int:
    """Calibrate lengths, placements and encoder offsets of a robot from measured poses.

    Parameters of --sigma are displacements of joints and frames: JOINT.x, .y, .z, .roll, .pitch, .yaw, along
    the axes of the body that carries them, .length (away from the joint before), JOINT.offset of an encoder,
    FRAME1/FRAME2.length of a closure; with * for any name, and =inf where nothing is known.
    """
    protect([*inputs, data], [out, figure])
    parts = _combined(combined)
    widths = {name: _width(robot, name, value, parts) for name, value in sigmas}
    away = np.zeros(3) if point is None else numbers_of("--point", point)
    readings = {
        name: unit == "m" for name, (unit, _) in zip(robot.actuated, units_of_actuated(robot), strict=True)
    }

    def measured(read: FloatArray, seen: tuple[str, ...], values: FloatArray) -> Measurements:
        noise = [angle_accuracy if name[0] == "r" else accuracy for name in seen]
        return Measurements(read, values, seen, frame, noise, base, away)

    if plan is not None:
        require_plan(out, figure, hold_out, leave_out)
        with in_options(_WORDS):
            given = _candidates(robot, data, readings, point is not None)
            chosen = plan_measurements(robot, measured(*given), plan, widths, parts)
        header = [f"{name} [{'m' if length else 'rad'}]" for name, length in readings.items()]
        written = write_results(lambda to: write_table(to, header, tuple(chosen.readings.T)), out)
        show(console := console_beside(out), plan_table(chosen), notes=True)
        print_written(console, written)
        return 0
    if data is None:
        raise click.UsageError("expected --measured, a file of measured poses, or --plan")
    if out is not None and out.suffix.lower() == ".csv":
        raise click.UsageError("--out: a CSV file holds the poses of --plan; expected .urdf, .xml or .sdf")
    every = measured(*poses_in(data, readings, _COLUMNS, True))
    own, held = parted(len(every), hold_out)
    with in_options(_WORDS):
        found = calibrate_robot(robot, every.only(own), widths, parts, leave_out)
        tested = found.tested(every.only(held)) if held.any() else None
    beside: list[Path] = []

    def save(path: Path) -> Path:
        beside.extend(found.robot.write(path)[1:])
        return path

    files = write_results(save, out, figure, lambda plots: plots.calibration_figure(found, tested))
    console = console_beside(out)
    show(console, found.table(), notes=True)
    before, after = (rms(part[0], every.sigma) for part in (found.before, found.after))
    print_plain(
        console, f"{own.sum()} poses used: {before:.3g} before, {after:.3g} after, in standard deviations."
    )
    if tested is not None:
        before, after = (rms(part, every.sigma) for part in tested)
        print_plain(console, f"{held.sum()} poses held out: {before:.3g} before, {after:.3g} after.")
    tell_noise(console, found.noise)
    used = np.flatnonzero(own)
    print_warnings(
        console, [f"pose {used[k] + 1}, {name}: does not fit the others" for _, k, name in found.outliers]
    )
    print_written(console, [*files, *beside])
    return 0


def _candidates(
    robot: ClosedLoopModel, data: Path | None, readings: dict[str, bool], bar: bool
) -> tuple[FloatArray, tuple[str, ...], FloatArray]:
    """Return poses to choose from, and what is measured: what the file has columns of, else the position."""
    seen: tuple[str, ...] = ()
    if data is None:
        read = candidate_readings(robot, _CANDIDATES)
    else:
        read, seen, _ = poses_in(data, readings, _COLUMNS, False)
    seen = seen or (("distance",) if bar else ("x", "y", "z"))
    return read, seen, np.zeros((len(read), len(seen)))


def _combined(texts: tuple[str, ...]) -> dict[str, dict[str, float]]:
    """Return the parts of combined parameters, with their factors."""
    found: dict[str, dict[str, float]] = {}
    for text in texts:
        name, equals, parts = text.partition("=")
        if not equals or not name.strip() or not parts.strip() or name.strip() in found:
            raise InputError(f"--combine: expected NAME=PART,PART each name once, got {shown(text)}")
        found[name.strip()] = dict(_part(part.strip()) for part in parts.split(","))
    return found


def _part(text: str) -> tuple[str, float]:
    factor, star, name = text.partition("*")
    if star and is_number(factor):
        return name.strip(), float(factor)
    return text, 1.0


def _width(robot: ClosedLoopModel, name: str, value: Any, combined: dict[str, dict[str, float]]) -> float:
    """Return a standard deviation, in the unit that the parameter has."""
    if str(value).strip().lower() == "inf":
        return float("inf")
    element = next(iter(combined.get(name, {name: 1.0})))
    joint, _, kind = element.rpartition(".")
    angle = kind in ("roll", "pitch", "yaw")
    if kind == OFFSET:
        units = dict(zip(robot.actuated, units_of_actuated(robot), strict=True))
        angle = any(unit == "rad" for each, (unit, _) in units.items() if fnmatchcase(each, joint))
    try:
        return float((ANGLE if angle else LENGTH).read(str(value), f"--sigma {name}"))
    except ParameterError as error:
        raise InputError(str(error)) from error
