"""Columns of runs from a table."""

from __future__ import annotations

from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.files import called
from p3dof.analysis.designs.files import read_designs
from p3dof.analysis.designs.stream import require_size
from p3dof.runs.many.columns import run_columns_of

_ROWS = 100_000


def read_runs(source: Any, any_size: bool = False) -> dict[str, FloatArray]:
    """Return the columns of a table: names in its first line, a run in every other one.

    Parameters
    ----------
    source : path-like or stream
        A CSV file, units in brackets behind the names, or a Parquet file; a stream is CSV.
    any_size : bool
        Take machines of more than 20 m too.

    Returns
    -------
    dict of str to ndarray, shape (R,)
        By header.

    Raises
    ------
    InputError
        If a name, a unit or a number does not fit, two columns mean the same, or a machine is larger than
        20 m; the message has file and row.
    FileError
        If the file cannot be read.
    MissingExtraError
        If pyarrow is not installed, which Parquet needs.
    """
    parts = []
    for rows in read_designs(source, _ROWS, run_columns_of):
        if not any_size:
            require_size(run_columns_of(rows.columns), rows, called(source))
        parts.append(rows.columns)
    return {header: np.concatenate([part[header] for part in parts]) for header in parts[0]}
