"""Integrators in C that know no robot: text that the extension includes and that printed C contains."""

from __future__ import annotations

from functools import cache
from pathlib import Path

__all__ = ["FOLDER", "text"]

FOLDER = Path(__file__).parent  # where the headers are


@cache
def text(name: str) -> str:
    """Return a header as text, to be pasted into C that is printed.

    What it needs defined before stands at its beginning.
    """
    return (FOLDER / f"{name}.h").read_text(encoding="utf-8")
