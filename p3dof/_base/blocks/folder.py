"""The folder of a sweep: where its files are, which blocks are there, and who works on it."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import socket
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

from p3dof._base.blocks.manifest import NAME_OF_FILE, Manifest
from p3dof._base.errors import FileError, SweepError
from p3dof._base.files import called, make_folders
from p3dof._base.files.reading import reason

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

TOTALS = "reductions.npz"
"""What the reductions found in all blocks, once all are there."""

_LOCK = "sweep.lock"
_BLOCKS = "blocks"
_IN_A_FOLDER = 1000
_FILE = re.compile(r"(\d{10})\.(npz|parquet)", re.ASCII)

_NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP}

_working: set[Path] = set()
_guard = threading.Lock()


def path_of(folder: Path, manifest: Manifest, number: int) -> Path:
    """Return the file of a block: a thousand in each folder."""
    name = f"{number:010d}.{manifest.format}"
    return folder / _BLOCKS / f"{number // _IN_A_FOLDER:07d}" / name


def numbers_there(folder: Path, manifest: Manifest) -> list[int]:
    """Return the numbers of the blocks that have a file, rising.

    Parameters
    ----------
    folder : Path
        Of the sweep.
    manifest : Manifest
        Of the sweep.

    Returns
    -------
    list of int

    Raises
    ------
    FileError
        If the folder cannot be read.
    """
    found: list[int] = []
    try:
        with contextlib.suppress(FileNotFoundError):
            for inner in os.scandir(folder / _BLOCKS):
                if not inner.is_dir():
                    continue
                with os.scandir(inner) as files:
                    matches = [_FILE.fullmatch(file.name) for file in files]
                found += [int(match[1]) for match in matches if match and match[2] == manifest.format]
    except OSError as error:
        raise FileError(f"{called(folder)}: cannot be read ({reason(error)})") from error
    return sorted(number for number in set(found) if number < manifest.blocks)


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep the folder of a sweep for this process alone; the system drops the lock when the process ends.

    Parameters
    ----------
    folder : Path
        Made if it is missing.

    Raises
    ------
    SweepError
        If somebody else works on it.
    FileError
        If the folder cannot be made or written in.
    """
    try:
        make_folders(folder.resolve())
        path = folder.resolve() / _LOCK
        with _guard:
            if path in _working:
                raise SweepError(f"{called(folder)}: this process works on this sweep already")
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
            _working.add(path)
    except OSError as error:
        if isinstance(error, FileError):
            raise
        raise FileError(f"{called(folder)}: cannot be written ({reason(error)})") from error
    try:
        if not _take(descriptor):
            who = os.pread(descriptor, 200, 0).decode("utf-8", "replace") if hasattr(os, "pread") else ""
            raise SweepError(f"{called(folder)}: another process works on this sweep{_by(who)}")
        os.ftruncate(descriptor, 0)
        os.write(descriptor, f"{os.getpid()} on {socket.gethostname()}".encode())
        yield
    finally:
        os.close(descriptor)
        with _guard:
            _working.discard(path)


def _take(descriptor: int) -> bool:
    """Lock a file; false if another process has done so. A child that is forked does not share the lock."""
    try:
        if sys.platform == "win32":
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno in _NO_LOCKS  # a file system without locks: nobody can be told apart
    return True


def _by(who: str) -> str:
    return f" (process {who.strip()})" if re.fullmatch(r"\d+ on [\w.\-]+", who.strip()) else ""


def require_folder(folder: Path) -> None:
    """Raise `SweepError` unless a worker sees the folder of the sweep."""
    if not (folder / NAME_OF_FILE).is_file():
        raise SweepError(
            f"{folder}: a worker on {socket.gethostname()} does not see this folder; share it between the "
            "machines, or let the blocks come back to be written here (shared=False)"
        )
