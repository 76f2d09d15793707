"""What the commands show: tables on any terminal, warnings, a progress bar."""

from __future__ import annotations

import json
import logging
import math
import shutil
import sys
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click
import numpy as np
import rich.table
from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

from p3dof._base.checks import one_line, visible
from p3dof._base.errors import LOG, P3dofError
from p3dof._base.files import scratch_folder
from p3dof._base.tables import NONE, Numeral, Table
from p3dof.cli.app import LONGEST, Command, spelled


@dataclass
class Answer:
    """What a command has to tell: printed piece by piece, not at all, or as one JSON document."""

    silent: bool = False  # nothing but warnings is printed on the way
    as_json: bool = False  # not even these
    beside: bool = False  # a file takes the standard output
    streams: list[Path] = field(default_factory=list)  # files that go there when the command has ended
    data: dict[str, Any] = field(default_factory=dict)  # results by name
    tables: list[Table] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    files: list[str] = field(default_factory=list)  # that were written

    def document(self) -> dict[str, Any]:
        """Return all as plain data; numbers that do not exist are null."""
        kept = ("title", "header", "rows", "note")
        tables = [{name: getattr(table, name) for name in kept} for table in self.tables]
        own = {"tables": tables, "notes": self.notes, "warnings": self.warnings, "files": self.files}
        return {name: plain(value) for name, value in (self.data | own).items()}


_current: ContextVar[Answer | None] = ContextVar("_current", default=None)


def _answer() -> Answer:
    """Return that of the command that runs; one that is printed and forgotten outside of any."""
    return _current.get() or Answer()


@contextmanager
def printing(ctx: click.Context) -> Iterator[None]:
    """Print what a command tells as --json and --quiet say; then write what goes to the standard output."""
    as_json, quiet = (bool(ctx.meta.get(f"p3dof.{name}")) for name in ("json", "quiet"))
    answer = Answer(as_json or quiet, as_json, streams=ctx.meta.get("p3dof.streams", []))
    outputs = [one.name for one in ctx.command.params if getattr(one.type, "writes", False)]
    count = len(answer.streams) + sum(str(ctx.params.get(name)) == "-" for name in outputs)
    if as_json and count:
        raise click.UsageError("--json and --out - both take the standard output")
    if count > 1:
        raise click.UsageError("only one file can be written to the standard output (-)")
    answer.beside = count > 0
    before = _current.set(answer)
    try:
        yield
    finally:
        _current.reset(before)
    for path in filter(Path.exists, answer.streams):
        with path.open("rb") as file:
            _copy(file)
    if as_json:
        sys.stdout.write(json.dumps(answer.document(), indent=1) + "\n")


Command.printing = staticmethod(printing)  # type: ignore[method-assign]


def _copy(file: Any) -> None:
    """Copy the bytes of a file to the standard output, which may be one of text only."""
    stdout: Any = sys.stdout
    if hasattr(stdout, "buffer"):
        stdout.flush()
        shutil.copyfileobj(file, stdout.buffer)
    else:
        stdout.write(file.read().decode())


def streamed(name: str, ctx: click.Context) -> Path:
    """Return the path of a file that goes to the standard output when the command has ended well."""
    path = ctx.with_resource(scratch_folder()) / name
    ctx.meta.setdefault("p3dof.streams", []).append(path)
    return path


def give(data: Mapping[str, Any]) -> None:
    """Add results by name to the JSON document of --json."""
    _answer().data.update(data)


def plain(value: Any) -> Any:
    """Return a value as JSON has it: lists in place of arrays, null in place of NaN and infinity."""
    if isinstance(value, Mapping):
        return {str(name): plain(one) for name, one in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    value = value.value if isinstance(value, Numeral) else value
    return None if isinstance(value, float) and not math.isfinite(value) else value


def deliver(text: str) -> None:
    """Write a text that is the result of a command itself, such as a program."""
    give({"text": text})
    if not _answer().silent:
        sys.stdout.write(text)


@contextmanager
def in_options(words: Mapping[str, str]) -> Iterator[None]:
    """Name arguments of Python as a command has them, in errors and on Ctrl-C."""
    try:
        yield
    except (P3dofError, KeyboardInterrupt) as error:
        if error.args and isinstance(error.args[0], str):
            told = error.args[0]
            for python, option in words.items():
                told = told.replace(python, option)
            error.args = (told, *error.args[1:])
        raise


@contextmanager
def progress_bar(name: str, total: int) -> Iterator[Update | None]:
    """Show a bar while something works; nothing at all where nobody looks."""
    console = Console(stderr=True)
    if not console.is_terminal or _answer().silent:
        yield None
        return
    columns = (TextColumn(name), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, TextColumn("{task.description}"), console=console, transient=True) as bar:
        update, level = Update(bar, total), LOG.level
        LOG.addHandler(update)
        LOG.setLevel(logging.INFO)
        try:
            yield update
        finally:
            LOG.setLevel(level)
            LOG.removeHandler(update)


class Update(logging.Handler):
    """What long work calls with how far it is; beside the bar is what is logged meanwhile."""

    def __init__(self, bar: Progress, total: int) -> None:
        super().__init__(logging.INFO)
        self._bar, self._task = bar, bar.add_task("", total=total)

    def __call__(self, done: int, total: int) -> None:
        """Show how far it is."""
        self._bar.update(self._task, completed=done, total=total, description="")

    def emit(self, record: logging.LogRecord) -> None:
        """Show what takes long before there is any progress, such as a compiler."""
        self._bar.update(self._task, description=escape(record.getMessage()))


def show(console: Console, *tables: Table, notes: bool = False) -> None:
    """Print tables of the package."""
    answer = _answer()
    answer.tables += tables
    for table in () if answer.silent else tables:
        print_table(_place(console), rich_table(table))
        if notes and table.note:
            _print_line(console, table.note)


def _place(console: Console) -> Console:
    """Return where to print: the standard error where the standard output takes a file."""
    return Console(stderr=True) if _answer().beside and not console.stderr else console


def rich_table(table: Table) -> rich.table.Table:
    """Return a table as Rich has it.

    One of many columns or rows has no frame, one of many columns has units in a line of their own.
    """
    wide = table.layout == "wide"
    looks: dict[str, Any] = {"box": SIMPLE_HEAD, "padding": 0} if table.layout in ("wide", "list") else {}
    result = rich.table.Table(title=escape(table.title), **looks)
    for i, name in enumerate(table.header):
        words = i == 0 or table.layout in ("words", "list")
        lines = name.replace(" [", "\n[").replace("] ", "]\n") if wide else name
        result.add_column(escape(lines), justify="left" if words else "right")
    for row in table.aligned():
        result.add_row(*("-" if cell == NONE else escape(cell) for cell in row))
    return result


def say(text: str) -> None:
    """Say something aside, on one line of the standard error."""
    sys.stderr.write(f"p3dof: {one_line(text, LONGEST)}\n")


def print_warnings(console: Console, warnings: Sequence[str]) -> None:
    """Print what a reader of a result should know, one line each; see `InverseDynamics.warnings`."""
    answer = _answer()
    answer.warnings += warnings
    where = Console(stderr=True) if answer.silent else _place(console)
    for warning in () if answer.as_json else warnings:
        where.print(visible(warning), style="yellow", markup=False, highlight=False, soft_wrap=True)


def print_plain(console: Console, text: str, style: str = "") -> None:
    """Print without wrapping or markup: a path stays whole and can be copied."""
    answer = _answer()
    for path in answer.streams:
        text = text.replace(str(path), "-")
    answer.notes.append(text)
    if not answer.silent:
        _print_line(console, text, style)


def _print_line(console: Console, text: str, style: str = "") -> None:
    _place(console).print(visible(text), style=style, markup=False, highlight=False, soft_wrap=True)


def print_written(console: Console, paths: Iterable[Path]) -> None:
    """Say which files were written."""
    answer = _answer()
    for path in (path for path in paths if path not in answer.streams):
        answer.files.append(str(path))
        if not answer.silent:
            _print_line(console, f"wrote {path}")


def print_table(console: Console, table: rich.table.Table) -> None:
    """Print a table without breaking a number or a name, however narrow the terminal is.

    Headers wrap between words. Where that is too wide, the frame is left out; where even that is, each row
    becomes lines of ``column: value``.
    """
    rows = [[_plain(cell, console) for cell in column.cells] for column in table.columns]
    headers = [_plain(column.header, console) for column in table.columns]
    title = _plain(table.title or "", console)
    least = [_width(cells, header.split()) for header, cells in zip(headers, rows, strict=True)]
    widths = [_width(cells, header.splitlines()) for header, cells in zip(headers, rows, strict=True)]
    looks: dict[str, Any] = {"box": table.box, "padding": table.padding}
    if sum(least) > console.width - _frame(console, len(rows), looks):
        looks = {"box": SIMPLE_HEAD, "padding": 0}
    room = console.width - _frame(console, len(rows), looks)
    if sum(least) > room:
        _print_lines(console, title, headers, list(zip(*rows, strict=True)))
        return
    while sum(widths) > room:
        widths[int(np.argmax(np.subtract(widths, least)))] -= 1
    fitting = rich.table.Table(title=Text(title, "table.title") if title else None, **looks)
    for column, header, width in zip(table.columns, headers, widths, strict=True):
        fitting.add_column(Text(header, "table.header"), justify=column.justify, width=width)
    for row in zip(*rows, strict=True):
        fitting.add_row(*map(Text, row))
    console.print(fitting)


def _plain(content: object, console: Console) -> str:
    text = Text.from_markup(content).plain if isinstance(content, str) else str(content)
    return visible(spelled(text, console.encoding))


def _width(*texts: Sequence[str]) -> int:
    return max((cell_len(text) for some in texts for text in some), default=0)


def _frame(console: Console, columns: int, looks: dict[str, Any]) -> int:
    """Return how many columns of the terminal a table needs beside its content."""
    like = rich.table.Table(**looks)
    for _ in range(columns):
        like.add_column("", width=1)
    return console.measure(like, options=console.options.update_width(10_000)).maximum - columns


def _print_lines(console: Console, title: str, headers: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print rows one below the other, each as its first cell and ``column: value`` lines."""
    lines = [title] if title else []
    for row in rows:
        lines.append(f"{headers[0]}: {row[0]}" if headers[0].strip() else row[0])
        named = zip(headers[1:], row[1:], strict=True)
        labels = ((" ".join(header.split()), cell.strip()) for header, cell in named)
        lines += [f"  {label}: {cell}" if label else f"  {cell}" for label, cell in labels if cell]
    for line in lines:
        indent = line[: len(line) - len(line.lstrip())]
        for part in _wrapped(line.strip(), indent, console.width):
            console.print(part, markup=False, highlight=False, soft_wrap=True)


def _wrapped(line: str, indent: str, width: int) -> list[str]:
    return textwrap.wrap(
        line,
        max(width, 1),
        initial_indent=indent,
        subsequent_indent=indent + "    ",
        break_long_words=False,
        break_on_hyphens=False,
    )
