"""Reading files and streams, never more than a limit."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import IO, Any, TypeAlias

from p3dof._base.checks import shown, visible
from p3dof._base.errors import FileError

MAX_BYTES = 20_000_000
"""Largest text file that is read without another limit [bytes]."""

Source: TypeAlias = str | os.PathLike[str] | IO[str] | IO[bytes]
"""Where text is read from: a file, or a stream that is open for reading, such as the standard input."""


def read_text(source: Source, limit: int = MAX_BYTES) -> str:
    """Return the text of a UTF-8 file or stream.

    Parameters
    ----------
    source : path-like or stream
        The file.
    limit : int
        Largest size [bytes]; no more than that is ever loaded.

    Returns
    -------
    str

    Raises
    ------
    FileError
        If `source` is no path, or the file is missing, unreadable, larger than `limit` or not UTF-8 text.
    """
    name = called(source)
    try:
        text = read_bytes(source, limit).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(f"{name}: expected UTF-8 text, got {error.reason} at byte {error.start}") from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_bytes(source: Source, limit: int = MAX_BYTES) -> bytes:
    """Return the bytes of a file or stream; parameters and errors as of `read_text`."""
    name = called(source)
    try:
        if is_stream(source):
            found = source.read(limit + 1)  # type: ignore[union-attr]  # it can read
            data = found.encode("utf-8", "surrogateescape") if isinstance(found, str) else bytes(found)
        else:
            _require_regular(Path(source), name)  # type: ignore[arg-type]  # it is a path
            with Path(source).open("rb") as stream:  # type: ignore[arg-type]  # likewise
                data = stream.read(limit + 1)
    except FileError:
        raise
    except (OSError, ValueError) as error:
        raise FileError(f"{name}: cannot be read ({reason(error)})") from error
    if len(data) > limit:
        raise FileError(f"{name}: expected at most {limit} bytes")
    return data


def _require_regular(path: Path, name: str) -> None:
    """Raise for what is there but is no file with an end: to open a named pipe may wait for ever."""
    mode = path.stat().st_mode
    if stat.S_ISDIR(mode):
        raise FileError(f"{name}: cannot be read (it is a folder)")
    if not stat.S_ISREG(mode):
        raise FileError(f"{name}: cannot be read (it is a pipe, a socket or a device, not a regular file)")


def is_stream(thing: Any) -> bool:
    """Return whether something is open for reading, instead of the path of a file."""
    return not isinstance(thing, str | os.PathLike) and hasattr(thing, "read")


def called(path: Any) -> str:
    """Return what to call a file or stream in an error.

    Parameters
    ----------
    path : path-like or stream

    Returns
    -------
    str

    Raises
    ------
    FileError
        If it is neither.
    """
    if is_stream(path):
        name = getattr(path, "name", None)
        return {"<stdin>": "standard input"}.get(name, name) if isinstance(name, str) else "standard input"
    try:
        name = str(Path(path))
    except TypeError as error:
        raise FileError(f"expected the path of a file, got {shown(path)}") from error
    return str(path) if len(name) <= 4096 and name == visible(name) and "\n" not in name else shown(name)


def reason(error: Exception) -> str:
    """Return why the system refused, in one line."""
    return (error.strerror if isinstance(error, OSError) else None) or str(error)
