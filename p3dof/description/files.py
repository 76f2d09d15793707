"""The files of a description: writing them, and telling whether those that are there are up to date."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import zip_longest
from pathlib import Path
from typing import TypeAlias

from p3dof.description.drake_text import drake
from p3dof.description.masses import with_masses
from p3dof.description.mechanism import Mechanism
from p3dof.description.mjcf_text import mjcf
from p3dof.description.sdf_text import sdf
from p3dof.description.srdf_text import srdf
from p3dof.description.tree import describe
from p3dof.description.urdf_plus_text import urdf_plus
from p3dof.description.urdf_text import sidecar, urdf
from p3dof.description.usd_stage import usd
from p3dof.errors import InputError
from p3dof.files import read_text, write_atomic
from p3dof.parameters import Parameters

Writer: TypeAlias = Callable[[Mechanism], str]
"""Turns a description into the text of one file."""

FORMATS: dict[str, Mapping[str, Writer]] = {
    "urdf": {"p3dof.urdf": urdf, "p3dof.yaml": sidecar},
    "drake": {"p3dof_drake.urdf": drake},
    "mjcf": {"p3dof_mjcf.xml": mjcf},
    "sdf": {"p3dof.sdf": sdf},
    "urdf+": {"p3dof_plus.urdf": urdf_plus},
    "srdf": {"p3dof.srdf": srdf},
    "usd": {"p3dof.usda": usd},
}
"""The formats by name: which files each has, and what writes them. A new format is one more entry."""

TOLERANCE = 1e-12
"""Difference, relative or absolute, that `check` lets pass: last bits depend on the CPU."""

_NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w.])")


def texts(parameters: Parameters, formats: Iterable[str] = ("urdf",), exact: bool = False) -> dict[str, str]:
    """Return what the files of some formats hold.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    formats : iterable of str
        Names in `FORMATS`.
    exact : bool
        Leave massless links massless, instead of giving every link a mass without a change of the dynamics
        (see `p3dof.description.masses`).

    Returns
    -------
    dict of str to str
        Text by file name.

    Raises
    ------
    InputError
        If a format is unknown.
    ModelError
        If a body is too light to give its massless neighbours a mass.
    """
    mechanism = describe(parameters) if exact else with_masses(describe(parameters))
    result: dict[str, str] = {}
    for name in formats:
        if name not in FORMATS:
            raise InputError(f"formats: expected some of {', '.join(FORMATS)}, got {name!r}")
        result.update({file: writer(mechanism) for file, writer in FORMATS[name].items()})
    return result


def write(
    parameters: Parameters,
    folder: str | os.PathLike[str],
    formats: Iterable[str] = ("urdf",),
    exact: bool = False,
) -> list[Path]:
    """Write the description of a machine.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    folder : path-like
        Where to; made if missing.
    formats : iterable of str
        Names in `FORMATS`.
    exact : bool
        As for `texts`.

    Returns
    -------
    list of Path
        The files written, each whole or not at all.

    Raises
    ------
    InputError
        If a format is unknown.
    FileError
        If a file cannot be written.
    """
    contents = texts(parameters, formats, exact)
    return [write_atomic(Path(folder) / name, text) for name, text in contents.items()]


def check(
    parameters: Parameters,
    folder: str | os.PathLike[str],
    formats: Iterable[str] = ("urdf",),
    exact: bool = False,
) -> list[str]:
    """Compare the files in a folder with what `write` would write there.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    folder : path-like
        Where the files are.
    formats : iterable of str
        Names in `FORMATS`.
    exact : bool
        As for `texts`.

    Returns
    -------
    list of str
        One line for each difference, naming file and line; empty if all is up to date. Numbers are equal
        within `TOLERANCE`.

    Raises
    ------
    InputError
        If a format is unknown.
    FileError
        If a file is there and cannot be read.
    """
    found: list[str] = []
    for name, expected in texts(parameters, formats, exact).items():
        path = Path(folder) / name
        if path.exists():
            found += (f"{path}, {what}" for what in _differences(expected, read_text(path)))
        else:
            found.append(f"{path}: missing")
    return found


def _differences(expected: str, got: str) -> Iterator[str]:
    lines = zip_longest(expected.splitlines(), got.splitlines())
    for number, (ours, theirs) in enumerate(lines, start=1):
        if ours is None:
            yield f"line {number}: expected the end of the file, got {theirs.strip()!r}"
            return
        if theirs is None:
            yield f"line {number}: expected {ours.strip()!r}, got the end of the file"
            return
        if not _same(ours, theirs):
            yield f"line {number}: expected {ours.strip()!r}, got {theirs.strip()!r}"


def _same(ours: str, theirs: str) -> bool:
    if _NUMBER.sub("#", ours) != _NUMBER.sub("#", theirs):
        return False
    pairs = zip(_NUMBER.findall(ours), _NUMBER.findall(theirs), strict=True)
    return all(math.isclose(float(a), float(b), rel_tol=TOLERANCE, abs_tol=TOLERANCE) for a, b in pairs)
