"""What is measured of the machine: `p3dof excite`, `identify`, `calibrate`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np

from p3dof._base.files import write_table
from p3dof._base.tables import formatted
from p3dof.analysis.identification import MachineForces
from p3dof.cli.app import app
from p3dof.cli.files import InputFile, OutputFile, console_beside, protect, source, write_results
from p3dof.cli.kinds import FIGURE
from p3dof.cli.loop.identify import Asked, asked_options, command_of, identified
from p3dof.cli.machine import PARAMETERS, PAYLOAD, machine_of
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
from p3dof.cli.output import in_options, print_plain, print_warnings, print_written, show
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import Body, Parameters, write_parameters

_MOTIONS = 4000  # of the machine's closed forms are quick


@app.command()
@PARAMETERS
@PAYLOAD
@wanted(_MOTIONS)
@TASK
@ACCURACY
@OUTPUTS
def excite(
    parameters: Path | None,
    payload: Body | None,
    wanted: Wanted,
    task: Path | None,
    target_error: float | None,
    out: Path | None,
    figure: Path | None,
) -> int:
    """Optimise an excitation motion for identification, within all limits of the machine.

    Its periods show the parameters of bodies and friction as well as possible; printed is how well, before
    the experiment. Exit code 1 when no motion is within the limits.
    """
    protect((parameters, task), (out, figure))
    forces = MachineForces(machine_of(parameters, payload))
    states = None
    if task is not None:
        motion = Motion.from_csv(source(task))
        states = forces.from_coordinates(motion.pose, motion.velocity, motion.acceleration)
    return run(forces, states, wanted, target_error, (out, figure), derivatives=True)


@app.command()
@click.argument("data", type=InputFile(), metavar="DATA")
@PARAMETERS
@asked_options
@click.option(
    "--out",
    type=OutputFile("parameters"),
    help="Parameter file to write with the identified machine (.yaml).",
)
def identify(data: Path, parameters: Path | None, asked: Asked, out: Path | None) -> int:
    """Identify inertia and friction of the machine from DATA, a log of its sliders.

    DATA is CSV or Parquet: t,slide_a,slide_b,slide_c and force:slide_a (or current:slide_a) and so on; units
    in square brackets. Velocities, the delay of the forces, and noise are found from it.

    Exit code 1 when the held-out log of --validate is predicted no better than by the design; no parameters
    are written then.
    """
    protect([data, parameters, asked.held_out], [out, asked.report_file])
    held_out = [] if asked.held_out is None else ["--validate", asked.held_out]
    own = [] if parameters is None else ["--parameters", parameters]
    command = command_of("p3dof identify", data, *own, *held_out)

    def save(found: Parameters) -> list[Path]:
        assert out is not None  # noqa: S101 - else it is not called
        write_parameters(found, out)
        return [out]

    forces: Any = MachineForces(machine_of(parameters, None))
    return identified(forces, data, asked, None if out is None else save, command)


_WORDS = ACCURACIES | {
    "sigma:": "--sigma:",
    "tolerances": "--sigma",
    "tolerance of": "--sigma",
    "sigma of": "--sigma",
}
_WORDS |= {
    "count:": "--plan:",
    "lengths by names of parameters, such as {'L': '50 um'}": "one NAME=VALUE or more, such as 'L=50 um'",
}
"""What arguments of Python are here."""
READ = {"A": True, "B": True, "C": True}
POSE = {"y": True, "z": True, "theta": False}
"""Columns of a file of measured poses, and which are lengths."""


@app.command()
@click.argument("data", type=InputFile(), required=False, metavar="[DATA]")
@PARAMETERS
@MEASURING
@click.option(
    "--out",
    type=OutputFile("joints"),
    help="File to write: the machine with one R, r and L for all legs (.yaml); or lengths of each leg and "
    "encoder offsets, or the poses of --plan (.csv).",
)
@FIGURE
def calibrate(
    data: Path | None,
    parameters: Path | None,
    accuracy: float,
    angle_accuracy: float,
    sigmas: tuple[tuple[str, Any], ...],
    hold_out: int | None,
    leave_out: bool,
    plan: int | None,
    out: Path | None,
    figure: Path | None,
) -> int:
    """Calibrate lengths of the legs and encoder offsets from measured poses.

    DATA is a CSV file with columns A, B, C (positions of the sliders, as their encoders read) and y, z, theta
    (as measured; empty where nothing was), with units if not SI: 'theta [deg]'. Parameters of --sigma are R,
    r, L and encoder of each leg, or of one (L.a), and device.y, device.z, device.theta, the axes of what
    measures; others keep the values of the design.
    """
    from p3dof.analysis.tolerances import calibrate_machine, machine_calibration_tables, plan_machine
    from p3dof.loops.identification.calibration import plan_table

    protect((data, parameters), (out, figure))
    robot, widths = machine_of(parameters), dict(sigmas)
    noise = (accuracy, accuracy, angle_accuracy)
    if plan is not None:
        require_plan(out, figure, hold_out, leave_out)
        with in_options(_WORDS):
            given = None if data is None else poses_in(data, READ, POSE, False)[0]
            chosen = plan_machine(robot, plan, noise, widths, given)
        header = [f"{name} [m]" for name in READ]
        written = write_results(lambda to: write_table(to, header, tuple(chosen.readings.T)), out)
        show(console := console_beside(out), plan_table(chosen), notes=True)
        print_written(console, written)
        return 0
    if data is None:
        raise click.UsageError("expected DATA, a file of measured poses, or --plan")
    read, seen, values = poses_in(data, READ, POSE, True)
    pose = np.full((len(read), 3), np.nan)
    pose[:, [list(POSE).index(name) for name in seen]] = values
    own, held = parted(len(read), hold_out)
    with in_options(_WORDS):
        found = calibrate_machine(robot, read[own], pose[own], noise, widths, leave_out)
    tested = found.errors(read[held], pose[held]) if held.any() else None

    def save(path: Path) -> Path:
        if path.suffix.lower() == ".csv":
            return found.to_csv(path)
        write_parameters(found.machine, path)
        return path

    written = write_results(
        save,
        out,
        figure,
        lambda plots: plots.calibration_figure(found, None if tested is None else tested[:2]),
    )
    console = console_beside(out)
    show(console, *machine_calibration_tables(found), notes=True)
    if tested is not None:
        told = ", ".join(f"{rms(part, noise):.3g}" for part in tested)
        print_plain(
            console, f"{held.sum()} poses held out: {told} (design, all legs, one R, r, L), in deviations."
        )
    offsets = ", ".join(formatted(1e3 * x, "+.4f") for x in found.encoders)
    print_plain(console, f"Encoders of the machine with one R, r and L read {offsets} mm too much (A, B, C).")
    tell_noise(console, found.noise)
    used = np.flatnonzero(own)
    far = [f"pose {used[k] + 1}, {name}: does not fit the others" for k, name in found.outliers]
    if tested is not None:
        far += held_out_told(tested[1], noise, list(POSE), held, found.noise)
    print_warnings(console, far)
    print_written(console, written)
    return 0
