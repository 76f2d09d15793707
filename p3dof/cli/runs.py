"""`p3dof runs`: many machines in time under a controller, from a table to a table."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np
from rich.console import Console

from p3dof._base.errors import InputError
from p3dof.cli.actuation import ActuationOptions, with_actuation
from p3dof.cli.app import app
from p3dof.cli.files import InputFile, OutputFile, protect, source
from p3dof.cli.kinds import POSITIVE, Number, Whole
from p3dof.cli.machine import any_size
from p3dof.cli.options import Case, with_load
from p3dof.cli.output import in_options, print_plain, print_warnings, progress_bar, show
from p3dof.cli.payloads import print_payloads
from p3dof.machine.motion.entering import natural_ramp
from p3dof.runs import TIME_LIMIT, InitialState, Integration
from p3dof.runs.controllers_by_name import CONTROLLERS
from p3dof.runs.many import failures, figures_table, read_runs, stops_table


@app.command()
@click.argument("table", type=InputFile(), metavar="RUNS")
@with_load
@click.option(
    "--controller",
    type=click.Choice(tuple(CONTROLLERS)),
    default="pd",
    show_default=True,
    help="What moves the machines along the motion; its model is the machine of --parameters.",
)
@click.option("--rate", type=POSITIVE, default=1000.0, show_default=True, help="Of the controller [Hz].")
@click.option("--frequency", type=POSITIVE, default=5.0, show_default=True, help="Of its feedback [Hz].")
@click.option(
    "--damping", type=POSITIVE, default=1.0, show_default=True, help="Damping ratio of its feedback."
)
@click.option("--integral-time", type=POSITIVE, help="Of its integral [s]; none without it.")
@click.option("--saturation", type=POSITIVE, help="Largest force of an actuator [N]; unlimited without it.")
@with_actuation
@click.option("--ramp", type=Number(min=0), help="As of 'simulate' [s].")
@click.option("--duration", type=POSITIVE, help="Of each run [s]; that of the motion without it.")
@click.option("--step", type=POSITIVE, default=1e-3, show_default=True, help="Longest step of RK4 [s].")
@click.option("--threads", type=Whole(1, 1024), help="Most threads; all processors without it.")
@click.option(
    "--time-limit",
    type=POSITIVE,
    default=TIME_LIMIT,
    show_default=True,
    help="Longest time that all runs may take [s], as estimated before they start.",
)
@click.option(
    "--out", type=OutputFile("run"), help="CSV or NPZ file for the columns and figures of every run."
)
def runs(
    case: Case,
    table: Path,
    controller: str,
    rate: float,
    frequency: float,
    damping: float,
    integral_time: float | None,
    saturation: float | None,
    actuation: ActuationOptions,
    ramp: float | None,
    duration: float | None,
    step: float,
    threads: int | None,
    time_limit: float,
    out: Path | None,
) -> int:
    """Follow a motion with many machines in time: tolerances, gains, starts, payloads, noise.

    RUNS is a CSV or Parquet file with a row for each run, or - for CSV on the standard input. Its columns are
    numbers of the machine by their names in the parameter file, with dots (L [mm], platform.mass,
    payload.mass); start.y, start.z, start.theta, start.vy, start.vz, start.vtheta; frequency, damping,
    integral_time; wrench.fy, wrench.fz, wrench.my; seed. All else is the same for all runs. Runs that cannot
    be have a reason.

    Exit code 1 when not every run goes on to its end.
    """
    protect((table, case.parameters, case.motion_file, case.wrench_file), (out,))
    columns = read_runs(source(table), any_size())
    chosen = natural_ramp(case.motion) if ramp is None else ramp
    motion = case.motion.from_rest(chosen) if chosen else case.motion
    gains = {"integral_time": np.inf if integral_time is None else integral_time}
    acting = CONTROLLERS[controller](case.robot.parameters, motion, frequency, damping, **gains)
    count = len(next(iter(columns.values())))
    with in_options({"time_limit of Integration": "--time-limit"}), progress_bar("runs", count) as progress:
        found = case.robot.simulate_many(
            motion.duration if duration is None else duration,
            columns,
            start=InitialState(motion.pose[0], motion.velocity[0]),
            controller=acting,
            control=actuation.loop(rate, saturation or False),
            wrench=case.load_along(chosen),
            integration=Integration(scheme="rk4", step=step, time_limit=time_limit),
            progress=progress,
            **({} if threads is None else {"threads": threads}),
        )
    if not found.done.any():
        raise InputError("no run was done")
    written = None if out is None else found.save(out)
    console = Console()
    print_payloads(console, case)
    show(console, stops_table(found), figures_table(found))
    notes = [found.note] if found.note.startswith("one by one") else []
    notes += ["interrupted: the runs that were done are kept"] if found.interrupted else []
    print_warnings(console, [*notes, *failures(found, first=1)])
    if written is not None:
        print_plain(console, f"wrote {written}")
    return 0 if found.finished.all() else 1
