"""Measured poses in CSV files: a line of names and units, a line a pose, empty where nothing was measured."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence

import numpy as np

from p3dof._base.checks import (
    ANGLES,
    LARGEST,
    LENGTHS,
    FloatArray,
    is_number,
    name_and_unit,
    shown,
    with_point,
)
from p3dof._base.errors import InputError

_LENGTHS = {**LENGTHS, "um": (1.0, 1e6), "µm": (1.0, 1e6)}
_ANGLES = {**ANGLES, "mrad": (1.0, 1e3)}


def read_poses(
    text: str, source: str, readings: Mapping[str, bool], measured: Mapping[str, bool]
) -> tuple[FloatArray, tuple[str, ...], FloatArray]:
    """Read what motors read, and what was measured there; columns in any order.

    Parameters
    ----------
    text, source : str
        Of the file, and what to call it in an error. Lines that are blank or begin with ``#`` are skipped.
    readings : mapping of str to bool
        Names of the motors, all of which have a column, and whether each is a length; else it is an angle.
    measured : mapping of str to bool
        The same of what may be measured; columns of the file that are in neither are refused.

    Returns
    -------
    tuple
        Readings (K, m), names of what was measured, in the order of `measured`, and its values (K, c), with
        NaN where a field is empty.

    Raises
    ------
    InputError
        With file, line and column.
    """
    lines = [
        (i, line) for i, line in enumerate(io.StringIO(text), 1) if line.strip() and line.lstrip()[0] != "#"
    ]
    if len(lines) < 2:
        raise InputError(f"{source}: expected a line of names and lines of numbers, got {len(lines)} lines")
    names, factors = _header(lines[0], source, {**measured, **readings})
    missing = [name for name in readings if name not in names]
    if missing:
        raise InputError(f"{source}: there is no column {shown(missing[0])}: expected one for every motor")
    table = np.array([_row(line, source, names, readings) for line in lines[1:]]) * factors
    seen = tuple(name for name in measured if name in names)
    columns = [names.index(name) for name in (*readings, *seen)]
    values = table[:, columns]
    return values[:, : len(readings)], seen, values[:, len(readings) :]


def _fields(line: tuple[int, str], source: str) -> list[str]:
    if ";" in line[1] and "," not in line[1]:
        raise InputError(f"{source}, line {line[0]}: expected commas between the columns, got ';'")
    return [field.strip() for field in next(csv.reader([line[1]]))]


def _header(line: tuple[int, str], source: str, lengths: Mapping[str, bool]) -> tuple[list[str], FloatArray]:
    names, factors = [], []
    for field in _fields(line, source):
        name, unit = name_and_unit(field)
        where = f"{source}, line {line[0]}, column {shown(name)}"
        if name not in lengths or name in names:
            wanted = "each name once" if name in names else f"one of {', '.join(lengths)}"
            raise InputError(f"{where}: expected {wanted}")
        units = _LENGTHS if lengths[name] else _ANGLES
        if unit is not None and unit not in units:
            raise InputError(f"{where}: expected a unit of {', '.join(units)}, got [{unit[:20]}]")
        multiply, divide = units[unit] if unit is not None else (1.0, 1.0)
        names.append(name)
        factors.append(multiply / divide)
    return names, np.array(factors)


def _row(line: tuple[int, str], source: str, names: Sequence[str], needed: Mapping[str, bool]) -> list[float]:
    fields = _fields(line, source)
    if len(fields) != len(names):
        raise InputError(f"{source}, line {line[0]}: expected {len(names)} columns, got {len(fields)}")
    row = []
    for name, field in zip(names, fields, strict=True):
        number = float(field) if is_number(field) else math.nan
        if (field or name in needed) and not abs(number) <= LARGEST:
            where = f"{source}, line {line[0]}, column {name}"
            raise InputError(f"{where}: expected a number, got {shown(field)}{with_point(field)}")
        row.append(number)
    return row
