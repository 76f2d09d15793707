"""Files of the command line: what may be read and written is known before the work, and ``-`` is a stream."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import click
from rich.console import Console

from p3dof._base.errors import P3dofError
from p3dof._base.files import SUFFIXES, check_writable, scratch_folder, suffix_of, together

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STREAM = Path("-")
"""Stands for the standard input or output."""


def file_name(path: Path | None) -> str | None:
    """Return the name of a file without its folder, ``-`` for a stream."""
    return None if path is None else path.name


class InputFile(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # generic in newer versions only
    """A file to read, or ``-`` for the standard input."""

    name = "FILE"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Return the path."""
        path = Path(value)
        if str(value) == "-" and sys.stdin is None:
            self.fail("the standard input is closed", param, ctx)
        return path.absolute() if path == STREAM and str(value) != "-" else path


class OutputFile(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # likewise
    """A file to write, whose ending fits what is written.

    Parameters
    ----------
    kind : str
        A key of `p3dof._base.files.SUFFIXES`.
    stream : bool
        Whether it may be the standard output, ``-``.
    """

    name = "FILE"

    def __init__(self, kind: str, stream: bool = False) -> None:
        self._kind, self._stream = kind, stream

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Return the path."""
        if str(value) == "-" and self._stream:
            return _standard_output(param, ctx)
        try:
            suffix = suffix_of(value, self._kind)
        except P3dofError as error:
            self.fail(str(error), param, ctx)
        _require_library(self._kind, suffix)
        return Path(value)


def _require_library(kind: str, suffix: str) -> None:
    """Raise `MissingExtraError` if what such a file is made with is not installed."""
    if kind == "figure":
        from p3dof.report.plots.common import require_figures

        require_figures()
    if kind == "report":
        from p3dof.report.templates import require_reports

        require_reports()
    if kind in ("report", "film", "picture", "show") and suffix != ".html":
        from p3dof.viewer.headless import require_playwright

        require_playwright()


class OutputFolder(click.ParamType):  # type: ignore[type-arg,unused-ignore]  # likewise
    """A folder to write files to.

    Parameters
    ----------
    stream : bool
        Whether it may be the standard output, ``-``, instead.
    """

    name = "FOLDER"

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
        return _standard_output(param, ctx)


_FILES = {".c", ".h", ".mjs", ".wasm", ".usda", ".json", *(end for ends in SUFFIXES.values() for end in ends)}
"""How names end that are those of files rather than of folders."""


def _standard_output(param: click.Parameter | None, ctx: click.Context | None) -> Path:
    """Return `STREAM`, unless what is written there would be lost."""
    if getattr(sys.stdout, "name", None) == os.devnull:  # what stands for a stream that the caller closed
        raise click.BadParameter("the standard output is closed", ctx, param)
    return STREAM


def _as_json(ctx: click.Context, param: click.Parameter, value: bool) -> bool:
    return value and bool(_standard_output(param, ctx))


JSON = click.option(
    "--json",
    "as_json",
    is_flag=True,
    callback=_as_json,
    help="Print the numbers as JSON, in SI units, and nothing else.",
)


def source(path: Path) -> Path | IO[bytes]:
    """Return what to read for a path of the command line: the file, or the standard input."""
    if path != STREAM:
        return path
    stdin: Any = sys.stdin
    stream: IO[bytes] = getattr(stdin, "buffer", stdin)
    return stream


def protect(inputs: Iterable[Path | None], outputs: Iterable[Path | None]) -> None:
    """Refuse, before the work, to write over a file that is read, twice to one file, or where nothing can be.

    Parameters
    ----------
    inputs, outputs : iterable of Path or None
        What a command reads and writes.

    Raises
    ------
    UsageError
        If an output is used already, or two inputs are the standard input.
    FileError
        If an output cannot be written.
    """
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


def write_results(
    save: Callable[[Path], Path],
    out: Path | None,
    draw: Callable[[], Figure] | None = None,
    figure: Path | None = None,
) -> list[Path]:
    """Write what a command found, as a table and a figure, both or none.

    Parameters
    ----------
    save : callable
        Writes the table to a path.
    out : Path, optional
        Where to; the standard output if it is `STREAM`.
    draw : callable
        Returns the figure.
    figure : Path, optional
        Where to.

    Returns
    -------
    list of Path
        The files written.
    """
    written = []
    with together():
        if out is not None and out != STREAM:
            written.append(save(out))
        if figure is not None and draw is not None:
            from p3dof.report import plots

            written.append(plots.save(draw(), figure))
    if out == STREAM:
        with scratch_folder() as folder:
            table = save(folder / "table.csv")
            with table.open(encoding="utf-8", newline="") as lines:
                shutil.copyfileobj(lines, sys.stdout)
    return written
