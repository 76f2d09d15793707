"""`Table`: texts and numbers in rows and columns, for a page, a notebook and a terminal alike."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

Cell: TypeAlias = float | str
"""A number that is written by what shows the table, or a text that stands as it is."""

Layout: TypeAlias = Literal["plain", "wide", "words", "list"]
"""Numbers in few columns or in many, words, or words in many rows."""

NONE = "–"
"""What stands for a number that does not exist."""
_WHOLE = 1e-9
"""Shares no more than this above 1 are the whole: of rounding."""


@dataclass(frozen=True)
class Table:
    """A table of texts and numbers.

    Parameters
    ----------
    title : str
        What it shows.
    header : tuple of str
        Names of the columns, with units.
    rows : tuple of tuple of str or float
        The first cell of each is its name.
    note : str
        What a reader must know besides.
    layout : {"plain", "wide", "words", "list"}
        Numbers in few columns, numbers in many, words, or words in many rows.
    decimals : int
        Of its numbers on a terminal, where they stand below each other.
    """

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""
    layout: Layout = "plain"
    decimals: int = 4

    def texts(self) -> tuple[tuple[str, ...], ...]:
        """Return the rows with six digits a number."""
        return tuple(
            tuple(cell if isinstance(cell, str) else number(cell) for cell in row) for row in self.rows
        )

    def aligned(self) -> tuple[tuple[str, ...], ...]:
        """Return the rows with `decimals` a number."""
        return tuple(
            tuple(cell if isinstance(cell, str) else fixed(cell, self.decimals) for cell in row)
            for row in self.rows
        )


def number(value: float) -> str:
    """Return a number with six digits; a dash for what does not exist."""
    return NONE if math.isnan(value) else f"{value + 0.0:.6g}"


def fixed(value: float, decimals: int) -> str:
    """Return a number with so many decimals; a dash for what does not exist."""
    return NONE if math.isnan(value) else f"{value:.{decimals}f}"


def percent(share: float, decimals: int = 1) -> str:
    """Return a share in percent; one just above the whole has so many decimals more that it shows.

    Parameters
    ----------
    share : float
        1 is the whole.
    decimals : int
        How many there are mostly.

    Returns
    -------
    str
        ``"beyond"`` for infinity: where nothing is allowed.
    """
    return f"{share:.{decimals + _more(share, decimals)}%}" if share < math.inf else "beyond"


def _more(share: float, decimals: int) -> int:
    """Return how many more decimals tell a share from the whole, if it is above it."""
    above = share - 1
    if not _WHOLE < above < 0.5 * 10 ** -(decimals + 2):
        return 0
    return math.ceil(-math.log10(above)) - 2 - decimals


def table_of(
    title: str,
    header: Sequence[str],
    rows: Mapping[str, Sequence[Cell]],
    note: str = "",
    layout: Layout = "plain",
    decimals: int = 4,
) -> Table:
    """Return a table of numbers and texts by the names of its rows.

    Parameters
    ----------
    title : str
        What it shows.
    header : sequence of str
        Names of the columns, that of the rows' names first.
    rows : mapping of str to sequence
        The cells of each row.
    note, layout, decimals
        As of `Table`.

    Returns
    -------
    Table
    """
    cells = tuple(
        (name, *(cell if isinstance(cell, str) else float(cell) for cell in values))
        for name, values in rows.items()
    )
    return Table(title, tuple(header), cells, note, layout, decimals)


def time_text(seconds: float) -> str:
    """Return a short time in words: three digits and the unit that suits it.

    Parameters
    ----------
    seconds : float
        The time [s].

    Returns
    -------
    str
        Such as ``"72.1 µs"`` or ``"10.3 ms"``.
    """
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6), ("ns", 1e-9)):
        digits = f"{seconds / size:.3g}"
        if float(digits) >= 1 or unit == "ns":
            break
    return f"{float(digits):.15g} {unit}"
