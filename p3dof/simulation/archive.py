"""Runs as NumPy archives: what is in them, and how they are read when somebody else may have made them.

An archive is read with no trust: its directory is bounded before it is taken in, every member's size is known
from its header before its content is, and no more than the declared size is ever decompressed.
"""

from __future__ import annotations

import io
import math
import os
import re
import stat
import struct
import zipfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from p3dof.errors import FileError
from p3dof.files import called

MAX_SAMPLES = 200_000
"""Most samples of a run that is read without another limit: about 100 MB in memory."""
MAX_TEXT = 10_000
"""Longest text that is read [characters]."""

_MAX_DIRECTORY = 64_000  # bytes; that of a run has 1700
_END = struct.Struct("<4s4H2LH")  # the last record of a zip file without a comment
_HEADER = re.compile(
    rb"{'descr': '([<>|][fiU]\d{1,5})', 'fortran_order': (True|False), 'shape': \(([\d, ]{0,40})\), } *\n"
)
_MAGIC = b"\x93NUMPY\x01\x00"


@dataclass(frozen=True)
class Member:
    """What an array of an archive looks like.

    Parameters
    ----------
    kind : str
        NumPy's letter for the kind of its numbers: ``"f"`` (float64), ``"i"`` (int64) or ``"U"`` (text).
    shape : tuple of int or str
        A letter stands for a length that all arrays with this letter share.
    optional : bool
        Whether it may be missing.
    """

    kind: str
    shape: tuple[int | str, ...]
    optional: bool = False


FORM: dict[str, Member] = {
    "time": Member("f", ("N",)),
    "pose": Member("f", ("N", 3)),
    "velocity": Member("f", ("N", 3)),
    "acceleration": Member("f", ("N", 3)),
    "forces": Member("f", ("N", 3)),
    "asked": Member("f", ("N", 3)),
    "sliders": Member("f", ("N", 3)),
    "slider_velocities": Member("f", ("N", 3)),
    "wrench": Member("f", ("N", 6)),
    "closure_error": Member("f", ("N",)),
    "joint_names": Member("U", (10,)),
    "q": Member("f", ("N", 10)),
    "v": Member("f", ("N", 10)),
    "a": Member("f", ("N", 10)),
    "method": Member("U", ()),
    "stop": Member("U", ("S",)),
    "stop_time": Member("f", ()),
    "evaluations": Member("i", ()),
    "seconds": Member("f", ()),
    "reference": Member("f", ("N", 3), optional=True),
}
"""The arrays of a run."""


def pack(arrays: Mapping[str, Any]) -> bytes:
    """Return the archive of a run.

    Parameters
    ----------
    arrays : mapping of str to array-like
        By the names of `FORM`.

    Returns
    -------
    bytes
    """
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def unpack(
    path: str | os.PathLike[str], check: Callable[[dict[str, Any]], None], max_samples: int = MAX_SAMPLES
) -> dict[str, Any]:
    """Read the arrays of a run.

    Parameters
    ----------
    path : path-like
        The archive.
    check : callable
        Is given what has been read after every array; what it raises ends the reading before more is.
    max_samples : int
        Most samples to read.

    Returns
    -------
    dict of str to ndarray
        By the names of `FORM`, with its kinds and shapes; numbers are finite but for ``stop_time``.

    Raises
    ------
    FileError
        If the file cannot be read, or anything in it is not as `FORM` says.
    """
    name = called(path)
    most = {"N": max_samples, "S": 2}
    try:
        if not stat.S_ISREG(Path(path).stat().st_mode):
            raise _UnfitError("it is not a regular file")
        with Path(path).open("rb") as stream:
            _check_directory(stream)
            with zipfile.ZipFile(stream) as archive:
                return _read_all(archive, check, most)
    except _ERRORS as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error) or "it is cut off"
        raise FileError(f"{name}: expected a run saved as .npz ({reason})") from error


class _UnfitError(ValueError):
    """Why a file is no run."""


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


def _check_directory(stream: IO[bytes]) -> None:
    """Raise unless the directory at the end of a zip file is small, whatever the file's size."""
    size = stream.seek(0, os.SEEK_END)
    before = min(size, _END.size + 20)
    stream.seek(size - before)
    tail = stream.read(before)
    if len(tail) < _END.size:
        raise _UnfitError("it is cut off, or something else")
    signature, *_, directory, _offset, comment = _END.unpack(tail[-_END.size :])
    if signature != b"PK\5\6" or comment or tail.startswith(b"PK\6\7") or directory > _MAX_DIRECTORY:
        raise _UnfitError("it does not end as such a file does")


def _read_all(
    archive: zipfile.ZipFile, check: Callable[[dict[str, Any]], None], most: Mapping[str, int]
) -> dict[str, Any]:
    members = {info.filename: info for info in archive.infolist()}
    expected = {f"{name}.npy" for name in FORM}
    for info in archive.infolist():
        if info.filename not in expected or members[info.filename] is not info:
            raise _UnfitError(f"it holds {info.filename[:40]!r}, more than a run has")
    found: dict[str, Any] = {}
    lengths = _Lengths(most)
    for name, form in FORM.items():
        if f"{name}.npy" in members:
            found[name] = _read(archive, members[f"{name}.npy"], name, form, lengths)
            check(found)
        elif not form.optional:
            raise _UnfitError(f"{name} is missing")
    return found


def _read(archive: zipfile.ZipFile, info: zipfile.ZipInfo, name: str, form: Member, lengths: _Lengths) -> Any:
    """Read one array: first what it claims to be, then as much as that is."""
    if info.compress_type not in {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED} or info.flag_bits & 1:
        raise _UnfitError(f"{name}: it is packed in another way")
    with archive.open(info) as member:
        kind, columns_first, shape, header = _header(member, name)
        _check_shape(name, form, kind, shape, lengths)
        size = math.prod(shape) * kind.itemsize
        if info.file_size != header + size:
            raise _UnfitError(f"{name}: expected {header + size} bytes, got {info.file_size}")
        data = member.read(size)
        if len(data) != size or member.read(1):
            raise _UnfitError(f"{name}: it is cut off")
    flat: np.ndarray[Any, Any] = np.frombuffer(data, kind).astype(kind.newbyteorder("="))
    array = flat.reshape(shape, order="F" if columns_first else "C")
    if form.kind == "f" and name != "stop_time" and not np.isfinite(array).all():
        raise _UnfitError(f"{name}: expected finite numbers")
    return array


def _header(member: IO[bytes], name: str) -> tuple[np.dtype[Any], bool, tuple[int, ...], int]:
    """Return type, order, shape and length of the header of an array."""
    begin = member.read(len(_MAGIC) + 2)
    length = int.from_bytes(begin[-2:], "little")
    if begin[:-2] != _MAGIC or length > 400:
        raise _UnfitError(f"{name}: it is no array")
    match = _HEADER.fullmatch(member.read(length))
    if match is None:
        raise _UnfitError(f"{name}: it is no array of numbers or text")
    described, order, lengths = (part.decode() for part in match.groups())
    if described.startswith("|") or (described[1] in "fi" and described[2:] != "8"):
        raise _UnfitError(f"{name}: expected numbers of 8 bytes, got {described!r}")
    shape = tuple(int(part) for part in lengths.split(",") if part.strip())
    return np.dtype(described), order == "True", shape, len(begin) + length


def _check_shape(
    name: str, form: Member, kind: np.dtype[Any], shape: tuple[int, ...], lengths: _Lengths
) -> None:
    if kind.kind != form.kind:
        words = {"f": "numbers", "i": "a whole number", "U": "text"}
        raise _UnfitError(f"{name}: expected {words[form.kind]}, got {kind}")
    if kind.kind == "U" and kind.itemsize > 4 * MAX_TEXT:
        raise _UnfitError(f"{name}: expected at most {MAX_TEXT} characters")
    wanted = tuple(lengths.of(n, shape[i : i + 1]) for i, n in enumerate(form.shape))
    if shape != wanted:
        raise _UnfitError(f"{name}: expected the shape {wanted}, got {shape}")


class _Lengths:
    """The lengths that letters stand for: the first array with a letter tells, within what is allowed."""

    def __init__(self, most: Mapping[str, int]) -> None:
        self._most = most
        self._known: dict[str, int] = {}

    def of(self, length: int | str, got: tuple[int, ...]) -> int:
        """Return the length that an array should have where it has `got`."""
        if isinstance(length, int):
            return length
        if length not in self._known and got:
            if got[0] > self._most[length]:
                raise _UnfitError(f"expected at most {self._most[length]} samples, got {got[0]}")
            self._known[length] = got[0]
        return self._known.get(length, 0)
