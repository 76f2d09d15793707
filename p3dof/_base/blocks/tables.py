"""Tables of what a sweep found."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from p3dof._base.blocks.reduction import Rows
from p3dof._base.blocks.results import Sweep
from p3dof._base.blocks.statistics import ColumnMoments, Counts
from p3dof._base.tables import Table, html_of, notebook_html, number, table_of

SHOWN = 20
"""Rows that a table shows of many."""

WIDE = 5
"""Columns likewise."""


def sweep_tables(sweep: Sweep) -> tuple[Table, ...]:
    """Return one table for each reduction of a sweep.

    Parameters
    ----------
    sweep : Sweep
        Complete or not.

    Returns
    -------
    tuple of Table
    """
    named = sweep.manifest.with_unit
    return tuple(_table(name, found, named) for name, found in sweep.reductions.items())


def sweep_facts(sweep: Sweep) -> str:
    """Return how far a sweep is, in one line."""
    manifest = sweep.manifest
    return (
        f"{len(sweep)} of {manifest.count} items in {len(sweep.numbers)} of {manifest.blocks} blocks, "
        f"seed {manifest.seed}, {len(manifest.keep)} of {len(manifest.columns)} columns kept"
    )


@html_of.register(Sweep)
def sweep_html(sweep: Sweep) -> str:
    """Return how a notebook shows a sweep, as HTML."""
    return notebook_html("Sweep", sweep_facts(sweep), sweep_tables(sweep), sweep.notes)


def _table(name: str, found: Any, named: Callable[[str], str]) -> Table:
    title = name[:1].upper() + name[1:]
    if isinstance(found, Rows):
        return _of_rows(title, found, named)
    if isinstance(found, Counts):
        return _of_counts(title, found, named)
    if isinstance(found, Mapping) and all(isinstance(item, ColumnMoments) for item in found.values()):
        header = ("column", "mean", "standard deviation", "smallest", "largest", "items", "without a number")
        rows = {
            named(column): (*map(number, (m.mean, m.deviation, m.low, m.high)), str(m.count), str(m.invalid))
            for column, m in found.items()
        }
        return table_of(title, header, rows)
    return Table(title, ("result",), ((str(found),),), layout="words")


def _of_rows(title: str, found: Rows, named: Callable[[str], str]) -> Table:
    columns = dict(list(found.columns.items())[:WIDE])
    rows = {
        str(item): tuple(number(float(array[i])) for array in columns.values())
        for i, item in enumerate(found.index[:SHOWN].tolist())
    }
    note = f"The first {SHOWN} of {len(found)}." if len(found) > SHOWN else ""
    if len(columns) < len(found.columns):
        note += f" {len(columns)} of {len(found.columns)} columns."
    return table_of(title, ("item", *map(named, columns)), rows, note.strip())


def _of_counts(title: str, found: Counts, named: Callable[[str], str]) -> Table:
    step = -(-len(found.counts) // SHOWN)
    starts = np.arange(0, len(found.counts), step)
    stops = np.minimum(starts + step, len(found.counts))
    rows = {
        f"{number(found.edges[start])} to {number(found.edges[stop])}": (str(found.counts[start:stop].sum()),)
        for start, stop in zip(starts.tolist(), stops.tolist(), strict=True)
    }
    note = f"Below: {found.below}, above: {found.above}, without a number: {found.invalid}."
    return table_of(title, (named(found.column), "items"), rows, note)
