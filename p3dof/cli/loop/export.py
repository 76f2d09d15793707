"""`p3dof loop export`: any robot in other formats."""

from __future__ import annotations

import warnings
from pathlib import Path

import click
from rich.console import Console

from p3dof._base.errors import ModelWarning
from p3dof._base.files import together, write_atomic
from p3dof.cli.files import STREAM, InputFile, OutputFile, protect, source
from p3dof.cli.loop.group import loop, with_robot
from p3dof.cli.loop.motion import forces_along
from p3dof.cli.output import print_plain, print_warnings, say
from p3dof.loops import ClosedLoopModel
from p3dof.loops.writers.files import SUFFIX, contents
from p3dof.viewer.document.glb import save_glb
from p3dof.viewer.document.robots.document import robot_document
from p3dof.viewer.document.robots.figure import RobotFigure
from p3dof.viewer.document.robots.motion import JointMotion

_SCENE = "glb"


@loop.command()
@with_robot
@click.option(
    "--format",
    "format_",
    type=click.Choice([*SUFFIX, _SCENE]),
    help="By default what the name of the file ends in: .urdf, .xml (MJCF), .sdf, .glb. Drake reads SDF with "
    "loops in elements of its own.",
)
@click.option(
    "--motion",
    "motion_file",
    type=InputFile(),
    help="With glb: motion of the actuated joints that it makes, as of 'forces'; it stands still without.",
)
@click.option(
    "--package-dir",
    "package_dirs",
    type=InputFile(),
    multiple=True,
    help="With glb: folder with the packages of 'package://', or one of them. Meshes are opened in these "
    "folders and in that of FILE only.",
)
@click.option(
    "--out",
    type=OutputFile("exported robot"),
    required=True,
    help="The file; the sidecar of a URDF is written beside it, with the ending .yaml.",
)
def export(
    robot: ClosedLoopModel,
    inputs: list[Path],
    format_: str | None,
    motion_file: Path | None,
    package_dirs: tuple[Path, ...],
    out: Path,
) -> int:
    """Write a robot as URDF and sidecar, MJCF or SDF, with all its loops; or as glTF, to look at.

    The forces of all motions stay the same. What a format cannot hold is an error that names it. Meshes are
    written to glTF only (.glb): the shapes of the file, or rods, moving, for browsers, presentations and
    Blender.
    """
    if _SCENE in (format_, out.suffix.lower()[1:]):
        return _write_scene(robot, inputs, motion_file, package_dirs, out)
    if motion_file is not None or package_dirs:
        raise click.UsageError(f"--motion and --package-dir belong to {_SCENE}")
    protect(inputs, [out, *([out.with_suffix(".yaml")] if out.suffix.lower() == SUFFIX["urdf"] else [])])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ModelWarning)
        texts = contents(robot, out, format_)
    for warning in caught:
        if issubclass(warning.category, ModelWarning):
            say(str(warning.message))
    with together():
        written = [write_atomic(path, text) for path, text in texts.items()]
    console = Console()
    for path in written:
        print_plain(console, f"wrote {path}")
    return 0


def _write_scene(
    robot: ClosedLoopModel,
    inputs: list[Path],
    motion_file: Path | None,
    package_dirs: tuple[Path, ...],
    out: Path,
) -> int:
    """Write a robot as glTF, moving if there is a motion."""
    protect([*inputs, *([] if motion_file is None else [motion_file])], [out])
    run = None if motion_file is None else forces_along(robot, source(motion_file))
    console = Console()
    figure = RobotFigure(robot, str(inputs[0]) if inputs[0] != STREAM else None, package_dirs)
    motion = None if run is None else JointMotion(run.time, run.q)
    document = robot_document(robot, figure, motion)
    print_warnings(console, document["runs"][0]["notes"])
    print_plain(console, f"wrote {save_glb(out, document)}")
    return 0
