"""Columns of runs from a CSV file."""

from __future__ import annotations

import csv
from typing import Any

import numpy as np

from p3dof.checks import FloatArray, shown
from p3dof.designs.files import require_header
from p3dof.errors import FileError, InputError
from p3dof.files import called, read_text
from p3dof.many_runs.columns import run_columns_of


def read_runs(source: Any) -> dict[str, FloatArray]:
    """Return the columns of a CSV file: names in its first line, a run in every other one.

    Parameters
    ----------
    source : path-like or stream
        The file.

    Returns
    -------
    dict of str to ndarray, shape (R,)

    Raises
    ------
    FileError
        If it cannot be read, has no rows, a row of another length, a name twice, or something else than
        numbers; with the row.
    InputError
        If a column means nothing, or two mean the same.
    """
    name = called(source)
    lines = [row for row in csv.reader(read_text(source).splitlines()) if any(cell.strip() for cell in row)]
    if len(lines) < 2:
        raise FileError(f"{name}: expected names of columns and at least one run")
    header = [cell.strip() for cell in lines[0]]
    require_header(header, name)
    twice = [cell for cell in header if header.count(cell) > 1]
    if twice or not all(header):
        raise FileError(f"{name}: expected different names of columns, got {shown((twice or [''])[0])}")
    try:
        run_columns_of(header)
    except InputError as error:
        raise InputError(f"{name}: {str(error).removeprefix('runs: ')}") from error
    rows = np.empty((len(lines) - 1, len(header)))
    for k, row in enumerate(lines[1:]):
        if len(row) != len(header):
            raise FileError(f"{name}: run {k + 1}: expected {len(header)} numbers, got {len(row)}")
        try:
            rows[k] = [float(cell) for cell in row]
        except ValueError as error:
            raise FileError(f"{name}: run {k + 1}: {error}") from error
    return dict(zip(header, np.ascontiguousarray(rows.T), strict=True))
