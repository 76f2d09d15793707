"""`p3dof loop show`: any robot in the browser, or as a file to look at."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import click
from rich.console import Console

from p3dof._base.errors import InputError
from p3dof._base.files import SUFFIXES, suffix_of
from p3dof._base.time_series.wrenches import WrenchHistory
from p3dof.cli.files import InputFile, OutputFile, protect
from p3dof.cli.files import source as opened
from p3dof.cli.kinds import SECONDS, Whole
from p3dof.cli.loop import loop
from p3dof.cli.loop.robot import (
    AT,
    EXTERNAL,
    METHOD,
    assembled,
    externals,
    figure_of,
    force_option,
    forces_of,
    with_robot,
)
from p3dof.cli.output import print_warnings, print_written, progress_bar
from p3dof.cli.viewing import View, with_view
from p3dof.loops import ClosedLoopModel
from p3dof.runs import Integration, simulate_robot
from p3dof.runs.forces_along import RobotForces, forces_along, through_ranges
from p3dof.viewer import JointMotion, robot_page, show_robot
from p3dof.viewer.document.document import slider_ranges
from p3dof.viewer.document.motion import Run
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
    help="Motion of the actuated joints to play, as for 'loop forces'; by default none.",
)
@click.option(
    "--simulate",
    "duration",
    type=SECONDS,
    help="Simulate the robot from rest for so long [s], as 'loop simulate' does, and play it.",
)
@force_option("With --simulate: ")
@EXTERNAL
@click.option(
    "--still",
    is_flag=True,
    help="Show the reference configuration at rest. Without it, and without --motion, --simulate, --set and "
    "--external, the motors move through their ranges.",
)
@click.option("--closure-forces", is_flag=True, help="Show the closure forces from the start.")
@click.option(
    "--shapes/--no-shapes", default=True, help="Show the shapes of the links in the file; rods otherwise."
)
@click.option(
    "--package-dir",
    "package_dirs",
    type=InputFile(),
    multiple=True,
    help="Folder of the packages of 'package://', or one of them; repeatable. Meshes are read from these "
    "folders and that of FILE only.",
)
@click.option("--trace", metavar="FRAME", help="With --meshcat: draw the path of a frame.")
@METHOD
@with_view
@click.option(
    "--out",
    type=OutputFile("show"),
    help="File to write, instead of serving a page: .html (plays offline), .mp4, .gif or .png (need "
    "Chromium and playwright).",
)
@click.option(
    "--size",
    type=Whole(16, MAX_PIXELS),
    nargs=2,
    default=SIZE,
    metavar="WIDTH HEIGHT",
    help="Size of a picture or film [pixels].",
)
def show(
    robot: ClosedLoopModel,
    inputs: list[Path],
    values: tuple[str, ...],
    motion_file: Path | None,
    duration: float | None,
    forces: tuple[str, ...],
    external: tuple[str, ...],
    still: bool,
    closure_forces: bool,
    shapes: bool,
    package_dirs: tuple[Path, ...],
    trace: str | None,
    method: Literal["general", "compiled"],
    view: View,
    out: Path | None,
    size: tuple[int, int],
) -> int:
    """Show a robot with its closures and forces in the browser: play a motion, or move its joints by hand.

    The page is served to this machine only, until Ctrl-C or a termination signal, which end it with exit code
    0. With --out a file is written instead. Exit code 1 when the loops do not close, or the robot cannot
    perform the motion. Needs the extra 'viz'.
    """
    protect([*inputs, *([] if motion_file is None else [motion_file])], [out])
    view.require_page([] if out is None else [out])
    if view.meshcat and closure_forces:
        raise click.UsageError("--closure-forces are in the page with charts, not in --meshcat")
    if trace is not None and not view.meshcat:
        raise click.UsageError("--trace needs --meshcat")
    given = _Given(values, motion_file, duration, forces, external, method)
    picture = out is not None and suffix_of(out, "show") in SUFFIXES["picture"]
    moving = None if still or picture else given.default(robot)
    motion, warnings = given.motion(robot) if moving is None else (moving, [])
    _check_moment(motion, view.at)
    figure = figure_of(robot, inputs[0] if shapes else None, package_dirs)
    print_warnings(Console(), [*warnings, *figure.notes])

    if view.meshcat:
        from p3dof.viewer.robot_scene import RobotScene, robot_viewer

        if out is None:
            view.play(lambda: robot_viewer(robot, figure, trace=trace, port=view.port), motion, "the robot")
        else:
            recording = RobotScene(robot, figure, trace=trace).record(motion, **view.page)
            print_written(Console(), [recording.save(out)])
        return 0
    notes = warnings if moving is None else moving.remarks
    shared: dict[str, Any] = {"shapes": figure, "closure_forces": closure_forces, "notes": notes}
    shared |= view.page
    if out is None:
        view.serve(lambda: show_robot(robot, motion, port=view.port, method=method, **shared), "the robot")
    else:
        print_written(Console(), [view.write(out, robot_page(robot, motion, **shared), size=size)])
    return 0


@dataclass(frozen=True)
class _Given:
    """What a user wants to see, by the options of the command."""

    values: tuple[str, ...]
    motion_file: Path | None
    duration: float | None
    forces: tuple[str, ...]
    external: tuple[str, ...]
    method: Literal["general", "compiled"]

    def __post_init__(self) -> None:
        moves = self.motion_file is not None or self.duration is not None
        for option, other, both in (
            ("--set", "--motion", self.values and self.motion_file is not None),
            ("--simulate", "--motion", self.duration is not None and self.motion_file is not None),
            ("--external", "a motion", self.external and moves),
        ):
            if both:
                raise click.UsageError(f"{option} and {other} exclude each other")
        if self.forces and self.duration is None:
            raise click.UsageError("--actuator-force needs --simulate")

    def motion(self, robot: ClosedLoopModel) -> tuple[JointMotion | Run, list[str]]:
        """Return the motion, and what there is to know about it."""
        if self.motion_file is not None:
            found = forces_along(robot, opened(self.motion_file), method=self.method, watch=progress_bar)
            if len(robot.actuated) > robot.mobility(found.q[0]):  # other forces would do too
                return JointMotion.of_run(robot, found, smallest=True), list(found.remarks)
            return found, list(found.remarks)
        start = assembled(robot, self.values).q
        if self.duration is None:
            given = externals(self.external)
            loads = {frame: one for frame, one in given.items() if not isinstance(one, WrenchHistory)}
            if len(loads) < len(given):
                raise InputError("--external: expected numbers, for a robot at rest has no time")
            return JointMotion.at_rest(robot, start, loads), []
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

    def default(self, robot: ClosedLoopModel) -> RobotForces | None:
        """Return a motion through the ranges of the motors, if there is one and nothing else is asked for."""
        if self.values or self.motion_file is not None or self.duration is not None or self.external:
            return None
        q = assembled(robot, ()).q
        extent = max(float(abs(place.translation).max()) for place in robot.model.jointPlacements)
        return through_ranges(robot, q, slider_ranges(robot, q, extent / 4), self.method)


def _check_moment(motion: JointMotion | Run, at: float | None) -> None:
    """Refuse a time that a motion does not have."""
    first, last = float(motion.time[0]), float(motion.time[-1])
    if at is not None and not first <= at <= last:
        raise InputError(f"--at: expected a time from {first:g} to {last:g} s, got {at:g}")
