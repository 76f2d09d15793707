"""YAML text to plain data: nothing but data, bounded, with one clear error."""

from __future__ import annotations

from typing import Any, NoReturn

import yaml

from p3dof._base.checks import LARGEST, one_line, shown
from p3dof._base.errors import P3dofError

MAX_YAML = 1_000_000
"""Longest YAML text that is read [characters]: parameters and sidecars take thousands."""


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
    if text.lstrip()[:1] == "<":
        kind = "a URDF" if "<robot" in text else "XML"
        raise error(f"{source}: expected YAML, got what looks like {kind}")
    try:
        return yaml.load(text, Loader=_StrictLoader)  # noqa: S506 - a SafeLoader
    except yaml.YAMLError as problem:
        mark = getattr(problem, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark is not None else ""
        what = getattr(problem, "problem", None) or str(problem).splitlines()[0]
        hint = "; indent by spaces, YAML takes no tabs" if r"'\t'" in what else ""
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
