"""`p3dof report`: one page that tells all about a motion."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console

from p3dof._base.files import suffix_of
from p3dof.analysis.reactions import ALL, Choice, of_result
from p3dof.cli.app import app
from p3dof.cli.files import STREAM, InputFile, OutputFile
from p3dof.cli.machine import actuator_options
from p3dof.cli.options import JOINTS, STIFFNESS, Case, load_friction_in, stiffness_in, with_case
from p3dof.cli.output import print_plain, print_warnings, progress_bar
from p3dof.cli.payloads import payloads_in_words, print_payloads
from p3dof.cli.work import WORK, Work, task_named
from p3dof.design.fastest import limits_of
from p3dof.design.forces_of_tasks import TaskForces
from p3dof.methods import InverseDynamics


@app.command("report")
@click.argument("task_file", metavar="[TASK]", type=InputFile(), required=False)
@with_case
@JOINTS
@STIFFNESS
@WORK
@click.option(
    "--out",
    type=OutputFile("report"),
    default="out/report.html",
    show_default=True,
    help="File to write: .html, or .pdf with a picture of what moves (needs a Chromium, and playwright).",
)
@click.option("--title", help="Heading of the page.")
@click.option("--page/--no-page", default=True, help="Embed the page in which the machine moves.")
def make(
    case: Case,
    task_file: Path | None,
    joints: Choice,
    stiffness: Path | None,
    out: Path,
    title: str | None,
    page: bool,
    **given: Any,
) -> int:
    """Write a report in one file, HTML or PDF (needs the extra 'report').

    Of a TASK (YAML): does the machine fit, which rating is worst, when and by how much; drives of a
    catalogue with their torque-speed curves, lives of bearings, alternatives. Of a motion (--motion; the
    paper's without it): parameters, figures and tables; with --drives or --bearings as of a task.

    Exit code 1 when the machine cannot make the motion, or does not fit.
    """
    work = Work(**given)
    case.protect(out)
    work.protect(task_file, (case.parameters, case.motion_file, case.wrench_file, stiffness), (out,))
    told = _Told(out, title, page, _command(case, task_file, work, joints, stiffness, out, title, page))
    if task_file is not None or work.asks:
        if joints != ALL:
            raise click.UsageError("--joints: parts are held against the loads of elastic joints")
        return _assessed(case, task_file, work, stiffness, told)
    return _of_motion(case, joints, stiffness, told)


@dataclass(frozen=True)
class _Told:
    """Where a report goes, and what it says of itself."""

    out: Path
    title: str | None
    page: bool
    command: str

    @property
    def printed(self) -> bool:
        return suffix_of(self.out, "report") == ".pdf"


def _assessed(case: Case, task_file: Path | None, work: Work, stiffness: Path | None, told: _Told) -> int:
    """Write the report on a machine and what it has to do."""
    from p3dof import report

    robot, given = case.robot, stiffness_in(stiffness)
    limits = None
    if task_file is None:
        if case.on_invalid != "raise":
            raise click.UsageError("--on-invalid nan: a motion with gaps cannot be held against ratings")
        work.refuse_plans("a motion file says how long it takes")
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
    result = work.assessed(robot, found, given, told.title or "", limits)
    page = report.moving_page(result) if told.page else None
    picture = None
    if told.printed and page is not None:
        from p3dof.viewer.pictures import screenshot

        time = result.worst.time
        picture = screenshot(page, 0.0 if math.isnan(time) else time)
    files = {"task": task_file, "drives": work.drives, "bearings": work.bearings, "stiffness": stiffness}
    files["load friction"] = work.load_friction
    path = report.write_assessment(
        told.out,
        result,
        title=told.title,
        about=_about(case, {name: str(file) for name, file in files.items() if file is not None}),
        command=told.command,
        page=None if page is None or told.printed else page.html,
        picture=picture,
    )
    console = Console()
    print_payloads(console, case)
    print_plain(console, f"{result.name}: {result.verdict}")
    print_plain(console, f"not checked: {'; '.join(result.unchecked)}")
    print_warnings(console, result.warnings)
    print_plain(console, f"wrote {path}")
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
    from p3dof import report

    with progress_bar("report", len(case.motion)) as progress:
        comparison = case.robot.compare(
            case.motion,
            wrench=case.wrench,
            on_invalid=case.on_invalid,  # type: ignore[arg-type]  # one of two, as the options say
            progress=progress,
        )
    result = comparison.second
    case.require_valid(result.valid)
    reactions = of_result(
        case.robot.loop,
        case.robot.parameters,
        comparison.first,
        joints,
        case.on_invalid,  # type: ignore[arg-type]  # likewise
        stiffness_in(stiffness),
    )
    moving = case.robot.page(result, reactions=reactions).html if told.page and not told.printed else None
    picture = _picture(case, result) if told.page and told.printed else None
    path = report.write(
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
    console = Console()
    print_payloads(console, case)
    print_warnings(console, result.warnings)
    print_plain(console, f"wrote {path}")
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
    out: Path,
    title: str | None,
    page: bool,
) -> str:
    """Return the command that makes this report."""
    payload = None
    if case.payload is not None:
        payload = ",".join(repr(float(part)) for part in (case.payload.mass, *case.payload.com))
    options = {
        "--parameters": case.parameters,
        "--motion": case.motion_file,
        "--samples": case.samples,
        **actuator_options(),
        "--payload": payload,
        "--wrench": case.wrench_file,
        "--on-invalid": None if case.on_invalid == "raise" else case.on_invalid,
        "--joints": None if joints == ALL else joints,
        "--stiffness": stiffness,
        **work.options,
        "--title": title,
        "--out": out,
    }
    words = ["p3dof", "report", *([] if task_file is None else [str(task_file)])]
    words += [
        name if value is True else f"{name}={value}" for name, value in options.items() if value is not None
    ]
    return shlex.join(words if page else [*words, "--no-page"])
