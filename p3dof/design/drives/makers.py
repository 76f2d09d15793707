"""Tables of makers: rows of a CSV file as parts of a catalogue of drives.

The form, in place of the list of a kind of parts or as an item of it::

    motors:
      table: motors.csv                        # in the folder of this file
      encoding: cp1252                         # as spreadsheets write; utf-8 without it
      separator: ";"                           # a comma without it
      decimal: ","                             # a point without it
      thousands: "."                           # none without it
      header: 3                                # line of the names; the first that is not blank without it
      first: 5                                 # line of the first row; the next one without it
      columns:                                 # column, or its number: field, and the unit of its numbers
        Type: name
        "M0 [Nm]": rated_torque                # the unit of the header
        n max: max_speed [rpm]
        J: inertia [kg cm^2]
        I max: winding.max_current_rms [A]
        n: curve.speed [rpm]                   # a point of the curve a row
        S1: curve.continuous [Nm]
        S6: curve.peak [Nm]
      constant: {max_inertia_ratio: 10}        # for all rows, and where a cell is empty

Rows of one name that follow each other are one part. A cell may have a unit of its own.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from p3dof._base.checks import meant, name_and_unit, one_line, shown
from p3dof._base.errors import DriveError, ParameterError
from p3dof._base.files import called, read_bytes
from p3dof._base.quantities import Quantity
from p3dof.machine.parameters.machine import read_fields

CURVE = ("curve.speed", "curve.continuous", "curve.peak")  # fields of which a row is a point of the curve
ENCODINGS = ("utf-8", "utf-16", "cp1252", "latin-1", "shift_jis", "gb18030")
SEPARATORS = (",", ";", "\t", "|")
_GROUPS = ("", ".", ",", "'", "’", " ")
_SPACES = " \u00a0\u2009\u202f"
"""What may stand between groups of three digits for a space: makers print narrow ones."""
_OPTIONAL = ("encoding", "separator", "decimal", "thousands", "header", "first", "constant")
FIELDS = ("table", "columns", *_OPTIONAL)
_MOST_BYTES, _MOST_ROWS, _MOST_COLUMNS, _LONGEST = 5_000_000, 20_000, 500, 200
_EMPTY = {"", "-", "–", "—", "n/a", "n.a."}
_WORDS = {"yes": True, "true": True, "1": True, "no": False, "false": False, "0": False}
_ALIKE = {
    **dict.fromkeys(("1/min", "min-1", "min^-1", "min⁻¹", "r/min", "rev/min", "U/min", "1/min."), "rpm"),
    **dict.fromkeys(("kgcm²", "kgcm^2", "kgcm2", "kg·cm²"), "kg cm^2"),
    **dict.fromkeys(("kgm²", "kgm^2", "kgm2", "kg·m²"), "kg m^2"),
    **dict.fromkeys(("gcm²", "gcm^2", "gcm2", "g·cm²"), "g cm^2"),
    **dict.fromkeys(("kgmm²", "kgmm^2", "kgmm2"), "kg mm^2"),
    **dict.fromkeys(("lb-in", "lbin", "lb.in", "lb·in", "in-lb", "lbf-in"), "lbf in"),
    **dict.fromkeys(("oz-in", "ozin", "in-oz"), "ozf in"),
    **dict.fromkeys(("N·m", "N.m", "N-m"), "Nm"),
}  # fmt: skip
"""How makers write units, without spaces, and how they are written here."""


_BRACKET = re.compile(r"[\[(]([^\[\]()]*)[\])]\s*\Z")
"""Where a header has the unit of its column."""


@dataclass(frozen=True)
class _Form:
    """How a table is written, as its fields in the catalogue say."""

    encoding: str = "utf-8"
    separator: str = ","
    decimal: str = "."
    thousands: str = ""
    header: int | None = None  # lines, from 1
    first: int | None = None
    constant: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        choices: tuple[tuple[str, tuple[str, ...]], ...] = (
            ("encoding", ENCODINGS),
            ("separator", SEPARATORS),
            ("decimal", (".", ",")),
            ("thousands", _GROUPS),
        )
        for name, known in choices:
            if getattr(self, name) not in known:
                told = ", ".join(map(repr, known))
                raise ParameterError(f"{name}: expected one of {told}, got {shown(getattr(self, name))}")
        if self.decimal == self.thousands:
            raise ParameterError(f"thousands: expected another sign than decimal, got {self.thousands!r}")
        for name in ("header", "first"):
            line = getattr(self, name)
            if line is not None and (isinstance(line, bool) or not isinstance(line, int) or line < 1):
                raise ParameterError(f"{name}: expected the number of a line, got {shown(line)}")
        if not isinstance(self.constant, Mapping):
            raise ParameterError(f"constant: expected fields, got {shown(self.constant)}")

    @property
    def number(self) -> re.Pattern[str]:
        """What a number looks like: sign, digits, fraction, exponent, and a unit or %."""
        group = f"[{_SPACES}]" if self.thousands == " " else re.escape(self.thousands)
        whole = rf"\d{{1,3}}(?:{group}\d{{3}})+|\d+" if group else r"\d+"
        dot = re.escape(self.decimal)
        return re.compile(
            rf"([+−-]?)({whole}|(?={dot}\d))(?:{dot}(\d*))?([eE][+-]?\d{{1,3}})?\s*([^\d\s.,'’].*)?\Z",
            re.ASCII | re.DOTALL,
        )


@dataclass(frozen=True)
class _Column:
    """A column that is read: its number, what to call it, its field, and the unit of its numbers."""

    index: int
    name: str
    field: str
    unit: str


Known = Mapping[str, tuple[str, Quantity | None]]
"""Fields by their names with dots: the type as the source has it, and the kind of number."""


def parts_of_table(data: Any, known: Known, required: Sequence[str], folder: Path, where: str) -> list[Any]:
    """Return what the rows of a table say, as (where, fields by name) of each part.

    `known` has the fields of a part, `required` those that it needs, `folder` is where the table lies.
    """
    data = read_fields(data, where, ("table", "columns"), _OPTIONAL)
    try:
        form = _Form(**{name: data[name] for name in _OPTIONAL if name in data})
    except ParameterError as error:
        raise DriveError(f"{where}: {error}") from error
    if not isinstance(data["table"], str):
        raise DriveError(f"{where}: table: expected the name of a CSV file, got {shown(data['table'])}")
    if not isinstance(data["columns"], Mapping) or not data["columns"]:
        raise DriveError(f"{where}: columns: expected columns and their fields, got {shown(data['columns'])}")
    unknown = [name for name in form.constant if name not in {each.partition(".")[0] for each in known}]
    if unknown:
        raise DriveError(f"{where}: constant: unknown field {shown(unknown[0])}{_told(unknown[0], known)}")
    path = folder / data["table"]
    rows = _lines(path, form)
    header, names = next(rows, (0, []))
    if not names:
        raise DriveError(f"{called(path)}: expected a line with the names of the columns")
    columns = _columns(data["columns"], names, known, where, f"{called(path)}, line {header}")
    return _parts(rows, columns, known, required, form, called(path))


def _lines(path: Path, form: _Form) -> Iterator[tuple[int, list[str]]]:
    """Yield number and cells of the header and of each row that is not blank."""
    source = called(path)
    try:
        text = read_bytes(path, _MOST_BYTES).decode(form.encoding)
    except UnicodeDecodeError as error:
        raise DriveError(
            f"{source}: expected {form.encoding} text, got {error.reason} at byte {error.start}; "
            f"`encoding` may be one of {', '.join(ENCODINGS)}"
        ) from error
    text = text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n").replace("\0", " ")
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=form.separator, strict=True)
    line, count = 0, 0
    try:
        for cells in reader:
            began, line = line + 1, reader.line_num
            wanted = form.header if not count else form.first
            found = [cell.strip() for cell in cells]
            if not any(found) or (wanted is not None and began < wanted):
                continue
            count += 1
            if count > _MOST_ROWS or len(found) > _MOST_COLUMNS:
                raise DriveError(
                    f"{source}, line {began}: expected at most {_MOST_ROWS} rows of {_MOST_COLUMNS} cells"
                )
            yield began, found
    except csv.Error as error:
        raise DriveError(f"{source}, line {line + 1}: not valid CSV: {one_line(str(error))}") from error


def _columns(
    data: Mapping[Any, Any], names: list[str], known: Known, where: str, source: str
) -> list[_Column]:
    """Return the columns that are read, each as often as it has fields."""
    found = []
    for key, value in data.items():
        index = _index(key, names, source)
        place = f"{where}: columns: {one_line(str(key), 80)}"
        for item in value if isinstance(value, list) else [value]:
            if not isinstance(item, str):
                raise DriveError(f"{place}: expected the name of a field, got {shown(item)}")
            name, unit = name_and_unit(item)
            if name not in known:
                raise DriveError(f"{place}: unknown field {shown(name)}{_told(name, known)}")
            unit = _unit(unit, names[index], known[name][1], place)
            found.append(_Column(index, one_line(names[index] or str(index + 1), 80), name, unit))
    fields = [column.field for column in found]
    twice = [name for name in fields if name != "name" and fields.count(name) > 1]
    if twice:
        raise DriveError(f"{where}: columns: the field {twice[0]!r} is given by more than one column")
    if "name" not in fields:
        raise DriveError(f"{where}: columns: expected a column for the field 'name'")
    points = [name for name in CURVE if name in fields]
    if points and len(points) < len(CURVE):
        raise DriveError(f"{where}: columns: expected {', '.join(CURVE)}, got {', '.join(points)} alone")
    return found


def _told(name: Any, known: Known) -> str:
    return meant(name, known) or f", expected {', '.join(known)}"


def _index(key: Any, names: list[str], source: str) -> int:
    """Return which column is meant, by its name in the header or its number from 1."""
    if isinstance(key, int) and not isinstance(key, bool):
        if not 1 <= key <= len(names):
            raise DriveError(f"{source}: expected a column from 1 to {len(names)}, got {shown(key)}")
        return key - 1
    wanted = " ".join(str(key).split())
    same = [index for index, name in enumerate(names) if " ".join(name.split()) == wanted]
    if len(same) == 1:
        return same[0]
    if same:
        raise DriveError(f"{source}: {len(same)} columns are called {shown(wanted)}: give the number instead")
    sign = next((sign for sign in SEPARATORS if len(names) == 1 and sign in names[0]), None)
    hint = f"; is the `separator` {sign!r}?" if sign else meant(wanted, names)
    listed = one_line(", ".join(filter(None, names)), 200)
    raise DriveError(f"{source}: expected a column {shown(wanted)}, got {listed}{hint}")


def _unit(given: str | None, header: str, quantity: Quantity | None, place: str) -> str:
    """Return the unit of a column: the one that its field is given with, or else that of its header."""
    if quantity is None:
        if given is not None:
            raise DriveError(f"{place}: expected a field without a unit, got [{one_line(given, 40)}]")
        return ""
    bracket = _BRACKET.search(header)
    own = _scale(bracket[1] if bracket else None, quantity)
    if given is None:
        return own[0] if own else ""
    asked = _scale(given, quantity)
    if asked is None:
        _scale_of(_ours(given), quantity, place)
        return ""
    if own is not None and own[1] != asked[1]:
        raise DriveError(f"{place}: expected the unit of the column, {own[0]}, got {asked[0]}")
    return asked[0]


def _scale(unit: str | None, quantity: Quantity) -> tuple[str, float] | None:
    """Return a unit as it is written here, and its size; None for no unit or one that is not understood."""
    try:
        return None if unit is None else (_ours(unit), _scale_of(_ours(unit), quantity, ""))
    except DriveError:
        return None


def _scale_of(unit: str, quantity: Quantity, place: str) -> float:
    try:
        return float(quantity.read(f"1 {unit}", place))
    except ParameterError as error:
        raise DriveError(str(error)) from error


def _ours(unit: str) -> str:
    """Return a unit as it is written here."""
    return _ALIKE.get("".join(unit.split()), unit.strip())


def _parts(
    rows: Iterator[tuple[int, list[str]]],
    columns: list[_Column],
    known: Known,
    required: Sequence[str],
    form: _Form,
    source: str,
) -> list[Any]:
    parts: list[tuple[str, dict[str, Any]]] = []
    number = form.number
    for line, cells in rows:
        where = f"{source}, line {line}"
        row: dict[str, Any] = {}
        for column in columns:
            cell = cells[column.index] if column.index < len(cells) else ""
            if cell.lower() in _EMPTY:
                continue
            place = f"{where}, column {column.name!r}"
            value = _value(cell, column, known, form, number, place)
            if column.field == "name" and "name" in row:
                value = f"{row['name']} {value}"
            row[column.field] = value
        point = [row.pop(name, None) for name in CURVE]
        follows = bool(parts) and row.get("name", parts[-1][1].get("name")) == parts[-1][1].get("name")
        if not follows or None in point:
            _begin(parts, row, columns, required, form, where)
        else:
            _go_on(parts[-1][1], row, where)
        if point != [None] * 3:
            parts[-1][1].setdefault("curve", []).append(_point(point, where))
    if not parts:
        raise DriveError(f"{source}: expected a row at least")
    return [(where, _nested(part, form.constant)) for where, part in parts]


def _begin(
    parts: list[tuple[str, dict[str, Any]]],
    row: dict[str, Any],
    columns: list[_Column],
    required: Sequence[str],
    form: _Form,
    where: str,
) -> None:
    """Begin a part with a row; what it needs stands there."""
    for column in columns:
        needed = column.field in required or column.field == "name"
        if needed and column.field not in row and column.field not in form.constant:
            raise DriveError(f"{where}, column {column.name!r}: expected a value, got none")
    parts.append((where, row))


def _go_on(part: dict[str, Any], row: Mapping[str, Any], where: str) -> None:
    """Hold a further row of a part against those before: it may leave out, but say nothing else."""
    for name, value in row.items():
        if part.setdefault(name, value) != value:
            raise DriveError(f"{where}: {name}: expected what the rows before say of {part['name']!r}")


def _point(point: list[Any], where: str) -> list[Any]:
    if None in point:
        raise DriveError(f"{where}: {CURVE[point.index(None)]}: expected a value, got none")
    return point


def _nested(part: Mapping[str, Any], constant: Mapping[str, Any]) -> dict[str, Any]:
    """Return fields with those of a part inside it; what rows say goes before what holds for all."""
    found: dict[str, Any] = {
        name: dict(value) if isinstance(value, Mapping) else value for name, value in constant.items()
    }
    for name, value in part.items():
        outer, dot, inner = name.partition(".")
        if not dot:
            found[name] = value
        elif isinstance(found.setdefault(outer, {}), dict):
            found[outer][inner] = value
    return found


def _value(cell: str, column: _Column, known: Known, form: _Form, number: re.Pattern[str], place: str) -> Any:
    """Return what a cell holds: a number in SI units, a text, a whole number, or true or false."""
    kind, quantity = known[column.field]
    if kind == "str":
        if len(cell) > _LONGEST:
            raise DriveError(f"{place}: expected at most {_LONGEST} characters, got {len(cell)}")
        return cell
    if kind == "bool":
        if cell.lower() not in _WORDS:
            raise DriveError(f"{place}: expected yes or no, got {shown(cell)}")
        return _WORDS[cell.lower()]
    written = number.match(cell) if len(cell) <= 60 else None
    if written is None:
        signs = f"decimal {form.decimal!r}" + (f", thousands {form.thousands!r}" if form.thousands else "")
        raise DriveError(f"{place}: expected a number ({signs}), got {shown(cell)}")
    sign, whole, fraction, power, unit = written.groups(default="")
    digits = "".join(filter(str.isdecimal, whole))
    plain = f"{'-' if sign in ('-', '−') else ''}{digits or 0}.{fraction or 0}{power}"
    if quantity is not None:
        unit = _ours(unit) if unit else column.unit
        try:
            found = quantity.read(f"{plain} {unit}".strip(), place)
        except ParameterError as error:
            raise DriveError(str(error)) from error
    elif unit.strip() not in ("", "%"):
        raise DriveError(f"{place}: expected a number without a unit, got {shown(cell)}")
    else:
        found = float(plain)
    if not math.isfinite(found):
        raise DriveError(f"{place}: expected a finite number, got {shown(cell)}")
    if quantity is None and unit:
        return f"{plain} %"
    return int(found) if kind == "int" and found.is_integer() else found
