"""`p3dof report`: one page that tells all about a motion."""

from __future__ import annotations

import shlex
from pathlib import Path

import click
import numpy as np
from rich.console import Console

from p3dof.cli.app import app
from p3dof.cli.files import STREAM, OutputFile
from p3dof.cli.options import JOINTS, STIFFNESS, Case, stiffness_in, with_case
from p3dof.cli.output import print_plain, print_warnings, progress_bar
from p3dof.cli.payloads import payloads_in_words, print_payloads
from p3dof.files import suffix_of
from p3dof.manipulator import InverseDynamics
from p3dof.reactions import ALL, Choice, of_result


@app.command("report")
@with_case
@JOINTS
@STIFFNESS
@click.option(
    "--out",
    type=OutputFile("report"),
    default="out/report.html",
    show_default=True,
    help="File to write: .html, or .pdf with a picture of what moves (needs a Chromium, and playwright).",
)
@click.option("--title", help="Heading of the page.")
@click.option("--page/--no-page", default=True, help="Embed the page in which the machine moves.")
def make(case: Case, joints: Choice, stiffness: Path | None, out: Path, title: str | None, page: bool) -> int:
    """Write parameters, figures, tables and the moving machine as one page (needs the extra 'report').

    Exit code 1 when the machine cannot make the motion.
    """
    case.protect(out)
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
    printed = suffix_of(out, "report") == ".pdf"
    reactions = of_result(
        case.robot.loop,
        case.robot.parameters,
        comparison.first,
        joints,
        case.on_invalid,  # type: ignore[arg-type]  # likewise
        stiffness_in(stiffness),
    )
    moving = case.robot.page(result, reactions=reactions).html if page and not printed else None
    picture = _picture(case, result) if page and printed else None
    path = report.write(
        out,
        case.robot,
        case.motion,
        case.wrench,
        case.on_invalid,
        title=title,
        about=_about(case),
        command=_command(case, joints, stiffness, out, title, page),
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


def _about(case: Case) -> dict[str, str]:
    """Say where machine, motion and loads come from."""
    found = {
        "machine": _named(case.parameters),
        "motion": _named(case.motion_file),
    }
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
    case: Case, joints: Choice, stiffness: Path | None, out: Path, title: str | None, page: bool
) -> str:
    """Return the command that makes this report."""
    payload = None
    if case.payload is not None:
        payload = ",".join(repr(float(part)) for part in (case.payload.mass, *case.payload.com))
    options = {
        "--parameters": case.parameters,
        "--motion": case.motion_file,
        "--samples": case.samples,
        "--payload": payload,
        "--wrench": case.wrench_file,
        "--on-invalid": None if case.on_invalid == "raise" else case.on_invalid,
        "--joints": None if joints == ALL else joints,
        "--stiffness": stiffness,
        "--title": title,
        "--out": out,
    }
    words = ["p3dof", "report"]
    words += [f"{name}={value}" for name, value in options.items() if value is not None]
    return shlex.join(words if page else [*words, "--no-page"])
