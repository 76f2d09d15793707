"""`p3dof optimise` and `p3dof pareto`: better machines, from a problem in a file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console

from p3dof._base.errors import InputError
from p3dof._base.tables import Table
from p3dof.cli.app import app
from p3dof.cli.files import InputFile, OutputFile, OutputFolder, protect, save_figure
from p3dof.cli.kinds import FIGURE, Whole, named_option
from p3dof.cli.output import give, in_options, print_warnings, print_written, progress_bar, show
from p3dof.design.optimisation import DesignProblem, Optimum, front_tables, optimum_tables, read_problem
from p3dof.design.optimisation.evolution import GENERATIONS
from p3dof.design.optimisation.minimising import STARTS
from p3dof.design.optimisation.pareto import GENERATIONS as OF_FRONT
from p3dof.design.optimisation.pareto import POINTS, POPULATION

_WORDS = {
    "resume=True": "--store",
    "subject_to": "--subject-to",
    "method='epsilon'": "--algorithm epsilon",
    "bodies='solids'": "bodies: solids",
}
"""What arguments of Python are here."""

_PROBLEM = click.argument("problem", type=InputFile(), metavar="PROBLEM")
_SEED = click.option("--seed", type=Whole(0, 2**32 - 1), default=0, help="Seed of the random numbers.")
_STORE = click.option(
    "--store",
    type=OutputFolder(),
    help="Folder for intermediate results: after an interruption, the same command resumes from there.",
)
_ANY_SIZE = click.option(
    "--any-size", is_flag=True, help="Accept a machine larger than 20 m or smaller than 1 mm."
)


_BOUNDS = named_option(
    "--subject-to",
    "subject_to",
    "Constraint: worst value allowed of a measure, 'width=500 mm'; repeatable.",
    "width=500 mm",
)


@app.command()
@_PROBLEM
@click.option("--objective", help="Measure to optimise; by default the first objective of the file.")
@_BOUNDS
@click.option(
    "--algorithm",
    "method",
    type=click.Choice(("slsqp", "evolution")),
    default="slsqp",
    help="SLSQP with exact gradients from several starts, or differential evolution.",
)
@click.option("--starts", type=Whole(1, 10_000), default=STARTS, help="Number of starts of slsqp.")
@click.option(
    "--generations",
    type=Whole(1, 1_000_000),
    default=GENERATIONS,
    help="Largest number of generations of evolutionary algorithms.",
)
@_SEED
@click.option("--out", type=OutputFile("parameters"), help="Parameter file to write: the optimum (YAML).")
@click.option(
    "--report",
    type=OutputFile("report"),
    help="Report to write, on the optimum beside the start (.html or .pdf; needs the extra 'report').",
)
@_STORE
@FIGURE
@_ANY_SIZE
def optimise(
    problem: Path,
    objective: str | None,
    subject_to: tuple[tuple[str, Any], ...],
    method: Any,
    starts: int,
    generations: int,
    seed: int,
    out: Path | None,
    report: Path | None,
    store: Path | None,
    figure: Path | None,
    any_size: bool,
) -> int:
    """Optimise a design: minimise or maximise one objective under constraints.

    PROBLEM is a YAML file: design variables with their bounds, objectives, constraints. The tables list the
    changes against the machine of the file and the active constraints, and check the optimum on finer grids
    and by the other method of inverse dynamics. Exit code 1 when no design satisfies all constraints.
    """
    protect((problem,), (out, report, figure))
    work = generations if method == "evolution" else starts
    with in_options(_WORDS):
        asked = read_problem(problem, any_size)
        if report is not None:
            _require_one_motion(asked)
        counted = "combinations" if asked.discrete else "starts"
        with progress_bar("generations" if method == "evolution" else counted, work) as progress:
            found = asked.minimise(
                objective,
                dict(subject_to),
                method=method,
                starts=starts,
                generations=generations,
                seed=seed,
                store=store,
                resume=store is not None,
                progress=progress,
            )
        if out is not None:
            found.write_parameters(out)
    if report is not None:
        _write_report(found, report)
    give(_as_data(found))
    _tell(
        optimum_tables(found), found.notes, (out, report), figure, lambda plots: plots.optimum_figure(found)
    )
    return 0


@app.command()
@_PROBLEM
@_BOUNDS
@click.option(
    "--algorithm",
    "method",
    type=click.Choice(("epsilon", "nsga2", "nsga3")),
    default="epsilon",
    help="Epsilon-constraint method for two objectives, or genetic algorithms (extra 'studio').",
)
@click.option(
    "--points", type=Whole(2, 100_000), default=POINTS, help="Number of designs on the Pareto front."
)
@click.option(
    "--population", type=Whole(4, 1_000_000), default=POPULATION, help="Population of the genetic algorithms."
)
@click.option(
    "--generations",
    type=Whole(1, 1_000_000),
    default=OF_FRONT,
    help="Largest number of generations of evolutionary algorithms.",
)
@_SEED
@click.option("--out", type=OutputFile("table"), help="CSV file to write: all designs of the Pareto front.")
@_STORE
@FIGURE
@_ANY_SIZE
def pareto(
    problem: Path,
    subject_to: tuple[tuple[str, Any], ...],
    method: Any,
    points: int,
    population: int,
    generations: int,
    seed: int,
    out: Path | None,
    store: Path | None,
    figure: Path | None,
    any_size: bool,
) -> int:
    """Compute a Pareto front of designs: no other design is better in one objective and no worse in the rest.

    PROBLEM is a YAML file as for 'optimise', with two or more objectives. Results of genetic algorithms are
    refined with exact gradients. Exit code 1 when no design satisfies all constraints.
    """
    protect((problem,), (out, figure))
    with in_options(_WORDS):
        asked = read_problem(problem, any_size)
        bounded = _bounded(asked, dict(subject_to))
        total = points if method == "epsilon" else generations
        with progress_bar("points" if method == "epsilon" else "generations, points", total) as progress:
            found = bounded.pareto(
                method=method,
                points=points,
                population=population,
                generations=generations,
                seed=seed,
                store=store,
                resume=store is not None,
                progress=progress,
            )
        if out is not None:
            found.to_csv(out)
    columns = found.to_columns()
    give({"front": columns, "method": found.method, "seed": found.seed})
    _tell(front_tables(found), (), (out,), figure, lambda plots: plots.front_figure(found))
    return 0


def _bounded(problem: DesignProblem, bounds: dict[str, Any]) -> DesignProblem:
    from p3dof.design.optimisation.minimising import bounds_of

    return problem.asking(None, bounds_of(problem, bounds))


def _require_one_motion(problem: DesignProblem) -> None:
    """Raise unless the report can compare machines of a problem, before they are looked for."""
    moved = any(name.startswith("offset.") for name in problem.variables.names)
    if moved or problem.setting.wrench is not None:
        raise InputError("--report compares machines over one motion: expected no wrench and no offset")


def _write_report(found: Optimum, path: Path) -> None:
    """Write the comparison of the optimum with the machine that there was, over the motion."""
    from p3dof.design.design_comparison import compare_designs
    from p3dof.design.optimisation.population import Population
    from p3dof.report.assessment import write_designs

    problem = found.problem
    machines = {"start": problem.machine(np.nan_to_num(problem.start)), "optimum": found.machine}
    work = problem.setting.duties
    if work is None:
        write_designs(path, compare_designs(machines, problem.setting.motion))
        return
    drives = None
    if work.catalogue is not None:  # with the leads of both, and margins as they were kept
        designs = {"start": np.nan_to_num(problem.start), "optimum": found.design}
        drives = {}
        for name, design in designs.items():
            one = work.drive_of(Population(problem.setting, design[None]), 0)
            parts = {"motors": [one.motor], "transmissions": [one.transmission], "gears": [one.gear]}
            drives[name] = replace(work.catalogue, **parts, axes={})
    pages = []
    for k, duty in enumerate(work.tasks, 1):
        told = {duty.task.name or f"task {k}": duty.task}
        how = {"duration": duty.duration, "rest": duty.rest, "samples": duty.samples}
        pages += compare_designs(machines, told, bearings=work.bearings, drives=drives, **how)
    write_designs(path, pages)


def _as_data(found: Optimum) -> dict[str, Any]:
    check = found.check
    finer = float(check.finer.objectives[0, 0])
    return {
        "design": dict(zip(found.problem.variables.labels, found.design.tolist(), strict=True)),
        "found": {name: float(values[0]) for name, values in found.found.to_columns().items()},
        "binding": list(found.binding),
        "finer_grid": {"value": finer, "violation": check.violation},
        "pinocchio": {"largest_force": check.largest, "difference": check.difference},
        "method": found.method,
        "seed": found.seed,
        "evaluations": found.evaluations,
    }


def _tell(
    tables: Sequence[Table],
    notes: Sequence[str],
    outputs: tuple[Path | None, ...],
    figure: Path | None,
    draw: Callable[[Any], Any],
) -> None:
    """Print what was found, and draw it."""
    console = Console()
    show(console, *tables, notes=True)
    print_warnings(console, notes)
    written = [path for path in outputs if path is not None] + save_figure(draw, figure)
    print_written(console, written)
