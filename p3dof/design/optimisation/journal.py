"""`Journal`: the folder of an optimisation, in which every finished part of it is a file.

An optimisation that is begun anew with the same journal takes finished parts from it instead of computing
them: it comes to the same result as one that was never interrupted. Files are whole or not there.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np

from p3dof._base.blocks.folder import locked
from p3dof._base.checks import one_line
from p3dof._base.errors import FileError, SweepError
from p3dof._base.files import (
    UnfitError,
    called,
    dump_hashed,
    pack_arrays,
    parse_hashed,
    read_text,
    unpack_arrays,
    write_atomic,
)
from p3dof._base.version import __version__

MANIFEST = "optimisation.json"
"""What the folder is the journal of."""

_LARGEST = 1_000_000
_MOST = 10_000_000
"""Largest manifest [bytes], and most numbers of an array."""
_KIND = "p3dof optimisation"
_TOLD = 3


class Journal:
    """Finished parts of an optimisation, by name: in a folder, or nowhere.

    Parameters
    ----------
    folder : path-like, optional
        Where; made if it is missing. Without one nothing is kept.
    about : mapping
        All that the parts depend on: plain data.
    resume : bool
        Take the parts that are there.

    Raises
    ------
    SweepError
        If the folder holds something else, or parts of this without `resume`.
    FileError
        If it cannot be read or written.
    """

    def __init__(
        self, folder: str | os.PathLike[str] | None, about: Mapping[str, Any], resume: bool = False
    ) -> None:
        self.folder = None if folder is None else Path(called(folder)).absolute()
        self.taken = 0
        self._about = {"kind": _KIND, "versions": {"p3dof": __version__, "numpy": np.__version__}, **about}
        self._lock: AbstractContextManager[None] | None = None
        if self.folder is not None:
            self._begin(self.folder, resume)

    def __enter__(self) -> Journal:
        if self.folder is not None:
            self._lock = locked(self.folder)
            self._lock.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        if self._lock is not None:
            self._lock.__exit__(None, None, None)

    def _begin(self, folder: Path, resume: bool) -> None:
        path = folder / MANIFEST
        ours = json.loads(json.dumps(self._about, sort_keys=True))
        if not path.exists():
            write_atomic(path, dump_hashed(ours))
            return
        try:
            there = parse_hashed(read_text(path, _LARGEST), _KIND)
        except ValueError as error:
            raise FileError(
                f"{path}: expected the state of an optimisation ({one_line(str(error))})"
            ) from error
        different = list(_differences(there, ours, ""))
        if different:
            more = f" (and {len(different) - _TOLD} more)" if len(different) > _TOLD else ""
            raise SweepError(
                f"{folder}: holds another optimisation: {one_line(', '.join(different[:_TOLD]))}{more}; "
                "choose another folder"
            )
        if not resume:
            raise SweepError(f"{folder}: holds this optimisation already; to go on with it: resume=True")

    def read(self, name: str) -> dict[str, Any] | None:
        """Return a finished part, or None if it is not there or is damaged.

        Parameters
        ----------
        name : str
            What it was called.

        Returns
        -------
        dict of str to ndarray, or None
        """
        if self.folder is None:
            return None
        path = self.folder / f"{name}.npz"
        if not path.exists():
            return None
        try:
            found = unpack_arrays(path, lambda there: there, _accept, what="a part of an optimisation")
        except FileError:
            return None  # it is computed again
        self.taken += 1
        return found

    def write(self, name: str, **arrays: Any) -> None:
        """Keep a finished part."""
        if self.folder is not None:
            write_atomic(self.folder / f"{name}.npz", pack_arrays(arrays, compressed=False))


def _accept(name: str, kind: Any, shape: tuple[int, ...]) -> None:
    if kind.kind not in "fi" or np.prod(shape, dtype=float) > _MOST:
        raise UnfitError(f"{name}: it is of the type {kind} and the shape {shape}")


def _differences(there: Any, ours: Any, where: str) -> list[str]:
    """Return what differs, by name."""
    if isinstance(there, dict) and isinstance(ours, dict):
        found = []
        for key in dict.fromkeys((*there, *ours)):
            name = f"{where}.{key}" if where else str(key)
            if key not in there or key not in ours:
                found.append(f"{name} is only {'here' if key in ours else 'there'}")
            else:
                found += _differences(there[key], ours[key], name)
        return found
    if json.dumps(there) == json.dumps(ours):
        return []
    return [f"{where} is {one_line(json.dumps(there), 60)} there, {one_line(json.dumps(ours), 60)} here"]
