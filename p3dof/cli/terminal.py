"""Tables on any terminal, however narrow it is."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

from p3dof._base.checks import visible
from p3dof.cli.encoding import spelled


def print_table(console: Console, table: Table) -> None:
    """Print a table without breaking a number or a name, however narrow the terminal is.

    Headers wrap between words. Where that is too wide, the frame is left out; where even that is, each row
    becomes lines of ``column: value``.

    Parameters
    ----------
    console : rich.console.Console
        Where to print it.
    table : rich.table.Table
        The table; every cell holds text.
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
    fitting = Table(title=Text(title, "table.title") if title else None, **looks)
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
    like = Table(**looks)
    for _ in range(columns):
        like.add_column("", width=1)
    return console.measure(like, options=console.options.update_width(10_000)).maximum - columns


def _print_lines(console: Console, title: str, headers: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print rows one below the other, each as its first cell and ``column: value`` lines."""
    lines = [title] if title else []
    for row in rows:
        lines.append(f"{headers[0]}: {row[0]}" if headers[0].strip() else row[0])
        named = zip(headers[1:], row[1:], strict=True)
        lines += [f"  {' '.join(header.split())}: {cell.strip()}" for header, cell in named if cell.strip()]
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
