"""Runs as NumPy archives: what is in them, and how they are read when somebody else may have made them."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from p3dof._base.files import MAX_TEXT, UnfitError, pack_arrays, unpack_arrays

MAX_SAMPLES = 200_000
"""Most samples of a run that is read without another limit: about 100 MB in memory."""


@dataclass(frozen=True)
class Member:
    """What an array of an archive looks like.

    Parameters
    ----------
    kind : str
        NumPy's letter for the kind of its numbers: ``"f"`` (float64), ``"i"`` (int64) or ``"U"`` (text).
    shape : tuple of int or str
        A letter stands for a length that all arrays with this letter share.
    optional : bool
        Whether it may be missing.
    """

    kind: str
    shape: tuple[int | str, ...]
    optional: bool = False


FORM: dict[str, Member] = {
    "time": Member("f", ("N",)),
    "pose": Member("f", ("N", 3)),
    "velocity": Member("f", ("N", 3)),
    "acceleration": Member("f", ("N", 3)),
    "forces": Member("f", ("N", 3)),
    "asked": Member("f", ("N", 3)),
    "sliders": Member("f", ("N", 3)),
    "slider_velocities": Member("f", ("N", 3)),
    "wrench": Member("f", ("N", 6)),
    "closure_error": Member("f", ("N",)),
    "joint_names": Member("U", (10,)),
    "q": Member("f", ("N", 10)),
    "v": Member("f", ("N", 10)),
    "a": Member("f", ("N", 10)),
    "method": Member("U", ()),
    "stop": Member("U", ("S",)),
    "stop_time": Member("f", ()),
    "evaluations": Member("i", ()),
    "seconds": Member("f", ()),
    "note": Member("U", ()),
    "reference": Member("f", ("N", 3), optional=True),
}
"""The arrays of a run."""


def pack(arrays: Mapping[str, Any]) -> bytes:
    """Return the archive of a run.

    Parameters
    ----------
    arrays : mapping of str to array-like
        By the names of `FORM`.

    Returns
    -------
    bytes
    """
    return pack_arrays(arrays)


def unpack(
    path: str | os.PathLike[str], check: Callable[[dict[str, Any]], None], max_samples: int = MAX_SAMPLES
) -> dict[str, Any]:
    """Read the arrays of a run.

    Parameters
    ----------
    path : path-like
        The archive.
    check : callable
        Is given what has been read after every array; what it raises ends the reading before more is.
    max_samples : int
        Most samples to read.

    Returns
    -------
    dict of str to ndarray
        By the names of `FORM`, with its kinds and shapes; numbers are finite but for ``stop_time``.

    Raises
    ------
    FileError
        If the file cannot be read, or anything in it is not as `FORM` says.
    """
    lengths = _Lengths({"N": max_samples, "S": 2})

    def accept(name: str, kind: np.dtype[Any], shape: tuple[int, ...]) -> None:
        _check_shape(name, FORM[name], kind, shape, lengths)

    def found(arrays: dict[str, Any]) -> None:
        name = next(reversed(arrays))
        if FORM[name].kind == "f" and name != "stop_time" and not np.isfinite(arrays[name]).all():
            raise UnfitError(f"{name}: expected finite numbers")
        check(arrays)

    return unpack_arrays(path, _expected, accept, found, what="a run saved as .npz")


def _expected(there: list[str]) -> list[str]:
    """Return which arrays of a run to read; raise if there are others, or too few."""
    for name in there:
        if name not in FORM:
            raise UnfitError(f"it holds {f'{name[:36]}.npy'!r}, more than a run has")
    for name, form in FORM.items():
        if name not in there and not form.optional:
            raise UnfitError(f"{name} is missing")
    return [name for name in FORM if name in there]


def _check_shape(
    name: str, form: Member, kind: np.dtype[Any], shape: tuple[int, ...], lengths: _Lengths
) -> None:
    if kind.kind != form.kind:
        words = {"f": "numbers", "i": "a whole number", "U": "text"}
        raise UnfitError(f"{name}: expected {words[form.kind]}, got {kind}")
    if kind.kind == "U" and kind.itemsize > 4 * MAX_TEXT:
        raise UnfitError(f"{name}: expected at most {MAX_TEXT} characters")
    wanted = tuple(lengths.of(n, shape[i : i + 1]) for i, n in enumerate(form.shape))
    if shape != wanted:
        raise UnfitError(f"{name}: expected the shape {wanted}, got {shape}")


class _Lengths:
    """The lengths that letters stand for: the first array with a letter tells, within what is allowed."""

    def __init__(self, most: Mapping[str, int]) -> None:
        self._most = most
        self._known: dict[str, int] = {}

    def of(self, length: int | str, got: tuple[int, ...]) -> int:
        """Return the length that an array should have where it has `got`."""
        if isinstance(length, int):
            return length
        if length not in self._known and got:
            if got[0] > self._most[length]:
                raise UnfitError(f"expected at most {self._most[length]} samples, got {got[0]}")
            self._known[length] = got[0]
        return self._known.get(length, 0)
