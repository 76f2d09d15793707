"""Archives of arrays: NumPy's .npz of plain arrays, read with no trust in who wrote it, and Parquet."""

from __future__ import annotations

import io
import math
import os
import re
import stat
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, TypeAlias

import numpy as np

from p3dof._base.checks import one_line
from p3dof._base.errors import FileError, MissingExtraError
from p3dof._base.files.reading import called

MAX_TEXT = 10_000
"""Longest text that is read without another limit [characters]."""

_END = struct.Struct("<4s4H2LH")  # the last record of a zip file without a comment
_HEADER = re.compile(
    rb"{'descr': '([<>|][fiU]\d{1,6})', 'fortran_order': (True|False), 'shape': \(([\d, ]{0,40})\), } *\n"
)
_MAGIC = b"\x93NUMPY\x01\x00"

Accept: TypeAlias = Callable[[str, np.dtype[Any], tuple[int, ...]], None]
"""Is given name, type and shape of an array before it is read; raises `UnfitError` unless they are right."""


class UnfitError(ValueError):
    """Why a file is not what it should be."""


_ERRORS = (
    OSError,
    ValueError,  # ours, P3dofError's input errors, and text that is none
    EOFError,
    LookupError,
    RuntimeError,  # of zipfile, about what it does not support
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    OverflowError,
    MemoryError,
)


def pack_arrays(arrays: Mapping[str, Any], compressed: bool = True) -> bytes:
    """Return an archive of arrays."""
    stream = io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(stream, **arrays)
    return stream.getvalue()


def unpack_arrays(
    path: str | os.PathLike[str] | IO[bytes],
    names: Callable[[list[str]], list[str]],
    accept: Accept,
    found: Callable[[dict[str, Any]], None] = lambda _: None,
    *,
    what: str = "arrays saved as .npz",
    max_directory: int = 64_000,
) -> dict[str, Any]:
    """Read the arrays of an archive; numbers of 8 bytes (float64, int64) or text.

    `names`: is given the names that are there, and returns those to read, in this order; raises `UnfitError`
    if there are wrong ones.

    `accept`: is given name, type and shape of each array before its content is read.

    `found`: is given what has been read after every array; what it raises ends the reading before more is.
    """
    name = called(path)
    try:
        if not isinstance(path, str | os.PathLike):
            return _read_archive(path, names, accept, found, max_directory)
        if not stat.S_ISREG(Path(path).stat().st_mode):
            raise UnfitError("it is not a regular file")
        with Path(path).open("rb") as stream:
            return _read_archive(stream, names, accept, found, max_directory)
    except _ERRORS as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error) or "it is cut off"
        raise FileError(f"{name}: expected {what} ({one_line(reason)})") from error


def _read_archive(
    stream: IO[bytes],
    names: Callable[[list[str]], list[str]],
    accept: Accept,
    found: Callable[[dict[str, Any]], None],
    max_directory: int,
) -> dict[str, Any]:
    count = _check_directory(stream, max_directory)
    with zipfile.ZipFile(stream) as archive:
        if len(archive.infolist()) != count:  # one that is damaged may seem to end before
            raise UnfitError(f"it holds {len(archive.infolist())} arrays, but had {count}")
        members = {info.filename: info for info in archive.infolist()}
        for info in archive.infolist():
            if not info.filename.endswith(".npy") or members[info.filename] is not info:
                raise UnfitError(f"it holds {info.filename[:40]!r}, more than it should")
        arrays: dict[str, Any] = {}
        for name in names([key.removesuffix(".npy") for key in members]):
            arrays[name] = _read(archive, members[f"{name}.npy"], name, accept)
            found(arrays)
        return arrays


def _check_directory(stream: IO[bytes], most: int) -> int:
    """Return how many members a zip file has; raise unless the directory at its end is small."""
    size = stream.seek(0, os.SEEK_END)
    before = min(size, _END.size + 20)
    stream.seek(size - before)
    tail = stream.read(before)
    if len(tail) < _END.size:
        raise UnfitError("it is cut off, or something else")
    signature, *_, count, directory, _offset, comment = _END.unpack(tail[-_END.size :])
    if signature != b"PK\5\6" or comment or tail.startswith(b"PK\6\7") or directory > most:
        raise UnfitError("it does not end as such a file does")
    return int(count)


def _read(archive: zipfile.ZipFile, info: zipfile.ZipInfo, name: str, accept: Accept) -> Any:
    """Read one array: first what it claims to be, then as much as that is."""
    if info.compress_type not in {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED} or info.flag_bits & 1:
        raise UnfitError(f"{name}: it is packed by another method")
    with archive.open(info) as member:
        kind, columns_first, shape, header = _header(member, name)
        accept(name, kind, shape)
        size = math.prod(shape) * kind.itemsize
        if info.file_size != header + size:
            raise UnfitError(f"{name}: expected {header + size} bytes, got {info.file_size}")
        data = member.read(size)
        if len(data) != size or member.read(1):
            raise UnfitError(f"{name}: it is cut off")
    flat: np.ndarray[Any, Any] = np.frombuffer(data, kind).astype(kind.newbyteorder("="))
    return flat.reshape(shape, order="F" if columns_first else "C")


def _header(member: IO[bytes], name: str) -> tuple[np.dtype[Any], bool, tuple[int, ...], int]:
    """Return type, order, shape and length of the header of an array."""
    begin = member.read(len(_MAGIC) + 2)
    length = int.from_bytes(begin[-2:], "little")
    if begin[:-2] != _MAGIC or length > 400:
        raise UnfitError(f"{name}: it is no array")
    match = _HEADER.fullmatch(member.read(length))
    if match is None:
        raise UnfitError(f"{name}: it is no array of numbers or text")
    described, order, lengths = (part.decode() for part in match.groups())
    if described.startswith("|") or (described[1] in "fi" and described[2:] != "8"):
        raise UnfitError(f"{name}: expected numbers of 8 bytes, got {described!r}")
    shape = tuple(int(part) for part in lengths.split(",") if part.strip())
    return np.dtype(described), order == "True", shape, len(begin) + length


WRITE = {"write_page_checksum": True}  # how pyarrow is to write
READ = {"page_checksum_verification": True}
"""How it is to read; pages of other programs without a checksum are taken as they are."""


def pyarrow() -> Any:
    """Return pyarrow, with its Parquet."""
    try:
        import pyarrow as found
        import pyarrow.parquet
    except ImportError as error:
        raise MissingExtraError("Parquet files need pyarrow: pip install 'p3dof[tables]'") from error
    return found


@contextmanager
def damage_told(expected: str) -> Iterator[None]:
    """Turn what is said of a damaged file, by pyarrow or in this block, into a `FileError` of one line."""
    errors = (pyarrow().ArrowException, OSError, ValueError, LookupError, OverflowError, MemoryError)
    try:
        yield
    except errors as error:
        raise FileError(f"{expected} ({one_line(str(error), 200)})") from error
