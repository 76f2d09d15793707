"""Designs of a file to results in a file, a block at a time, and what is worth telling about all of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.errors import InputError
from p3dof._base.tables import Table, number, table_of
from p3dof.analysis.designs.columns import BodiesOfDesigns, Designs
from p3dof.analysis.designs.evaluation import BLOCK, DesignEvaluation
from p3dof.analysis.designs.files import Rows
from p3dof.analysis.designs.names import LENGTHS, Column, columns_of
from p3dof.analysis.designs.results import DesignForces
from p3dof.analysis.designs.status import DesignStatus
from p3dof.machine.parameters import Parameters
from p3dof.machine.parameters.plain import LARGEST

ROWS = 16 * BLOCK
"""Rows of a file that are computed at a time: enough for all threads."""

_WORDS = np.array([status.name.lower() for status in DesignStatus], dtype=object)


@dataclass
class DesignSummary:
    """How many designs can and cannot, and the best of those that can.

    Parameters
    ----------
    best : int
        How many of the best to keep: those with the least largest force.
    """

    best: int = 10
    count: int = 0
    by_status: NDArray[np.int_] = field(default_factory=lambda: np.zeros(len(DesignStatus), dtype=np.int_))
    rows: NDArray[np.int_] = field(default_factory=lambda: np.zeros(0, dtype=np.int_))
    peaks: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    columns: dict[str, FloatArray] = field(default_factory=dict)

    @property
    def feasible(self) -> int:
        """How many designs make the motion."""
        return int(self.by_status[DesignStatus.FEASIBLE])

    def add(self, rows: Rows, found: DesignForces) -> None:
        """Add a block of designs."""
        self.count += len(found)
        self.by_status += np.bincount(found.status, minlength=len(DesignStatus))
        good = np.flatnonzero(found.feasible)
        peaks = np.concatenate([self.peaks, found.peak_force[good]])
        order = np.argsort(peaks.max(axis=1), kind="stable")[: self.best]
        self.rows = np.concatenate([self.rows, rows.first + good])[order]
        self.columns = {
            name: np.concatenate([self.columns.get(name, np.zeros(0)), column[good]])[order]
            for name, column in rows.columns.items()
        }
        self.peaks = peaks[order]

    def tables(self) -> list[Table]:
        """Return what there is, and the best, as tables."""
        counts = {
            status.in_words: (str(int(many)),)
            for status, many in zip(DesignStatus, self.by_status, strict=True)
            if many
        }
        tables = [table_of(f"{self.count} designs", ("of these", "designs"), counts)]
        if len(self.rows):
            header = ("row", *self.columns, "peak A [N]", "peak B [N]", "peak C [N]")
            numbers = np.column_stack([*self.columns.values(), self.peaks])
            best = {str(row): tuple(map(number, line)) for row, line in zip(self.rows, numbers, strict=True)}
            tables.append(table_of("Least peak force", header, best))
        return tables


def evaluated(
    blocks: Iterator[Rows],
    evaluation: DesignEvaluation,
    machine: Parameters,
    bodies: BodiesOfDesigns,
    source: str,
    any_size: bool = False,
) -> Iterator[tuple[Rows, DesignForces]]:
    """Compute designs block by block.

    Parameters
    ----------
    blocks : iterator of Rows
        Designs, from `read_designs`.
    evaluation : DesignEvaluation
        What is asked of them.
    machine, bodies
        As of `Designs`.
    source : str
        What to call the file in an error.
    any_size : bool
        Take machines of more than 20 m too.

    Yields
    ------
    rows : Rows
    found : DesignForces

    Raises
    ------
    InputError
        If a column does not fit; the message has the row where there is one.
    """
    for rows in blocks:
        designs = Designs(rows.columns, machine, bodies)
        if not any_size:
            require_size(columns_of(rows.columns), rows, source)
        yield rows, evaluation.evaluate(designs)


def require_size(columns: Iterable[Column], rows: Rows, source: str) -> None:
    """Raise `InputError` for a machine of more than 20 m: most are in millimetres without saying so.

    Parameters
    ----------
    columns : iterable of Column
        What the headers mean.
    rows : Rows
        Some rows of the file.
    source : str
        What to call the file.
    """
    for column, (header, given) in zip(columns, rows.columns.items(), strict=True):
        values = column.in_si(given)
        large = np.flatnonzero(values > LARGEST) if column.name in LENGTHS else np.zeros(0)
        if large.size:
            value = values[large[0]]
            raise InputError(
                f"{source}, row {rows.first + int(large[0])}, column {header}: {value:g} m is more than "
                f"{LARGEST:g} m: lengths are in metres; did you mean '{header} [mm]'? "
                "(--any-size takes it as it is)"
            )


def table_of_results(rows: Rows, found: DesignForces) -> dict[str, NDArray[Any]]:
    """Return the columns of a results file: designs as they were given, the status in words, all figures."""
    columns = found.to_columns()
    columns["status"] = _WORDS[found.status]
    return {**rows.columns, **columns}
