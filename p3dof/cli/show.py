"""`p3dof show`: the machine in the browser, or as a file to look at."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console

from p3dof._base.files import SUFFIXES, suffix_of, together
from p3dof.cli.app import app
from p3dof.cli.files import OutputFile
from p3dof.cli.kinds import Number
from p3dof.cli.options import Case, with_case
from p3dof.cli.output import print_plain, print_warnings, progress_bar
from p3dof.cli.payloads import print_payloads
from p3dof.cli.serving import OPEN, PAUSED, PORT, SPEED, serve

if TYPE_CHECKING:
    from p3dof.viewer.document.saved import Page
    from p3dof.viewer.live_viewer import LiveViewer


@app.command()
@with_case
@PORT
@SPEED
@click.option("--fps", type=Number(1, 240), help="Frames a second of a film; 25 without it.")
@click.option(
    "--at", type=float, help="Time of the motion to begin at, and of the picture [s]; its first without it."
)
@PAUSED
@click.option(
    "--meshcat", is_flag=True, help="Show the machine at home as Pinocchio's MeshcatVisualizer does, alone."
)
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
    meshcat: bool,
    browse: bool,
    out: Path | None,
    video: Path | None,
    screenshot: Path | None,
) -> int:
    """Show the machine and its forces in the browser: play a motion, drag the platform, try what if.

    The page is served to this machine only, until Ctrl-C or a termination signal, which end it with exit
    code 0. With --out, --video or --screenshot files are written instead, with exit code 1 when the machine
    cannot make the motion. Needs the extra 'viz'.
    """
    case.protect(out, video, screenshot)
    case.require_moment("--at", at)
    from p3dof.viewer import showing

    if meshcat:
        from p3dof.viewer.visualizer import MeshcatPage

        if out or video or screenshot:
            raise click.UsageError("--meshcat is live: it writes no files")
        serve(lambda: MeshcatPage(case.robot, port), "the machine at home", browse)
        return 0
    console = Console()
    print_payloads(console, case)
    result, _ = case.solve("virtual-power")
    print_warnings(console, result.warnings)
    if out or video or screenshot:
        paths = [path for path in (out, screenshot, video) if path is not None]
        page = showing.page(case.robot, result, at=at, speed=speed, playing=not paused)
        with together():
            written = [_write(path, page, speed, fps or 25.0) for path in paths]
        for path in written:
            print_plain(console, f"wrote {path}")
        return 0 if result.possible else 1

    def make() -> LiveViewer:
        return showing.show(case.robot, result, port=port, speed=speed, playing=not paused, at=at)

    serve(make, "the machine", browse)
    return 0


def _write(path: Path, page: Page, speed: float, fps: float) -> Path:
    """Write what the ending of a name stands for: a page, a film or a picture."""
    from p3dof.viewer.pictures import save_screenshot, save_video

    ending = suffix_of(path, "show")
    if ending in SUFFIXES["animation"]:
        return page.save(path)
    if ending in SUFFIXES["picture"]:
        return save_screenshot(path, page)
    with progress_bar("film", 1) as progress:
        return save_video(path, page, fps, speed, progress=progress)
