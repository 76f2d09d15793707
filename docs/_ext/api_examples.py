"""Examples of all public functions and classes: read from ``reference/examples/``, shown on the API's pages.

A file a door. A line ``# names`` begins an example of these names, which follow ``p3dof.``; libraries that
it needs beside the package follow in brackets. Below it stands a session as Python's doctest reads it.
``tests/house/test_examples.py`` runs each in a folder that has the robots of the gallery in ``gallery/``.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from operator import attrgetter
from pathlib import Path
from types import ModuleType
from typing import Any

import p3dof

FOLDER = Path(__file__).parents[1] / "reference/examples"
HEADING = re.compile(r"^# ([\w., ]+?)(?: \[([\w, ]+)\])?\n", re.MULTILINE)


@dataclass(frozen=True)
class Example:
    """A session that shows some names, and the libraries that it needs."""

    file: Path
    names: tuple[str, ...]
    needs: tuple[str, ...]
    text: str


@cache
def examples() -> tuple[Example, ...]:
    """Return all examples, by file and place in it."""
    found = []
    for file in sorted(FOLDER.glob("*.txt")):
        before, *parts = HEADING.split(file.read_text(encoding="utf-8"))
        if before.strip():
            raise ValueError(f"{file.name}: expected '# names' in the first line, got {before.strip()!r}")
        for names, needs, text in zip(*(parts[i::3] for i in range(3)), strict=True):
            words = (tuple((listed or "").replace(",", " ").split()) for listed in (names, needs))
            found.append(Example(file, *words, text.strip() + "\n"))
    return tuple(found)


def members() -> dict[str, list[tuple[str, Any]]]:
    """Return the functions and classes that each page lists: of `p3dof`, then of each door and its rooms."""
    pages, told = {}, set()
    for page in ["", *doors_and_rooms()]:
        module = attrgetter(page)(p3dof) if page else p3dof
        pages[page] = []
        for name in getattr(module, "__all__", ()):
            what = getattr(module, name)
            if _is_ours(what) and id(what) not in told:
                told.add(id(what))
                pages[page].append((name, what))
    return pages


def _is_ours(what: Any) -> bool:
    """Whether it is a function or class of the package: a public name may stand for a type of Python."""
    found = inspect.isfunction(what) or inspect.isclass(what)
    return found and what.__module__.partition(".")[0] == "p3dof"


def doors_and_rooms() -> Iterator[str]:
    """Yield the name of each public module, each door before its rooms."""
    for door in p3dof.__all__:
        if isinstance(getattr(p3dof, door), ModuleType):
            yield door
            yield from rooms_of(door)


def rooms_of(door: str) -> list[str]:
    """Return the rooms behind a door that offer something."""
    offered = getattr(getattr(p3dof, door), "__all__", ())
    found = {name: getattr(getattr(p3dof, door), name) for name in offered}
    rooms = [
        name for name, room in found.items() if isinstance(room, ModuleType) and hasattr(room, "__all__")
    ]
    return [f"{door}.{name}" for name in rooms]


def public() -> dict[str, Any]:
    """Return all functions and classes that have a place in the API, by their names after ``p3dof.``."""
    return {f"{page}.{name}".lstrip("."): what for page, listed in members().items() for name, what in listed}


@cache
def _shown() -> dict[int, Example]:
    names = public()
    return {id(names[name]): example for example in examples() for name in example.names}


def show(app: Any, _kind: str, _name: str, what: Any, _options: Any, lines: list[str]) -> None:
    """Give a docstring the section that its example stands in; before numpydoc reads it."""
    example = _shown().get(id(what))
    if example is not None:
        app.env.note_dependency(str(example.file))
        lines += ["", "Examples", "--------", *example.text.splitlines(), ""]


def setup(app: Any) -> dict[str, bool]:
    """Have examples shown by autodoc."""
    app.setup_extension("sphinx.ext.autodoc")
    app.connect("autodoc-process-docstring", show, priority=400)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
