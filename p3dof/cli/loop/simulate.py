"""`p3dof loop simulate`: any robot in time under constant forces."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from p3dof.checks import FloatArray
from p3dof.cli.app import FAILED
from p3dof.cli.files import OutputFile, console_beside, protect, write_results
from p3dof.cli.loop.group import AT, assembled, forces_of, loop, with_robot
from p3dof.cli.options import POSITIVE, Whole
from p3dof.cli.output import print_plain, print_warnings, progress_bar, show
from p3dof.closed_loop import ClosedLoopModel
from p3dof.simulation import Integration, RobotRun, simulate_robot
from p3dof.simulation.work import TIME_LIMIT
from p3dof.tables import Table, number


@loop.command()
@with_robot
@AT
@click.option(
    "--force",
    "forces",
    multiple=True,
    metavar="JOINT=FORCE",
    help="Constant force of an actuated joint [N or N m, or with a unit]; none without it.",
)
@click.option("--duration", type=POSITIVE, default=1.0, show_default=True, help="How long [s].")
@click.option("--samples", type=Whole(2, 1_000_000), default=1001, show_default=True, help="Samples to keep.")
@click.option(
    "--time-limit",
    type=POSITIVE,
    default=TIME_LIMIT,
    show_default=True,
    help="Longest time that the run may take [s], as estimated before it starts.",
)
@click.option(
    "--out",
    type=OutputFile("table", stream=True),
    help="CSV file, - for the standard output, for joints, velocities, forces and energy.",
)
def simulate(
    robot: ClosedLoopModel,
    inputs: list[Path],
    values: tuple[str, ...],
    forces: tuple[str, ...],
    duration: float,
    samples: int,
    time_limit: float,
    out: Path | None,
) -> int:
    """Let a robot move from rest under constant forces of its actuators.

    Exit code 1 when the loops do not close at the start, or the run ends before its time.
    """
    protect(inputs, [out])
    acting = forces_of(robot, forces)
    start = assembled(robot, values).q
    settings = Integration(rtol=1e-9, atol=1e-11, time_limit=time_limit)
    with progress_bar("run", samples) as progress:
        run = simulate_robot(
            robot, duration, start, None, acting, samples=samples, integration=settings, progress=progress
        )
    written = write_results(run.to_csv, out)
    console = console_beside(out)
    show(console, _table(run, acting))
    print_warnings(console, [] if run.stop is None else [f"ended by {run.stop}"])
    for path in written:
        print_plain(console, f"wrote {path}")
    return 0 if run.finished else FAILED


def _table(run: RobotRun, forces: FloatArray) -> Table:
    power = run.v[:, run.loop.actuated_v] @ forces
    work = float(np.sum((power[1:] + power[:-1]) / 2 * np.diff(run.time)))
    rows = (
        ("time", f"{number(float(run.time[-1]))} s"),
        ("energy gained", f"{number(float(run.energy[-1] - run.energy[0]))} J"),
        ("work of the actuators", f"{number(work)} J"),
        ("largest speed of a joint", f"{number(float(np.abs(run.v).max(initial=0.0)))} m/s or rad/s"),
        ("largest gap of a loop", f"{run.gap.max(initial=0.0):.1e} m or rad"),
    )
    return Table("Run", ("", "value"), rows, layout="words")
