"""Templates of generated files."""

from __future__ import annotations

from importlib.resources import files
from string import Template


class _Text(Template):
    """Templates mark what is put in with ``@``, which C, make and CMake leave free here."""

    delimiter = "@"


def fill(template: str, **values: str) -> str:
    """Return a template of this room with what is put in.

    Parameters
    ----------
    template : str
        The name of its file.
    **values : str
        Text by placeholder.

    Returns
    -------
    str
    """
    text = (files("p3dof.codegen") / "templates" / template).read_text(encoding="utf-8")
    return _Text(text).substitute(values)
