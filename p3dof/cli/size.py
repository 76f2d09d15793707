"""`p3dof size`: which drives fit a task."""

from __future__ import annotations

from pathlib import Path

import click

from p3dof.cli.app import app
from p3dof.cli.files import InputFile, OutputFile, console_beside, protect, source, write_results
from p3dof.cli.kinds import POSITIVE, Number, Whole
from p3dof.cli.machine import PARAMETERS, machine_of
from p3dof.cli.options import FIGURE, LOAD_FRICTION, METHOD, STIFFNESS, load_friction_in, stiffness_in
from p3dof.cli.output import print_plain, progress_bar, show
from p3dof.design.assessment import frictionless
from p3dof.design.drives import (
    GENERIC,
    axes_table,
    cycle_of,
    not_checked,
    ranking_table,
    ratings_table,
    read_catalogue,
    verdict,
    write_ranking,
)
from p3dof.design.drives.sizing import BRAKE_SAFETY
from p3dof.design.fastest import limits_of
from p3dof.design.forces_of_tasks import forces_of_task
from p3dof.design.sizing import size_drives
from p3dof.design.task_limits import sizing_table, within_limits
from p3dof.design.tasks import read_task


@app.command()
@click.argument("task_file", metavar="TASK", type=InputFile())
@PARAMETERS
@click.option(
    "--drives",
    "catalogue_file",
    type=InputFile(),
    help="Catalogue of motors, gears, screws and belts (YAML); generic sizes without it.",
)
@click.option(
    "--duration",
    type=POSITIVE,
    help="Time of the whole task, dwells included [s]; not needed where all stops have one in the file.",
)
@click.option(
    "--rest", type=Number(min=0), default=0.0, show_default=True, help="Time at rest after each task [s]."
)
@click.option(
    "--brake-safety",
    type=POSITIVE,
    default=BRAKE_SAFETY,
    show_default=True,
    help="How much more a holding brake must hold than what it bears.",
)
@click.option(
    "--samples", type=Whole(2, 1_000_000), default=4001, show_default=True, help="Least number of samples."
)
@click.option("--top", type=Whole(1), default=10, show_default=True, help="How many drives to list.")
@METHOD
@LOAD_FRICTION
@STIFFNESS
@click.option(
    "--out",
    type=OutputFile("table", stream=True),
    help="CSV file, - for the standard output, for all drives.",
)
@FIGURE
def size(
    task_file: Path,
    parameters: Path | None,
    catalogue_file: Path | None,
    duration: float | None,
    rest: float,
    brake_safety: float,
    samples: int,
    top: int,
    method: str,
    load_friction: Path | None,
    stiffness: Path | None,
    out: Path | None,
    figure: Path | None,
) -> int:
    """Say which drives fit a task, the weakest that does first, and what the first of them is used for.

    Every motor of the catalogue is tried with every gear and every screw or belt, the same on all three axes.
    Exit code 1 when none fits, the machine cannot do the task, or a limit of the machine or the task is
    exceeded.
    """
    from p3dof.report import plots

    protect((task_file, parameters, catalogue_file, load_friction, stiffness), (out, figure))
    task = read_task(source(task_file))
    catalogue = GENERIC if catalogue_file is None else read_catalogue(source(catalogue_file))
    robot = machine_of(parameters)
    plan = task.plan(duration, samples)
    friction = load_friction_in(load_friction)
    if friction is None and stiffness is not None:
        raise click.UsageError("--stiffness decides the loads of --load-friction, which is not given")
    given = stiffness_in(stiffness)
    found = forces_of_task(robot, plan, method, load_friction=friction, stiffness=given)
    with progress_bar("drives", len(catalogue)) as progress:
        ranked = size_drives(robot, found, catalogue, rest=rest, brake_safety=brake_safety, progress=progress)
    console = console_beside(out)
    best = ranked[0]
    nearest = "" if best.fits else "comes nearest, but "
    told = verdict(best, lambda time: found.piece_at(time).name)
    print_plain(console, f"{best.drives[0].name} {nearest}{told}")
    print_plain(console, f"not checked: {'; '.join((*not_checked(best), *frictionless(robot, found)))}")
    show(console, ranking_table(ranked, top), notes=True)
    show(console, axes_table(best), ratings_table(best, lambda time: found.piece_at(time).name), notes=True)
    machine, own = robot.parameters.limits, limits_of(robot, task) if task.limits else None
    show(console, sizing_table(found, machine, own), notes=True)
    within = within_limits(found, machine, own)
    if not within:
        print_plain(console, "the task exceeds limits of the machine or its own, with any drive")
    if catalogue_file is None:
        print_plain(console, "generic sizes, for a first look only: give the makers' numbers with --drives")
    written = write_results(
        lambda to: write_ranking(ranked, to),
        out,
        lambda: plots.drives_figure(best, cycle_of(found, rest)),
        figure,
    )
    for path in written:
        print_plain(console, f"wrote {path}")
    return 0 if best.fits and within else 1
