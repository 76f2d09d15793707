"""`p3dof urdf` and `p3dof export`: the model as files."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import click
from rich.console import Console

from p3dof._base.errors import MissingExtraError
from p3dof._base.files import together
from p3dof.cli.app import app
from p3dof.cli.files import STREAM, InputFile, OutputFolder, protect, source
from p3dof.cli.machine import PARAMETERS, machine_of
from p3dof.cli.output import print_plain, say
from p3dof.cli.payloads import say_payloads
from p3dof.machine import description
from p3dof.machine.motion import Motion, paper_motion
from p3dof.viewer.document.document import page_document
from p3dof.viewer.document.glb import save_glb

T = TypeVar("T")

_SCENE = "glb"
SHOWN = 20
"""Most differences that ``--check`` prints."""

OUT_FOLDER = click.option(
    "--out",
    type=OutputFolder(stream=True),
    help="Folder of the generated files; urdf for the paper's machine and out/urdf for another one without "
    "it, - for the standard output.",
)
CHECK = click.option("--check", is_flag=True, help="Write nothing; exit code 1 if the files there differ.")
FORCE = click.option(
    "--force",
    is_flag=True,
    help="Write over files of the paper's machine, and over foreign ones.",
)

WASM = click.option(
    "--wasm",
    is_flag=True,
    help="WebAssembly too, for browsers and Node, and JavaScript that loads it; needs clang and lld.",
)


@app.command()
@PARAMETERS
@OUT_FOLDER
@CHECK
@FORCE
@click.option("--exact", is_flag=True, help="Leave massless links massless, which many readers misread.")
def urdf(parameters: Path | None, out: Path | None, check: bool, force: bool, exact: bool) -> int:
    """Write the URDF and its sidecar (loop closures, actuated joints), or check those in a folder."""
    return _write_or_check(Job(parameters, out, ("urdf",), exact, force), check)


@app.command()
@PARAMETERS
@OUT_FOLDER
@CHECK
@FORCE
@click.option(
    "--format",
    "formats",
    type=click.Choice(("all", *description.FORMATS, _SCENE)),
    multiple=True,
    default=("all",),
    show_default=True,
    help="What to write; may be given several times. 'glb', which 'all' leaves out, is the moving machine to "
    "look at, for browsers, presentations and Blender.",
)
@click.option(
    "--motion",
    "motion_file",
    type=InputFile(),
    help="With glb: the motion that it makes (CSV); the paper's without it.",
)
def export(
    parameters: Path | None,
    out: Path | None,
    check: bool,
    force: bool,
    formats: tuple[str, ...],
    motion_file: Path | None,
) -> int:
    """Write the model for other tools, with its loops where the format can hold them."""
    if _SCENE in formats:
        if len(formats) > 1 or check or out == STREAM:
            raise click.UsageError(f"--format {_SCENE} goes with no other one, no --check and no stream")
        return _write_scene(parameters, motion_file, Job(parameters, out, ()).folder)
    if motion_file is not None:
        raise click.UsageError(f"--motion belongs to --format {_SCENE}")
    whole = "all" in formats
    chosen = tuple(description.FORMATS) if whole else tuple(dict.fromkeys(formats))
    return _write_or_check(Job(parameters, out, chosen, force=force, skip_missing=whole), check)


def _write_scene(parameters: Path | None, motion_file: Path | None, folder: Path) -> int:
    """Write the machine as glTF, moving; samples that it cannot reach are passed over."""
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


@dataclass(frozen=True)
class Job:
    """What to write, and where to.

    Parameters
    ----------
    parameters : Path, optional
        File of the machine.
    out : Path, optional
        Folder.
    formats : tuple of str
        Names in `p3dof.machine.description.FORMATS`.
    exact : bool
        Whether massless links stay so.
    force : bool
        Whether to write over foreign files.
    skip_missing : bool
        Whether to pass over a format, aloud, whose library is not installed.
    """

    parameters: Path | None
    out: Path | None
    formats: tuple[str, ...]
    exact: bool = False
    force: bool = False
    skip_missing: bool = False

    @property
    def folder(self) -> Path:
        """Where the files are: those of the paper's machine have a place of their own."""
        return self.out or Path("urdf" if self.parameters is None else "out/urdf")

    def of_each(self, act: Callable[[str], list[T]]) -> list[T]:
        """Do something with every format that can be written here."""
        return [item for name in self.formats for item in self._of_one(name, act)]

    def _of_one(self, name: str, act: Callable[[str], list[T]]) -> list[T]:
        try:
            return act(name)
        except MissingExtraError as error:
            if not self.skip_missing:
                raise
            say(f"{name} left out: {error}")
            return []


def print_differences(console: Console, differences: Sequence[str]) -> None:
    """Print the first of the differences that a check found, and how many more there are."""
    for line in differences[:SHOWN]:
        print_plain(console, line)
    if len(differences) > SHOWN:
        print_plain(console, f"... and {len(differences) - SHOWN} more differences")


def _print_text(job: Job) -> int:
    """Write the one file of a format to the standard output, and say aside what belongs to it."""
    if len(job.formats) != 1:
        raise click.UsageError("--out -: expected one --format for the standard output")
    protect((job.parameters,), ())
    texts = description.texts(machine_of(job.parameters).parameters, job.formats, job.exact)
    (_, text), *others = texts.items()
    sys.stdout.write(text)
    for name, _ in others:
        say(f"{name}, which belongs to it, is written to a folder only")
    return 0


def _write_or_check(job: Job, check: bool) -> int:
    console, folder = Console(), job.folder
    if job.out == STREAM and not check:
        return _print_text(job)
    if check:
        if job.out == STREAM:
            raise click.UsageError("--check: expected the folder of the files to check, not -")
        machine = machine_of(job.parameters).parameters
        found = job.of_each(lambda name: description.check(machine, folder, (name,), job.exact))
        print_differences(console, found)
        if not found:
            print_plain(console, f"{folder}: up to date")
        return 1 if found else 0
    protect((job.parameters,), [folder / file for name in job.formats for file in description.FORMATS[name]])
    machine = machine_of(job.parameters).parameters
    say_payloads(console, machine, job.parameters)
    with together():
        written = job.of_each(lambda name: description.write(machine, folder, (name,), job.exact, job.force))
    for path in written:
        print_plain(console, f"wrote {path}")
    return 0
