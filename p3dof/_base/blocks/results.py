"""`Sweep`: what a folder holds of a sweep, read with no trust in whoever wrote it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.blocks import storage
from p3dof._base.blocks.problem import Block
from p3dof._base.blocks.reduction import ColumnMoments, Counts, Rows, State
from p3dof._base.blocks.storage import (
    TOTALS,
    Manifest,
    Totals,
    numbers_there,
    parse_manifest,
    path_of,
    read_manifest,
)
from p3dof._base.errors import FileError, InputError
from p3dof._base.files import called
from p3dof._base.tables import ShownInNotebook, Table, html_of, notebook_html, number, table_of

LARGEST = 2_000_000_000  # largest size of columns that are read at a time without another limit [bytes]


@dataclass(frozen=True, eq=False)
class Sweep(ShownInNotebook):
    """What there is of a sweep: its columns block by block, and what its reductions found.

    Parameters
    ----------
    folder : Path
        Where it is.
    manifest : Manifest
        What it is.
    numbers : tuple of int
        The blocks that are there, rising.
    notes : tuple of str
        What happened on the way: blocks that were damaged.
    computed : int
        How many blocks were computed by the call that returned it; 0 where it was only read.
    """

    folder: Path
    manifest: Manifest
    numbers: tuple[int, ...]
    notes: tuple[str, ...] = ()
    computed: int = 0

    @classmethod
    def load(cls, folder: str | os.PathLike[str], notes: tuple[str, ...] = (), computed: int = 0) -> Sweep:
        """Read a sweep, whether it is complete or not; columns when they are asked for.

        Parameters
        ----------
        folder : path-like
            Of the sweep.
        notes : tuple of str
            What to tell of it.
        computed : int
            Likewise: how many of its blocks are new.

        Raises
        ------
        FileError
            If there is no sweep, or its manifest is damaged.
        """
        where = Path(called(folder)).absolute()
        manifest = parse_manifest(read_manifest(where), where)
        return cls(where, manifest, tuple(numbers_there(where, manifest)), notes, computed)

    def __len__(self) -> int:
        return sum(len(self.manifest.block(number)) for number in self.numbers)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({str(self.folder)!r}, {len(self)} of {self.manifest.count} items)"

    @property
    def complete(self) -> bool:
        """Whether all blocks are there."""
        return len(self.numbers) == self.manifest.blocks

    def blocks(self, names: Sequence[str] | None = None) -> Iterator[tuple[Block, dict[str, NDArray[Any]]]]:
        """Read the blocks that are there, one after the other.

        Parameters
        ----------
        names : sequence of str, optional
            Columns to read; all that are kept by default.

        Yields
        ------
        block : Block
            Which items.
        columns : dict of str to ndarray, shape (n,)

        Raises
        ------
        InputError
            If a column was not kept.
        FileError
            If a block cannot be read.
        """
        wanted = self._kept(names)
        for block_number in self.numbers:
            block = self.manifest.block(block_number)
            yield block, storage.read_block(self.manifest, block, self._path(block_number), wanted).columns

    def columns(
        self, names: Sequence[str] | None = None, max_bytes: int = LARGEST
    ) -> dict[str, NDArray[Any]]:
        """Read columns (N,) of all items that are there, and ``index``, which items they are.

        Parameters
        ----------
        names : sequence of str, optional
            Columns to read; all that are kept by default.
        max_bytes : int
            Largest size to read [bytes].

        Raises
        ------
        InputError
            If a column was not kept, or they are larger than `max_bytes`.
        FileError
            If a block cannot be read.
        """
        wanted = self._kept(names)
        size = 8 * len(self) * (len(wanted) + 1)
        if size > max_bytes:
            raise InputError(
                f"columns: {size} bytes are more than {max_bytes}; `blocks` reads them one after the other"
            )
        parts: dict[str, list[NDArray[Any]]] = {name: [] for name in ("index", *wanted)}
        for block, found in self.blocks(wanted):
            parts["index"].append(np.arange(block.start, block.stop))
            for name in wanted:
                parts[name].append(found[name])
        empty = np.zeros(0)
        return {name: np.concatenate(arrays) if arrays else empty for name, arrays in parts.items()}

    @cached_property
    def reductions(self) -> dict[str, Any]:
        """What the reductions found in all blocks that are there, by their names.

        `Rows` of a `TopK` or `ParetoArchive`, `Counts` of a `Histogram`, `ColumnMoments` of `Moments`.
        """
        states = self._states()
        pairs = zip(self.manifest.reductions, states, strict=True)
        return {reduction.name: reduction.result(state) for reduction, state in pairs}

    def _states(self) -> tuple[State, ...]:
        if not self.manifest.reductions:
            return ()
        if self.complete and (self.folder / TOTALS).exists():
            try:
                return storage.read_totals(self.manifest, self.folder / TOTALS)
            except FileError:  # damaged: the blocks say it too
                pass
        totals = Totals(self.manifest)
        for block_number in self.numbers:
            block = self.manifest.block(block_number)
            totals.add(storage.read_block(self.manifest, block, self._path(block_number), ()).states)
        return totals.states()

    def _path(self, number: int) -> Path:
        return path_of(self.folder, self.manifest, number)

    def _kept(self, names: Sequence[str] | None) -> tuple[str, ...]:
        wanted = self.manifest.keep if names is None else tuple(names)
        for name in wanted:
            if name not in self.manifest.keep:
                there = ", ".join(self.manifest.keep) or "none"
                raise InputError(f"columns: expected some of those that are kept ({there}), got {name!r}")
        return wanted


SHOWN = 20  # rows that a table shows of many

WIDE = 5  # columns likewise


def sweep_tables(sweep: Sweep) -> tuple[Table, ...]:
    """Return one table for each reduction of a sweep."""
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
            named(column): [number(x) for x in (m.mean, m.deviation, m.low, m.high, m.count, m.invalid)]
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
        f"{number(found.edges[i])} to {number(found.edges[end])}": (number(found.counts[i:end].sum()),)
        for i, end in zip(starts.tolist(), stops.tolist(), strict=True)
    }
    note = f"Below: {found.below}, above: {found.above}, without a number: {found.invalid}."
    return table_of(title, (named(found.column), "items"), rows, note)
