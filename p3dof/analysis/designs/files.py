"""Files of designs, a block of rows at a time: CSV and Parquet, however long they are."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from dataclasses import field as data_field
from functools import partial
from itertools import islice
from pathlib import Path
from typing import IO, Any, NamedTuple, NoReturn, TypeAlias, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from p3dof._base import files
from p3dof._base.checks import FloatArray, is_number, one_line, real, require_commas, shown, unknown_field
from p3dof._base.errors import FileError, InputError, MissingExtraError, MotionError, ParameterError
from p3dof._base.files.archives import READ, WRITE, damage_told, pyarrow
from p3dof._base.quantities import Quantity
from p3dof._base.tables import Table, formatted, table_of
from p3dof._base.tables import number as number_text
from p3dof.analysis.designs.columns import LENGTHS, BodiesOfDesigns, Column, Designs, columns_of
from p3dof.analysis.designs.evaluation import BLOCK, DesignEvaluation
from p3dof.analysis.designs.results import DesignForces, DesignStatus
from p3dof.machine.motion import Motion, WrenchHistory, paper_motion
from p3dof.machine.parameters import Parameters, read_parameters
from p3dof.machine.parameters.machine import LARGEST

_LONGEST_LINE = 100_000  # longest line of a CSV file [characters]
_SHOWN = 40

Meaning: TypeAlias = Callable[[Sequence[str]], list[Column]]
"""Gives the columns that headers mean, or raises `InputError`."""


class Rows(NamedTuple):
    """Some rows of a file."""

    first: int  # number of the first of them; 1 is that of the first design
    columns: dict[str, FloatArray]  # (n,): by header


def read_designs(source: Any, rows: int, meaning: Meaning = columns_of) -> Iterator[Rows]:
    """Read designs, block by block: no more of the file is held than that."""
    name = files.called(source)
    parquet = not files.is_stream(source) and Path(source).suffix.lower() == ".parquet"
    try:
        reader = _read_parquet if parquet else _read_csv
        yield from reader(source, name, rows, meaning)
    except UnicodeDecodeError as error:
        raise FileError(f"{name}: expected UTF-8 text, got {error.reason}") from error
    except (FileError, InputError, MissingExtraError):
        raise
    except OSError as error:
        raise FileError(f"{name}: cannot be read ({files.reason(error)})") from error


def count_designs(source: Any) -> int | None:
    """Return about how many designs a file has, for a progress bar; None where that cannot be known."""
    if files.is_stream(source):
        return None
    try:
        if Path(source).suffix.lower() == ".parquet":
            return int(pyarrow().parquet.ParquetFile(source).metadata.num_rows)
        with Path(source).open("rb") as stream:
            return max(sum(chunk.count(b"\n") for chunk in iter(partial(stream.read, 1 << 20), b"")) - 1, 0)
    except Exception:  # reading it tells
        return None


@contextmanager
def _text(source: Any) -> Iterator[IO[str]]:
    if not files.is_stream(source):
        with Path(source).open(encoding="utf-8-sig", newline="") as stream:
            yield stream
    elif isinstance(source, io.TextIOBase):
        yield cast(IO[str], source)
    else:
        text = io.TextIOWrapper(source, encoding="utf-8-sig", newline="")
        try:
            yield text
        finally:
            text.detach()


def _read_csv(source: Any, name: str, rows: int, meaning: Meaning) -> Iterator[Rows]:
    with _text(source) as stream:
        lines = iter(partial(stream.readline, _LONGEST_LINE), "")
        number, line = next(_numbered(_short(lines, name, 0), 1), (0, ""))
        header, first = _header(line, name, meaning), 1
        while taken := list(islice(_short(lines, name, number), rows)):
            columns = _columns(taken, number + 1, header, name, first)
            number += len(taken)
            del taken  # it is as large as what is computed next
            if count := len(columns[header[0]]):
                yield Rows(first, columns)
                first += count
        if first == 1:
            raise InputError(f"{name}: expected rows of numbers after the names of columns, got none")


def _short(lines: Iterator[str], name: str, before: int) -> Iterator[str]:
    """Yield lines; raise for one that is too long."""
    for number, line in enumerate(lines, before + 1):
        if len(line) == _LONGEST_LINE:
            raise InputError(f"{name}, line {number}: expected less than {_LONGEST_LINE} characters")
        yield line


def _numbered(lines: Iterable[str], first: int) -> Iterator[tuple[int, str]]:
    """Yield (number, line) of each line that is not blank and not a comment."""
    for number, line in enumerate(lines, first):
        if line.strip() and not line.lstrip().startswith("#"):
            yield number, line


def _header(line: str, name: str, meaning: Meaning) -> list[str]:
    if not line:
        raise InputError(f"{name}: expected the names of columns first, got an empty file")
    fields = [field.strip() for field in next(csv.reader([line]))]
    require_commas(fields, name, InputError)
    _check_names(fields, name, meaning)
    return fields


def _check_names(fields: Sequence[str], name: str, meaning: Meaning) -> None:
    require_header(fields, name)
    for number, field in enumerate(fields, start=1):
        try:
            meaning([field])
        except InputError as error:  # noqa: PERF203 - a few names
            raise InputError(f"{name}, column {number}: {_bare(error)}") from error
    try:
        meaning(fields)
    except InputError as error:
        raise InputError(f"{name}: {_bare(error)}") from error


def _bare(error: InputError) -> str:
    """Return a message without what it is about, where a file says that."""
    return str(error).removeprefix("designs: ").removeprefix("runs: ")


def require_header(fields: Sequence[str], name: str) -> None:
    """Raise `InputError` if the first line of a table has numbers where names of columns belong."""
    if fields and all(is_number(field) for field in fields):
        raise InputError(
            f"{name}: the first line has numbers only; expected the names of the columns there, such as "
            "R [mm],platform.mass"
        )


def _columns(
    lines: Sequence[str], number: int, header: Sequence[str], name: str, first: int
) -> dict[str, FloatArray]:
    text = "".join(lines)
    if "\r" in text:
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    table = files.numbers_of_lines(text, 0, _LONGEST_LINE, len(header))
    if table is None:
        table = _read_with_care(list(_numbered(lines, number)), header, name, first)
    return dict(zip(header, np.ascontiguousarray(table.T), strict=True))


def _read_with_care(
    taken: Sequence[tuple[int, str]], header: Sequence[str], name: str, first: int
) -> FloatArray:
    """Read what is not plain numbers between commas, and name the first field that is no number."""
    if not taken:
        return np.empty((0, len(header)))
    try:
        table = np.loadtxt(
            [line for _, line in taken],
            delimiter=",",
            ndmin=2,
            comments=None,
            quotechar='"',
            dtype=np.float64,
        )
    except ValueError:
        _name_the_field(taken, header, name, first)
    if table.shape != (len(taken), len(header)):
        _name_the_field(taken, header, name, first)
    return table


def _name_the_field(
    taken: Sequence[tuple[int, str]], header: Sequence[str], name: str, first: int
) -> NoReturn:
    """Raise for the first field that is no number."""
    for row, (number, line) in enumerate(taken, start=first):
        fields = next(csv.reader([line]), [])
        where = f"{name}, row {row} (line {number})"
        if len(fields) != len(header):
            raise InputError(f"{where}: expected {len(header)} columns, got {len(fields)}")
        for column, field in zip(header, fields, strict=True):
            if not is_number(field):
                got = repr(one_line(field.strip(), _SHOWN)) if field.strip() else "nothing"
                raise InputError(f"{where}, column {one_line(column)}: expected a number, got {got}")
    raise InputError(f"{name}, rows {first} to {first + len(taken) - 1}: not valid CSV")


def _read_parquet(source: Any, name: str, rows: int, meaning: Meaning) -> Iterator[Rows]:
    told, parquet = f"{name}: no Parquet file, or damaged", pyarrow().parquet
    with Path(source).open("rb") as stream:
        with damage_told(told):
            file = parquet.ParquetFile(stream, **READ)
            header = list(file.schema_arrow.names)
        _check_names(header, name, meaning)
        if not file.metadata.num_rows:
            raise InputError(f"{name}: expected rows of numbers, got none")
        with damage_told(told):
            batches = file.iter_batches(batch_size=rows)
        first = 1
        while True:
            with damage_told(told):
                batch = next(batches, None)
            if batch is None:
                break
            columns = {field: _numbers(batch.column(field), field, name, first) for field in header}
            yield Rows(first, columns)
            first += len(batch)
        if first != file.metadata.num_rows + 1:
            raise FileError(f"{told} (its metadata list {file.metadata.num_rows} rows)")


def _numbers(column: Any, field: str, name: str, first: int) -> FloatArray:
    kind, types = column.type, pyarrow().types
    if not (types.is_floating(kind) or types.is_integer(kind)):
        raise InputError(f"{name}, column {field}: expected numbers, got the type {kind}")
    if column.null_count:
        missing = int(np.argmax(column.is_null().to_numpy(zero_copy_only=False)))
        raise InputError(f"{name}, row {first + missing}, column {field}: expected a number, got nothing")
    return np.asarray(column.to_numpy(zero_copy_only=False), dtype=np.float64)


class ResultWriter:
    """Writes rows of results as they come; columns are those of the first block."""

    def __init__(self, stream: IO[bytes], parquet: bool) -> None:
        self._stream, self._parquet = stream, parquet
        self._table: Any = None
        self._begun = False

    def write(self, columns: Mapping[str, NDArray[Any]]) -> None:
        """Write a block of rows, each column (n,): numbers, or text."""
        if self._parquet:
            self._write_parquet(columns)
            return
        if not self._begun:
            self._begun = True
            self._stream.write(files.csv_line(columns))
        for start in range(0, len(next(iter(columns.values()))), BLOCK):
            block = (column[start : start + BLOCK] for column in columns.values())
            self._stream.write(files.table_lines([x.tolist() if x.dtype.kind in "OU" else x for x in block]))

    def _write_parquet(self, columns: Mapping[str, NDArray[Any]]) -> None:
        table = pyarrow().table(dict(columns))
        if self._table is None:
            self._table = pyarrow().parquet.ParquetWriter(self._stream, table.schema, **WRITE)
        self._table.write_table(table)

    def close(self) -> None:
        """Write what a file ends in."""
        if self._table is not None:
            self._table.close()


@contextmanager
def results_file(path: Path) -> Iterator[ResultWriter]:
    """Open a file for results that takes its place when all is written, or not at all."""
    parquet = files.suffix_of(path, "designs") == ".parquet"
    if parquet:
        pyarrow()
    opened: AbstractContextManager[IO[bytes]] = files.write_streamed(path)
    with opened as stream:
        writer = ResultWriter(stream, parquet)
        try:
            yield writer
        except BaseException:
            with suppress(Exception):  # what it is closed over is removed
                writer.close()
            raise
        writer.close()


_T = TypeVar("_T")


def mapping(value: Any, where: str, fields: tuple[str, ...] | None) -> Mapping[str, Any]:
    """Return a mapping that is not empty, and has no fields but these if they are told."""
    if not isinstance(value, Mapping) or not value:
        raise InputError(f"{where}: expected fields, got {'nothing' if not value else shown(value)}")
    for key in value:
        if not isinstance(key, str) or (fields is not None and key not in fields):
            told = unknown_field(key, value, fields) if fields else f"unknown field {shown(key)}"
            raise InputError(f"{where}: {told}")
    return value


def listed(value: Any, where: str) -> list[Any]:
    """Return a list."""
    if not isinstance(value, list):
        raise InputError(f"{where}: expected a list, got {shown(value)}")
    return value


def named(where: str, make: Callable[[], _T]) -> _T:
    """Return what a constructor makes; errors about arguments get the place in the file in front."""
    try:
        return make()
    except (InputError, MotionError, ParameterError) as error:
        told = str(error.args[0])
        if told.startswith(where):
            raise
        raise type(error)(f"{where}: {told}") from error
    except TypeError as error:  # a value of a kind that no constructor expects
        raise InputError(f"{where}: {error}") from error


def number_of(value: Any, quantity: Quantity | None, where: str) -> float:
    """Return a number in SI units of one that may have a unit, where there is one."""
    found = value if quantity is None else quantity.read(value, where)
    if isinstance(found, bool) or not isinstance(found, int | float):
        what = "a number without a unit" if quantity is None else quantity.name
        raise InputError(f"{where}: expected {what}, got {shown(value)}")
    return real(where, found)


def machine_of(value: Any, folder: Path, where: str, any_size: bool) -> Parameters | None:
    """Return the machine of a file or of fields, if there is one."""
    if value is None:
        return None
    if isinstance(value, str):
        return read_beside(lambda path: read_parameters(path, any_size), folder, value, where)
    return Parameters.from_dict(value, where, any_size)


def motion_of(value: Any, folder: Path, where: str) -> Motion:
    """Return the paper's motion or that of a file."""
    if isinstance(value, str):
        return read_beside(Motion.from_csv, folder, value, where)
    data = mapping(value, where, ("paper", "file", "samples"))
    if "paper" in data and len(data) == 1:
        return paper_motion(data["paper"])
    if "file" not in data or "paper" in data or not isinstance(data["file"], str):
        raise InputError(f"{where}: expected a motion file, {{file: ..., samples: ...}} or {{paper: ...}}")
    motion = read_beside(Motion.from_csv, folder, data["file"], where)
    return motion.resampled(data["samples"]) if "samples" in data else motion


def wrench_of(value: Any, folder: Path, where: str) -> Any:
    """Return the load of a file, or what else the field holds."""
    return read_beside(WrenchHistory.from_csv, folder, value, where) if isinstance(value, str) else value


def read_beside(read: Callable[[Path], _T], folder: Path, name: str, where: str) -> _T:
    """Return what a file holds that is named in this one; say so if it is not there."""
    path = folder / name
    if not os.path.exists(path):  # noqa: PTH110 - Path.exists fails where a name is too long
        raise FileError(
            f"{where}: there is no file {files.called(path)}; names count from the folder of this file"
        )
    return read(path)


ROWS = 16 * BLOCK  # rows of a file that are computed at a time: enough for all threads

_WORDS = np.array([status.name.lower() for status in DesignStatus], dtype=object)


@dataclass
class DesignSummary:
    """How many designs can and cannot, and the best of those that can."""

    best: int = 10  # how many of the best to keep: those with the least largest force
    count: int = 0
    by_status: NDArray[np.int_] = data_field(
        default_factory=lambda: np.zeros(len(DesignStatus), dtype=np.int_)
    )
    rows: NDArray[np.int_] = data_field(default_factory=lambda: np.zeros(0, dtype=np.int_))
    peaks: FloatArray = data_field(default_factory=lambda: np.zeros((0, 3)))
    columns: dict[str, FloatArray] = data_field(default_factory=dict)

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
            status.in_words: (formatted(many, "d"),)
            for status, many in zip(DesignStatus, self.by_status, strict=True)
            if many
        }
        tables = [table_of(f"{self.count} designs", ("of these", "designs"), counts)]
        if len(self.rows):
            header = ("row", *self.columns, "peak A [N]", "peak B [N]", "peak C [N]")
            numbers = np.column_stack([*self.columns.values(), self.peaks])
            best = {
                str(row): tuple(map(number_text, line)) for row, line in zip(self.rows, numbers, strict=True)
            }
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
    """Compute designs block by block."""
    for rows in blocks:
        designs = Designs(rows.columns, machine, bodies)
        if not any_size:
            require_size(columns_of(rows.columns), rows, source)
        yield rows, evaluation.evaluate(designs)


def require_size(columns: Iterable[Column], rows: Rows, source: str) -> None:
    """Raise `InputError` for a machine of more than 20 m: most are in millimetres without saying so."""
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
