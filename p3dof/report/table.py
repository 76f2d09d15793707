"""A table of a report: texts in rows and columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Table:
    """A table of texts.

    Parameters
    ----------
    title : str
        What it shows.
    header : tuple of str
        Names of the columns.
    rows : tuple of tuple of str
        The first cell of each is its name.
    note : str
        What a reader must know besides.
    """

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


def number(value: float) -> str:
    """Return a number with six digits; a dash for what does not exist."""
    return "–" if np.isnan(value) else f"{value + 0.0:.6g}"


def table_of(
    title: str, header: Sequence[str], rows: Mapping[str, Sequence[float | str]], note: str = ""
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
    note : str
        What a reader must know besides.

    Returns
    -------
    Table
    """
    cells = (
        (name, *(value if isinstance(value, str) else number(value) for value in values))
        for name, values in rows.items()
    )
    return Table(title, tuple(header), tuple(cells), note)
