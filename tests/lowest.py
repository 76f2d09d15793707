"""Print the lowest versions that pyproject.toml declares, as constraints for pip.

    python tests/lowest.py plot report viz > lowest.txt

takes the project's own dependencies and those of the extras that are named. ``>=2.0`` and ``~=2.0`` become
``==2.0``; markers are kept, and what has no lower bound is an error: nobody could say what it works with.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

PYPROJECT = Path(__file__).parents[1] / "pyproject.toml"


def lowest(project: dict[str, Any], extras: list[str]) -> list[str]:
    """Return one pin for every requirement of a project and of some of its extras."""
    optional = project["optional-dependencies"]
    todo = [*project["dependencies"], *(text for extra in extras for text in optional[extra])]
    pins: dict[str, str] = {}
    while todo:
        requirement = Requirement(todo.pop(0))
        if requirement.name == project["name"]:  # an extra made of others
            todo += [text for extra in sorted(requirement.extras) for text in optional[extra]]
            continue
        bounds = [s.version for s in requirement.specifier if s.operator in {">=", "~=", "=="}]
        if len(bounds) != 1:
            raise SystemExit(f"pyproject.toml: {requirement}: expected one lower bound")
        marker = f"; {requirement.marker}" if requirement.marker else ""
        pins[str(requirement)] = f"{requirement.name}=={bounds[0]}{marker}"
    return sorted(set(pins.values()), key=str.lower)


def read_project() -> dict[str, Any]:
    """Return the table ``project`` of our pyproject.toml."""
    table: dict[str, Any] = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["project"]
    return table


if __name__ == "__main__":
    print("\n".join(lowest(read_project(), sys.argv[1:])))  # noqa: T201 - its output
