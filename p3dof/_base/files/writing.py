"""Writing files whole or not at all, one by one or several together."""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from collections.abc import Iterator
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from p3dof._base.errors import FileError, P3dofError
from p3dof._base.files import temporary
from p3dof._base.files.reading import called, reason


def write_atomic(path: str | os.PathLike[str], content: str | bytes) -> Path:
    """Write a file whole or not at all: an existing file is replaced only when the new one is complete.

    Within `together` it is replaced at the end of that block.

    Parameters
    ----------
    path : path-like
        The file; missing folders above it are made, as `make_folders` does. An existing file keeps its
        permissions; of a symbolic link the file that it points to is replaced.
    content : str or bytes
        Text is encoded as UTF-8 with Unix line ends.

    Returns
    -------
    Path
        The path written, as it was given.

    Raises
    ------
    FileError
        If `path` is no path, or the folder or the file cannot be written; what was there before is left as it
        was.
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

    Raises
    ------
    FileError
        If a file cannot be replaced.
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

    Parameters
    ----------
    path : path-like
        As of `write_atomic`.

    Yields
    ------
    binary stream
        Where to write.

    Raises
    ------
    FileError
        If the file cannot be written; what was there before is left as it was.
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
    """Find out whether a file can be written, before the work for it begins; nothing is left behind.

    Parameters
    ----------
    path : path-like
        The file; its folders need not be there, but for one at the root of the file system.

    Raises
    ------
    FileError
        If it is no regular file, or its folder cannot be made or written in.
    """
    with _named(path):
        target = _target(path)
        _require_place(target.parent)
        folder = next(parent for parent in target.parents if parent.exists())
        for part in target.relative_to(folder).parts:
            with contextlib.suppress(FileNotFoundError):
                (folder / part).stat()  # an error: longer than names may be here
        trial, descriptor = temporary.new_file(folder)
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
        found, descriptor = temporary.new_file(target.parent)
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
        backup = staged.backup = temporary.new_name(staged.target.parent)
        staged.backup_descriptor = temporary.hold(staged.target)
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
    for path, descriptor in (
        (staged.path, staged.descriptor),
        (staged.backup, staged.backup_descriptor),
    ):
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

    Parameters
    ----------
    folder : Path
        An absolute path.

    Returns
    -------
    list of Path
        The new ones, the highest first.

    Raises
    ------
    OSError
        If one cannot be made.
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
