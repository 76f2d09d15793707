"""`p3dof compare-designs`: machines, or tasks, side by side."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from p3dof._base.errors import TaskError
from p3dof._base.files import called, parse_yaml, read_text, together
from p3dof.cli.app import app
from p3dof.cli.files import JSON, STREAM, InputFile, OutputFile, protect, source
from p3dof.cli.kinds import Whole
from p3dof.cli.machine import PARAMETERS, any_size, driven, machine_of
from p3dof.cli.options import FIGURE, STIFFNESS, load_friction_in, stiffness_in
from p3dof.cli.output import in_options, print_plain, progress_bar, show
from p3dof.cli.work import SAMPLES, WORK, Work, task_named
from p3dof.design.bearings import read_bearings
from p3dof.design.design_comparison import (
    DesignComparison,
    compare_designs,
    comparison_table,
    verdicts_table,
    write_comparisons,
)
from p3dof.design.design_comparison import as_json as text_of
from p3dof.design.drives import read_catalogue
from p3dof.design.tasks import Task
from p3dof.machine.parameters import read_parameters
from p3dof.manipulator import Manipulator


@app.command("compare-designs")
@click.argument("files", metavar="MACHINE|TASK...", type=InputFile(), nargs=-1, required=True)
@click.option(
    "--task", "tasks", type=InputFile(), multiple=True, help="Task that all machines do; may be given again."
)
@PARAMETERS
@WORK
@STIFFNESS
@click.option(
    "--samples",
    type=Whole(2, 1_000_000),
    default=SAMPLES,
    show_default=True,
    help="Least number of samples of a task.",
)
@JSON
@click.option("--csv", "table", type=OutputFile("table"), help="CSV file to write.")
@click.option("--out", type=OutputFile("report"), help="Page to write, .html or .pdf (extra 'report').")
@FIGURE
def make(
    files: tuple[Path, ...],
    tasks: tuple[Path, ...],
    parameters: Path | None,
    stiffness: Path | None,
    samples: int,
    as_json: bool,
    table: Path | None,
    out: Path | None,
    figure: Path | None,
    **given: Any,
) -> int:
    """Put machines, or tasks, side by side: loads, powers, cycle time, worst ratings, mass, room, lives.

    Parameter files are machines that do the tasks of --task, or the paper's motion without any. Task files
    are done by one machine (--parameters; the paper's without it) and compared with each other. Differences
    are against the first; for tables of many machines there is 'designs'.

    Exit code 1 when one does not fit, or cannot do a task.
    """
    work = Work(**given)
    read = (*files, *tasks)
    protect((parameters, stiffness, *read), (table, out, figure))
    work.protect(None, (stiffness, parameters, *read), (table, out, figure))
    robots, jobs = _sorted(files, tasks, parameters)
    if figure is not None and len(jobs) > 1:
        raise click.UsageError("--figure: one figure for one task; --out has those of all tasks")
    if not jobs:
        work.refuse_plans("the paper's motion takes 1 s; give tasks with --task")
    catalogue = None if work.drives is None else read_catalogue(source(work.drives))
    parts = None if work.bearings is None else read_bearings(source(work.bearings))
    with (
        progress_bar("designs", len(robots) * max(len(jobs), 1)) as progress,
        in_options({"duration: ": "--duration, or --fastest: "}),
    ):
        found = compare_designs(
            robots,
            jobs or None,
            duration=work.duration,
            fastest=work.fastest,
            drives=catalogue,  # type: ignore[arg-type,unused-ignore]  # an iterable of drives
            bearings=parts,
            stiffness=stiffness_in(stiffness),
            load_friction=load_friction_in(work.load_friction),
            rest=work.rest,
            brake_safety=work.brake_safety,
            samples=samples,
            progress=progress,
        )
    written = _written(found, table, out, figure, _command())
    if as_json:
        sys.stdout.write(text_of(found) + "\n")
    else:
        _print(found, written)
    return 0 if all(one.fits for part in found for one in part.assessments) else 1


def _print(found: list[DesignComparison], written: list[Path]) -> None:
    console = Console()
    for part in found:
        show(console, comparison_table(part), verdicts_table(part), notes=True)
        for one in part.assessments:
            print_plain(console, f"{one.name}: {one.verdict}")
    for path in written:
        print_plain(console, f"wrote {path}")


def _written(
    found: list[DesignComparison], table: Path | None, out: Path | None, figure: Path | None, command: str
) -> list[Path]:
    """Write what is asked for, all of it or nothing."""
    writers: list[Callable[[], Path]] = []
    if table is not None:
        writers.append(lambda: write_comparisons(found, table))
    if out is not None:
        from p3dof import report

        writers.append(lambda: report.write_designs(out, found, command=command))
    if figure is not None:
        from p3dof.report import plots

        writers.append(lambda: plots.save(plots.comparison_figure(found[0]), figure))
    with together():
        return [write() for write in writers]


def _sorted(
    files: tuple[Path, ...], tasks: tuple[Path, ...], parameters: Path | None
) -> tuple[dict[str, Manipulator], dict[str, Task]]:
    """Return machines and tasks by the names of their files."""
    if STREAM in (*files, *tasks):
        raise click.UsageError("compare-designs reads files by their names: - is none")
    kinds = [_is_task(path) for path in files]
    if any(kinds) and not all(kinds):
        one, other = files[kinds.index(True)], files[kinds.index(False)]
        raise click.UsageError(f"{one} is a task and {other} a machine: give tasks of machines with --task")
    if all(kinds):
        if tasks:
            raise click.UsageError("--task: give machines to do it, not tasks")
        return {"the machine": machine_of(parameters)}, {
            name: task_named(path) for name, path in _by_name(files).items()
        }
    if parameters is not None:
        raise click.UsageError("--parameters: the machines are given already")
    robots = {
        name: Manipulator(driven(read_parameters(source(path), any_size())))
        for name, path in _by_name(files).items()
    }
    return robots, {name: task_named(path) for name, path in _by_name(tasks).items()}


def _is_task(path: Path) -> bool:
    data = parse_yaml(read_text(path), called(path), TaskError)
    return isinstance(data, dict) and "waypoints" in data


def _by_name(paths: tuple[Path, ...]) -> dict[str, Path]:
    """Return files by their stems, or by all of their paths where stems are alike."""
    stems = [path.stem for path in paths]
    names = stems if len(set(stems)) == len(stems) else [str(path) for path in paths]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise click.UsageError(f"{twice} is given twice")
    return dict(zip(names, paths, strict=True))


def _command() -> str:
    """Return the command as it was given."""
    context = click.get_current_context()
    words: list[str] = []
    for parameter in context.command.params:
        value = context.params.get(parameter.name or "")
        if value is None or value is False or value in (parameter.default, ()):
            continue
        each = value if isinstance(value, tuple) else (value,)
        if isinstance(parameter, click.Argument):
            words += [str(one) for one in each]
        else:
            option = parameter.opts[0]
            words += [option if one is True else f"{option}={one}" for one in each]
    return shlex.join(["p3dof", "compare-designs", *words])
