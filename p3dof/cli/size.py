"""`p3dof size` and `p3dof balance`: which drives fit a task, and which counterbalance spares them most."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import cast, get_args

import click

from p3dof._base.errors import InputError
from p3dof.cli.app import app
from p3dof.cli.case import LOAD_FRICTION, METHOD, STIFFNESS, Case, load_friction_in, stiffness_in
from p3dof.cli.files import InputFile, OutputFile, console_beside, protect, source, write_results
from p3dof.cli.kinds import DURATION, FIGURE, Whole, table_out
from p3dof.cli.machine import PARAMETERS, PAYLOAD, machine_of
from p3dof.cli.output import in_options, print_plain, print_written, progress_bar, show
from p3dof.cli.work import BRAKE, FRICTIONLESS, LIFE, PER_AXIS, REST, STOPS
from p3dof.design.assessment import frictionless as without_friction
from p3dof.design.balance import OBJECTIVES, BalanceKind, Objective, balance_table, best_balance
from p3dof.design.drives import (
    GENERIC,
    StopLoads,
    axes_table,
    caveats,
    cycle_of,
    not_checked,
    nuts_table,
    ranking_table,
    ratings_table,
    read_catalogue,
    required_life,
    stops_table,
    supply_table,
    verdict,
    write_ranking,
)
from p3dof.design.fastest import limits_of, sizing_table, within_limits
from p3dof.design.forces_of_tasks import (
    USUAL_FRICTION,
    TaskForces,
    forces_of_task,
    with_guide_friction,
    with_rotors,
)
from p3dof.design.sizing import size_drives, stopped_safely
from p3dof.design.tasks import read_task
from p3dof.machine.parameters import Body, write_parameters
from p3dof.manipulator import Manipulator
from p3dof.methods import InverseDynamics, Method

_ALL = "all"
_TASKS = (".yaml", ".yml")


@app.command()
@click.argument("task_file", metavar="TASK", type=InputFile())
@PARAMETERS
@click.option(
    "--drives",
    "catalogue_file",
    type=InputFile(),
    help="Catalogue of motors, gears, screws and belts (YAML); by default generic sizes.",
)
@DURATION
@REST
@BRAKE
@PER_AXIS
@STOPS
@LIFE
@FRICTIONLESS
@click.option("--samples", type=Whole(2, 1_000_000), default=4001, help="Least number of samples.")
@click.option("--top", type=Whole(1), default=10, help="Number of drives to list.")
@METHOD
@LOAD_FRICTION
@STIFFNESS
@table_out("all drives, ranked")
@FIGURE
def size(
    task_file: Path,
    parameters: Path | None,
    catalogue_file: Path | None,
    duration: float | None,
    rest: float,
    brake_safety: float,
    per_axis: bool,
    stops: bool,
    life: str | None,
    frictionless: bool,
    samples: int,
    top: int,
    method: str,
    load_friction: Path | None,
    stiffness: Path | None,
    out: Path | None,
    figure: Path | None,
) -> int:
    """Size motors and screws for a task: lists the drives that fit, the smallest first.

    Every motor of the catalogue is combined with every gear and every screw or belt, the same on all three
    axes, or another on each (--per-axis, or axes of the catalogue). Exit code 1 when no drive fits, the
    machine cannot perform the task, or a limit of the machine or of the task is exceeded.
    """
    protect((task_file, parameters, catalogue_file, load_friction, stiffness), (out, figure))
    robot = machine_of(parameters)
    task = read_task(source(task_file)).on(robot.parameters.geometry)
    catalogue = GENERIC if catalogue_file is None else read_catalogue(source(catalogue_file))
    with in_options({"duration: ": "--duration: "}):
        plan = task.plan(duration, samples)
    friction = load_friction_in(load_friction)
    if friction is None and stiffness is not None:
        raise click.UsageError("--stiffness decides the loads of --load-friction, which is not given")
    given = stiffness_in(stiffness)
    needed = required_life(life, "--life")
    bare = forces_of_task(robot, plan, method, load_friction=friction, stiffness=given)
    found = bare if frictionless or not bare.possible else with_guide_friction(robot, bare, None, given)
    with progress_bar("drives", len(catalogue)) as progress:
        ranked = size_drives(
            robot,
            found,
            catalogue,
            rest=rest,
            brake_safety=brake_safety,
            per_axis=per_axis,
            life=needed,
            frictionless=True,
            progress=progress,
        )
    console = console_beside(out)
    stopped: tuple[StopLoads, ...] = ()
    if stops:
        ranked, stopped = stopped_safely(robot, found, ranked, catalogue.stop)
    best = ranked[0]
    nearest = "" if best.fits else "comes nearest, but "
    told = verdict(best, lambda time: found.piece_at(time).name)
    print_plain(console, f"{best.name} {nearest}{told}")
    machine, own = (
        robot.parameters.limits,
        limits_of(robot, task, reflected_mass=0.0) if task.limits else None,
    )
    driven = with_rotors(found, [drive.reflected_mass for drive in best.drives])
    within = within_limits(driven, machine, own)
    if not within:
        print_plain(console, "the task exceeds limits of the machine or its own, whatever a drive bears")
    for words in caveats(best):
        print_plain(console, words)
    replaced = ", which replaces the armature" if robot.parameters.actuators.armature else ""
    print_plain(console, f"forces of limits have the drives' own inertia{replaced}")
    if found is not bare:
        print_plain(console, f"assumed: {USUAL_FRICTION} (--frictionless leaves it out)")
    print_plain(console, f"not checked: {'; '.join((*not_checked(best), *without_friction(robot, found)))}")
    show(console, ranking_table(ranked, top), notes=True)
    show(console, axes_table(best), ratings_table(best, lambda time: found.piece_at(time).name), notes=True)
    nuts = nuts_table(best)
    show(console, *([nuts] if nuts.rows else []), notes=True)
    if best.supply is not None:
        show(console, supply_table(best.supply), notes=True)
    if stopped:
        show(console, stops_table(stopped), notes=True)
    show(console, sizing_table(driven, machine, own), notes=True)
    if catalogue_file is None:
        print_plain(console, "generic sizes, for a first look only: give the makers' numbers with --drives")
    written = write_results(
        lambda to: write_ranking(ranked, to),
        out,
        figure,
        lambda plots: plots.drives_figure(best, cycle_of(found, rest)),
    )
    print_written(console, written)
    return 0 if best.fits and within else 1


@app.command()
@click.argument("file", metavar="[MOTION_OR_TASK]", required=False, type=InputFile())
@PARAMETERS
@click.option(
    "--kind",
    type=click.Choice((*get_args(BalanceKind), _ALL)),
    default=_ALL,
    help="Kind of counterbalance: constant force, spring with a force at home, or counterweight.",
)
@click.option(
    "--objective",
    type=click.Choice(OBJECTIVES),
    default="rms",
    help="What is minimised: root mean square or peak of the actuator forces.",
)
@PAYLOAD
@click.option(
    "--wrench", "wrench_file", type=InputFile(), help="External load on the platform over a motion (CSV)."
)
@click.option(
    "--samples", type=Whole(2, 1_000_000), help="Number of samples of the paper's motion or of a task."
)
@DURATION
@METHOD
@click.option(
    "--out",
    type=OutputFile("parameters"),
    help="Parameter file to write: the machine with the counterbalance (YAML).",
)
@FIGURE
def balance(
    file: Path | None,
    parameters: Path | None,
    kind: str,
    objective: Objective,
    payload: Body | None,
    wrench_file: Path | None,
    samples: int | None,
    duration: float | None,
    method: Method,
    out: Path | None,
    figure: Path | None,
) -> int:
    """Optimise the counterbalance of each slider: the least root mean square or peak of the actuator forces.

    For a motion file (CSV), a task file (YAML) with its dwells and payloads, or the paper's motion. A
    counterbalance of the same kind that the machine has already is replaced. --out writes the machine with
    the counterbalance of --kind.
    """
    protect((file, parameters, wrench_file), (out, figure))
    if kind == _ALL and (out, figure) != (None, None):
        raise click.UsageError("--out and --figure need one kind of counterbalance: choose it with --kind")
    if file is not None and file.suffix.lower() in _TASKS:
        if wrench_file is not None:
            raise click.UsageError("--wrench belongs to a motion; a task has its loads in its file")
        robot = machine_of(parameters, payload)
        task = read_task(source(file)).on(robot.parameters.geometry)
        with in_options({"duration: ": "--duration: "}):
            plan = task.plan(duration, 1001 if samples is None else samples)
        found: InverseDynamics | TaskForces = forces_of_task(robot, plan, method)
    else:
        robot, found = _moved(Case(parameters, file, samples, payload, wrench_file), duration, method)
    kinds = get_args(BalanceKind) if kind == _ALL else (kind,)
    best = [best_balance(robot, found, cast(BalanceKind, one), objective) for one in kinds]
    console = console_beside(out)
    show(console, *(balance_table(one) for one in best), notes=True)

    def save(path: Path) -> Path:
        own = machine_of(parameters).parameters  # what the option adds is no part of the machine
        write_parameters(replace(own, actuators=best[0].actuators), path)
        return path

    drawn = write_results(save, out, figure, lambda plots: plots.balance_figure(best[0]))
    print_written(console, drawn)
    return 0


def _moved(case: Case, duration: float | None, method: Method) -> tuple[Manipulator, InverseDynamics]:
    """Return a machine and its forces over a motion."""
    if duration is not None:
        raise click.UsageError("--duration belongs to a task; a motion has its own times")
    result, _ = case.solve(method)
    if not result.possible:
        raise InputError("the machine cannot perform this motion")
    return case.robot, result
