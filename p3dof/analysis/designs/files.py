"""Files of designs, a block of rows at a time: CSV and Parquet, however long they are."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import IO, Any, NamedTuple, NoReturn, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, one_line
from p3dof._base.errors import FileError, InputError, MissingExtraError
from p3dof._base.files import called, is_stream, reason, suffix_of, write_streamed
from p3dof._base.files.parquet import READ, WRITE, damage_told, pyarrow
from p3dof.analysis.designs.names import Column, columns_of

_LONGEST_LINE = 100_000
"""Longest line of a CSV file [characters]."""
_SHOWN = 40

Meaning: TypeAlias = Callable[[Sequence[str]], list[Column]]
"""Gives the columns that headers mean, or raises `InputError`."""


class Rows(NamedTuple):
    """Some rows of a file.

    Parameters
    ----------
    first : int
        Number of the first of them; 1 is that of the first design.
    columns : dict of str to ndarray, shape (n,)
        By header.
    """

    first: int
    columns: dict[str, FloatArray]


def read_designs(source: Any, rows: int, meaning: Meaning = columns_of) -> Iterator[Rows]:
    """Read designs, block by block: no more of the file is held than that.

    Parameters
    ----------
    source : path-like or stream
        A CSV file with the names of columns in its first line, units in brackets, or a Parquet file with such
        names; a stream is CSV.
    rows : int
        Of a block.
    meaning : callable
        Returns the columns that headers mean, or raises.

    Yields
    ------
    Rows

    Raises
    ------
    InputError
        If a name, a unit or a number does not fit; the message has the row.
    FileError
        If the file cannot be read.
    MissingExtraError
        If pyarrow is not installed, which Parquet needs.
    """
    name = called(source)
    parquet = not is_stream(source) and Path(source).suffix.lower() == ".parquet"
    try:
        reader = _read_parquet if parquet else _read_csv
        yield from reader(source, name, rows, meaning)
    except UnicodeDecodeError as error:
        raise FileError(f"{name}: expected UTF-8 text, got {error.reason}") from error
    except (FileError, InputError, MissingExtraError):
        raise
    except OSError as error:
        raise FileError(f"{name}: cannot be read ({reason(error)})") from error


def count_designs(source: Any) -> int | None:
    """Return about how many designs a file has, for a progress bar; None where that cannot be known."""
    if is_stream(source):
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
    if not is_stream(source):
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
        lines = _lines(stream, name)
        header = _header(next(lines, (0, ""))[1], name, meaning)
        first, taken = 1, []
        for numbered in lines:
            taken.append(numbered)
            if len(taken) == rows:
                yield Rows(first, _columns(taken, header, name, first))
                first, taken = first + rows, []
        if taken or first == 1:
            if not taken:
                raise InputError(f"{name}: expected rows of numbers after the names of columns, got none")
            yield Rows(first, _columns(taken, header, name, first))


def _lines(stream: IO[str], name: str) -> Iterator[tuple[int, str]]:
    """Yield (number, line) of each line that is not blank and not a comment."""
    for number, line in enumerate(iter(partial(stream.readline, _LONGEST_LINE), ""), start=1):
        if len(line) == _LONGEST_LINE:
            raise InputError(f"{name}, line {number}: expected less than {_LONGEST_LINE} characters")
        if line.strip() and not line.lstrip().startswith("#"):
            yield number, line


def _header(line: str, name: str, meaning: Meaning) -> list[str]:
    if not line:
        raise InputError(f"{name}: expected the names of columns first, got an empty file")
    fields = [field.strip() for field in next(csv.reader([line]))]
    for separator, word in ((";", "semicolons"), ("\t", "tabs")):
        if len(fields) == 1 and separator in fields[0]:
            raise InputError(f"{name}: expected commas between the columns, got {word}")
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
    """Raise `InputError` if the first line of a table has numbers where names of columns belong.

    Parameters
    ----------
    fields : sequence of str
        Of the first line.
    name : str
        What to call the file.
    """
    if fields and all(_is_number(field) for field in fields):
        raise InputError(
            f"{name}: the first line has numbers only; expected the names of the columns there, such as "
            "R [mm],platform.mass"
        )


def _columns(
    taken: Sequence[tuple[int, str]], header: Sequence[str], name: str, first: int
) -> dict[str, FloatArray]:
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
    return dict(zip(header, np.ascontiguousarray(table.T), strict=True))


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
            if not _is_number(field):
                got = repr(one_line(field.strip(), _SHOWN)) if field.strip() else "nothing"
                raise InputError(f"{where}, column {one_line(column)}: expected a number, got {got}")
    raise InputError(f"{name}, rows {first} to {first + len(taken) - 1}: not valid CSV")


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return "_" not in field and field.isascii()


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
            raise FileError(f"{told} (it says that it has {file.metadata.num_rows} rows)")


def _numbers(column: Any, field: str, name: str, first: int) -> FloatArray:
    kind, types = column.type, pyarrow().types
    if not (types.is_floating(kind) or types.is_integer(kind)):
        raise InputError(f"{name}, column {field}: expected numbers, got the type {kind}")
    if column.null_count:
        missing = int(np.argmax(column.is_null().to_numpy(zero_copy_only=False)))
        raise InputError(f"{name}, row {first + missing}, column {field}: expected a number, got nothing")
    return np.asarray(column.to_numpy(zero_copy_only=False), dtype=np.float64)


class ResultWriter:
    """Writes rows of results as they come; columns are those of the first block.

    Parameters
    ----------
    stream : binary stream
        Where to.
    parquet : bool
        As Parquet, else as CSV.
    """

    def __init__(self, stream: IO[bytes], parquet: bool) -> None:
        self._stream, self._parquet = stream, parquet
        self._table: Any = None
        self._header: list[str] = []

    def write(self, columns: Mapping[str, NDArray[Any]]) -> None:
        """Write a block of rows, each column (n,): numbers, or text."""
        if self._parquet:
            self._write_parquet(columns)
            return
        if not self._header:
            self._header = list(columns)
            row = io.StringIO(newline="")
            csv.writer(row, lineterminator="\n").writerow(self._header)
            self._stream.write(row.getvalue().encode())
        lists = [
            array.tolist() if array.dtype.kind in "OU" else list(map(repr, array.tolist()))
            for array in columns.values()
        ]
        text = "".join([f"{','.join(row)}\n" for row in zip(*lists, strict=True)])
        self._stream.write(text.encode())

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
    """Open a file for results that takes its place when all is written, or not at all.

    Parameters
    ----------
    path : Path
        Ends in ``.csv`` or ``.parquet``.

    Yields
    ------
    ResultWriter

    Raises
    ------
    InputError, FileError, MissingExtraError
        If it cannot be written.
    """
    parquet = suffix_of(path, "designs") == ".parquet"
    if parquet:
        pyarrow()
    opened: AbstractContextManager[IO[bytes]] = write_streamed(path)
    with opened as stream:
        writer = ResultWriter(stream, parquet)
        try:
            yield writer
        except BaseException:
            with suppress(Exception):  # what it is closed over is removed
                writer.close()
            raise
        writer.close()
