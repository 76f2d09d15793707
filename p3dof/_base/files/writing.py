"""Writing files whole or not at all, one by one or together; their kinds, and what is generated.

Temporary files and folders that whoever comes later can tell from those in use, and remove.

Each is locked as long as the process that made it holds it open. The system drops the lock when that process
ends, however it ends: what bears our name and is not locked belongs to nobody any more.
"""

from __future__ import annotations

import contextlib
import csv
import errno
import io
import math
import os
import re
import secrets
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache
from itertools import zip_longest
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.errors import FileError, InputError, P3dofError
from p3dof._base.files.numbers import table_lines
from p3dof._base.files.reading import called, read_text, reason

if sys.platform != "win32":
    import fcntl

_NAME = re.compile(r"\.p3dof-[0-9a-f]{16}\.tmp")


def new_name(folder: Path) -> Path:
    """Return a name in a folder that nothing bears, for something temporary."""
    return folder / f".p3dof-{secrets.token_hex(8)}.tmp"


def new_file(folder: Path) -> tuple[Path, int]:
    """Make an empty temporary file with the permissions that any new file gets."""
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
    """Make a folder for intermediate files in the system's place for such, and remove it in the end."""
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
    """Remove what processes that ended without cleaning up left in a folder: ours by name, owner and lock."""
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


def write_atomic(path: str | os.PathLike[str], content: str | bytes) -> Path:
    """Write a file whole or not at all: an existing file is replaced only when the new one is complete.

    Within `together` it is replaced at the end of that block.

    The path written, as it was given.
    """
    with _named(path), together():
        data = content.encode("utf-8") if isinstance(content, str) else content
        _open_set.get().stage(path, data)  # type: ignore[union-attr]  # `together` opened one
    return Path(path)


@contextlib.contextmanager
def together() -> Iterator[None]:
    """Let all files that are written in this block replace what is there at its end: all of them or none.

    Each file is complete on the disk before the first one is replaced. When one cannot be replaced, those
    before it are put back. An exception that leaves the block leaves everything as it was. A block within
    another is part of it.
    """
    if _open_set.get() is not None:
        yield
        return
    files = _FileSet()
    token = _open_set.set(files)
    try:
        yield
        files.replace()
    finally:
        _open_set.reset(token)
        files.close()


@contextlib.contextmanager
def write_streamed(path: str | os.PathLike[str]) -> Iterator[IO[bytes]]:
    """Write a file piece by piece: it takes its place at the end of this block, whole, or not at all.

    Where to write.
    """
    with _named(path):
        files = _FileSet()
        try:
            with files.stream(path) as stream:
                yield stream
            files.replace()
        finally:
            files.close()


def check_writable(path: str | os.PathLike[str]) -> None:
    """Find out whether a file can be written, before the work for it begins; nothing is left behind."""
    with _named(path):
        target = _target(path)
        _require_place(target.parent)
        folder = next(parent for parent in target.parents if parent.exists())
        for part in target.relative_to(folder).parts:
            with contextlib.suppress(FileNotFoundError):
                (folder / part).stat()  # an error: longer than names may be here
        trial, descriptor = new_file(folder)
        os.close(descriptor)
        trial.unlink()


@dataclass
class _Staged:
    """A file that is complete, and waits to take its place."""

    name: str
    target: Path
    path: Path
    descriptor: int | None
    backup: Path | None = None
    backup_descriptor: int | None = None


class _FileSet:
    """Files that replace what is there at one time."""

    def __init__(self) -> None:
        self._staged: dict[Path, _Staged] = {}
        self._made: list[Path] = []
        self._done = False

    def stage(self, path: str | os.PathLike[str], data: bytes) -> None:
        """Write a file beside where it is to be."""
        with self.stream(path) as stream:
            stream.write(data)

    @contextlib.contextmanager
    def stream(self, path: str | os.PathLike[str]) -> Iterator[IO[bytes]]:
        """Open a file beside where it is to be."""
        target = _target(path)
        self._made += make_folders(target.parent)
        earlier = self._staged.pop(target, None)
        if earlier is not None:
            _discard(earlier)
        found, descriptor = new_file(target.parent)
        self._staged[target] = _Staged(called(path), target, found, descriptor)
        if target.exists():
            found.chmod(target.stat().st_mode & 0o777)
        with os.fdopen(descriptor, "wb", closefd=False) as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())

    def replace(self) -> None:
        """Put all files in their places, or all back."""
        replaced: list[_Staged] = []
        try:
            for staged in self._staged.values():
                with _named(staged.name):
                    replaced.append(staged)
                    _put(staged, keep=len(self._staged) > 1)
        except BaseException:
            for staged in reversed(replaced):
                _put_back(staged)
            raise
        self._done = True

    def close(self) -> None:
        """Remove what is temporary, and folders that turned out not to be needed."""
        for staged in self._staged.values():
            _discard(staged)
        if not self._done:
            for folder in reversed(self._made):
                with contextlib.suppress(OSError):
                    folder.rmdir()


_open_set: ContextVar[_FileSet | None] = ContextVar("_open_set", default=None)


def _put(staged: _Staged, keep: bool) -> None:
    """Replace one file; keep what was there until all are replaced."""
    if keep and staged.target.exists():
        backup = staged.backup = new_name(staged.target.parent)
        staged.backup_descriptor = hold(staged.target)
        try:
            os.link(staged.target, backup)
        except OSError:  # a file system without links, or somebody else's file
            staged.target.replace(backup)
    if os.name == "nt" and staged.descriptor is not None:  # an open file cannot be renamed there
        os.close(staged.descriptor)
        staged.descriptor = None
    staged.path.replace(staged.target)


def _put_back(staged: _Staged) -> None:
    """Undo `_put`, wherever it stopped."""
    if staged.backup is not None:
        with contextlib.suppress(OSError):
            staged.backup.replace(staged.target)
    elif not staged.path.exists():  # it took a place that was free
        with contextlib.suppress(OSError):
            staged.target.unlink()


def _discard(staged: _Staged) -> None:
    for path, descriptor in ((staged.path, staged.descriptor), (staged.backup, staged.backup_descriptor)):
        if path is not None:
            path.unlink(missing_ok=True)
        if descriptor is not None:
            os.close(descriptor)


def _target(path: str | os.PathLike[str]) -> Path:
    """Return the file behind a path; raise unless there is a regular one or none."""
    target = Path(path).resolve()
    try:
        mode = target.stat().st_mode
    except FileNotFoundError:
        return target
    if not stat.S_ISREG(mode):
        what = "a folder" if stat.S_ISDIR(mode) else "not a regular file"
        raise FileError(f"{called(path)}: cannot be written (it is {what})")
    return target


def make_folders(folder: Path) -> list[Path]:
    """Make a folder and those above it, but none at the root of the file system.

    The new ones, the highest first.
    """
    missing = [above for above in (folder, *folder.parents) if not above.exists()]
    _require_place(folder)
    folder.mkdir(parents=True, exist_ok=True)
    return missing[::-1]


def _require_place(folder: Path) -> None:
    """Raise where a missing folder would be made at the root of the file system.

    Only an administrator could, or who is one within a container: mostly by a wrong name, or where a place
    outside is not mounted. Nobody else can, and so it is the same error for all.
    """
    top = Path(*folder.parts[:2])
    if folder.anchor == "/" and not top.exists():
        raise FileNotFoundError(errno.ENOENT, f"there is no folder {top}", str(top))


@contextlib.contextmanager
def _named(path: str | os.PathLike[str]) -> Iterator[None]:
    """Turn what the system says into an error that names the file."""
    name = called(path)
    try:
        yield
    except P3dofError:  # it has its own words, such as of the input that is read on the way
        raise
    except (OSError, ValueError, RuntimeError) as error:
        raise FileError(f"{name}: cannot be written ({reason(error)})") from error


_BEGINNING = 300
_NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w.])")


def write_generated(
    texts: Mapping[str, str],
    folder: str | os.PathLike[str],
    mark: str,
    force: bool = False,
    foreign: Callable[[str, str], str | None] = lambda _name, _text: None,
) -> list[Path]:
    """Write generated files, all or none; none if one would take the place of a file that is not such.

    The files written.

    `foreign`: is given the name and the text of a marked file that is there; returns why it may not be
    written over all the same, or None.
    """
    paths = {name: Path(folder) / name for name in texts}
    for name, path in paths.items():
        reason = None if force or not path.is_file() else _reason(path, name, mark, foreign)
        if reason:
            advice = "use another folder, or force it (--force)"
            raise FileError(f"{path}: would be overwritten, but {reason}; {advice}")
    with together():
        return [write_atomic(path, texts[name]) for name, path in paths.items()]


def _reason(path: Path, name: str, mark: str, foreign: Callable[[str, str], str | None]) -> str | None:
    """Return why a file that is there may not be written over."""
    try:
        there = read_text(path)
    except FileError:
        there = ""  # what cannot be read as text is none of ours
    return foreign(name, there) if mark in there[:_BEGINNING] else "was not generated by p3dof"


def check_generated(
    texts: Mapping[str, str], folder: str | os.PathLike[str], relative: float = 0.0, absolute: float = 0.0
) -> list[str]:
    """Compare the files in a folder with what would be written there.

    One line for each difference, naming file and line; empty if all is up to date.
    """
    found: list[str] = []
    for name, expected in texts.items():
        path = Path(folder) / name
        if path.exists():
            lines = differences(expected, read_text(path), relative, absolute)
            found += (f"{path}, {what}" for what in lines)
        else:
            found.append(f"{path}: missing")
    return found


def differences(expected: str, got: str, relative: float = 0.0, absolute: float = 0.0) -> Iterator[str]:
    """Yield the lines in which a text is not what is expected; numbers may differ within tolerances."""
    lines = zip_longest(expected.splitlines(), got.splitlines())
    for number, (ours, theirs) in enumerate(lines, start=1):
        if ours is None or theirs is None or not _same(ours, theirs, relative, absolute):
            texts = ("the end of the file" if line is None else repr(line.strip()) for line in (ours, theirs))
            yield "line {}: expected {}, got {}".format(number, *texts)
            if ours is None or theirs is None:
                return


def _same(ours: str, theirs: str, relative: float, absolute: float) -> bool:
    if ours == theirs:
        return True
    if _NUMBER.sub("#", ours) != _NUMBER.sub("#", theirs):
        return False
    pairs = zip(_NUMBER.findall(ours), _NUMBER.findall(theirs), strict=True)
    return all(math.isclose(float(a), float(b), rel_tol=relative, abs_tol=absolute) for a, b in pairs)


SUFFIXES: dict[str, tuple[str, ...]] = {
    "table": (".csv",),
    "run": (".csv", ".npz"),
    "designs": (".csv", ".parquet"),
    "parameters": (".yaml", ".yml"),
    "figure": (".png", ".svg", ".pdf"),
    "report": (".html", ".pdf"),
    "animation": (".html",),
    "scene": (".glb",),
    "joints": (".csv", ".yaml", ".yml"),
    "robot": (".urdf", ".xml", ".sdf"),
    "exported robot": (".urdf", ".xml", ".sdf", ".glb"),
    "calibrated": (".urdf", ".xml", ".sdf", ".csv"),
    "map": (".nc",),
    "film": (".mp4", ".gif"),
    "picture": (".png",),
    "show": (".html", ".mp4", ".gif", ".png"),
}
"""The endings by kind. A new format is one more ending here, and a case where the file is written."""


def suffix_of(path: str | os.PathLike[str], kind: str) -> str:
    """Return the ending of the name of a file to write, in lower case."""
    name, possible = called(path), SUFFIXES[kind]
    suffix = Path(path).suffix.lower()
    if suffix not in possible:
        *first, last = possible
        words = f"{', '.join(first)} or {last}" if first else last
        raise InputError(f"{name}: expected a file name that ends in {words}")
    return suffix


_ROWS = 16_384  # rows of a table that are written at a time


def write_table(path: str | os.PathLike[str], header: list[str], columns: tuple[NDArray[Any], ...]) -> Path:
    """Write columns of numbers, or of text, to a CSV file that reads back to the same bits.

    The path written.
    """
    suffix_of(path, "table")
    given = [np.asarray(column, None if column.dtype.kind == "U" else float) for column in columns]
    if len({len(column) for column in given}) > 1:
        raise ValueError("expected columns of one length")
    with _named(path), together(), _open_set.get().stream(path) as stream:  # type: ignore[union-attr]
        stream.write(csv_line(header))
        for start in range(0, len(given[0]) if given else 0, _ROWS):
            block = (column[start : start + _ROWS] for column in given)
            stream.write(table_lines([_quoted(x) if x.dtype.kind == "U" else x for x in block], False))
    return Path(path)


def csv_line(fields: Iterable[str]) -> bytes:
    """Return a line of texts, in quotes where they need them."""
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerow(fields)
    return text.getvalue().encode()


def _quoted(texts: NDArray[Any]) -> list[str]:
    return [csv_line([text, ""])[:-2].decode() for text in texts.tolist()]
