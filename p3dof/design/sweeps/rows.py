"""`FileRows`: designs of a CSV or Parquet file as the inputs of a sweep."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from p3dof._base.blocks import Block
from p3dof._base.checks import FloatArray
from p3dof._base.errors import FileError, InputError
from p3dof._base.files import called
from p3dof._base.files.reading import reason
from p3dof.analysis.designs.files import Meaning, read_designs
from p3dof.analysis.designs.names import columns_of
from p3dof.analysis.designs.stream import require_size

LARGEST_CSV = 500_000_000
"""Largest CSV file that is taken, which each worker holds as a whole [bytes]; Parquet may be larger."""

_ROWS = 100_000


class FileRows:
    """The rows of a file of designs, one after the other; the workers must see the file.

    Parameters
    ----------
    path : path-like
        CSV or Parquet, with names and units of columns as `p3dof designs` takes them.
    meaning : callable
        Returns the columns that headers mean: those of designs by default, or of runs.
    any_size : bool
        Take machines of more than 20 m too.

    Raises
    ------
    InputError, FileError, MissingExtraError
        If it cannot be read, or a column does not fit.
    """

    def __init__(
        self, path: str | os.PathLike[str], meaning: Meaning = columns_of, any_size: bool = True
    ) -> None:
        self.path = Path(called(path)).absolute()
        self.sha256 = _sha256(self.path)
        self._meaning = meaning
        self.names, self.count = _look(self.path, meaning, any_size)

    def settings(self) -> dict[str, Any]:
        """Return what the columns depend on."""
        return {"kind": "rows", "rows": self.count, "columns": list(self.names), "sha256": self.sha256}

    def draw(self, block: Block) -> dict[str, FloatArray]:
        """Return the columns of a block, in the units of the file."""
        _require_same(self.path, self.sha256)
        if self.path.suffix.lower() == ".parquet":
            return _rows_of_parquet(self.path, self.names, block.start, block.stop)
        columns = _whole(self.path, self.sha256, self._meaning)
        return {name: columns[name][block.start : block.stop] for name in self.names}


def _look(path: Path, meaning: Meaning, any_size: bool) -> tuple[tuple[str, ...], int]:
    """Return names and number of rows, after a look at each of them."""
    if path.suffix.lower() != ".parquet" and path.stat().st_size > LARGEST_CSV:
        raise InputError(f"{path}: expected at most {LARGEST_CSV} bytes of CSV; Parquet may be larger")
    names: tuple[str, ...] = ()
    count = 0
    for rows in read_designs(path, _ROWS, meaning):
        names = tuple(rows.columns)
        if not any_size:
            require_size(meaning(names), rows, path.name)
        count += len(next(iter(rows.columns.values())))
    return names, count


@lru_cache(maxsize=2)
def _whole(path: Path, _sha256: str, meaning: Meaning) -> dict[str, FloatArray]:
    parts = [rows.columns for rows in read_designs(path, _ROWS, meaning)]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


@lru_cache(maxsize=8)
def _require_same(path: Path, sha256: str) -> None:
    """Raise if a worker sees another file, or none; looked at once by each process."""
    if _sha256(path) != sha256:
        raise InputError(f"{path}: the file has changed since the sweep was begun")


def _sha256(path: Path) -> str:
    found = hashlib.sha256()
    try:
        with path.open("rb") as stream:
            for chunk in iter(partial(stream.read, 1 << 20), b""):
                found.update(chunk)
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({reason(error)})") from error
    return found.hexdigest()


def _rows_of_parquet(path: Path, names: tuple[str, ...], start: int, stop: int) -> dict[str, FloatArray]:
    """Read some rows: only the groups of rows that they are in."""
    import pyarrow.parquet

    with pyarrow.parquet.ParquetFile(path) as file:
        groups: list[int] = []
        first = 0
        for group, (begin, end) in enumerate(_groups(file)):
            if begin < stop and end > start:
                first = begin if not groups else first
                groups.append(group)
        table = file.read_row_groups(groups, columns=list(names)).slice(start - first, stop - start)
        return {name: np.asarray(table.column(name).to_numpy(), dtype=np.float64) for name in names}


def _groups(file: Any) -> Iterator[tuple[int, int]]:
    begin = 0
    for group in range(file.metadata.num_row_groups):
        end = begin + file.metadata.row_group(group).num_rows
        yield begin, end
        begin = end
