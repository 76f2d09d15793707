"""`p3dof report`, `compare-designs`, `studio`: pages about a motion, a task, a few machines, many designs."""

from __future__ import annotations

import csv
import math
import shlex
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
from rich.console import Console

from p3dof._base.checks import FloatArray, require_commas, whole
from p3dof._base.errors import InputError, TaskError
from p3dof._base.files import called, parse_yaml, read_text, suffix_of, together
from p3dof.analysis.reactions import ALL, Choice
from p3dof.cli.app import app
from p3dof.cli.case import STIFFNESS, Case, load_friction_in, stiffness_in, with_case, with_load
from p3dof.cli.files import STREAM, InputFile, OutputFile, protect, save_figure, source
from p3dof.cli.kinds import FIGURE, Whole
from p3dof.cli.machine import PARAMETERS, actuator_options, any_size, driven, machine_of, payloads_in_words
from p3dof.cli.output import give, in_options, print_plain, print_warnings, print_written, progress_bar, show
from p3dof.cli.reactions import JOINTS
from p3dof.cli.work import (
    CLEARANCE,
    SAMPLES,
    STOPS,
    SURROUNDINGS,
    Work,
    surroundings_in,
    task_named,
    with_work,
)
from p3dof.design.bearings import read_bearings
from p3dof.design.clearance import clearance_of
from p3dof.design.design_comparison import (
    DesignComparison,
    compare_designs,
    comparison_table,
    verdicts_table,
    write_comparisons,
)
from p3dof.design.drives import read_catalogue
from p3dof.design.fastest import limits_of
from p3dof.design.forces_of_tasks import TaskForces
from p3dof.design.tasks import Task
from p3dof.machine.parameters import read_parameters
from p3dof.manipulator import Manipulator
from p3dof.methods import InverseDynamics

_LARGEST_FILE = 50_000_000


@app.command("report")
@click.argument("task_file", metavar="[TASK]", type=InputFile(), required=False)
@with_case
@JOINTS
@STIFFNESS
@with_work
@SURROUNDINGS
@CLEARANCE
@STOPS
@click.option(
    "--out",
    type=OutputFile("report"),
    default="out/report.html",
    help="Report to write (.html or .pdf, which needs playwright and Chromium).",
)
@click.option("--title", help="Title of the report.")
@click.option(
    "--animation/--no-animation", "page", default=True, help="Embed the page with the moving machine."
)
def report(
    case: Case,
    task_file: Path | None,
    joints: Choice,
    stiffness: Path | None,
    out: Path,
    title: str | None,
    page: bool,
    work: Work,
    surroundings: Path | None,
    clearance: float | None,
    stops: bool,
) -> int:
    """Write a report in one file, HTML or PDF (needs the extra 'report').

    On a TASK (YAML): whether the machine fits, utilisation of all ratings, the worst with time and place,
    drives of a catalogue with torque-speed curves, bearing life, alternatives. On a motion (--motion, by
    default the paper's): parameters, figures and tables; with --drives or --bearings as on a task.

    Exit code 1 when the machine cannot perform the motion, or does not fit.
    """
    case.protect(out)
    work.protect(
        task_file, (case.parameters, case.motion_file, case.wrench_file, stiffness, surroundings), (out,)
    )
    apart = _Apart(surroundings, clearance)
    told = _Told(
        out,
        title,
        page,
        _command(case, task_file, work, joints, stiffness, apart, out, title, page, stops),
        stops,
    )
    if stops and work.drives is None:
        raise click.UsageError("--stops: drives stop the machine: give them with --drives")
    if task_file is not None or work.asks or apart.asks:
        if joints != ALL:
            raise click.UsageError("--joint-model: parts are checked against the loads of elastic joints")
        return _assessed(case, task_file, work, stiffness, apart, told)
    return _of_motion(case, joints, stiffness, told)


@dataclass(frozen=True)
class _Apart:
    """What stands around a machine, and the distance that parts must keep [m], as the options name them."""

    surroundings: Path | None
    clearance: float | None

    @property
    def asks(self) -> bool:
        return self.surroundings is not None or self.clearance is not None


@dataclass(frozen=True)
class _Told:
    """Where a report goes, and what it says of itself."""

    out: Path
    title: str | None
    page: bool
    command: str
    stops: bool

    @property
    def printed(self) -> bool:
        return suffix_of(self.out, "report") == ".pdf"


def _assessed(
    case: Case, task_file: Path | None, work: Work, stiffness: Path | None, apart: _Apart, told: _Told
) -> int:
    """Write the report on a machine and what it has to do."""
    from p3dof import report as pages

    robot, given = case.robot, stiffness_in(stiffness)
    limits = None
    if task_file is None:
        if case.on_invalid != "raise":
            raise click.UsageError("--on-invalid nan: a motion with gaps cannot be held against ratings")
        work.refuse_plans("a motion file has its own duration")
        friction = load_friction_in(work.load_friction)
        found: InverseDynamics | TaskForces = (
            case.solve("compiled")[0]
            if friction is None
            else robot.inverse_dynamics(
                case.motion,
                method="virtual-power",
                wrench=case.wrench,
                load_friction=friction,
                stiffness=given,
            )
        )
    else:
        _refuse_motion(case)
        task = task_named(task_file)
        found = work.forces(robot, task, given, case.samples)
        limits = limits_of(robot, task) if task.limits else None
    near = None
    if apart.asks:
        around = surroundings_in(apart.surroundings)
        near = clearance_of(robot, found, around, required=apart.clearance or 0.0)
    result = work.assessed(robot, found, given, told.title or "", limits, near, told.stops)
    page = pages.moving_page(result) if told.page else None
    picture = None
    if told.printed and page is not None:
        from p3dof.viewer.pictures import screenshot

        time = result.worst.time
        picture = screenshot(page, 0.0 if math.isnan(time) else time)
    files = {"task": task_file, "drives": work.drives, "bearings": work.bearings, "stiffness": stiffness}
    files |= {"load friction": work.load_friction, "surroundings": apart.surroundings}
    path = pages.write_assessment(
        told.out,
        result,
        title=told.title,
        about=_about(case, {name: str(file) for name, file in files.items() if file is not None}),
        command=told.command,
        page=None if page is None or told.printed else page.html,
        picture=picture,
    )
    console = case.console()
    print_plain(console, f"{result.name}: {result.verdict}")
    if result.assumed:
        print_plain(console, f"assumed: {'; '.join(result.assumed)}")
    print_plain(console, f"not checked: {'; '.join(result.unchecked)}")
    print_warnings(console, result.warnings)
    print_written(console, [path])
    return 0 if result.fits else 1


def _refuse_motion(case: Case) -> None:
    """Refuse options of motions beside a task, which has its own."""
    others = {
        "--motion": case.motion_file,
        "--wrench": case.wrench_file,
        "--on-invalid nan": None if case.on_invalid == "raise" else True,
    }
    for option, value in others.items():
        if value is not None:
            raise click.UsageError(f"{option}: a task has its own motion and loads")


def _of_motion(case: Case, joints: Choice, stiffness: Path | None, told: _Told) -> int:
    """Write the report on a motion."""
    from p3dof import report as pages
    from p3dof.analysis.reactions.evaluation import of_result

    with progress_bar("report", len(case.motion)) as progress:
        comparison = case.robot.compare(
            case.motion, wrench=case.wrench, on_invalid=case.on_invalid, progress=progress
        )
    result = comparison.second
    case.require_valid(result.valid)
    reactions = of_result(
        case.robot.bare_loop,
        case.robot.parameters,
        comparison.first,
        joints,
        case.on_invalid,
        stiffness_in(stiffness),
    )
    moving = case.robot.page(result, reactions=reactions).html if told.page and not told.printed else None
    picture = _picture(case, result) if told.page and told.printed else None
    path = pages.write(
        told.out,
        case.robot,
        case.motion,
        case.wrench,
        case.on_invalid,
        title=told.title,
        about=_about(case),
        command=told.command,
        page=moving,
        picture=picture,
        comparison=comparison,
        reactions=reactions,
    )
    console = case.console()
    print_warnings(console, result.warnings)
    print_written(console, [path])
    return 0 if result.possible else 1


def _picture(case: Case, result: InverseDynamics) -> bytes:
    """Return a picture of the machine at the instant of the largest force."""
    from p3dof.viewer.pictures import screenshot

    strongest = int(np.argmax(np.nan_to_num(np.abs(result.forces)).max(axis=1)))
    return screenshot(case.robot.page(result), float(result.time[strongest]))


def _about(case: Case, files: Mapping[str, str] | None = None) -> dict[str, str]:
    """Say where machine, motion and loads come from, and other files."""
    found = {"machine": _named(case.parameters)}
    if files is None or "task" not in files:
        found["motion"] = _named(case.motion_file)
    found |= files or {}
    words = payloads_in_words(case.robot.parameters, case.parameters, case.payload)
    if words:
        found["payload"] = words.removeprefix("payload: ")
    if case.wrench_file is not None:
        found["external load"] = _named(case.wrench_file)
    return found


def _named(path: Path | None) -> str:
    if path is None:
        return "the paper's"
    return "from the standard input" if path == STREAM else str(path)


def _command(
    case: Case,
    task_file: Path | None,
    work: Work,
    joints: Choice,
    stiffness: Path | None,
    apart: _Apart,
    out: Path,
    title: str | None,
    page: bool,
    stops: bool,
) -> str:
    """Return the command that makes this report."""
    payload = case.payload and ",".join(repr(float(part)) for part in (case.payload.mass, *case.payload.com))
    options = {
        "--parameters": case.parameters,
        "--motion": case.motion_file,
        "--samples": case.samples,
        **actuator_options(),
        "--payload": payload,
        "--wrench": case.wrench_file,
        "--on-invalid": None if case.on_invalid == "raise" else case.on_invalid,
        "--joint-model": None if joints == ALL else joints,
        "--stiffness": stiffness,
        **work.options,
        "--surroundings": apart.surroundings,
        "--clearance": apart.clearance,
        "--stops": stops or None,
        "--title": title,
        "--out": out,
    }
    words = ["p3dof", "report", *([] if task_file is None else [str(task_file)])]
    words += [
        name if value is True else f"{name}={value}" for name, value in options.items() if value is not None
    ]
    return shlex.join(words if page else [*words, "--no-animation"])


@app.command("compare-designs")
@click.argument("files", metavar="MACHINE|TASK...", type=InputFile(), nargs=-1, required=True)
@click.option("--task", "tasks", type=InputFile(), multiple=True, help="Task file (YAML); repeatable.")
@PARAMETERS
@with_work
@STIFFNESS
@click.option(
    "--samples", type=Whole(2, 1_000_000), default=SAMPLES, help="Least number of samples of a task."
)
@click.option(
    "--out", "table", type=OutputFile("table"), help="CSV file to write: the table of the comparison."
)
@click.option(
    "--report",
    "out",
    type=OutputFile("report"),
    help="Report to write on the comparison (.html or .pdf; needs the extra 'report').",
)
@FIGURE
def designs(
    files: tuple[Path, ...],
    tasks: tuple[Path, ...],
    parameters: Path | None,
    stiffness: Path | None,
    samples: int,
    table: Path | None,
    out: Path | None,
    figure: Path | None,
    work: Work,
) -> int:
    """Compare machines or tasks: loads, powers, cycle time, utilisations, mass, installation space, life.

    Parameter files are machines, compared on the tasks of --task, or on the paper's motion. Task files are
    tasks, compared on one machine (--parameters, by default the paper's). Differences are against the first
    file. For tables of many machines, see 'designs'.

    Exit code 1 when a machine does not fit, or cannot perform a task.
    """
    read = (*files, *tasks)
    protect((parameters, stiffness, *read), (table, out, figure))
    work.protect(None, (stiffness, parameters, *read), (table, out, figure))
    robots, jobs = _sorted(files, tasks, parameters)
    if figure is not None and len(jobs) > 1:
        raise click.UsageError("--figure: one figure for one task; --report has those of all tasks")
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
            per_axis=work.per_axis,
            life=work.required,
            frictionless=work.frictionless,
            samples=samples,
            progress=progress,
        )
    written = _written(found, table, out, figure, _as_given())
    give({"comparisons": [one.to_dict() for one in found]})
    _print(found, written)
    return 0 if all(one.fits for part in found for one in part.assessments) else 1


def _print(found: list[DesignComparison], written: list[Path]) -> None:
    console = Console()
    for part in found:
        show(console, comparison_table(part), verdicts_table(part), notes=True)
        for one in part.assessments:
            print_plain(console, f"{one.name}: {one.verdict}")
    print_written(console, written)


def _written(
    found: list[DesignComparison], table: Path | None, out: Path | None, figure: Path | None, command: str
) -> list[Path]:
    """Write what is asked for, all of it or nothing."""
    with together():
        written = [] if table is None else [write_comparisons(found, table)]
        if out is not None:
            from p3dof import report as pages

            written.append(pages.write_designs(out, found, command=command))
        return written + save_figure(lambda plots: plots.comparison_figure(found[0]), figure)


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


def _as_given() -> str:
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


@app.command()
@with_load
@click.option(
    "--designs",
    type=InputFile(),
    help="Table of designs (CSV, units in brackets), such as 'p3dof designs --out' writes.",
)
@click.option("--small", multiple=True, metavar="COLUMN", help="Column of designs to minimise; repeatable.")
@click.option("--large", multiple=True, metavar="COLUMN", help="Column of designs to maximise; repeatable.")
@click.option("--start", type=Whole(1, 10_000_000), help="Row of the reference design in the table.")
@click.option("--index", "indices", multiple=True, metavar="NAME", help="Performance index; repeatable.")
@click.option("--grid", type=Whole(5, 401), default=81, help="Number of poses of the map along each axis.")
@click.option("--out", type=OutputFile("animation"), required=True, help="HTML page to write.")
@in_options({"index: ": "--index: ", "better: ": "--small, --large: "})
def studio(
    case: Case,
    designs: Path | None,
    small: tuple[str, ...],
    large: tuple[str, ...],
    start: int | None,
    indices: tuple[str, ...],
    grid: int,
    out: Path,
) -> int:
    """Write a page with maps of performance indices over y and θ, singularity loci, limits, and the motion.

    A table of designs is drawn as a scatter plot and as parallel coordinates; a selection in one is shown in
    the other.
    """
    protect((case.parameters, case.motion_file, case.wrench_file, designs), (out,))
    if designs is None and (small or large or start):
        raise click.UsageError("--small, --large and --start belong to --designs")
    if twice := set(small) & set(large):
        raise click.UsageError(f"{min(twice)!r} is given as --small and as --large")
    table = None if designs is None else _columns(designs)
    if table and start:
        whole("--start", start, 1, len(next(iter(table.values()))))
    from p3dof.viewer.machine.studio import save_studio

    written = save_studio(
        out,
        case.robot,
        case.motion,
        table,
        indices=indices or None,
        counts=(grid, grid),
        better={**dict.fromkeys(small, "small"), **dict.fromkeys(large, "large")},
        start=None if start is None else start - 1,
    )
    print_written(case.console(), [written])
    return 0


def _columns(path: Path) -> dict[str, FloatArray]:
    """Return the columns of a table that hold numbers; empty cells are NaN."""
    if path == STREAM:
        raise click.UsageError("--designs: expected a file")
    lines = [line for line in read_text(path, _LARGEST_FILE).splitlines() if line.strip() and line[0] != "#"]
    rows = list(csv.reader(lines))
    if len(rows) < 2:
        raise InputError(f"{path}: expected a header and a row for each design")
    header, *body = rows
    require_commas(header, str(path), InputError)
    for number, row in enumerate(body, start=1):
        if len(row) != len(header):
            raise InputError(f"{path}, row {number}: expected {len(header)} cells, got {len(row)}")
    found = {}
    for name, cells in zip(header, zip(*body, strict=True), strict=True):
        with suppress(ValueError):  # of words, such as a status
            found[name.strip()] = np.array([float(cell) if cell.strip() else np.nan for cell in cells])
    if not found:
        raise InputError(f"{path}: expected columns of numbers, got words only")
    return found
