"""`Sweep`: what a folder holds of a sweep, read with no trust in whoever wrote it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.blocks import storage
from p3dof._base.blocks.folder import TOTALS, numbers_there, path_of
from p3dof._base.blocks.manifest import Manifest, parse_manifest, read_manifest
from p3dof._base.blocks.problem import Block
from p3dof._base.blocks.reduction import State
from p3dof._base.blocks.totals import Totals
from p3dof._base.errors import FileError, InputError
from p3dof._base.files import called
from p3dof._base.tables import ShownInNotebook

LARGEST = 2_000_000_000
"""Largest size of columns that are read at a time without another limit [bytes]."""


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
        """Read a sweep, whether it is complete or not.

        Parameters
        ----------
        folder : path-like
            Of the sweep.
        notes : tuple of str
            What to tell of it.
        computed : int
            Likewise: how many of its blocks are new.

        Returns
        -------
        Sweep
            Columns are read when they are asked for.

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
        for number in self.numbers:
            block = self.manifest.block(number)
            yield block, storage.read_block(self.manifest, block, self._path(number), wanted).columns

    def columns(
        self, names: Sequence[str] | None = None, max_bytes: int = LARGEST
    ) -> dict[str, NDArray[Any]]:
        """Read columns of all items that are there.

        Parameters
        ----------
        names : sequence of str, optional
            Columns to read; all that are kept by default.
        max_bytes : int
            Largest size to read [bytes].

        Returns
        -------
        dict of str to ndarray, shape (N,)
            And ``index``, which items they are.

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
        for number in self.numbers:
            block = self.manifest.block(number)
            totals.add(storage.read_block(self.manifest, block, self._path(number), ()).states)
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
