"""What kinds of files are written, and how their names end: the ending decides, or is refused."""

from __future__ import annotations

import os
from pathlib import Path

from p3dof._base.errors import InputError
from p3dof._base.files.reading import called

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
    "map": (".nc",),
    "film": (".mp4", ".gif"),
    "picture": (".png",),
    "show": (".html", ".mp4", ".gif", ".png"),
}
"""The endings by kind. A new format is one more ending here, and a case where the file is written."""


def suffix_of(path: str | os.PathLike[str], kind: str) -> str:
    """Return the ending of the name of a file to write, in lower case.

    Parameters
    ----------
    path : path-like
        The file.
    kind : str
        A key of `SUFFIXES`.

    Returns
    -------
    str

    Raises
    ------
    InputError
        If a file of this kind is not written in this format; the message names those that are.
    FileError
        If `path` is no path.
    """
    name, possible = called(path), SUFFIXES[kind]
    suffix = Path(path).suffix.lower()
    if suffix not in possible:
        *first, last = possible
        words = f"{', '.join(first)} or {last}" if first else last
        raise InputError(f"{name}: expected a file name that ends in {words}")
    return suffix
