"""The files of a description: writing them, and telling whether those that are there are up to date."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TypeAlias

from p3dof._base.errors import InputError, ModelError
from p3dof._base.files import check_generated, differences, write_generated
from p3dof.machine.description.mechanism import Mechanism
from p3dof.machine.description.mjcf_text import mjcf
from p3dof.machine.description.sdf_text import sdf
from p3dof.machine.description.tree import describe, with_masses
from p3dof.machine.description.urdf_text import drake, sidecar, srdf, urdf, urdf_plus
from p3dof.machine.description.usd_stage import usd
from p3dof.machine.parameters import PAPER, Parameters

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

_MARK = "ritten by p3dof:"


def texts(parameters: Parameters, formats: Iterable[str] = ("urdf",), exact: bool = False) -> dict[str, str]:
    """Return what the files of some formats hold; text by file name."""
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
    force: bool = False,
) -> list[Path]:
    """Write the description of a machine, all files or none.

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
    force : bool
        Write over files that were not written by p3dof, and over those of the paper's machine by those of
        another one.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    InputError
        If a format is unknown.
    FileError
        If a file cannot be written, or is one of those that need `force`.
    """
    formats = tuple(formats)
    contents = texts(parameters, formats, exact)

    def foreign(name: str, there: str) -> str | None:
        papers = [_of_paper(formats, variant).get(name) for variant in (False, True)]
        if _same_as_one(papers, there) and not _same_as_one(papers, contents[name]):
            return "describes the paper's machine"
        return None

    return write_generated(contents, folder, _MARK, force, foreign)


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
    return check_generated(texts(parameters, formats, exact), folder, TOLERANCE, TOLERANCE)


def _of_paper(formats: Iterable[str], exact: bool) -> dict[str, str]:
    """Return the texts of the paper's machine, or none if a format cannot hold massless links."""
    try:
        return texts(PAPER, formats, exact)
    except ModelError:
        return {}


def _same_as_one(known: Iterable[str | None], text: str) -> bool:
    return any(one and not any(differences(one, text, TOLERANCE, TOLERANCE)) for one in known)
