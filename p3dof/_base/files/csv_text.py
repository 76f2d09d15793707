"""Columns of numbers to CSV that reads back to the same bits."""

from __future__ import annotations

import csv
import io
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.files.kinds import suffix_of
from p3dof._base.files.writing import write_atomic


def write_table(path: str | os.PathLike[str], header: list[str], columns: tuple[NDArray[Any], ...]) -> Path:
    """Write columns of numbers, or of text, to a CSV file that reads back to the same bits.

    Parameters
    ----------
    path : path-like
        The file; replaced whole or not at all.
    header : list of str
        Names of the columns.
    columns : tuple of ndarray, shape (N,)
        The columns.

    Returns
    -------
    Path
        The path written.

    Raises
    ------
    InputError
        If its name does not end in ``.csv``.
    FileError
        If the file cannot be written.
    """
    suffix_of(path, "table")
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    texts = [column.dtype.kind == "U" for column in columns]
    lists = [
        np.asarray(column, None if text else float).tolist()
        for column, text in zip(columns, texts, strict=True)
    ]
    for row in zip(*lists, strict=True):
        writer.writerow(value if text else f"{value:.17g}" for value, text in zip(row, texts, strict=True))
    return write_atomic(path, text.getvalue())
