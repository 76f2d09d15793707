"""Files of the command line, generated ones too: what may be read and written is known before the work.

``-`` is a stream.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem
from rich.console import Console

from p3dof._base.checks import meant
from p3dof._base.errors import MissingExtraError, P3dofError
from p3dof._base.files import SUFFIXES, check_generated, check_writable, suffix_of, together, write_generated
from p3dof._base.tables import require_xarray
from p3dof.cli.app import require_standard_output
from p3dof.cli.output import print_plain, say, streamed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from p3dof.codegen.webassembly import WebFiles

STREAM = Path("-")
"""Stands for the standard input or output."""


def file_name(path: Path | None) -> str | None:
    """Return the name of a file without its folder, ``-`` for a stream."""
    return None if path is None else path.name


class _Named(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # generic in newer versions only
    """What a shell completes as the name of a file, or of a folder."""

    name = "FILE"

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """Let the shell look for names."""
        del ctx, param
        return [CompletionItem(incomplete, type="dir" if self.name == "FOLDER" else "file")]


class InputFile(_Named):
    """A file to read, or ``-`` for the standard input."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Return the path."""
        path = Path(value)
        if str(value) == "-" and sys.stdin is None:
            self.fail("the standard input is closed", param, ctx)
        if path.suffix and path.parent.is_dir() and not path.exists():
            near = meant(path.stem, (one.stem for one in path.parent.iterdir() if one.suffix == path.suffix))
            if near:
                named = re.sub("'([^']+)'", rf"'\1{path.suffix}'", near)
                self.fail(f"there is no file {value}{named}", param, ctx)
        return path.absolute() if path == STREAM and str(value) != "-" else path


class InputFolder(_Named):
    """A folder to read from."""

    name = "FOLDER"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Return the path."""
        if not Path(value).is_dir():
            self.fail(f"expected a folder, got {value}", param, ctx)
        return Path(value)


class OutputFile(_Named):
    """A file to write, whose ending fits what is written; perhaps a folder, whose name has none.

    ``-`` is the standard output: the first kind that fits goes there when the command has ended, or what is a
    `stream` piece by piece.
    """

    writes = True

    def __init__(self, kind: str, stream: bool = False, folder: bool = False) -> None:
        self._kind, self._stream, self._folder = kind, stream, folder

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Return the path."""
        named = str(value) != "-" or ctx is None
        if self._folder and named and not Path(value).suffix and str(value):
            return Path(value)
        try:
            suffix = suffix_of(value, self._kind) if named else SUFFIXES[self._kind][0]
            _require_library(self._kind, suffix)
        except P3dofError as error:
            self.fail(str(error), param, ctx)
        if ctx is None or named:
            return Path(value)
        require_standard_output(param, ctx)
        return STREAM if self._stream else streamed(f"output{suffix}", ctx)


def _require_library(kind: str, suffix: str) -> None:
    """Raise `MissingExtraError` if what such a file is made with is not installed."""
    if kind == "figure":
        from p3dof.report.plots.common import require_figures

        require_figures()
    if kind == "report":
        from p3dof.report.templates import require_reports

        require_reports()
    if kind == "map":
        require_xarray(f"a map ({suffix})")
    if kind in ("report", "film", "picture", "show") and suffix != ".html":
        from p3dof.viewer.headless import require_playwright

        require_playwright()


class OutputFolder(_Named):
    """A folder to write files to."""

    name = "FOLDER"
    writes = True

    def __init__(self, stream: bool = False) -> None:
        self._stream = stream

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Return the path."""
        if not str(value):
            self.fail("expected a folder, got an empty name", param, ctx)
        if str(value) != "-":
            path = Path(value)
            if path.suffix.lower() in _FILES and str(value)[-1] not in "/\\" and not path.is_dir():
                self.fail(f"expected a folder, got the name of a file, {value} ({value}/ is one)", param, ctx)
            return path.absolute() if path == STREAM else path
        if not self._stream:
            self.fail("expected a folder: several files do not fit into the standard output", param, ctx)
        require_standard_output(param, ctx)
        return STREAM


_FILES = {".c", ".h", ".mjs", ".wasm", ".usda", ".json", *(end for ends in SUFFIXES.values() for end in ends)}
"""How names end that are those of files rather than of folders."""


def out_folder(what: str, default: str = "out") -> Callable[[Any], Any]:
    """Return --out of what writes a folder by default."""
    words = f"Folder to write {what} to."
    return click.option("--out", type=OutputFolder(), default=default, help=words)


def source(path: Path) -> Path | IO[bytes]:
    """Return what to read for a path of the command line: the file, or the standard input."""
    if path != STREAM:
        return path
    stdin: Any = sys.stdin
    stream: IO[bytes] = getattr(stdin, "buffer", stdin)
    return stream


def protect(inputs: Iterable[Path | None], outputs: Iterable[Path | None]) -> None:
    """Refuse before the work to write over a file that is read, twice to one file, or where none can be."""
    given = [path for path in inputs if path is not None]
    if given.count(STREAM) > 1:
        raise click.UsageError("only one file can be read from the standard input (-)")
    used = {os.path.realpath(path) for path in given if path != STREAM}  # Path.resolve fails at a loop
    for path in outputs:
        if path is None or path == STREAM:
            continue
        check_writable(path)
        if os.path.realpath(path) in used:
            raise click.UsageError(f"{path} would be overwritten: it is already used by this command")
        used.add(os.path.realpath(path))


def console_beside(*outputs: Path | None) -> Console:
    """Return where to print: the standard error where the standard output takes a file."""
    return Console(stderr=STREAM in outputs)


def save_figure(draw: Callable[[Any], Figure], *paths: Path | None) -> list[Path]:
    """Draw a figure, if it is asked for, with the room `p3dof.report.plots`; return the files written."""
    wanted = [path for path in paths if path is not None]
    if not wanted:
        return []
    from p3dof.report import plots

    figure = draw(plots)
    return [plots.save(figure, path) for path in wanted]


def save_figure_if_possible(draw: Callable[[Any], Figure], *paths: Path | None) -> list[Path]:
    """Likewise; say that there is none where matplotlib is not installed."""
    try:
        return save_figure(draw, *paths)
    except MissingExtraError as error:
        say(f"no figure: {error}")
        return []


def write_results(
    save: Callable[[Path], Path],
    out: Path | None,
    figure: Path | None = None,
    draw: Callable[[Any], Figure] | None = None,
) -> list[Path]:
    """Write what a command found, as a table and a figure, both or none; the files written."""
    written = []
    with together():
        if out is not None:
            written.append(save(out))
        if draw is not None:
            written += save_figure(draw, figure)
    return written


TOLERANCE = 1e-9
"""Relative difference of numbers that ``--check`` lets pass in the C of a controller: a change of the machine
that matters is more, other last bits on another processor are less."""
SHOWN = 20
"""Most differences that ``--check`` prints."""

CHECK = click.option("--check", is_flag=True, help="Write nothing; exit code 1 if the existing files differ.")
FORCE = click.option(
    "--force",
    is_flag=True,
    help="Overwrite files of the paper's machine, and files that p3dof did not write.",
)
CPU = click.option(
    "--cpu",
    default="native",
    help="Processor that the Makefile compiles for, by the compiler's name (haswell, cortex-a72); native: "
    "the one where make runs; '': any of its family.",
)
WASM = click.option(
    "--wasm",
    is_flag=True,
    help="Also WebAssembly for browsers and Node, and JavaScript that loads it; needs clang and lld.",
)


@dataclass(frozen=True)
class Generated:
    """C for a folder, and the WebAssembly that is built from it."""

    texts: Mapping[str, str]  # by file name
    folder: Path
    prefix: str  # what its names begin with
    mark: str  # in what was generated
    tolerance: float = TOLERANCE
    web: WebFiles | None = None

    @classmethod
    def of(cls, texts: Mapping[str, str], folder: Path, mark: str, web: WebFiles, wasm: bool) -> Generated:
        """Return the C of a controller, with its WebAssembly if that is wanted."""
        found = {**texts, **web.texts()} if wasm else texts
        return cls(found, folder, web.module.prefix, mark, web=web if wasm else None)

    @property
    def paths(self) -> list[Path]:
        """All files."""
        return [self.folder / name for name in (*self.texts, *(self.web.names if self.web else ()))]

    def differences(self) -> list[str]:
        """Return in what the files that are there differ, a line each."""
        found = check_generated(self.texts, self.folder, self.tolerance)
        return found + (self.web.check(self.folder) if self.web else [])

    def write(self, force: bool) -> list[Path]:
        """Write the files; over foreign ones by force only."""
        from p3dof.codegen.naming import of_another

        with together():
            written = write_generated(self.texts, self.folder, self.mark, force, of_another(self.prefix))
            return written + ([self.web.write(self.folder, self.texts, force)] if self.web else [])


def print_check(found: Mapping[Path, Sequence[str]]) -> int:
    """Print what a check found by folder or file: the first of the differences; return the exit code."""
    console = Console()
    for place, differences in found.items():
        if not differences:
            print_plain(console, f"{place}: up to date")
    lines = [line for differences in found.values() for line in differences]
    for line in lines[:SHOWN]:
        print_plain(console, line)
    if len(lines) > SHOWN:
        print_plain(console, f"... and {len(lines) - SHOWN} more differences")
    return 1 if lines else 0
