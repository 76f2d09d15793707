"""`p3dof urdf` and `p3dof export`: the model as files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import click
from rich.console import Console

from p3dof._base.errors import MissingExtraError, ModelError, P3dofError
from p3dof._base.files import together
from p3dof._base.model_files import PACKAGE_PATH
from p3dof.cli.app import app
from p3dof.cli.files import CHECK, FORCE, STREAM, InputFile, OutputFolder, print_check, protect, source
from p3dof.cli.machine import PARAMETERS, machine_of, say_payloads
from p3dof.cli.output import deliver, print_plain, print_written, say
from p3dof.machine import description
from p3dof.machine.motion import Motion, paper_motion

T = TypeVar("T")

_SCENE, _ROS2 = "glb", "ros2"
OUT_FOLDER = click.option(
    "--out",
    type=OutputFolder(stream=True),
    help="Folder to write to, - for the standard output; by default urdf for the paper's machine, out/urdf "
    "for another one.",
)


@app.command()
@PARAMETERS
@OUT_FOLDER
@CHECK
@FORCE
@click.option("--exact", is_flag=True, help="Keep massless links massless; many programs cannot read them.")
def urdf(parameters: Path | None, out: Path | None, check: bool, force: bool, exact: bool) -> int:
    """Write the URDF and its sidecar (YAML: loop closures, actuated joints), or check existing ones."""
    return _write_or_check(Job(parameters, out, ("urdf",), exact, force), check)


@app.command()
@PARAMETERS
@OUT_FOLDER
@CHECK
@FORCE
@click.option(
    "--format",
    "formats",
    type=click.Choice(("all", *description.FORMATS, _SCENE, _ROS2)),
    multiple=True,
    default=("all",),
    help="Format to write; repeatable. all leaves out, with the reason, what cannot hold the machine, as its "
    "counterbalances, or whose library is not installed. Not part of all are glb, the moving machine for "
    "browsers, presentations and Blender, and ros2, a package for ROS 2.",
)
@click.option(
    "--motion",
    "motion_file",
    type=InputFile(),
    help="Motion file of the glb (CSV); by default the paper's motion.",
)
@click.option("--prefix", help="Prefix of all names and files of a ROS package, and its name.")
def export(
    parameters: Path | None,
    out: Path | None,
    check: bool,
    force: bool,
    formats: tuple[str, ...],
    motion_file: Path | None,
    prefix: str | None,
) -> int:
    """Write the model for other tools, with its loop closures where the format has them."""
    alone = {_SCENE, _ROS2} & {*formats}
    if alone and (len({*formats}) > 1 or check or out == STREAM):
        raise click.UsageError(f"--format {min(alone)} goes with no other one, no --check and no stream")
    if prefix is not None and _ROS2 not in formats:
        raise click.UsageError(f"--prefix belongs to --format {_ROS2}")
    if _SCENE in formats:
        return _write_scene(parameters, motion_file, Job(parameters, out, ()).folder)
    if motion_file is not None:
        raise click.UsageError(f"--motion belongs to --format {_SCENE}")
    if _ROS2 in formats:
        return _write_ros2(parameters, out or Path("out/ros2"), prefix, force)
    whole = "all" in formats
    chosen = tuple(description.FORMATS) if whole else tuple(dict.fromkeys(formats))
    return _write_or_check(Job(parameters, out, chosen, force=force, skip=whole), check)


def _write_scene(parameters: Path | None, motion_file: Path | None, folder: Path) -> int:
    """Write the machine as glTF, moving; samples that it cannot reach are passed over."""
    from p3dof.viewer.document.glb import save_glb
    from p3dof.viewer.machine.document import page_document

    path = folder / f"p3dof.{_SCENE}"
    protect((parameters, motion_file), [path])
    console, robot = Console(), machine_of(parameters)
    say_payloads(console, robot.parameters, parameters)
    motion = paper_motion(1001) if motion_file is None else Motion.from_csv(source(motion_file))
    result = robot.inverse_dynamics(motion, on_invalid="nan", method="compiled")
    left_out = len(motion) - int(result.valid.sum())
    if left_out:
        say(f"{left_out} of {len(motion)} samples are not valid, and left out")
    print_plain(console, f"wrote {save_glb(path, page_document(robot, result))}")
    return 0


def _write_ros2(parameters: Path | None, folder: Path, prefix: str | None, force: bool) -> int:
    """Write the machine as a package for ROS 2."""
    from p3dof.cli.loop.export import write_package
    from p3dof.codegen.ros2 import ros2_files
    from p3dof.loops import load_robot

    machine = machine_of(parameters).parameters
    say_payloads(Console(), machine, parameters)
    urdf, loops = description.texts(machine, ("urdf",)).values()
    files = ros2_files(load_robot(urdf, loops), prefix, description=urdf)
    return write_package((parameters,), folder, files, force)


@dataclass(frozen=True)
class Job:
    """What to write, and where to."""

    parameters: Path | None  # file of the machine
    out: Path | None  # folder
    formats: tuple[str, ...]  # names in `p3dof.machine.description.FORMATS`
    exact: bool = False  # whether massless links stay so
    force: bool = False  # whether to write over foreign files
    skip: bool = False  # whether to say which formats cannot hold the machine or be written here, and go on

    @property
    def folder(self) -> Path:
        """Where the files are: those of the paper's machine have a place of their own."""
        return self.out or Path("urdf" if self.parameters is None else "out/urdf")

    def of_each(self, folder: Path, act: Callable[[str], list[T]]) -> list[T]:
        """Do something with every format that can be written here, one at least."""
        done, left_out = list[T](), dict[str, P3dofError]()
        for name in self.formats:
            done += self._of_one(name, act, left_out)
        for name, error in left_out.items():
            old = [str(folder / file) for file in description.FORMATS[name] if (folder / file).exists()]
            say(f"{name} left out: {error}" + f"; {' and '.join(old)} stays as it was" * bool(old))
        return done

    def _of_one(self, name: str, act: Callable[[str], list[T]], left_out: dict[str, P3dofError]) -> list[T]:
        try:
            return act(name)
        except (MissingExtraError, ModelError) as error:
            left_out[name] = error
            if not self.skip or len(left_out) == len(self.formats):
                raise
            return []


def _print_text(job: Job) -> int:
    """Write the one file of a format to the standard output, and say aside what belongs to it."""
    if len(job.formats) != 1:
        raise click.UsageError("--out -: expected one --format for the standard output")
    protect((job.parameters,), ())
    texts = description.texts(machine_of(job.parameters).parameters, job.formats, job.exact)
    (_, text), *others = texts.items()
    deliver(text)
    for name, _ in others:
        say(f"{name}, which belongs to it, is written to a folder only")
    return 0


def _write_or_check(job: Job, check: bool) -> int:
    folder = job.folder
    if job.out == STREAM and not check:
        return _print_text(job)
    if check:
        if job.out == STREAM:
            raise click.UsageError("--check: expected the folder of the files to check, not -")
        if job.out is None and job.parameters is None and not folder.is_dir():
            folder = Path(PACKAGE_PATH)
            say("there is no folder urdf here: the files that come with p3dof are checked")
        machine = machine_of(job.parameters).parameters
        found = job.of_each(folder, lambda name: description.check(machine, folder, (name,), job.exact))
        return print_check({folder: found})
    protect((job.parameters,), [folder / file for name in job.formats for file in description.FORMATS[name]])
    machine, console = machine_of(job.parameters).parameters, Console()
    say_payloads(console, machine, job.parameters)
    with together():
        written = job.of_each(
            folder, lambda name: description.write(machine, folder, (name,), job.exact, job.force)
        )
    print_written(console, written)
    return 0
