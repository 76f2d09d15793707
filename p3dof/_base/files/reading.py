"""Reading files and streams within limits, and text of YAML and JSON to plain data."""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any, NoReturn, TypeAlias

import yaml

from p3dof._base.checks import LARGEST, one_line, shown, visible
from p3dof._base.errors import FileError, P3dofError, ParameterError

MAX_BYTES = 20_000_000
"""Largest text file that is read without another limit [bytes]."""

Source: TypeAlias = str | os.PathLike[str] | IO[str] | IO[bytes]
"""Where text is read from: a file, or a stream that is open for reading, such as the standard input."""


def read_text(source: Source, limit: int = MAX_BYTES) -> str:
    """Return the text of a UTF-8 file or stream."""
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
    """Return what to call a file or stream in an error."""
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


MAX_YAML = 1_000_000
"""Longest YAML text that is read [characters]: parameters and sidecars take thousands."""


def parse_yaml(text: str, source: str, error: type[P3dofError]) -> Any:
    """Parse YAML text safely: plain data only, no duplicate keys, bounded in size.

    At most `MAX_YAML` characters, 20 000 values (aliases expanded) and 1000 characters a value are read.

    Plain dictionaries, lists, strings and numbers.
    """
    if not isinstance(text, str):
        raise error(f"{source}: expected YAML text, got {shown(text)}")
    if len(text) > MAX_YAML:
        raise error(f"{source}: expected at most {MAX_YAML} characters of YAML, got {len(text)}")
    if text.lstrip()[:1] == "<":
        kind = "a URDF" if "<robot" in text else "XML"
        hint = "; p3dof loop and p3dof.load_robot read it" if error is ParameterError else ""
        raise error(f"{source}: expected YAML, got what looks like {kind}{hint}")
    if source.lower().endswith(".csv"):
        raise error(f"{source}: expected a YAML file, got a CSV file")
    try:
        return yaml.load(text, Loader=_StrictLoader)  # noqa: S506 - a SafeLoader
    except yaml.YAMLError as problem:
        mark = getattr(problem, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark is not None else ""
        what = getattr(problem, "problem", None) or str(problem).splitlines()[0]
        hint = "; indent by spaces, YAML takes no tabs" if r"'\t'" in what else ""
        if "<block" in what or "mapping values" in what:
            hint = "; fields of one level begin in one column, and have a space after the colon"
        raise error(f"{source}{where}: not valid YAML: {one_line(what)}{hint}") from problem
    except RecursionError as problem:
        raise error(f"{source}: not valid YAML: nested too deeply") from problem


_MAX_YAML_NODES = 20_000
_BITS = 1024  # of integers that no float can hold
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
            found = super().construct_object(node, deep)
        except (ValueError, TypeError, LookupError, AttributeError):
            # PyYAML lets these through for tags whose text does not fit them, such as "!!int ''".
            kind = node.tag.rpartition(":")[2]
            self._refuse(f"{shown(node.value)} does not fit its type, {kind}", node)
        if type(found) is int and found.bit_length() >= _BITS:
            self._refuse(f"expected numbers of at most {LARGEST:g} in size, got a huge integer", node)
        return found

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


_LONGEST = 300  # digits of whole numbers that a float can hold


def parse_json(text: str | bytes) -> Any:
    """Return what JSON text holds.

    Plain data; whole numbers that no float can hold are infinite, as other numbers are.
    """
    try:
        return json.loads(text, parse_int=lambda digits: (int if len(digits) < _LONGEST else float)(digits))
    except RecursionError as error:
        raise ValueError("nested too deeply") from error


def hash_of(data: Any) -> str:
    """Return the SHA-256 of plain data, whatever the order of their keys."""
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def dump_hashed(data: Mapping[str, Any]) -> str:
    """Return JSON text of plain data with their hash, for `parse_hashed`."""
    return json.dumps({**data, "hash": hash_of(data)}, indent=1, ensure_ascii=False) + "\n"


def parse_hashed(text: str, kind: str) -> dict[str, Any]:
    """Return what `dump_hashed` wrote, its hash checked and left out."""
    data = parse_json(text)
    if not isinstance(data, dict) or data.get("kind") != kind:
        raise ValueError("it is something else")
    told = data.pop("hash", None)
    if told != hash_of(data):
        raise ValueError("its hash does not fit")
    return data
