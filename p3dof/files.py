"""Reading and writing files so that nothing is lost: whole or not at all, bounded, with one clear error."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import yaml

from p3dof.errors import FileError, P3dofError

MAX_BYTES = 20_000_000
"""Largest text file that is read [bytes]; a bigger one is refused before it is loaded."""


def read_text(path: str | os.PathLike[str]) -> str:
    """Return the text of a UTF-8 file.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    str

    Raises
    ------
    FileError
        If the file is missing, unreadable, larger than `MAX_BYTES` or not UTF-8 text.
    """
    path = Path(path)
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise FileError(f"{path}: {size} bytes, expected at most {MAX_BYTES}")
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: expected UTF-8 text, got {error.reason}") from error
    except FileError:
        raise
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror or error})") from error


def write_atomic(path: str | os.PathLike[str], content: str | bytes) -> Path:
    """Write a file whole or not at all: an existing file is replaced only when the new one is complete.

    Parameters
    ----------
    path : path-like
        The file; missing parent folders are made. An existing file keeps its permissions.
    content : str or bytes
        Text is encoded as UTF-8 with Unix line ends.

    Returns
    -------
    Path
        The path written.

    Raises
    ------
    FileError
        If the folder or the file cannot be written; what was there before is left as it was.
    """
    path = Path(path)
    data = content.encode("utf-8") if isinstance(content, str) else content
    temporary: str | None = None
    try:
        if path.is_dir():
            raise FileError(f"{path}: cannot be written (it is a folder)")
        path.parent.mkdir(parents=True, exist_ok=True)
        mode = path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~_umask()
        descriptor, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        Path(temporary).chmod(mode)
        Path(temporary).replace(path)
        temporary = None
    except FileError:
        raise
    except OSError as error:
        raise FileError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)
    return path


def parse_yaml(text: str, source: str, error: type[P3dofError]) -> Any:
    """Parse YAML text safely (plain data only, duplicate keys refused).

    Parameters
    ----------
    text : str
        The YAML text.
    source : str
        What to call it in an error: usually the file name.
    error : type of P3dofError
        The error to raise on malformed text.

    Returns
    -------
    object
        Plain dictionaries, lists, strings and numbers.

    Raises
    ------
    P3dofError
        The given `error`, with `source` and the line.
    """
    try:
        return yaml.load(text, Loader=_UniqueKeyLoader)  # noqa: S506 - a SafeLoader
    except yaml.YAMLError as problem:
        mark = getattr(problem, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark is not None else ""
        what = getattr(problem, "problem", None) or str(problem).splitlines()[0]
        raise error(f"{source}{where}: not valid YAML: {what}") from problem
    except (RecursionError, ValueError) as problem:
        raise error(f"{source}: not valid YAML: {problem}") from problem


class _UniqueKeyLoader(yaml.SafeLoader):
    """`yaml.SafeLoader` that refuses a key given twice instead of silently keeping the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        for (key_node, _), key in zip(node.value, keys, strict=True):
            if keys.count(key) > 1:
                raise yaml.constructor.ConstructorError(
                    None, None, f"the key {key!r} is given more than once", key_node.start_mark
                )
        return super().construct_mapping(node, deep=deep)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
