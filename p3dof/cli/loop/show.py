"""`p3dof loop show`: a motion of any robot as a page that plays in any browser, or as a picture."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from p3dof.cli.files import InputFile, OutputFile, protect, source
from p3dof.cli.loop.group import AT, assembled, loop, with_robot
from p3dof.cli.loop.motion import forces_along
from p3dof.cli.options import Number, Whole
from p3dof.cli.output import print_plain
from p3dof.closed_loop import ClosedLoopModel
from p3dof.files import SUFFIXES, suffix_of, write_atomic
from p3dof.viewer import JointMotion, robot_animation_html, robot_picture
from p3dof.viewer.headless import MAX_PIXELS, SIZE
from p3dof.viewer.robots.sticks import StickFigure


@loop.command()
@with_robot
@AT
@click.option(
    "--motion",
    "motion_file",
    type=InputFile(),
    help="Motion of the actuated joints, as of 'forces'; the robot stands still without it.",
)
@click.option("--speed", type=Number(0.01, 100), default=1.0, show_default=True, help="Times faster.")
@click.option("--at", type=float, help="Time of the motion that a picture shows [s]; its first without it.")
@click.option(
    "--size",
    type=Whole(16, MAX_PIXELS),
    nargs=2,
    default=SIZE,
    show_default=True,
    metavar="WIDTH HEIGHT",
    help="Of a picture [pixels].",
)
@click.option("--closure-forces", is_flag=True, help="Show the forces in the closures from the beginning.")
@click.option(
    "--out",
    type=OutputFile("still"),
    required=True,
    help="HTML file, which plays with no network, or PNG (needs a Chromium, and playwright).",
)
def show(
    robot: ClosedLoopModel,
    inputs: list[Path],
    values: tuple[str, ...],
    motion_file: Path | None,
    speed: float,
    at: float | None,
    size: tuple[int, int],
    closure_forces: bool,
    out: Path,
) -> int:
    """Write a page or a picture that shows a robot as rods, its closures, and the forces on it.

    Exit code 1 when the loops do not close, or the robot cannot make the motion. Needs the extra 'viz'.
    """
    if motion_file is not None and values:
        raise click.UsageError("--set and --motion exclude each other")
    protect([*inputs, *([] if motion_file is None else [motion_file])], [out])
    if motion_file is None:
        motion = JointMotion.at_rest(robot, assembled(robot, values).q)
    else:
        motion = JointMotion.of_run(robot, forces_along(robot, source(motion_file)))
    title, layers = str(robot.model.name), {"closure_forces": closure_forces}
    figure = StickFigure(robot)
    content: str | bytes
    if suffix_of(out, "still") in SUFFIXES["picture"]:
        content = robot_picture(figure, motion, at, title, robot, layers, size)
    else:
        content = robot_animation_html(figure, motion, speed, title=title, loop=robot, layers=layers)
    print_plain(Console(), f"wrote {write_atomic(out, content)}")
    return 0
