"""`p3dof plan`: the motion of a task, and what it takes."""

from __future__ import annotations

from pathlib import Path

import click

from p3dof.cli.app import app
from p3dof.cli.files import InputFile, OutputFile, console_beside, protect, source, write_results
from p3dof.cli.options import FIGURE, METHOD, PARAMETERS, POSITIVE, Whole, machine_of
from p3dof.cli.output import print_plain, progress_bar, show
from p3dof.errors import InputError
from p3dof.files import together, write_table
from p3dof.manipulator.tasks import forces_of_task, pieces_table, sizing_table
from p3dof.motion import WrenchHistory
from p3dof.tasks import read_task


@app.command()
@click.argument("task_file", metavar="TASK", type=InputFile())
@PARAMETERS
@click.option(
    "--duration",
    type=POSITIVE,
    help="Time of the whole task, dwells included [s]; not needed where all stops have one in the file.",
)
@click.option(
    "--samples",
    type=Whole(2, 1_000_000),
    default=1001,
    show_default=True,
    help="Least number of samples of the motion, evenly spaced.",
)
@METHOD
@click.option(
    "--out",
    type=OutputFile("table", stream=True),
    help="Motion file to write (CSV), - for the standard output: what --motion of other commands takes.",
)
@click.option(
    "--wrench-out",
    type=OutputFile("table"),
    help="File for the external load over the task (CSV): what --wrench of other commands takes.",
)
@click.option(
    "--forces-out", type=OutputFile("table"), help="File for forces, power and what is carried (CSV)."
)
@FIGURE
def plan(
    task_file: Path,
    parameters: Path | None,
    duration: float | None,
    samples: int,
    method: str,
    out: Path | None,
    wrench_out: Path | None,
    forces_out: Path | None,
    figure: Path | None,
) -> int:
    """Plan the motion of a task file: from stop to stop, with blends, dwells, payloads and loads.

    The tables say what each piece of the way takes, how much of the machine's limits is used, when and where.
    Exit code 1 when a limit of the machine is exceeded, or it cannot make the motion.
    """
    protect((task_file, parameters), (out, wrench_out, forces_out, figure))
    task = read_task(source(task_file))
    robot = machine_of(parameters)
    planned = task.plan(duration, samples)
    load = planned.wrench
    if wrench_out is not None and load is None:
        raise InputError("--wrench-out: there is no external load in this task")
    with progress_bar("forces", len(planned.pieces)) as progress:
        found = forces_of_task(robot, planned, method, progress)
    from p3dof import plots

    with together():
        written = [] if forces_out is None else [found.to_csv(forces_out)]
        if wrench_out is not None and load is not None:
            written.append(_write_load(load, wrench_out))
        written = [
            *write_results(planned.motion.to_csv, out, lambda: plots.task_figure(found), figure),
            *written,
        ]
    console = console_beside(out)
    limits = robot.parameters.limits
    show(console, pieces_table(found), sizing_table(found, limits), notes=True)
    if not task.closed:
        print_plain(console, "the task does not end where it began: it cannot be repeated as it is")
    for path in written:
        print_plain(console, f"wrote {path}")
    shares = [one.share for one in found.utilisations(limits)]
    return 0 if all(share <= 1 for share in shares) else 1


def _write_load(load: WrenchHistory, path: Path) -> Path:
    header = ["t", "fx", "fy", "fz", "mx", "my", "mz"]
    return write_table(path, header, (load.time, *load.wrench.T))
