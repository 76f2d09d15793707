"""`p3dof loop show`: a motion of any robot as a page that plays in any browser."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np
from rich.console import Console

from p3dof.cli.files import InputFile, OutputFile, protect, source
from p3dof.cli.loop.group import AT, assembled, loop, with_robot
from p3dof.cli.loop.motion import forces_along
from p3dof.cli.options import Number
from p3dof.cli.output import print_plain
from p3dof.closed_loop import ClosedLoopModel
from p3dof.files import write_atomic
from p3dof.viewer import JointMotion, robot_animation_html
from p3dof.viewer.sticks import StickFigure


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
@click.option(
    "--out",
    type=OutputFile("animation"),
    required=True,
    help="HTML file, which plays with no network.",
)
def show(
    robot: ClosedLoopModel,
    inputs: list[Path],
    values: tuple[str, ...],
    motion_file: Path | None,
    speed: float,
    out: Path,
) -> int:
    """Write a page that shows a robot as rods, moving with the forces of its actuators.

    Exit code 1 when the loops do not close, or the robot cannot make the motion. Needs the extra 'viz'.
    """
    if motion_file is not None and values:
        raise click.UsageError("--set and --motion exclude each other")
    protect([*inputs, *([] if motion_file is None else [motion_file])], [out])
    if motion_file is None:
        motion = JointMotion(np.zeros(1), assembled(robot, values).q[None])
    else:
        found = forces_along(robot, source(motion_file))
        motion = JointMotion(found.time - found.time[0], found.q, robot.actuated, found.tau)
    page = robot_animation_html(StickFigure(robot), motion, speed, title=str(robot.model.name))
    print_plain(Console(), f"wrote {write_atomic(out, page)}")
    return 0
