"""Motion and wrench files: CSV text in and out.

The header of a motion is ``t,y,z,theta``, then either nothing (the pose alone) or ``ydot,zdot,thetadot,
yddot,zddot,thetaddot``, in exactly this order; that of a wrench is ``t,fx,fy,fz,mx,my,mz``. A unit in
brackets may follow each name, as in ``y [mm]``; without one the column is in SI units. Blank lines and lines
that begin with ``#`` are skipped, and what p3dof writes beside a motion, such as forces, is passed over.
"""

from __future__ import annotations

import csv
import re
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal, localcontext
from itertools import islice
from typing import NoReturn

import numpy as np

from p3dof._base.checks import (
    LARGEST,
    FloatArray,
    is_number,
    name_and_unit,
    one_line,
    require_commas,
    units_of,
    warn_caller,
    with_point,
)
from p3dof._base.errors import MotionError
from p3dof._base.files import numbers_of_lines, table_lines
from p3dof._base.time_series.times import is_of_clock

MAX_BYTES = 500_000_000
"""Largest motion file that is read [bytes]: about two million samples with all columns."""
MAX_LINE = 10_000
"""Longest line that is read [characters]."""

_DIGITS = 60
"""Digits of a difference of times: more than any clock has."""
_WRITTEN = ("s", "m", "m", "rad", "m/s", "m/s", "rad/s", "m/s^2", "m/s^2", "rad/s^2")


@dataclass(frozen=True)
class Form:
    """What a kind of file holds."""

    what: str  # what to call it in an error
    names: tuple[str, ...]  # its columns, the time first
    counts: tuple[int, ...]  # how many of them there may be
    units: Mapping[str, Mapping[str, tuple[float, float]]] | None = None
    """The units that a column may be in, by its name; by default the name tells the kind."""
    order: str = "in this order"  # in which order they may be, in words
    beside: frozenset[str] = frozenset()  # what p3dof itself writes beside them, which is passed over

    @property
    def rule(self) -> str:
        """The columns, in words."""
        choices = " or ".join(",".join(self.names[:count]) for count in self.counts)
        return f"the columns {choices}, {self.order}"


OF_A_RUN = "closure_error"
"""A column beside a motion that p3dof computed."""
MOTION = Form(
    "a motion",
    ("t", "y", "z", "theta", "ydot", "zdot", "thetadot", "yddot", "zddot", "thetaddot"),
    (4, 10),
    beside=frozenset(
        [f"{what}{leg}" for what in ("slider ", "slider velocity ", "f", "nut ") for leg in "ABC"]
        + [f"f{leg} asked" for leg in "ABC"]
        + [f"reference {name}" for name in ("y", "z", "theta")]
        + ["Fx", "Fy", "Fz", "Mx", "My", "Mz", OF_A_RUN, "power", "power_residual"]
    ),
)
HEADER = tuple(f"{name} [{unit}]" for name, unit in zip(MOTION.names, _WRITTEN, strict=True))
"""What the columns of a motion are called in files."""
WRENCH = Form("a wrench", ("t", "fx", "fy", "fz", "mx", "my", "mz"), (7,))


def parse(text: str, source: str, form: Form = MOTION) -> tuple[FloatArray, FloatArray, float]:
    """Read a motion, or a wrench, from CSV text.

    Times of a clock (`p3dof._base.time_series.times.is_of_clock`) are counted from the first one; the
    differences are those of the digits in the text.
    """
    rows = _rows(text, source)
    line, header = next(rows, (0, []))
    if not header:
        raise MotionError(f"{source}: expected {form.what} with {form.rule}, got an empty file")
    kept = _kept(header, form)
    factors = _header(header, kept, f"{source}, line {line}", form)
    start = _end_of_line(text, line)
    data = numbers_of_lines(text, start, MAX_LINE, len(header))
    if data is None:
        data = _read_with_care(rows, source, header)
    if not len(data):
        raise MotionError(f"{source}: expected lines of numbers after the header, got none")
    if len(kept) < len(header):
        data = np.ascontiguousarray(data[:, kept])
    for i, j in np.argwhere(~(np.abs(data) <= LARGEST)):
        large = np.isfinite(data[i, j])
        wanted = f"a number of at most {LARGEST:g} in size" if large else "a finite number"
        raise MotionError(
            f"{source}, line {_line_of(i, text)}, column {form.names[j]}: expected {wanted}, got {data[i, j]}"
        )
    multiply, divide = np.array(factors).T
    columns = data[:, 1:] * multiply[1:] / divide[1:]
    time, first = data[:, 0] * multiply[0] / divide[0], 0.0
    if is_of_clock(time):
        time, first = _since_the_first(text, kept[0], int(divide[0]))
    for i in np.flatnonzero(time[1:] <= time[:-1]):
        raise MotionError(
            f"{source}, line {_line_of(i + 1, text)}, column t: expected a time after {data[i, 0]:.16g}, "
            f"got {data[i + 1, 0]:.16g}"
        )
    if len(kept) < len(header):
        _tell(source, [name for k, name in enumerate(header) if k not in kept])
    return time, columns, first


def of_columns(
    columns: Mapping[str, FloatArray], source: str, form: Form
) -> tuple[FloatArray, FloatArray, float]:
    """Take columns of another kind of file, by their names with units, as `parse` takes those of CSV text."""
    factors = np.array(_header(list(columns), range(len(columns)), source, form))
    data = np.stack(list(columns.values()), axis=-1)
    for i, j in np.argwhere(~(np.abs(data) <= LARGEST)):
        raise MotionError(
            f"{source}, row {i + 1}, column {form.names[j]}: expected a finite number, got {data[i, j]}"
        )
    time, first = data[:, 0] * factors[0, 0] / factors[0, 1], 0.0
    if is_of_clock(time):
        time, first = time - time[0], float(time[0])
    for i in np.flatnonzero(time[1:] <= time[:-1]):
        raise MotionError(f"{source}, row {i + 2}, column t: expected a time after {data[i, 0]:.16g}")
    return time, data[:, 1:] * factors[1:, 0] / factors[1:, 1], first


def _read_with_care(rows: Iterator[tuple[int, list[str]]], source: str, header: list[str]) -> FloatArray:
    """Read line by line what is not plain numbers between commas, and name the first field that is none."""
    numbers = array("d")
    for line, row in rows:
        if len(row) != len(header):
            told = "; decimals are written with a point" if len(row) > len(header) else ""
            told = "; commas stand between the columns" if ";" in row[0] else told
            raise MotionError(f"{source}, line {line}: expected {len(header)} columns, got {len(row)}{told}")
        try:
            numbers.extend([float(field) for field in row])
        except ValueError:
            _name_the_field(row, f"{source}, line {line}", header)
        whole = "".join(row)
        if (
            "_" in whole or not whole.isascii()
        ):  # Python reads 1_000 and other scripts' digits, nobody else does
            _name_the_field(row, f"{source}, line {line}", header)
    return np.frombuffer(numbers).reshape(-1, len(header)) if numbers else np.empty((0, len(header)))


def _end_of_line(text: str, number: int) -> int:
    """Return where the line after this one begins."""
    at = 0
    for _ in range(number):
        at = text.find("\n", at) + 1 or len(text)
    return at


def _since_the_first(text: str, column: int, divide: int) -> tuple[FloatArray, float]:
    """Return the times [s] since the first one, and that: by the digits of the text, not rounded before."""
    rows = islice(_rows(text, ""), 1, None)
    times = (Decimal(row[column].strip()) for _, row in rows)
    with localcontext() as context:
        context.prec = _DIGITS
        first = next(times)
        return np.array([0.0, *(float((time - first) / divide) for time in times)]), float(first / divide)


def header_of(text: str, source: str) -> list[str]:
    """Return the names of a file's columns, without their units; none of an empty file."""
    _, header = next(_rows(text, source), (0, []))
    return [name_and_unit(field)[0] for field in header]


def dump(time: FloatArray, columns: FloatArray, start: float = 0.0) -> bytes:
    """Return CSV text in SI units that `parse` reads back to the same bits.

    As many digits as tell every number from its neighbours: up to 17.
    """
    clock = f"# t counts from {start!r} s of the clock\n" if start else ""
    return f"{clock}{','.join(HEADER)}\n".encode() + table_lines([time, *columns.T])


def _rows(text: str, source: str) -> Iterator[tuple[int, list[str]]]:
    """Yield (line number, fields) of every line that is not blank and not a comment."""
    for number, line in _lines(text):
        if len(line) > MAX_LINE:
            raise MotionError(
                f"{source}, line {number}: expected at most {MAX_LINE} characters, got {len(line)}"
            )
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        if '"' not in line:
            yield number, line.split(",")
            continue
        try:
            yield number, next(csv.reader([line], strict=True))
        except csv.Error as problem:
            raise MotionError(f"{source}, line {number}: not valid CSV: {problem}") from problem


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Yield (number, line) one by one: a file that is refused at its header is not split to its end."""
    number, start = 1, 0
    while (end := text.find("\n", start)) >= 0:
        yield number, text[start:end]
        number, start = number + 1, end + 1
    yield number, text[start:]


def _line_of(index: int, text: str) -> int:
    """Return the number of the line that holds a sample."""
    return next(islice(_rows(text, ""), index + 1, None))[0]


def _kept(header: list[str], form: Form) -> list[int]:
    """Return which columns are read: all but what p3dof writes beside them."""
    names = [name_and_unit(field)[0] for field in header]
    return [k for k, name in enumerate(names) if name in form.names or name not in form.beside]


def _tell(source: str, fields: list[str]) -> None:
    """Say which columns are passed over."""
    names = [name_and_unit(field)[0] for field in fields]
    more = f" and {len(names) - 4} more" if len(names) > 4 else ""
    warn_caller(f"{source}: passed over what p3dof writes beside a motion: {', '.join(names[:4])}{more}")


def _header(header: list[str], kept: Sequence[int], where: str, form: Form) -> list[tuple[float, float]]:
    """Check the names; return what to multiply each column by, and divide it by, to reach SI units."""
    require_commas(header, where, MotionError)
    fields = [name_and_unit(header[k]) for k in kept]
    for index, (k, (name, _)) in enumerate(zip(kept, fields, strict=True)):
        expected = form.names[index] if index < len(form.names) else "no more columns"
        if name != expected:
            bracket = re.match(rf"{re.escape(expected)} *\((.+)\)", name)
            told = f"; a unit is in square brackets: {expected} [{bracket[1]:.20}]" if bracket else ""
            told = "; a first line names the columns" if is_number(name) else told
            told = "; a comma too many?" if not name else told
            raise MotionError(
                f"{where}, column {k + 1}: expected {expected}, got {name!r:.40} ({form.rule}){told}"
            )
    if len(fields) not in form.counts:
        raise MotionError(f"{where}: expected {form.rule}, got only {','.join(name for name, _ in fields)}")
    return [_factor(name, unit, where, form) for name, unit in fields]


def _factor(name: str, unit: str | None, where: str, form: Form) -> tuple[float, float]:
    units = units_of(name) if form.units is None or name == "t" else form.units[name]
    if unit is None:
        return (1.0, 1.0)
    known = units.get(unit)
    if known is None:
        raise MotionError(
            f"{where}, column {name}: expected a unit of {', '.join(units)}, got [{one_line(unit, 40)}]"
        )
    return known


def _name_the_field(row: list[str], where: str, header: list[str]) -> NoReturn:
    """Raise for the first field that is not a number."""
    names = (name_and_unit(field)[0] for field in header)
    name, field = next(pair for pair in zip(names, row, strict=False) if not is_number(pair[1]))
    got = repr(field.strip())[:40] if field.strip() else "nothing"
    raise MotionError(f"{where}, column {name}: expected a number, got {got}{with_point(field)}")
