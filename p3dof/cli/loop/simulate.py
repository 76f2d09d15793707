"""`p3dof loop simulate`: any robot in time, under a controller, constant forces or none."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import click
import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import MissingExtraError
from p3dof._base.tables import Table, number
from p3dof.cli.app import FAILED
from p3dof.cli.files import OutputFile, console_beside, protect, write_results
from p3dof.cli.kinds import POSITIVE, Whole
from p3dof.cli.loop.control import EXTERNAL, METHOD, NONE, Control, externals, with_control
from p3dof.cli.loop.group import AT, assembled, forces_of, loop, with_robot
from p3dof.cli.output import in_options, print_plain, print_warnings, progress_bar, say, show
from p3dof.loops import ClosedLoopModel
from p3dof.loops.compiling_model import ROBOT_METHODS
from p3dof.loops.tables import joint_values
from p3dof.runs import (
    ROBOT_KINDS,
    Integration,
    JointReference,
    RobotController,
    RobotRun,
    simulate_robot,
)
from p3dof.runs.work import TIME_LIMIT

_LIMITS = {"stop": ROBOT_KINDS, "ignore": tuple(kind for kind in ROBOT_KINDS if kind != "joint limit")}

_OPTIONS = {
    "q: the run would start": "--set: the run would start",
    "(see stop_at)": "(see --limits)",
    "a longer max_step, ": "",
    "the method 'compiled'": "--method compiled",
    "allow it by time_limit": "allow it by --time-limit",
}
"""What arguments of Python are here."""

_MOST = 8
"""Most exceeded limits that are listed."""


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
@with_control
@EXTERNAL
@click.option(
    "--limits",
    type=click.Choice(tuple(_LIMITS)),
    default="stop",
    show_default=True,
    help="What limits of joints in the robot's file do: end the run, or nothing.",
)
@click.option("--duration", type=POSITIVE, help="How long [s]; as the motion, or 1, without it.")
@click.option("--samples", type=Whole(2, 1_000_000), default=1001, show_default=True, help="Samples to keep.")
@click.option(
    "--time-limit",
    type=POSITIVE,
    default=TIME_LIMIT,
    show_default=True,
    help="Longest time that the run may take [s], as estimated before it starts.",
)
@METHOD
@click.option(
    "--out",
    type=OutputFile("table", stream=True),
    help="CSV file, - for the standard output, for joints, velocities, forces and energy.",
)
@click.option("--multipliers", is_flag=True, help="Write the forces in the closures to the CSV file too.")
@click.option(
    "--plot",
    "--figure",
    "figure",
    type=OutputFile("figure"),
    help="Figure to draw (.png, .svg or .pdf; needs the extra 'plot').",
)
def simulate(
    robot: ClosedLoopModel,
    inputs: list[Path],
    values: tuple[str, ...],
    forces: tuple[str, ...],
    control: Control,
    external: tuple[str, ...],
    limits: str,
    duration: float | None,
    samples: int,
    time_limit: float,
    method: str,
    out: Path | None,
    multipliers: bool,
    figure: Path | None,
) -> int:
    """Let a robot move, under a controller or constant forces of its actuators.

    Exit code 1 when the loops do not close at the start, or the run ends before its time.
    """
    protect([*inputs, *([] if control.motion_file is None else [control.motion_file])], [out, figure])
    if multipliers and out is None:
        raise click.UsageError("--multipliers needs --out")
    if forces and control.controller != NONE:
        raise click.UsageError("--force and --controller exclude each other")
    loads, wanted = externals(external), control.reference(robot)
    q, v = _start(robot, values, wanted)
    compile_ = ROBOT_METHODS[method]
    compiled = None if compile_ is None else compile_(robot, q, loads)
    if control.controller == NONE:
        acting: RobotController = forces_of(robot, forces)
    else:
        acting = control.of(robot, q, wanted or JointReference.standing(_actuated(robot, q)), compiled)
    if duration is None:
        duration = wanted.duration if wanted is not None and wanted.duration else 1.0
    settings = Integration(rtol=1e-9, atol=1e-11, time_limit=time_limit)
    with in_options(_OPTIONS), progress_bar("run", samples) as progress:
        run = simulate_robot(
            robot,
            duration,
            q,
            v,
            acting,
            control=control.loop,
            external=loads,
            stop_at=_LIMITS[limits],
            samples=samples,
            integration=settings,
            progress=progress,
            method="general" if compiled is None else compiled,
        )
    written = write_results(partial(run.to_csv, multipliers=multipliers), out)
    written += _draw(run, figure)
    console = console_beside(out)
    show(console, _table(run))
    told = [] if run.stop is None else [f"ended by {run.stop}"]
    beyond = [f"limit exceeded: {one}" for one in run.exceedances()]
    more = [f"{len(beyond) - _MOST} more limits are exceeded"] if len(beyond) > _MOST else []
    print_warnings(console, [*told, *beyond[:_MOST], *more])
    for path in written:
        print_plain(console, f"wrote {path}")
    return 0 if run.finished else FAILED


def _start(
    robot: ClosedLoopModel, values: tuple[str, ...], wanted: JointReference | None
) -> tuple[FloatArray, FloatArray]:
    """Return configuration and velocity of the start: at rest where it was set, or as the motion starts."""
    if wanted is None or values:
        return assembled(robot, values).q, np.zeros(robot.model.nv)
    state = robot.complete(*wanted.at(0.0), robot.assemble().q)
    return state.q, state.v


def _actuated(robot: ClosedLoopModel, q: FloatArray) -> FloatArray:
    held = joint_values(robot, q)
    return np.array([float(held[name][0]) for name in robot.actuated])


def _draw(run: RobotRun, path: Path | None) -> list[Path]:
    if path is None:
        return []
    from p3dof.report import plots

    try:
        return [plots.save(plots.robot_run_figure(run), path)]
    except MissingExtraError as error:
        say(f"no figure: {error}")
        return []


def _table(run: RobotRun) -> Table:
    power = run.power.sum(axis=1)
    work = float(np.sum((power[1:] + power[:-1]) / 2 * np.diff(run.time)))
    rows = [
        ("time", f"{number(float(run.time[-1]))} s"),
        ("energy gained", f"{number(float(run.energy[-1] - run.energy[0]))} J"),
        ("work of the actuators", f"{number(work)} J"),
        ("largest force of an actuator", f"{number(float(np.abs(run.forces).max(initial=0.0)))} N or N m"),
        ("largest speed of a joint", f"{number(float(np.abs(run.v).max(initial=0.0)))} m/s or rad/s"),
        ("largest gap of a loop", f"{run.gap.max(initial=0.0):.1e} m or rad"),
    ]
    if run.error is not None:
        rows.insert(1, ("largest error of an actuated joint", f"{np.abs(run.error).max():.3g} m or rad"))
    return Table("Run", ("", "value"), tuple(rows), layout="words")
