"""`p3dof loop export`: any robot in other formats."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import click
from rich.console import Console

from p3dof._base.files import together, write_atomic
from p3dof.cli.files import FORCE, InputFile, OutputFile, protect, source
from p3dof.cli.loop import loop
from p3dof.cli.loop.robot import figure_of, with_robot
from p3dof.cli.output import print_warnings, print_written, progress_bar
from p3dof.loops import ClosedLoopModel
from p3dof.loops.writers import SUFFIX, contents

_SCENE, _ROS2 = "glb", "ros2"


@loop.command()
@with_robot
@click.option(
    "--format",
    "format_",
    type=click.Choice([*SUFFIX, _SCENE, _ROS2]),
    help="Format; by default from the ending of the file: .urdf, .xml (MJCF), .sdf, .glb. drake is SDF with "
    "the loop elements of Drake, ros2 a package for ROS 2 in a folder.",
)
@click.option(
    "--motion",
    "motion_file",
    type=InputFile(),
    help="Motion of the actuated joints in the glb, as for 'loop forces'; by default none.",
)
@click.option(
    "--package-dir",
    "package_dirs",
    type=InputFile(),
    multiple=True,
    help="Folder of the packages of 'package://', or one of them; repeatable. Meshes are "
    "read from these folders and that of FILE only.",
)
@click.option("--prefix", help="Prefix of all names and files of a ROS package, and its name.")
@click.option("--coordinates", help="Joints, with commas: those that a controller on ROS knows.")
@click.option("--actuators", help="Actuators behind --coordinates, with commas; all of the robot by default.")
@click.option(
    "--out",
    type=OutputFile("exported robot", folder=True),
    required=True,
    help="File to write; the sidecar of a URDF is written beside it, with the ending .yaml. Folder of a "
    "package for ROS 2.",
)
@FORCE
def export(
    robot: ClosedLoopModel,
    inputs: list[Path],
    format_: str | None,
    motion_file: Path | None,
    package_dirs: tuple[Path, ...],
    prefix: str | None,
    coordinates: str | None,
    actuators: str | None,
    out: Path,
    force: bool,
) -> int:
    """Write a robot as URDF with sidecar, MJCF or SDF, with all loop closures; or as a glTF scene.

    Or as a package for ROS 2, whose relay computes the passive joints.

    The exported model has the same dynamics. What a format cannot represent is an error that names it. Meshes
    are written to glTF only (.glb): the moving robot for browsers, presentations and Blender.
    """
    if format_ == _ROS2 and motion_file is None and not package_dirs:
        from p3dof.codegen.ros2 import ros2_files

        ends, others = (
            None if one is None else [name.strip() for name in one.split(",")]
            for one in (coordinates, actuators)
        )
        shapes = inputs[0] if inputs[0].suffix.lower() == SUFFIX["urdf"] else None
        return write_package(inputs, out, ros2_files(robot, prefix, ends, others, None, shapes), force)
    if prefix or coordinates or actuators or force:
        raise click.UsageError("--prefix, --coordinates, --actuators and --force belong to --format ros2")
    if _SCENE in (format_, out.suffix.lower()[1:]):
        return _write_scene(robot, inputs, motion_file, package_dirs, out)
    if motion_file is not None or package_dirs:
        raise click.UsageError(f"--motion and --package-dir belong to {_SCENE}")
    protect(inputs, [out, *([out.with_suffix(".yaml")] if out.suffix.lower() == SUFFIX["urdf"] else [])])
    texts = contents(robot, out, format_)
    with together():
        written = [write_atomic(path, text) for path, text in texts.items()]
    print_written(Console(), written)
    return 0


def write_package(inputs: Iterable[Path | None], out: Path, files: dict[str, str], force: bool) -> int:
    """Write a package for ROS 2."""
    from p3dof.codegen.ros2 import write_ros2

    if out.suffix:
        raise click.UsageError(f"--out: expected a folder for a package of ROS 2, got {out}")
    protect(inputs, [out / name for name in files])
    print_written(Console(), write_ros2(files, out, force))
    return 0


def _write_scene(
    robot: ClosedLoopModel,
    inputs: list[Path],
    motion_file: Path | None,
    package_dirs: tuple[Path, ...],
    out: Path,
) -> int:
    """Write a robot as glTF, moving if there is a motion."""
    from p3dof.runs.forces_along import forces_along
    from p3dof.viewer.document.document import robot_document
    from p3dof.viewer.document.glb import save_glb
    from p3dof.viewer.document.motion import JointMotion

    protect([*inputs, *([] if motion_file is None else [motion_file])], [out])
    run = None if motion_file is None else forces_along(robot, source(motion_file), watch=progress_bar)
    console = Console()
    figure = figure_of(robot, inputs[0], package_dirs)
    motion = None if run is None else JointMotion(run.time, run.q)
    document = robot_document(robot, figure, motion)
    print_warnings(console, document["runs"][0]["notes"])
    print_written(console, [save_glb(out, document)])
    return 0
