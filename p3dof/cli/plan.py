"""`p3dof plan` and `p3dof fastest`: the motion of a task, and what it takes."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from p3dof._base.errors import InputError
from p3dof._base.files import together, write_table
from p3dof.cli.app import app
from p3dof.cli.files import InputFile, OutputFile, console_beside, protect, source, write_results
from p3dof.cli.kinds import POSITIVE, Number, Whole
from p3dof.cli.machine import PARAMETERS, machine_of
from p3dof.cli.options import FIGURE, METHOD
from p3dof.cli.output import print_plain, progress_bar, show
from p3dof.design.best_path import BestPath, best_path, best_path_table
from p3dof.design.fastest import MOST_NODES, NODES, SMOOTH_NODES, fastest_plan, limits_of
from p3dof.design.forces_of_tasks import forces_of_task, limits_table, pieces_table
from p3dof.design.task_limits import sizing_table, within_limits
from p3dof.design.tasks import FastestPlan, Plan, Task, read_task, write_task
from p3dof.machine.motion import WrenchHistory
from p3dof.manipulator import Manipulator

_OPTIONS = (
    click.argument("task_file", metavar="TASK", type=InputFile()),
    PARAMETERS,
    click.option(
        "--samples",
        type=Whole(2, 1_000_000),
        default=1001,
        show_default=True,
        help="Least number of samples of the ways; waits have few besides.",
    ),
    METHOD,
    click.option(
        "--out",
        type=OutputFile("table", stream=True),
        help="Motion file to write (CSV), - for the standard output: what --motion of other commands takes.",
    ),
    click.option(
        "--wrench-out",
        type=OutputFile("table"),
        help="File for the external load over the task (CSV): what --wrench of other commands takes.",
    ),
    click.option(
        "--forces-out", type=OutputFile("table"), help="File for forces, power and what is carried (CSV)."
    ),
    FIGURE,
)


def _with_task(command: Callable[..., Plan | BestPath]) -> Callable[..., int]:
    """Give a command that makes a plan of a task and a machine its files, and what is told of the plan."""

    @functools.wraps(command)
    def wrapped(
        task_file: Path,
        parameters: Path | None,
        method: str,
        out: Path | None,
        wrench_out: Path | None,
        forces_out: Path | None,
        figure: Path | None,
        **others: Any,
    ) -> int:
        task_out = others.pop("task_out", None)
        if task_out is not None and not others["better_path"]:
            raise InputError("--task-out: expected with --best-path only")
        protect((task_file, parameters), (out, wrench_out, forces_out, figure, task_out))
        task, robot = read_task(source(task_file)), machine_of(parameters)
        if wrench_out is not None and not any(waypoint.wrench.any() for waypoint in task.waypoints):
            raise InputError("--wrench-out: there is no external load in this task")
        planned = command(task, robot, **others)
        return _told(task, robot, planned, method, out, wrench_out, forces_out, figure, task_out)

    found: Callable[..., int] = wrapped
    for option in reversed(_OPTIONS):
        found = option(found)
    return found


@app.command()
@_with_task
@click.option(
    "--duration",
    type=POSITIVE,
    help="Time of the whole task, dwells included [s]; not needed where all stops have one in the file.",
)
def plan(task: Task, _: Manipulator, samples: int, duration: float | None) -> Plan:
    """Plan the motion of a task file: from stop to stop, with blends, dwells, payloads and loads.

    The tables say what each piece of the way takes, how much of the limits is used, when and where: the
    tighter of machine and task. Exit code 1 when one is exceeded, or the machine cannot make the motion.
    """
    return task.plan(duration, samples)


@app.command()
@_with_task
@click.option("--force", type=POSITIVE, help="Largest force of each actuator [N].")
@click.option("--speed", type=POSITIVE, help="Largest slider speed [m/s].")
@click.option("--power", type=POSITIVE, help="Largest power that each actuator gives [W].")
@click.option(
    "--jerk", type=POSITIVE, help="Largest jerk of the sliders [m/s³]; without it their acceleration jumps."
)
@click.option("--nut-force", type=POSITIVE, help="Largest force that each nut passes on to its slider [N].")
@click.option(
    "--reflected-mass",
    type=Number(min=0),
    help="What motor and screw add to each slider's mass [kg], for the force limit.",
)
@click.option(
    "--nodes",
    type=Whole(10, MOST_NODES),
    help=f"Steps along each way between two stops: more come nearer to the least time.  [default: {NODES}; "
    f"{SMOOTH_NODES} with a jerk]",
)
@click.option(
    "--best-path",
    "better_path",
    is_flag=True,
    help="Change blends and waypoints too, as far as blend_range and tolerance in the file allow.",
)
@click.option(
    "--task-out", type=OutputFile("parameters"), help="Task file to write with the best path (YAML)."
)
def fastest(
    task: Task,
    robot: Manipulator,
    samples: int,
    nodes: int | None,
    better_path: bool,
    **limits: float | None,
) -> Plan | BestPath:
    """Find the fastest motion of a task file within limits of force, speed, power, jerk; with friction.

    Limits are those of the task file, and force and speed of the parameter file where it gives none; an
    option counts instead. They hold between the nodes too: the last table says how far each is used, where it
    holds and when. Files are those of 'plan'. Exit code 1 when another limit of the machine is exceeded, such
    as its stroke.
    """
    chosen = limits_of(robot, task, **limits)
    if better_path:
        with progress_bar("paths", 1) as progress:
            return best_path(robot, task, chosen, nodes=nodes, samples=samples, progress=progress)
    with progress_bar("ways", len(task.paths)) as progress:
        return fastest_plan(robot, task, chosen, nodes=nodes, samples=samples, progress=progress)


def _told(
    task: Task,
    robot: Manipulator,
    made: Plan | BestPath,
    method: str,
    out: Path | None,
    wrench_out: Path | None,
    forces_out: Path | None,
    figure: Path | None,
    task_out: Path | None,
) -> int:
    """Compute the forces of a plan, write its files and print its tables; return the exit code."""
    planned = made.plan if isinstance(made, BestPath) else made
    load = planned.wrench
    with progress_bar("forces", len(planned.pieces)) as progress:
        found = forces_of_task(robot, planned, method, progress)  # type: ignore[arg-type,unused-ignore]
    from p3dof.report import plots

    with together():
        others = [] if forces_out is None else [found.to_csv(forces_out)]
        if wrench_out is not None and load is not None:
            others.append(_write_load(load, wrench_out))
        drawn = functools.partial(plots.task_figure, found)
        written = [*write_results(planned.motion.to_csv, out, drawn, figure), *others]
        if task_out is not None and isinstance(made, BestPath):
            write_task(made.decided, task_out)
            written.append(task_out)
    console = console_beside(out)
    machine, own = robot.parameters.limits, None
    if task.limits and not isinstance(planned, FastestPlan):
        own = limits_of(robot, task)
    tables = [pieces_table(found), sizing_table(found, machine, own)]
    if isinstance(planned, FastestPlan):
        tables.append(limits_table(planned))
    if isinstance(made, BestPath):
        tables.append(best_path_table(made))
    show(console, *tables, notes=True)
    if not task.closed:
        print_plain(console, "the task does not end where it began: it cannot be repeated as it is")
    for path in written:
        print_plain(console, f"wrote {path}")
    if out is not None and any(piece.payload is not None for piece in planned.pieces):
        print_plain(
            console,
            f"{out} is the motion alone: commands that take it as --motion know nothing of what is carried; "
            "those that take the task do (report, size, balance, reactions --task, bearings --task)",
        )
    return 0 if within_limits(found, machine, own) else 1


def _write_load(load: WrenchHistory, path: Path) -> Path:
    header = ["t", "fx", "fy", "fz", "mx", "my", "mz"]
    return write_table(path, header, (load.time, *load.wrench.T))
