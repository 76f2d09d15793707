"""`p3dof simulate` and `p3dof runs`: the machine in time, under controllers; many machines."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console

from p3dof._base.errors import InputError
from p3dof._base.files import together
from p3dof._base.quantities import FORCE, LENGTH, SPEED
from p3dof.cli.app import app
from p3dof.cli.case import Case, with_load
from p3dof.cli.control import DAMPING, FREQUENCY, RATE, Feedback, actuation, time_limit
from p3dof.cli.files import InputFile, OutputFile, out_folder, protect, save_figure_if_possible, source
from p3dof.cli.kinds import FROM_ZERO, SECONDS, Amount, Number, Whole, as_one
from p3dof.cli.machine import any_size
from p3dof.cli.output import in_options, print_plain, print_warnings, print_written, progress_bar, show
from p3dof.closed_form.compiled.runs import available
from p3dof.machine.motion import Motion
from p3dof.machine.motion.core import RAMP
from p3dof.machine.parameters import Limits, Parameters
from p3dof.methods import METHODS
from p3dof.runs import InitialState, Integration, Simulation, errors_table
from p3dof.runs.controllers import CONTROLLERS
from p3dof.runs.machine import COMPILED
from p3dof.runs.many import failures, figures_table, read_runs, stops_table
from p3dof.runs.settings import EDGE, Work, estimate, require_affordable

_FORCE = Amount(FORCE)
SAMPLES = 1001
"""Least number of samples of a run: errors are sought among them."""
_SEEN = 50_000  # samples of the controller that are also samples of a run: forces change at each


@dataclass(frozen=True)
class _Feedback(Feedback):
    integral_time: float | None  # of its feedback [s]

    def controller(self, name: str, model: Parameters, motion: Motion) -> Any:
        """Return a controller that has a model of the machine, and follows a motion."""
        integral = np.inf if self.integral_time is None else self.integral_time
        return CONTROLLERS[name](model, motion, self.frequency, self.damping, integral_time=integral)


_with_feedback = as_one(
    "feedback",
    _Feedback,
    RATE,
    FREQUENCY,
    DAMPING,
    click.option(
        "--integral-time",
        type=SECONDS,
        help="Integral time of the controller [s]; by default no integral action.",
    ),
    click.option(
        "--saturation", type=_FORCE, help="Saturation of the actuator forces [N]; by default unlimited."
    ),
    actuation((LENGTH,), (SPEED,)),
    click.option(
        "--ramp",
        type=FROM_ZERO,
        help="Time over which the motion is entered from rest [s], 0 to start at its own velocity; by "
        f"default {RAMP}, and 0 for a motion that starts at rest.",
    ),
)


@app.command()
@with_load
@click.option(
    "--controller",
    "controllers",
    type=click.Choice(("all", *CONTROLLERS)),
    multiple=True,
    default=("all",),
    help="PD control of the sliders, PD with inverse dynamics as feedforward, or computed torque.",
)
@_with_feedback
@click.option(
    "--mass-error",
    type=Number(min=-1, min_open=True),
    default=0.0,
    help="Relative error of the masses in the model of the controller.",
)
@click.option(
    "--method",
    type=click.Choice(METHODS),
    default=COMPILED,
    help="Forward dynamics: in y, z, θ (compiled C, or the paper's formulas), or of all joints by Pinocchio.",
)
@out_folder("the simulations and the figure")
@click.option(
    "--format",
    "kind",
    type=click.Choice(("csv", "npz")),
    default="csv",
    help="Format of the simulations; npz also holds all joints.",
)
@click.option(
    "--every-tick",
    is_flag=True,
    help="Write a row at every sample of the controller while simulating (CSV): for long simulations.",
)
@time_limit("the simulations")
@click.option("--plot/--no-plot", default=True, help="Draw the figure (needs the extra 'plot').")
def simulate(
    case: Case,
    controllers: tuple[str, ...],
    feedback: _Feedback,
    mass_error: float,
    ramp: float | None,
    method: str,
    out: Path,
    kind: str,
    every_tick: bool,
    time_limit: float,
    plot: bool,
) -> int:
    """Simulate the machine under control along a motion: prints tracking errors, writes results and a figure.

    If a simulation cannot be compiled to C, the reason and a remedy are printed.

    Exit code 1 when a simulation ends early: the reason is printed, and its samples so far are kept.
    """
    names = tuple(CONTROLLERS) if "all" in controllers else tuple(dict.fromkeys(controllers))
    files = {name: out / f"simulation_{name}.{kind}" for name in names}
    figures = [out / f"tracking.{ending}" for ending in ("png", "svg")]
    case.protect(*files.values(), *figures)
    case.robot.inverse_kinematics(case.motion.pose)  # names a pose that is out of reach before anything moves
    motion, load = case.entered(ramp)
    control = feedback.loop()
    ticks = math.ceil(motion.duration * (control.rate or 0.0) - EDGE)
    samples = max(SAMPLES, len(motion), ticks + 1 if ticks < _SEEN else 0)
    if every_tick:
        if kind != "csv":
            raise InputError("--every-tick: writes CSV, leave out --format npz")
        samples = ticks + 1
    way = "C" if method == COMPILED and available(case.robot.kernels) else method
    one = estimate(way, motion.duration, samples, control.changes, control.quickest)
    all_runs = Work(len(names) * one.steps, len(names) * one.seconds)
    require_affordable(all_runs, 0 if every_tick else samples, time_limit, "--time-limit")
    model = _wrong(case.robot.parameters, mass_error)
    runs: dict[str, Simulation] = {}
    for name in names:
        with progress_bar(name, len(motion)) as progress:
            prepared = case.robot.prepare_run(
                motion.duration,
                controller=feedback.controller(name, model, motion),
                control=control,
                wrench=load,
                method=method,
                samples=samples,
                integration=Integration(time_limit=time_limit),
            )
            start = InitialState(motion.pose[0], motion.velocity[0])
            if every_tick:
                runs[name] = prepared.stream(files[name], start, progress=progress)
            else:
                runs[name] = prepared(start, progress=progress)
    with together():
        written = [files[name] if every_tick else run.save(files[name]) for name, run in runs.items()]
        if plot:
            written += save_figure_if_possible(lambda plots: plots.tracking_figure(runs), *figures)
    console = case.console()
    show(console, errors_table(runs))
    if samples <= ticks or any(len(run) < samples for run in runs.values() if run.finished):
        where = "the file has all" if every_tick else "--every-tick writes all"
        print_plain(console, f"largest among a part of the {ticks} samples of the controller; {where}")
    print_plain(console, f"method: {', '.join(dict.fromkeys(run.method for run in runs.values()))}")
    print_warnings(console, case.robot.remarks(case.motion, wrench=case.history))
    _print_ratio(console, runs)
    print_warnings(console, _exceedances(case.robot.parameters.limits, runs))
    print_warnings(console, [f"{name}: ended by {run.stop}" for name, run in runs.items() if run.stop])
    for note in dict.fromkeys(run.note for run in runs.values() if run.note):
        print_plain(console, note)
    print_written(console, written)
    return 0 if all(run.finished for run in runs.values()) else 1


def _wrong(parameters: Parameters, error: float) -> Parameters:
    return replace(parameters, bodies=parameters.bodies.scaled(1 + error)) if error else parameters


def _exceedances(limits: Limits, runs: dict[str, Simulation]) -> list[str]:
    """Say which limits the runs exceeded that do not end a run: of force and speed."""
    return [
        f"{name}: limit exceeded: {exceedance}"
        for name, run in runs.items()
        for exceedance in run.exceedances(limits)
        if exceedance.quantity in {"force", "speed"}
    ]


def _print_ratio(console: Console, runs: dict[str, Simulation]) -> None:
    """Print what the inverse model gains."""
    plain = runs.get("pd")
    for name, run in runs.items():
        if plain is None or run is plain or not (run.finished and plain.finished):
            continue
        if run.peak_error.min() > 0:
            gains = plain.peak_error / run.peak_error
            text = ", ".join(f"{gain:.3g} in {axis}" for gain, axis in zip(gains, "yzθ", strict=True))
            print_plain(console, f"{name}: errors of pd alone are larger by {text}")


@app.command()
@click.argument("table", type=InputFile(), metavar="RUNS")
@with_load
@click.option(
    "--controller",
    type=click.Choice(tuple(CONTROLLERS)),
    default="pd",
    help="PD control of the sliders, PD with inverse dynamics as feedforward, or computed torque; their "
    "model is the machine of --parameters.",
)
@_with_feedback
@click.option(
    "--duration", type=SECONDS, help="Duration of each simulation [s]; by default that of the motion."
)
@click.option("--step", type=SECONDS, default=1e-3, help="Largest step of the RK4 integrator [s].")
@click.option("--threads", type=Whole(1, 1024), help="Number of threads; by default one a processor.")
@time_limit("all simulations")
@click.option(
    "--out", type=OutputFile("run"), help="CSV or NPZ file to write: columns and results of every simulation."
)
def runs(
    case: Case,
    table: Path,
    controller: str,
    feedback: _Feedback,
    ramp: float | None,
    duration: float | None,
    step: float,
    threads: int | None,
    time_limit: float,
    out: Path | None,
) -> int:
    """Run a batch of simulations from a table: parameters, gains, initial states, payloads, noise.

    RUNS is a CSV or Parquet file with a row for each simulation, or - for CSV on the standard input. Its
    columns are parameters of the machine as named in the parameter file, with dots (L [mm], platform.mass,
    payload.mass); start.y, start.z, start.theta, start.vy, start.vz, start.vtheta; frequency, damping,
    integral_time; wrench.fy, wrench.fz, wrench.my; seed. Everything else is the same for all simulations. A
    simulation that is not possible gets a reason.

    Exit code 1 when a simulation ends early.
    """
    protect((table, case.parameters, case.motion_file, case.wrench_file), (out,))
    columns = read_runs(source(table), any_size())
    motion, load = case.entered(ramp)
    count = len(next(iter(columns.values())))
    with in_options({"time_limit of Integration": "--time-limit"}), progress_bar("runs", count) as progress:
        found = case.robot.simulate_many(
            motion.duration if duration is None else duration,
            columns,
            start=InitialState(motion.pose[0], motion.velocity[0]),
            controller=feedback.controller(controller, case.robot.parameters, motion),
            control=feedback.loop(),
            wrench=load,
            integration=Integration(scheme="rk4", step=step, time_limit=time_limit),
            progress=progress,
            **({} if threads is None else {"threads": threads}),
        )
    if not found.done.any():
        raise InputError("no run was done")
    written = [] if out is None else [found.save(out)]
    console = case.console()
    show(console, stops_table(found), figures_table(found))
    notes = [found.note] if found.note.startswith("one by one") else []
    notes += ["interrupted: the runs that were done are kept"] if found.interrupted else []
    print_warnings(console, [*notes, *failures(found, first=1)])
    print_written(console, written)
    return 0 if found.finished.all() else 1
