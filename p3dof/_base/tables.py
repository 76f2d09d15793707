"""`Table`: texts and numbers for page, notebook and terminal; `Tabular`: columns for files and libraries."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import singledispatch
from html import escape
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import Readable, name_and_unit
from p3dof._base.errors import MissingExtraError
from p3dof._base.files import write_table

Cell: TypeAlias = float | str
"""A number that is written by what shows the table, or a text that stands as it is."""

Columns: TypeAlias = dict[str, NDArray[Any]]
"""Columns by their names, with SI units where they have one."""

Layout: TypeAlias = Literal["plain", "wide", "words", "list"]
"""Numbers in few columns or in many, words, or words in many rows."""

NONE = "–"  # what stands for a number that does not exist
_MINUS_ZERO = re.compile(r" *-0[.0]*(e[+-]\d+)?%?")
_WHOLE = 1e-9  # shares no more than this above 1 are the whole: of rounding


@dataclass(frozen=True)
class Table:
    """A table of texts and numbers."""

    title: str
    header: tuple[str, ...]  # names of the columns, with units
    rows: tuple[tuple[Cell, ...], ...]  # the first cell of each is its name
    note: str = ""  # what a reader must know besides
    layout: Layout = "plain"
    """Numbers in few columns, in many (wide), words, or words in many rows (list)."""
    decimals: int = 4  # of its numbers on a terminal, where they stand below each other

    def texts(self) -> tuple[tuple[str, ...], ...]:
        """Return the rows with six digits a number."""
        return tuple(
            tuple(cell if isinstance(cell, str) else number(cell) for cell in row) for row in self.rows
        )

    def aligned(self) -> tuple[tuple[str, ...], ...]:
        """Return the rows with `decimals` a number."""
        return tuple(
            tuple(cell if isinstance(cell, str) else formatted(cell, f".{self.decimals}f") for cell in row)
            for row in self.rows
        )


class Numeral(str):
    """A number as it is shown, which keeps its value for those who compute with it."""

    value: float

    def __new__(cls, text: str, value: float) -> Numeral:
        found = super().__new__(cls, text)
        found.value = value.item() if isinstance(value, np.generic) else value
        return found

    def __getnewargs__(self) -> tuple[str, float]:  # type: ignore[override]
        return str(self), self.value


def number(value: float, unit: str = "", form: str = ".6g") -> Numeral:
    """Return a number as a format rounds it, with up to six digits; a dash for what does not exist."""
    text = f"{float(f'{value:{form}}') + 0.0:.6g} {unit}".rstrip()
    return Numeral(NONE if math.isnan(value) else text, value)


def formatted(value: float, form: str, unit: str = "") -> Numeral:
    """Return a number in a format, a share with the unit ``"%"`` as such; a dash for what does not exist."""
    text = f"{_rounded(100 * value if unit == '%' else value, form)} {unit}".rstrip()
    return Numeral(NONE if math.isnan(value) else text, value)


def _rounded(value: float, form: str) -> str:
    """Return a number in a format; what rounds to zero has no sign, or that of zero."""
    text = f"{value:{form}}"
    return f"{0.0:{form}}" if _MINUS_ZERO.fullmatch(text) else text


def percent(share: float, decimals: int = 1) -> Numeral:
    """Return a share in percent, with decimals to show what is just above 100; ``"beyond"`` for infinity."""
    text = _rounded(share, f".{decimals + _more(share, decimals)}%") if share < math.inf else "beyond"
    return Numeral(text, share)


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
    """Return a table of numbers and texts by the names of its rows."""
    cells = tuple(
        (name, *(cell if isinstance(cell, str) else float(cell) for cell in values))
        for name, values in rows.items()
    )
    return Table(title, tuple(header), cells, note, layout, decimals)


def time_text(seconds: float) -> Numeral:
    """Return a time with three digits and the unit that suits it, as ``"72.1 µs"`` or ``"10.3 ms"``."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6), ("ns", 1e-9)):
        digits = f"{seconds / size:.3g}"
        if float(digits) >= 1 or unit == "ns":
            break
    return Numeral(f"{float(digits):.15g} {unit}", seconds)


_STYLE = """
.p3dof { font-variant-numeric: tabular-nums; color: inherit; }
.p3dof p { margin: .3em 0; }
.p3dof .scroll { overflow-x: auto; margin: .6em 0 .2em; }
.p3dof table { border-collapse: collapse; margin: 0; background: none; color: inherit; font-size: inherit; }
.p3dof caption { text-align: left; font-weight: 600; color: inherit; padding: .2em 0; white-space: nowrap; }
.p3dof tr, .p3dof tr:hover { background: none !important; }
.p3dof th, .p3dof td { color: inherit; background: none; text-align: right; padding: .2em .7em;
  white-space: nowrap; border: 0 solid currentColor;
  border-color: color-mix(in srgb, currentColor 30%, transparent); }
.p3dof tbody :is(th, td) { border-bottom-width: 1px; }
.p3dof thead th { border-bottom-width: 2px; font-weight: 600; vertical-align: bottom; white-space: normal; }
.p3dof table.wide { font-size: .9em; }
.p3dof table.wide :is(th, td):not(:first-child) { padding: .2em .5em; }
.p3dof :is(th, td):first-child { text-align: left; padding-left: 0; }
.p3dof tbody th { font-weight: 400; }
.p3dof table.words :is(th, td) { text-align: left; }
.p3dof .note { opacity: .75; font-size: .9em; max-width: 60em; }
.p3dof ul { margin: .4em 0; padding-left: 1.2em; }
.p3dof .care { border-left: .3em solid currentColor; padding: .1em .8em; margin: .5em 0; }
"""
"""Only colours of the page that it stands in: it may be dark or light."""


def table_html(table: Table) -> str:
    """Return a table as HTML, in a box that can be scrolled, with its note below."""
    wide = table.layout == "wide"
    role = "region" if wide else "group"
    region = f' tabindex="0" role="{role}" aria-label="{escape(table.title)}"'
    layout = "words" if table.layout == "list" else table.layout
    kind = "" if layout == "plain" else f' class="{layout}"'
    lines = [f'<div class="scroll"{region}>', f"<table{kind}>", f"<caption>{escape(table.title)}</caption>"]
    if table.rows:
        names = "".join(f'<th scope="col">{escape(name)}</th>' for name in table.header)
        lines += [f"<thead><tr>{names}</tr></thead>", "<tbody>"]
        for name, *cells in table.texts():
            values = "".join(f"<td>{escape(cell)}</td>" for cell in cells)
            lines.append(f'<tr><th scope="row">{escape(name)}</th>{values}</tr>')
        lines.append("</tbody>")
    lines += ["</table>", "</div>"]
    if table.note:
        lines.append(f'<p class="note">{escape(table.note)}</p>')
    return "\n".join(lines) + "\n"


def notebook_html(
    title: str, facts: str, tables: Iterable[Table], warnings: Iterable[str] = (), remark: str = ""
) -> str:
    """Return how a notebook shows what a result is, warnings, then tables; colours are the notebook's."""
    lines = [f"<style>{_STYLE}</style>", f"<p><strong>{escape(title)}</strong>: {escape(facts)}</p>"]
    items = "".join(f"<li>{escape(warning)}</li>" for warning in warnings)
    if items:
        lines.append(f'<div class="care" role="note"><strong>Warnings</strong><ul>{items}</ul></div>')
    lines += [table_html(table) for table in tables]
    if remark:
        lines.append(f'<p class="note">{escape(remark)}</p>')
    text = f'<div class="p3dof">{"".join(lines)}</div>'
    return text.encode("utf-8", "backslashreplace").decode("utf-8")  # names of files may not be text


@singledispatch
def html_of(result: object) -> str:
    """Return how a notebook shows a result: the tables of each room say it for their own."""
    raise NotImplementedError(f"a notebook has no form for {type(result).__name__}")


class ShownInNotebook(Readable):
    """Base of the results that a notebook shows as tables."""

    def _repr_html_(self) -> str:
        return html_of(self)


class Tabular(Readable):
    """Base of results with rows: a result states its columns once, and files and data frames follow."""

    _row_name: ClassVar[str] = "t"  # what the rows are counted by: the dimension of a Dataset

    def to_columns(self) -> Columns:
        """Return all columns, one value a row, by their names with SI units, such as ``"power [W]"``.

        What takes arrays by name takes them too: ``polars.DataFrame(result.to_columns())``.
        """
        raise NotImplementedError

    def to_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write the columns to a CSV file that reads back to the same bits: up to 17 significant digits.

        Parameters
        ----------
        path : path-like
            The file; replaced whole or not at all.

        Raises
        ------
        InputError
            If its name does not end in ``.csv``.
        FileError
            If the file cannot be written.
        """
        columns = self.to_columns()
        return write_table(path, list(columns), tuple(columns.values()))

    def to_dataframe(self) -> Any:
        """Return the columns as a `pandas.DataFrame`, their SI units by name in ``attrs["units"]``.

        Raises
        ------
        MissingExtraError
            If pandas is not installed.
        """
        try:
            import pandas as pd  # type: ignore[import-untyped,import-not-found,unused-ignore]
        except ImportError as error:
            raise MissingExtraError("to_dataframe needs pandas: pip install 'p3dof[xarray]'") from error
        columns = self.to_columns()
        frame = pd.DataFrame(columns)
        frame.attrs["units"] = {name: unit for name in columns if (unit := name_and_unit(name)[1])}
        return frame

    def to_dataset(self) -> Any:
        """Return the columns as an `xarray.Dataset`, with SI units as attributes.

        Raises
        ------
        MissingExtraError
            If xarray is not installed.
        """
        return dataset_of(self.to_columns(), self._row_name)


POSE_COLUMNS = ("y [m]", "z [m]", "theta [rad]")
"""What the columns of a pose are called, of the machine that this package has closed forms of."""


def columns_by(form: str, names: Iterable[str], values: NDArray[Any]) -> Columns:
    """Return the columns of an array (..., k), by a form such as ``"f{} [N]"`` and k names."""
    columns = np.moveaxis(values, -1, 0).reshape(values.shape[-1], -1)
    return {form.format(name): column for name, column in zip(names, columns, strict=True)}


def columns_of_items(items: Sequence[object], fields: Mapping[str, str]) -> Columns:
    """Return what items have in common as columns, by what each field is to be called."""
    return {name: np.array([getattr(one, field) for one in items]) for name, field in fields.items()}


def dataset_of(columns: Mapping[str, NDArray[Any]], row: str) -> Any:
    """Return columns as a Dataset; the one that is called as its dimension, or else a number, counts rows."""
    found: dict[str, Any] = {}
    for header, values in columns.items():
        name, unit = name_and_unit(header)
        name = header if name in found else name  # a name twice, with two units
        found[name] = (row, values, {"units": unit} if unit else {})
    if row not in found:
        found[row] = (row, np.arange(len(next(iter(columns.values()), ()))))
    return require_xarray().Dataset(found)


def require_xarray(what: str = "to_dataset") -> Any:
    """Return xarray; an error says what needs it."""
    try:
        import xarray  # type: ignore[import-not-found,unused-ignore]
    except ImportError as error:
        raise MissingExtraError(f"{what} needs xarray: pip install 'p3dof[xarray]'") from error
    return xarray
