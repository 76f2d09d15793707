"""What the commands show: tables, warnings, a progress bar."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import rich.table
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from p3dof._base.checks import one_line, visible
from p3dof._base.errors import P3dofError
from p3dof._base.tables import NONE, Table
from p3dof.cli.app import LONGEST
from p3dof.cli.terminal import print_table


@contextmanager
def in_options(words: Mapping[str, str]) -> Iterator[None]:
    """Name arguments of Python as a command has them, in errors and on Ctrl-C.

    Parameters
    ----------
    words : mapping of str to str
        What an error says, and what to say instead, such as ``{"resume=True": "--resume"}``.
    """
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
    if not console.is_terminal:
        yield None
        return
    columns = (TextColumn(name), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        yield Update(bar, total)


class Update:
    """What `Manipulator.inverse_dynamics` calls while it works."""

    def __init__(self, bar: Progress, total: int) -> None:
        self._bar, self._task = bar, bar.add_task("", total=total)

    def __call__(self, done: int, total: int) -> None:
        """Show how far it is."""
        self._bar.update(self._task, completed=done, total=total)


def show(console: Console, *tables: Table, notes: bool = False) -> None:
    """Print tables of the package.

    Parameters
    ----------
    console : rich.console.Console
        Where to print them.
    *tables : Table
        Numbers get as many decimals as their table says, to stand below each other.
    notes : bool
        Print what stands below each table too.
    """
    for table in tables:
        print_table(console, rich_table(table))
        if notes and table.note:
            print_plain(console, table.note)


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
    for warning in warnings:
        console.print(visible(warning), style="yellow", markup=False, highlight=False, soft_wrap=True)


def print_plain(console: Console, text: str) -> None:
    """Print without wrapping or markup: a path stays whole and can be copied."""
    console.print(visible(text), markup=False, highlight=False, soft_wrap=True)
