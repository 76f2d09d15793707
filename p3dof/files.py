"""Reading and writing files so that nothing is lost: whole or not at all, bounded, with one clear error."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any, NoReturn

import yaml

from p3dof.checks import one_line, shown
from p3dof.errors import FileError, P3dofError

MAX_BYTES = 20_000_000
"""Largest text file that is read without another limit [bytes]."""
MAX_YAML = 1_000_000
"""Longest YAML text that is read [characters]: parameters and sidecars take thousands."""


def read_text(path: str | os.PathLike[str], limit: int = MAX_BYTES) -> str:
    """Return the text of a UTF-8 file.

    Parameters
    ----------
    path : path-like
        The file.
    limit : int
        Largest size [bytes]; no more than that is ever loaded.

    Returns
    -------
    str

    Raises
    ------
    FileError
        If `path` is no path, or the file is missing, unreadable, larger than `limit` or not UTF-8 text.
    """
    name = _called(path)
    try:
        with Path(path).open("rb") as stream:
            data = stream.read(limit + 1)
        if len(data) > limit:
            raise FileError(f"{name}: expected at most {limit} bytes")
        return data.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        raise FileError(f"{name}: expected UTF-8 text, got {error.reason} at byte {error.start}") from error
    except FileError:
        raise
    except (OSError, ValueError) as error:
        raise FileError(f"{name}: cannot be read ({_reason(error)})") from error


def write_atomic(path: str | os.PathLike[str], content: str | bytes) -> Path:
    """Write a file whole or not at all: an existing file is replaced only when the new one is complete.

    Parameters
    ----------
    path : path-like
        The file; missing parent folders are made. An existing file keeps its permissions; of a symbolic link
        the file that it points to is replaced.
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
    name = _called(path)
    temporary: Path | None = None
    try:
        data = content.encode("utf-8") if isinstance(content, str) else content
        target = Path(path).resolve()
        if target.exists() and not target.is_file():
            what = "a folder" if target.is_dir() else "not a regular file"
            raise FileError(f"{name}: cannot be written (it is {what})")
        target.parent.mkdir(parents=True, exist_ok=True)
        mode = target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~_umask()
        descriptor, unfinished = tempfile.mkstemp(prefix=".p3dof-", dir=target.parent)
        temporary = Path(unfinished)
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.chmod(mode)
        temporary.replace(target)
        temporary = None
    except FileError:
        raise
    except (OSError, ValueError, RuntimeError) as error:
        raise FileError(f"{name}: cannot be written ({_reason(error)})") from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
    return Path(path)


def parse_yaml(text: str, source: str, error: type[P3dofError]) -> Any:
    """Parse YAML text safely: plain data only, no duplicate keys, bounded in size.

    At most `MAX_YAML` characters, 20 000 values (aliases expanded) and 1000 characters a value are read.

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
    if not isinstance(text, str):
        raise error(f"{source}: expected YAML text, got {shown(text)}")
    if len(text) > MAX_YAML:
        raise error(f"{source}: expected at most {MAX_YAML} characters of YAML, got {len(text)}")
    try:
        return yaml.load(text, Loader=_StrictLoader)  # noqa: S506 - a SafeLoader
    except yaml.YAMLError as problem:
        mark = getattr(problem, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark is not None else ""
        what = getattr(problem, "problem", None) or str(problem).splitlines()[0]
        raise error(f"{source}{where}: not valid YAML: {one_line(what)}") from problem
    except RecursionError as problem:
        raise error(f"{source}: not valid YAML: nested too deeply") from problem


_MAX_YAML_NODES = 20_000
_MAX_YAML_SCALAR = 1000  # few enough digits that Python prints any integer


class _StrictLoader(yaml.SafeLoader):
    """`yaml.SafeLoader` that refuses duplicate keys, and what is huge or expands into something huge."""

    _composed = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        self._composed += 1
        if self._composed > _MAX_YAML_NODES:
            event = self.peek_event()  # type: ignore[no-untyped-call]
            self._refuse(f"expected at most {_MAX_YAML_NODES} values", event)
        node = super().compose_node(parent, index)
        if isinstance(node, yaml.ScalarNode) and len(node.value) > _MAX_YAML_SCALAR:
            got = len(node.value)
            self._refuse(f"expected at most {_MAX_YAML_SCALAR} characters a value, got {got}", node)
        return node

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep)
        except (ValueError, TypeError, LookupError, AttributeError):
            # PyYAML lets these through for tags whose text does not fit them, such as "!!int ''".
            kind = node.tag.rpartition(":")[2]
            self._refuse(f"{shown(node.value)} does not fit its type, {kind}", node)

    def get_single_node(self) -> yaml.Node | None:
        node = super().get_single_node()
        if node is not None:
            self._expanded_size(node, {})
        return node

    def _expanded_size(self, node: yaml.Node, sizes: dict[yaml.Node, int]) -> int:
        if node not in sizes:
            sizes[node] = _MAX_YAML_NODES + 1  # what an alias to a node inside itself finds
            children: list[yaml.Node] = []
            if isinstance(node, yaml.MappingNode):
                self._check_keys(node)
                children = [child for pair in node.value for child in pair]
            elif isinstance(node, yaml.SequenceNode):
                children = node.value
            sizes[node] = 1 + sum(self._expanded_size(child, sizes) for child in children)
        if sizes[node] > _MAX_YAML_NODES:
            self._refuse(f"expected at most {_MAX_YAML_NODES} values, aliases expanded", node)
        return sizes[node]

    def _check_keys(self, node: yaml.MappingNode) -> None:
        seen: set[tuple[str, str]] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue
            if (key.tag, key.value) in seen:
                self._refuse(f"the key {shown(key.value)} is given more than once", key)
            seen.add((key.tag, key.value))

    @staticmethod
    def _refuse(problem: str, place: Any) -> NoReturn:
        raise yaml.constructor.ConstructorError(None, None, problem, place.start_mark)


def _called(path: Any) -> str:
    """Return what to call a path in an error; raise FileError if it is none."""
    try:
        name = str(Path(path))
    except TypeError as error:
        raise FileError(f"expected the path of a file, got {shown(path)}") from error
    return str(path) if len(name) <= 4096 and "\n" not in name else shown(name)


def _reason(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
