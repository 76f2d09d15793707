"""Temporary files and folders that whoever comes later can tell from those in use, and remove.

Each is locked as long as the process that made it holds it open. The system drops the lock when that process
ends, however it ends: what bears our name and is not locked belongs to nobody any more.
"""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from p3dof._base.errors import FileError

if sys.platform != "win32":
    import fcntl

_NAME = re.compile(r"\.p3dof-[0-9a-f]{16}\.tmp")


def new_name(folder: Path) -> Path:
    """Return a name in a folder that nothing bears, for something temporary."""
    return folder / f".p3dof-{secrets.token_hex(8)}.tmp"


def new_file(folder: Path) -> tuple[Path, int]:
    """Make an empty temporary file with the permissions that any new file gets.

    Parameters
    ----------
    folder : Path
        Where; what killed processes left there is removed.

    Returns
    -------
    path : Path
    descriptor : int
        Open for writing; the file counts as in use until it is closed.

    Raises
    ------
    OSError
        If it cannot be made.
    """
    sweep_once(folder)
    while True:
        path = new_name(folder)
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
        descriptor = os.open(path, flags, 0o666)  # the kernel takes the umask off
        if _held(descriptor):
            return path, descriptor
        os.close(descriptor)


@contextlib.contextmanager
def scratch_folder() -> Iterator[Path]:
    """Make a folder for intermediate files in the system's place for such, and remove it in the end.

    Yields
    ------
    Path

    Raises
    ------
    FileError
        If there is no such place, or it is full.
    """
    try:
        parent = Path(tempfile.gettempdir())
        sweep_once(parent)
        path, descriptor = _new_folder(parent)
    except OSError as error:
        raise FileError(f"no folder for temporary files ({error.strerror or error})") from error
    try:
        yield path
    finally:
        shutil.rmtree(path, ignore_errors=True)
        if descriptor is not None:
            os.close(descriptor)


def _new_folder(parent: Path) -> tuple[Path, int | None]:
    while True:
        path = new_name(parent)
        path.mkdir(0o700)
        if sys.platform == "win32":
            return path, None
        descriptor = os.open(path, os.O_RDONLY)
        if _held(descriptor):
            return path, descriptor
        os.close(descriptor)


def hold(path: Path) -> int | None:
    """Open an existing file so that it counts as in use under a temporary name; None if that cannot be."""
    try:
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    except OSError:
        return None
    if sys.platform != "win32":
        with contextlib.suppress(OSError):  # somebody else's lock does as well
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    return descriptor


@cache
def sweep_once(folder: Path) -> None:
    """Sweep a folder the first time that this process writes there."""
    sweep(folder)


def sweep(folder: Path) -> None:
    """Remove what processes that ended without cleaning up left in a folder: ours by name, owner and lock.

    Parameters
    ----------
    folder : Path
        Where to look; folders below it are left alone.
    """
    with contextlib.suppress(OSError):
        for name in filter(_NAME.fullmatch, os.listdir(folder)):  # noqa: PTH208 - many names, no objects
            with contextlib.suppress(OSError):
                _remove_if_left(folder / name)


def _remove_if_left(path: Path) -> None:
    if sys.platform == "win32":
        path.unlink()  # refused while it is open
        return
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        status = os.fstat(descriptor)
        if status.st_uid != os.geteuid():
            return
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)  # an error: somebody works on it
        if stat.S_ISDIR(status.st_mode):
            shutil.rmtree(path)
        elif stat.S_ISREG(status.st_mode):
            path.unlink()
    finally:
        os.close(descriptor)


def _held(descriptor: int) -> bool:
    """Lock what was just made; return whether it is still there (a sweep may have come between)."""
    if sys.platform == "win32":
        return True
    with contextlib.suppress(OSError):  # a file system without locks: nobody can take it for left
        fcntl.flock(descriptor, fcntl.LOCK_EX)
    return os.fstat(descriptor).st_nlink > 0
