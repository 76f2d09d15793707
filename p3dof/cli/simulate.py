"""`p3dof simulate`: the machine in time, following a motion under controllers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click
import numpy as np
from rich.console import Console

from p3dof._base.errors import MissingExtraError
from p3dof._base.files import together
from p3dof.cli.actuation import ActuationOptions, with_actuation
from p3dof.cli.app import app
from p3dof.cli.files import OutputFolder
from p3dof.cli.kinds import POSITIVE, Number
from p3dof.cli.options import Case, with_load
from p3dof.cli.output import print_plain, print_warnings, progress_bar, say, show
from p3dof.cli.payloads import print_payloads
from p3dof.closed_form.compiled.runs import available
from p3dof.machine.motion.entering import RAMP, natural_ramp
from p3dof.machine.parameters import Limits, Parameters
from p3dof.methods import DEFAULT_METHOD, METHODS
from p3dof.runs import (
    TIME_LIMIT,
    InitialState,
    Integration,
    Simulation,
    errors_table,
)
from p3dof.runs.controllers_by_name import CONTROLLERS
from p3dof.runs.ways import IN_C
from p3dof.runs.work import Work, estimate, require_affordable

SAMPLES = 1001
"""Least number of samples of a run: errors are sought among them."""


@app.command()
@with_load
@click.option(
    "--controller",
    "controllers",
    type=click.Choice(("all", *CONTROLLERS)),
    multiple=True,
    default=("all",),
    show_default=True,
    help="Feedback at the sliders, the same with the inverse dynamics fed forward, or computed torque.",
)
@click.option("--rate", type=POSITIVE, default=1000.0, show_default=True, help="Of the controller [Hz].")
@click.option("--frequency", type=POSITIVE, default=5.0, show_default=True, help="Of its feedback [Hz].")
@click.option(
    "--damping", type=POSITIVE, default=1.0, show_default=True, help="Damping ratio of its feedback."
)
@click.option("--integral-time", type=POSITIVE, help="Of its integral [s]; none without it.")
@click.option(
    "--mass-error",
    type=Number(min=-1, min_open=True),
    default=0.0,
    show_default=True,
    help="By how much the masses in the controller's model are wrong, as a share.",
)
@click.option("--saturation", type=POSITIVE, help="Largest force of an actuator [N]; unlimited without it.")
@with_actuation
@click.option(
    "--ramp",
    type=Number(min=0),
    help="How long the motion takes to come from rest to its own rate [s], 0 to start as it does; "
    f"{RAMP} without it, and 0 for a motion that starts at rest.",
)
@click.option(
    "--method",
    type=click.Choice(METHODS),
    default=DEFAULT_METHOD,
    show_default=True,
    help="Integrate in y, z, θ, or Pinocchio's constrained dynamics of all joints.",
)
@click.option(
    "--out",
    type=OutputFolder(),
    default="out",
    show_default=True,
    help="Folder for the runs and the figure.",
)
@click.option(
    "--format",
    "kind",
    type=click.Choice(("csv", "npz")),
    default="csv",
    show_default=True,
    help="Of the runs; npz also holds all joints.",
)
@click.option(
    "--time-limit",
    type=POSITIVE,
    default=TIME_LIMIT,
    show_default=True,
    help="Longest time that the runs may take [s], as estimated before they start.",
)
@click.option("--plot/--no-plot", default=True, help="Draw the figure (needs the extra 'plot').")
def simulate(
    case: Case,
    controllers: tuple[str, ...],
    rate: float,
    frequency: float,
    damping: float,
    integral_time: float | None,
    mass_error: float,
    saturation: float | None,
    actuation: ActuationOptions,
    ramp: float | None,
    method: str,
    out: Path,
    kind: str,
    time_limit: float,
    plot: bool,
) -> int:
    """Follow a motion under controllers: tracking errors on the screen, runs and a figure in a folder.

    A run that could not be made in C says why, and what to do instead.

    Exit code 1 when a run ends before its time: its reason is printed, and its samples so far are kept.
    """
    names = tuple(CONTROLLERS) if "all" in controllers else tuple(dict.fromkeys(controllers))
    files = {name: out / f"simulation_{name}.{kind}" for name in names}
    figures = [out / f"tracking.{ending}" for ending in ("png", "svg")]
    case.protect(*files.values(), *figures)
    case.robot.inverse_kinematics(case.motion.pose)  # names a pose that is out of reach before anything moves
    chosen = natural_ramp(case.motion) if ramp is None else ramp
    motion = case.motion.from_rest(chosen) if chosen else case.motion
    samples = max(SAMPLES, len(motion))
    control = actuation.loop(rate, saturation or False)
    way = "C" if method in IN_C and available(case.robot.kernels) else method
    one = estimate(way, motion.duration, samples, control.changes, control.quickest)
    all_runs = Work(len(names) * one.steps, len(names) * one.seconds)
    require_affordable(all_runs, samples, time_limit, "--time-limit")
    model = _wrong(case.robot.parameters, mass_error)
    runs: dict[str, Simulation] = {}
    for name in names:
        gains = {"integral_time": np.inf if integral_time is None else integral_time}
        controller = CONTROLLERS[name](model, motion, frequency, damping, **gains)
        with progress_bar(name, len(motion)) as progress:
            runs[name] = case.robot.simulate(
                motion.duration,
                start=InitialState(motion.pose[0], motion.velocity[0]),
                controller=controller,
                control=control,
                wrench=case.load_along(chosen),
                method=method,
                samples=samples,
                integration=Integration(time_limit=time_limit),
                progress=progress,
            )
    with together():
        written = [run.save(files[name]) for name, run in runs.items()]
        if plot:
            written += _draw(figures, runs)
    console = Console()
    print_payloads(console, case)
    show(console, errors_table(runs))
    print_warnings(console, case.robot.remarks(case.motion, wrench=case.history))
    _print_ratio(console, runs)
    _print_limits(console, case.robot.parameters.limits, runs)
    for name, run in runs.items():
        if run.stop is not None:
            console.print(f"{name}: ended by {run.stop}", style="yellow", highlight=False, soft_wrap=True)
    for note in dict.fromkeys(run.note for run in runs.values() if run.note):
        print_plain(console, note)
    for path in written:
        print_plain(console, f"wrote {path}")
    return 0 if all(run.finished for run in runs.values()) else 1


def _wrong(parameters: Parameters, error: float) -> Parameters:
    return replace(parameters, bodies=parameters.bodies.scaled(1 + error)) if error else parameters


def _print_limits(console: Console, limits: Limits, runs: dict[str, Simulation]) -> None:
    """Say which limits the runs exceeded that do not end a run: of force and speed."""
    for name, run in runs.items():
        for exceedance in run.exceedances(limits):
            if exceedance.quantity in {"force", "speed"}:
                text = f"{name}: limit exceeded: {exceedance}"
                console.print(text, style="yellow", highlight=False, soft_wrap=True)


def _print_ratio(console: Console, runs: dict[str, Simulation]) -> None:
    """Print what the inverse model gains."""
    plain = runs.get("pd")
    for name, run in runs.items():
        if plain is None or run is plain or not (run.finished and plain.finished):
            continue
        if run.peak_error.min() > 0:
            gains = plain.peak_error / run.peak_error
            text = ", ".join(f"{gain:.3g} in {axis}" for gain, axis in zip(gains, "yzθ", strict=True))
            console.print(f"{name}: errors of pd alone are larger by {text}", highlight=False, soft_wrap=True)


def _draw(paths: list[Path], runs: dict[str, Simulation]) -> list[Path]:
    from p3dof.report import plots

    try:
        figure = plots.tracking_figure(runs)
    except MissingExtraError as error:
        say(f"no figure: {error}")
        return []
    return [plots.save(figure, path) for path in paths]
