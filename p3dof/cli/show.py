"""`p3dof show`: the machine in the browser, or as a file to look at."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from p3dof._base.files import together
from p3dof.cli.app import app
from p3dof.cli.case import Case, with_case
from p3dof.cli.files import OutputFile
from p3dof.cli.output import print_plain, print_warnings, print_written
from p3dof.cli.viewing import View, with_view
from p3dof.cli.work import CLEARANCE, SURROUNDINGS, surroundings_in
from p3dof.design.clearance import clearance_of


@app.command()
@with_case
@with_view
@SURROUNDINGS
@CLEARANCE
@click.option(
    "--out",
    type=OutputFile("show"),
    help="File to write, instead of serving a page: .html (plays offline), .mp4, .gif or .png (see below).",
)
@click.option(
    "--video", type=OutputFile("film"), help="Film to write, .mp4 or .gif (needs Chromium and playwright)."
)
@click.option("--screenshot", type=OutputFile("picture"), help="Picture to write, .png (needs the same).")
def show(
    case: Case,
    view: View,
    surroundings: Path | None,
    clearance: float | None,
    out: Path | None,
    video: Path | None,
    screenshot: Path | None,
) -> int:
    """Show the machine and its forces in the browser: play a motion, drag the platform, vary parameters.

    The page is served to this machine only, until Ctrl-C or a termination signal, which end it with exit
    code 0. With --out, --video or --screenshot files are written instead, with exit code 1 when the machine
    cannot perform the motion. --surroundings or --clearance also shows which parts are nearest, and how far
    apart they are. Needs the extra 'viz'.
    """
    paths = [path for path in (out, screenshot, video) if path is not None]
    case.protect(*paths, read=(surroundings,))
    case.require_moment("--at", view.at)
    view.require_page(paths)
    apart = surroundings is not None or clearance is not None
    if apart and view.meshcat:
        raise click.UsageError("--surroundings and --clearance are for the page, not for --meshcat")
    from p3dof.viewer.machine import showing

    console = case.console()
    result, _ = case.solve("virtual-power")
    print_warnings(console, result.warnings)
    more: dict[str, Any] = dict(view.page)
    if apart and result.possible:
        around = surroundings_in(surroundings)
        more["clearance"] = clearance_of(case.robot, result, around, required=clearance or 0.0)
        print_plain(console, more["clearance"].verdict)
    if not paths:
        if view.meshcat:
            view.play(lambda: case.robot.viewer(view.port), result, "the machine")
        else:
            view.serve(lambda: showing.show(case.robot, result, port=view.port, **more), "the machine")
        return 0
    page: Any = None
    if view.meshcat:
        from p3dof.viewer.machine.scene import Scene

        page = Scene(case.robot).record(result, **view.page)
    else:
        page = showing.page(case.robot, result, **more)
    with together():
        written = [page.save(path) if view.meshcat else view.write(path, page) for path in paths]
    print_written(console, written)
    return 0 if result.possible else 1
