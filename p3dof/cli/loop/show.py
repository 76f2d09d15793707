"""`p3dof loop show`: any robot in the browser, or as a file to look at."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import click
import numpy as np
from rich.console import Console

from p3dof._base.checks import FloatArray, frozen_array, shown
from p3dof._base.errors import InputError
from p3dof._base.files import SUFFIXES, suffix_of
from p3dof.cli.files import STREAM, InputFile, OutputFile, protect
from p3dof.cli.files import source as opened
from p3dof.cli.kinds import POSITIVE, Number, Whole
from p3dof.cli.loop.control import METHOD
from p3dof.cli.loop.group import AT, assembled, forces_of, loop, with_robot
from p3dof.cli.loop.motion import forces_along
from p3dof.cli.output import print_plain, print_warnings, progress_bar
from p3dof.cli.serving import OPEN, PAUSED, PORT, SPEED, serve
from p3dof.loops import ClosedLoopModel
from p3dof.runs import Integration, simulate_robot
from p3dof.viewer import JointMotion, robot_page, save_screenshot, save_video, show_robot
from p3dof.viewer.document.robots.figure import RobotFigure
from p3dof.viewer.document.robots.motion import Run
from p3dof.viewer.headless import MAX_PIXELS, SIZE

_RUN_SAMPLES = 1001
"""Of a run that is simulated to be shown."""


@loop.command()
@with_robot
@AT
@click.option(
    "--motion",
    "motion_file",
    type=InputFile(),
    help="Motion of the actuated joints to play, as of 'forces'; the robot stands still without it.",
)
@click.option(
    "--simulate",
    "duration",
    type=POSITIVE,
    help="Play what the robot does in so many seconds when it is let go, as of 'simulate'.",
)
@click.option(
    "--force",
    "forces",
    multiple=True,
    metavar="JOINT=FORCE",
    help="With --simulate: constant force of an actuated joint [N or N m, or with a unit]; none without it.",
)
@click.option(
    "--wrench",
    "wrenches",
    multiple=True,
    metavar="FRAME=FX,FY,FZ[,MX,MY,MZ]",
    help="Force [N] and moment [N m] on a frame, in world axes, of a robot that makes no motion.",
)
@click.option("--closure-forces", is_flag=True, help="Show the forces in the closures from the beginning.")
@click.option(
    "--shapes/--no-shapes",
    default=True,
    show_default=True,
    help="Show the shapes that the file gives to the links; rods without them.",
)
@click.option(
    "--package-dir",
    "package_dirs",
    type=InputFile(),
    multiple=True,
    help="Folder with the packages of 'package://', or one of them. Meshes are opened in these folders and "
    "in that of FILE only.",
)
@METHOD
@PORT
@SPEED
@click.option("--fps", type=Number(1, 240), help="Frames a second of a film; 25 without it.")
@click.option(
    "--at", type=float, help="Time of the motion to begin at, and of the picture [s]; its first without it."
)
@PAUSED
@OPEN
@click.option(
    "--out",
    type=OutputFile("show"),
    help="Write a file instead of serving: .html (plays with no network), .mp4, .gif or .png (need a "
    "Chromium, and playwright).",
)
@click.option(
    "--size",
    type=Whole(16, MAX_PIXELS),
    nargs=2,
    default=SIZE,
    show_default=True,
    metavar="WIDTH HEIGHT",
    help="Of a picture or film [pixels].",
)
def show(
    robot: ClosedLoopModel,
    inputs: list[Path],
    values: tuple[str, ...],
    motion_file: Path | None,
    duration: float | None,
    forces: tuple[str, ...],
    wrenches: tuple[str, ...],
    closure_forces: bool,
    shapes: bool,
    package_dirs: tuple[Path, ...],
    method: Literal["general", "compiled"],
    port: int | None,
    speed: float,
    fps: float | None,
    at: float | None,
    paused: bool,
    browse: bool,
    out: Path | None,
    size: tuple[int, int],
) -> int:
    """Show a robot with its closures and forces in the browser: play a motion, or move its joints by hand.

    The page is served to this machine only, until Ctrl-C or a termination signal, which end it with exit code
    0. With --out a file is written instead. Exit code 1 when the loops do not close, or the robot cannot make
    the motion. Needs the extra 'viz'.
    """
    protect([*inputs, *([] if motion_file is None else [motion_file])], [out])
    given = _Given(values, motion_file, duration, forces, wrenches, method)
    motion, warnings = given.motion(robot)
    _check_moment(motion, at)
    source = str(inputs[0]) if shapes and inputs[0] != STREAM else None  # what came by a stream is gone
    figure = RobotFigure(robot, source, package_dirs)
    print_warnings(Console(), [*warnings, *figure.notes])

    shared: dict[str, Any] = {"shapes": figure, "closure_forces": closure_forces, "notes": warnings}
    shared |= {"at": at, "speed": speed, "playing": not paused}
    if out is None:
        serve(lambda: show_robot(robot, motion, port=port, method=method, **shared), "the robot", browse)
        return 0
    page = robot_page(robot, motion, **shared)
    ending = suffix_of(out, "show")
    if ending in SUFFIXES["picture"]:
        save_screenshot(out, page, size=size)
    elif ending in SUFFIXES["film"]:
        with progress_bar("film", 1) as progress:
            save_video(out, page, fps or 25.0, speed, size, progress)
    else:
        page.save(out)
    print_plain(Console(), f"wrote {out}")
    return 0


@dataclass(frozen=True)
class _Given:
    """What a user wants to see, by the options of the command."""

    values: tuple[str, ...]
    motion_file: Path | None
    duration: float | None
    forces: tuple[str, ...]
    wrenches: tuple[str, ...]
    method: Literal["general", "compiled"]

    def __post_init__(self) -> None:
        moves = self.motion_file is not None or self.duration is not None
        for option, other, both in (
            ("--set", "--motion", self.values and self.motion_file is not None),
            ("--simulate", "--motion", self.duration is not None and self.motion_file is not None),
            ("--wrench", "a motion", self.wrenches and moves),
        ):
            if both:
                raise click.UsageError(f"{option} and {other} exclude each other")
        if self.forces and self.duration is None:
            raise click.UsageError("--force needs --simulate")

    def motion(self, robot: ClosedLoopModel) -> tuple[JointMotion | Run, list[str]]:
        """Return the motion, and what there is to know about it."""
        if self.motion_file is not None:
            found = forces_along(robot, opened(self.motion_file), method=self.method)
            if len(robot.actuated) > robot.mobility(found.q[0]):  # other forces would do too
                return JointMotion.of_run(robot, found, smallest=True), list(found.remarks)
            return found, list(found.remarks)
        start = assembled(robot, self.values).q
        if self.duration is None:
            return JointMotion.at_rest(robot, start, _wrenches(self.wrenches)), []
        acting = forces_of(robot, self.forces)
        settings = Integration(rtol=1e-9, atol=1e-11)
        with progress_bar("run", _RUN_SAMPLES) as progress:
            run = simulate_robot(
                robot,
                self.duration,
                start,
                None,
                acting,
                samples=_RUN_SAMPLES,
                integration=settings,
                progress=progress,
                method=self.method,
            )
        return run, [] if run.stop is None else [f"ended by {run.stop}"]


def _wrenches(texts: tuple[str, ...]) -> dict[str, FloatArray]:
    """Return wrenches (6,) by frame."""
    found: dict[str, FloatArray] = {}
    for text in texts:
        name, sign, numbers = text.rpartition("=")
        name = name.strip()
        try:
            values = [float(word) for word in numbers.split(",")]
        except ValueError:
            values = []
        if not (sign and name) or len(values) not in (3, 6):
            raise InputError(f"--wrench: expected FRAME=FX,FY,FZ or with MX,MY,MZ, got {shown(text)}")
        if name in found:
            raise InputError(f"--wrench: the frame {shown(name)} is given twice")
        found[name] = frozen_array(f"--wrench {name}", np.array([*values, 0.0, 0.0, 0.0][:6]), (6,))
    return found


def _check_moment(motion: JointMotion | Run, at: float | None) -> None:
    """Refuse a time that a motion does not have."""
    first, last = float(motion.time[0]), float(motion.time[-1])
    if at is not None and not first <= at <= last:
        raise InputError(f"--at: expected a time from {first:g} to {last:g} s, got {at:g}")
