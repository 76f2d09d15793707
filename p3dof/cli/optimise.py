"""`p3dof optimise` and `p3dof pareto`: better machines, from a problem in a file."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from p3dof._base.errors import InputError
from p3dof.cli.app import app
from p3dof.cli.files import JSON, InputFile, OutputFile, OutputFolder, protect
from p3dof.cli.kinds import Whole
from p3dof.cli.options import FIGURE
from p3dof.cli.output import in_options, print_plain, print_warnings, progress_bar, show
from p3dof.design.optimisation import (
    DesignProblem,
    Front,
    Optimum,
    front_tables,
    optimum_tables,
    read_problem,
)
from p3dof.design.optimisation.evolution import GENERATIONS
from p3dof.design.optimisation.minimising import STARTS
from p3dof.design.optimisation.pareto import GENERATIONS as OF_FRONT
from p3dof.design.optimisation.pareto import POINTS, POPULATION

_WORDS = {
    "resume=True": "--resume",
    "subject_to": "--subject-to",
    "method='epsilon'": "--method epsilon",
    "bodies='solids'": "bodies: solids",
}
"""What arguments of Python are here."""

_PROBLEM = click.argument("problem", type=InputFile(), metavar="PROBLEM")
_SEED = click.option(
    "--seed", type=Whole(0, 2**32 - 1), default=0, show_default=True, help="Of all random numbers."
)
_RESUME = click.option(
    "--resume",
    type=OutputFolder(),
    help="Folder for what is finished: the same command goes on with it after an interruption.",
)
_ANY_SIZE = click.option(
    "--any-size", is_flag=True, help="Take a machine of more than 20 m or less than 1 mm too."
)


class Bound(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # generic in newer versions only
    """A measure and the worst value that it may have, ``NAME=VALUE``."""

    name = "NAME=VALUE"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, float]:
        """Return the name and the value."""
        if isinstance(value, tuple):
            return value
        name, _, text = str(value).partition("=")
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not name.strip() or not math.isfinite(number):
            self.fail(f"expected NAME=VALUE such as width=0.5, in SI units, got {value!r}", param, ctx)
        return name.strip(), number


_BOUNDS = click.option(
    "--subject-to",
    type=Bound(),
    multiple=True,
    help="Worst value that a measure may have, 'width=0.5' [SI units]; several times for more.",
)


@app.command()
@_PROBLEM
@click.option("--objective", help="Measure to make better; the first objective of the file without it.")
@_BOUNDS
@click.option(
    "--method",
    type=click.Choice(("slsqp", "evolution")),
    default="slsqp",
    show_default=True,
    help="Local optima from several starts by exact gradients, or differential evolution.",
)
@click.option("--starts", type=Whole(1, 10_000), default=STARTS, show_default=True, help="Starts of slsqp.")
@click.option(
    "--generations",
    type=Whole(1, 1_000_000),
    default=GENERATIONS,
    show_default=True,
    help="Most generations of evolution.",
)
@_SEED
@click.option(
    "--out", type=OutputFile("parameters"), help="Machine file to write (YAML): what --parameters takes."
)
@click.option(
    "--report",
    type=OutputFile("report"),
    help="Page that compares the optimum with the start (.html, .pdf; needs the extra 'report').",
)
@_RESUME
@FIGURE
@JSON
@_ANY_SIZE
def optimise(
    problem: Path,
    objective: str | None,
    subject_to: tuple[tuple[str, float], ...],
    method: Any,
    starts: int,
    generations: int,
    seed: int,
    out: Path | None,
    report: Path | None,
    resume: Path | None,
    figure: Path | None,
    as_json: bool,
    any_size: bool,
) -> int:
    """Find the machine that is best by one objective, and keeps all constraints.

    PROBLEM is a YAML file: what may change and between which bounds, objectives, constraints. The tables say
    what changes against the machine of the file, what binds, and what the optimum is worth on finer grids and
    by the other way to the forces. Exit code 1 when no machine keeps all constraints.
    """
    protect((problem,), (out, report, figure))
    work = generations if method == "evolution" else starts
    with in_options(_WORDS):
        asked = read_problem(problem, any_size)
        if report is not None:
            _require_one_motion(asked)
        with progress_bar("generations" if method == "evolution" else "starts", work) as progress:
            found = asked.minimise(
                objective,
                dict(subject_to),
                method=method,
                starts=starts,
                generations=generations,
                seed=seed,
                store=resume,
                resume=resume is not None,
                progress=progress,
            )
        if out is not None:
            found.write_parameters(out)
    if report is not None:
        _write_report(found, report)
    _tell_optimum(found, (out, report), figure, as_json)
    return 0


@app.command()
@_PROBLEM
@_BOUNDS
@click.option(
    "--method",
    type=click.Choice(("epsilon", "nsga2", "nsga3")),
    default="epsilon",
    show_default=True,
    help="Bounds on the second of two objectives; or genetic algorithms, polished (extra 'studio').",
)
@click.option(
    "--points", type=Whole(2, 100_000), default=POINTS, show_default=True, help="Designs of the front."
)
@click.option(
    "--population",
    type=Whole(4, 1_000_000),
    default=POPULATION,
    show_default=True,
    help="Of genetic algorithms.",
)
@click.option(
    "--generations",
    type=Whole(1, 1_000_000),
    default=OF_FRONT,
    show_default=True,
    help="Of genetic algorithms.",
)
@_SEED
@click.option("--out", type=OutputFile("table"), help="Table of all designs to write (CSV).")
@_RESUME
@FIGURE
@JSON
@_ANY_SIZE
def pareto(
    problem: Path,
    subject_to: tuple[tuple[str, float], ...],
    method: Any,
    points: int,
    population: int,
    generations: int,
    seed: int,
    out: Path | None,
    resume: Path | None,
    figure: Path | None,
    as_json: bool,
    any_size: bool,
) -> int:
    """Find the machines that no other one beats in all objectives.

    PROBLEM is a YAML file as of 'optimise', with two objectives or more; those of genetic algorithms are
    polished by exact gradients. Exit code 1 when no machine keeps all constraints.
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
                store=resume,
                resume=resume is not None,
                progress=progress,
            )
        if out is not None:
            found.to_csv(out)
    _tell_front(found, out, figure, as_json)
    return 0


def _bounded(problem: DesignProblem, bounds: dict[str, float]) -> DesignProblem:
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
    from p3dof.report.designs import write_designs

    problem = found.problem
    machines = {"start": problem.machine(problem.start), "optimum": found.machine}
    write_designs(path, compare_designs(machines, problem.setting.motion))


def _tell_optimum(
    found: Optimum, written: tuple[Path | None, ...], figure: Path | None, as_json: bool
) -> None:
    console = Console()
    if as_json:
        print_plain(console, json.dumps(_as_data(found), indent=1))
    else:
        show(console, *optimum_tables(found), notes=True)
        print_warnings(console, found.notes)
    _files(console, found, "optimum_figure", written, figure, as_json)


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


def _tell_front(found: Front, out: Path | None, figure: Path | None, as_json: bool) -> None:
    console = Console()
    if as_json:
        columns = {name: values.tolist() for name, values in found.found.to_columns().items()}
        print_plain(
            console, json.dumps({"front": columns, "method": found.method, "seed": found.seed}, indent=1)
        )
    else:
        show(console, *front_tables(found), notes=True)
    _files(console, found, "front_figure", (out,), figure, as_json)


def _files(
    console: Console,
    found: Any,
    drawing: str,
    outputs: tuple[Path | None, ...],
    figure: Path | None,
    quiet: bool,
) -> None:
    written = [path for path in outputs if path is not None]
    if figure is not None:
        from p3dof.report import plots

        written.append(plots.save(getattr(plots, drawing)(found), figure))
    for path in () if quiet else written:
        print_plain(console, f"wrote {path}")
