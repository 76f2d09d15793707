"""`p3dof show`: the machine in the browser, or as a file to look at."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from p3dof.cli.app import app
from p3dof.cli.files import OutputFile
from p3dof.cli.options import Case, Number, with_case
from p3dof.cli.output import print_plain, print_warnings, progress_bar
from p3dof.cli.payloads import print_payloads
from p3dof.cli.serving import OPEN, PAUSED, PORT, SPEED, serve
from p3dof.files import SUFFIXES, suffix_of, together
from p3dof.manipulator import InverseDynamics


@app.command()
@with_case
@PORT
@SPEED
@click.option("--fps", type=Number(1, 240), help="Frames a second; 60 without it, 25 in a film.")
@click.option(
    "--at", type=float, help="Time of the motion to begin at, and of the picture [s]; its first without it."
)
@PAUSED
@OPEN
@click.option(
    "--out",
    type=OutputFile("show"),
    help="Write a file instead of serving: .html (plays with no network), .mp4, .gif or .png (see below).",
)
@click.option(
    "--video",
    type=OutputFile("film"),
    help="Likewise a film, .mp4 or .gif (needs a Chromium, and playwright).",
)
@click.option(
    "--screenshot",
    type=OutputFile("picture"),
    help="Likewise a picture, .png (needs them too).",
)
def show(
    case: Case,
    port: int | None,
    speed: float,
    fps: float | None,
    at: float | None,
    paused: bool,
    browse: bool,
    out: Path | None,
    video: Path | None,
    screenshot: Path | None,
) -> int:
    """Show the machine and its forces in the browser: play a motion, or move the platform by hand.

    The page is served to this machine only, until Ctrl-C or a termination signal, which end it with exit
    code 0. With --out, --video or --screenshot files are written instead, with exit code 1 when the machine
    cannot make the motion. Needs the extra 'viz'.
    """
    case.protect(out, video, screenshot)
    case.require_moment("--at", at)
    from p3dof.viewer.live import LiveViewer

    console = Console()
    print_payloads(console, case)
    result, _ = case.solve("virtual-power")
    print_warnings(console, result.warnings)
    if out or video or screenshot:
        paths = [path for path in (out, screenshot, video) if path is not None]
        with together():
            written = [_write(path, case, result, speed, fps, at) for path in paths]
        for path in written:
            print_plain(console, f"wrote {path}")
        return 0 if result.possible else 1

    def make() -> LiveViewer:
        return LiveViewer(
            case.robot, result, port=port, speed=speed, fps=fps or 60.0, playing=not paused, at=at
        )

    serve(make, "the machine", browse)
    return 0


def _write(
    path: Path, case: Case, result: InverseDynamics, speed: float, fps: float | None, at: float | None
) -> Path:
    """Write what the ending of a name stands for: an animation, a film or a picture."""
    from p3dof.viewer.animation import save_animation
    from p3dof.viewer.video import save_screenshot, save_video, view_of

    ending = suffix_of(path, "show")
    if ending in SUFFIXES["animation"]:
        return save_animation(path, case.robot, result, speed, fps or 60.0)
    if ending in SUFFIXES["picture"]:
        return save_screenshot(path, case.robot, **view_of(case.robot, result, at))
    with progress_bar("film", 1) as progress:
        return save_video(path, case.robot, result, fps or 25.0, speed=speed, progress=progress)
