"""What is measured of any robot: `p3dof loop excite`, `identify`, `calibrate`."""

from __future__ import annotations

import functools
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Literal

import click
import numpy as np
from rich.console import Console

from p3dof._base.checks import FloatArray, is_number, shown
from p3dof._base.errors import InputError, ParameterError
from p3dof._base.files import called, read_text, together, write_table
from p3dof._base.quantities import ANGLE, LENGTH, TIME
from p3dof._base.time_series.joint_files import read_joints
from p3dof._base.time_series.smoothing import Smooth
from p3dof.cli.files import InputFile, OutputFile, console_beside, protect, source, write_results
from p3dof.cli.kinds import FIGURE, POSITIVE, SECONDS, SMOOTH, Amount, as_one
from p3dof.cli.loop import loop
from p3dof.cli.loop.robot import METHOD, numbers_of, with_robot
from p3dof.cli.measuring import (
    ACCURACIES,
    ACCURACY,
    MEASURING,
    OUTPUTS,
    TASK,
    Wanted,
    held_out_told,
    parted,
    poses_in,
    require_plan,
    rms,
    run,
    tell_noise,
    wanted,
)
from p3dof.cli.output import in_options, print_plain, print_warnings, print_written, progress_bar, show
from p3dof.loops import ClosedLoopModel, Measurements, plan_measurements
from p3dof.loops import calibrate as calibrate_robot
from p3dof.loops.identification.calibration import COMPONENTS, MeasuredRobot, candidate_readings, plan_table
from p3dof.loops.identification.estimates import METHODS, EstimationMethod
from p3dof.loops.identification.fitting import DEVICE, OFFSET, displacements
from p3dof.loops.identification.forces import MASS, SHIFT, IdentifiableForces, LoopForces, States
from p3dof.loops.identification.logs import MotorLog, read_log
from p3dof.loops.identification.validation import (
    Identification,
    Validation,
    combinations_table,
    identify,
    parameters_table,
    validate,
    validation_table,
)
from p3dof.loops.tables import units_of_actuated

_MOTIONS = 400


@loop.command()
@with_robot
@wanted(_MOTIONS)
@TASK
@ACCURACY
@METHOD
@OUTPUTS
def excite(
    robot: ClosedLoopModel,
    inputs: list[Path],
    wanted: Wanted,
    task: Path | None,
    target_error: float | None,
    method: Literal["general", "compiled"],
    out: Path | None,
    figure: Path | None,
) -> int:
    """Optimise an excitation motion of the actuated joints for identification, within all limits.

    Its periods show the parameters of bodies and friction as well as possible; printed is how well, before
    the experiment. Exit code 1 when no motion is within the limits.
    """
    protect([*inputs, task], [out, figure])
    forces = LoopForces(robot, method)
    return run(forces, _task(forces, task), wanted, target_error, (out, figure), derivatives=False)


def _task(forces: LoopForces, path: Path | None) -> States | None:
    """Return the motion of the actuated joints in a file."""
    if path is None:
        return None
    given = source(path)
    sliding = [unit == "m" for unit in forces.position_units]
    curve = read_joints(read_text(given), called(given), forces.actuators, sliding)
    return forces.from_actuators(*curve.at(curve.time))


_WORDS = {
    "constants: ": "--constants: ",
    "period: ": "--period: ",
    "smooth: ": "--smooth: ",
    "delay: ": "--force-delay: ",
}


@dataclass(frozen=True)
class Asked:
    """What is asked of an identification, as the options say it."""

    held_out: Path | None
    constants: str | None
    offsets: bool
    period: float | None
    smooth: Smooth
    force_delay: float | None
    estimator: EstimationMethod
    widths: Literal["given", "estimated"]
    mass_share: float
    centre_shift: float
    trust_columns: bool
    report_file: Path | None

    def per_ampere(self, names: tuple[str, ...]) -> FloatArray | None:
        """Return the force per ampere of each actuator, one for all or one each."""
        if self.constants is None:
            return None
        try:
            found = np.array([float(part) for part in self.constants.split(",")])
        except ValueError as error:
            raise InputError(
                f"--constants: expected numbers with commas, got {shown(self.constants)}"
            ) from error
        if len(found) not in (1, len(names)):
            raise InputError(f"--constants: expected one number, or {len(names)} for {', '.join(names)}")
        return np.broadcast_to(found, len(names))

    def log(self, path: Path, forces: IdentifiableForces) -> MotorLog:
        """Read a log of the robot's actuators."""
        kinds = list(zip(forces.position_units, forces.force_units, strict=True))
        given: Any = path if path.suffix.lower() == ".parquet" else source(path)
        return read_log(given, forces.actuators, kinds, self.per_ampere(forces.actuators))


asked_options = as_one(
    "asked",
    Asked,
    click.option(
        "--validate",
        "held_out",
        type=InputFile(),
        help="Log of another motion, to validate on: without it nothing is known of the quality.",
    ),
    click.option(
        "--constants",
        help="Force per ampere of the actuators [N/A or N m/A], one or with commas, for logs of currents.",
    ),
    click.option(
        "--offsets/--no-offsets", default=False, help="Estimate constant offsets of the force sensors."
    ),
    click.option("--period", type=SECONDS, help="Period of the motion [s]; found by default."),
    SMOOTH,
    click.option(
        "--force-delay",
        type=Amount(TIME, ends=(-1.0, 1.0)),
        help="Time by which forces are later than positions in the log [s]; found by default.",
    ),
    click.option(
        "--estimator",
        type=click.Choice(METHODS),
        default="map",
        help="Maximum a posteriori, weighted least squares, essential parameters, or robust to outliers.",
    ),
    click.option(
        "--widths",
        type=click.Choice(("given", "estimated")),
        default="given",
        help="Whether the width of the prior is given, or estimated with the parameters.",
    ),
    click.option(
        "--mass-error",
        "mass_share",
        type=POSITIVE,
        default=MASS,
        help="Relative error of the masses in the design, a standard deviation: the prior.",
    ),
    click.option(
        "--centre-error",
        "centre_shift",
        type=Amount(LENGTH),
        default=SHIFT,
        help="Error of the mass centres in the design [m], a standard deviation.",
    ),
    click.option(
        "--trust-columns",
        is_flag=True,
        help="Do not stop where columns seem exchanged, turned round or in another unit.",
    ),
    click.option(
        "--report",
        "report_file",
        type=OutputFile("report"),
        help="Report to write on the identification: residuals, all parameters (.html or .pdf; needs the "
        "extra 'report').",
    ),
)


def identified(
    forces: IdentifiableForces,
    data: Path,
    asked: Asked,
    save: Callable[[Any], list[Path]] | None,
    command: str,
) -> int:
    """Identify, validate, print and write; the exit code."""
    console = Console()
    prior = forces.deviations(mass=asked.mass_share, shift=asked.centre_shift)
    ways: dict[str, Any] = {
        "smooth": "auto" if asked.smooth is None else asked.smooth,
        "check": not asked.trust_columns,
    }
    with in_options(_WORDS):
        found = identify(
            forces, asked.log(data, forces), deviations=prior, method=asked.estimator, widths=asked.widths,
            offsets=asked.offsets, period="auto" if asked.period is None else asked.period,
            delay="auto" if asked.force_delay is None else asked.force_delay, **ways,
        )  # fmt: skip
        checked = (
            None if asked.held_out is None else validate(found, asked.log(asked.held_out, forces), **ways)
        )
    _print(console, found, checked)
    good = checked is None or checked.better
    written: list[Path] = []
    with together():
        if save is not None and good:
            written += save(found.robot)
        if asked.report_file is not None:
            from p3dof.report import write_identification

            written.append(write_identification(asked.report_file, found, checked, command=command))
    print_written(console, written)
    return 0 if good else 1


def _print(console: Console, found: Identification, checked: Validation | None) -> None:
    show(console, parameters_table(found), combinations_table(found), notes=True)
    data = found.data
    for one in (data, *(() if checked is None else (checked.data,))):
        print_plain(console, one.about)
    if data.delay_deviation:
        spread = f"standard deviation {1e3 * data.delay_deviation:.2g} ms"
        print_plain(console, f"Forces are {1e3 * data.delay:.3g} ms later than positions ({spread}).")
    if found.offsets.any():
        told = zip(found.forces.actuators, found.offsets, found.forces.force_units, strict=True)
        print_plain(console, f"Offsets: {', '.join(f'{name} {x:.3g} {unit}' for name, x, unit in told)}.")
    if checked is not None:
        show(console, validation_table(checked), notes=True)
    remarks = [*found.remarks, *(checked.remarks if checked is not None else ())]
    print_warnings(console, list(dict.fromkeys(remarks)))
    if checked is None:
        print_warnings(console, ["not validated: give --validate a log of another motion"])
        return
    style = "bold green" if checked.better else "bold red"
    print_plain(console, checked.verdict, style)


def command_of(name: str, *parts: object) -> str:
    """Return a command as it is typed."""
    return shlex.join([*name.split(), *(str(part) for part in parts if part is not None)])


def _with_data(command: Callable[..., Any]) -> Callable[..., Any]:
    """Let the sidecar be left out before the log."""

    @functools.wraps(command)
    def run(sidecar: Path | None, data: Path | None, **others: Any) -> Any:
        if data is None:
            sidecar, data = None, sidecar
        if data is None:
            raise click.UsageError("DATA is missing: a log of the robot's motors (CSV or Parquet)")
        return command(sidecar=sidecar, data=data, **others)

    return run


@loop.command("identify")
@_with_data
@with_robot
@click.argument("data", type=InputFile(), required=False, metavar="[DATA]")
@asked_options
@click.option(
    "--out",
    type=OutputFile("robot"),
    help="Robot file to write with the identified parameters (.urdf with its sidecar, .xml or .sdf).",
)
def identify_robot(
    robot: ClosedLoopModel, inputs: list[Path], data: Path, asked: Asked, out: Path | None
) -> int:
    """Identify inertia and friction of a robot from DATA, a log of its motors.

    DATA is CSV or Parquet: t, each actuated joint for its position, force: or current: before its name for
    the other; units in square brackets. Velocities, the delay of the forces, and noise are found from it.

    Exit code 1 when the held-out log of --validate is predicted no better than by the design; no robot is
    written then.
    """
    protect([*inputs, data, asked.held_out], [out, asked.report_file])
    command = command_of("p3dof loop identify", *inputs, data, *_held_out(asked))
    save = None if out is None else lambda found: found.write(out)
    return identified(LoopForces(robot), data, asked, save, command)


def _held_out(asked: Asked) -> list[object]:
    return [] if asked.held_out is None else ["--validate", asked.held_out]


_OPTIONS = ACCURACIES | {
    "tolerances": "--sigma",
    "combined": "--combine",
    "frame:": "--frame:",
    "count:": "--plan:",
}
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
    away = np.zeros(3) if point is None else numbers_of("--point", point, LENGTH)
    readings = {
        name: unit == "m" for name, (unit, _) in zip(robot.actuated, units_of_actuated(robot), strict=True)
    }

    def measured(read: FloatArray, seen: tuple[str, ...], values: FloatArray) -> Measurements:
        noise = [angle_accuracy if name[0] == "r" else accuracy for name in seen]
        return Measurements(read, values, seen, frame, noise, base, away)

    if plan is not None:
        require_plan(out, figure, hold_out, leave_out)
        with in_options(_OPTIONS):
            one, asked = np.zeros((1, len(readings))), displacements(robot, widths, parts, [base])
            MeasuredRobot(robot, measured(one, ("x",), one[:, :1]), asked)  # checks, before poses are found
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
    with in_options(_OPTIONS):
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
    far = [f"pose {used[k] + 1}, {name}: does not fit the others" for _, k, name in found.outliers]
    if tested is not None:
        far += held_out_told(tested[1], every.sigma, every.components, held, found.noise)
    print_warnings(console, far)
    print_written(console, [*files, *beside])
    return 0


def _candidates(
    robot: ClosedLoopModel, data: Path | None, readings: dict[str, bool], bar: bool
) -> tuple[FloatArray, tuple[str, ...], FloatArray]:
    """Return poses to choose from, and what is measured: what the file has columns of, else the position."""
    seen: tuple[str, ...] = ()
    if data is None:
        with progress_bar("poses", _CANDIDATES) as progress:
            read = candidate_readings(robot, _CANDIDATES, progress=progress)
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
        meant = [unit for each, (unit, _) in units.items() if fnmatchcase(each, joint)]
        if not meant:
            return 1.0  # of a name that is refused when all are known
        angle = "rad" in meant
    try:
        return float((ANGLE if angle else LENGTH).read(str(value), f"--sigma {name}"))
    except ParameterError as error:
        raise InputError(str(error)) from error
