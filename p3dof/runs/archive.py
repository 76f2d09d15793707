"""Runs as NumPy archives: what is in them, and how they are read when somebody else may have made them."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from p3dof._base.checks import shown
from p3dof._base.errors import InputError
from p3dof._base.files import MAX_TEXT, UnfitError, pack_arrays, unpack_arrays
from p3dof._base.time_series.times import require_rising
from p3dof.runs.margins import Occurrence, Stop

MAX_SAMPLES = 200_000  # most samples of a run that is read without another limit: about 100 MB in memory

_MOST = 100  # most frames with wrenches, and kinds of events, of a run that is read


@dataclass(frozen=True)
class Member:
    """What an array of an archive looks like."""

    kind: str  # NumPy's letter for the kind of its numbers: `"f"` (float64), `"i"` (int64) or `"U"` (text)
    shape: tuple[int | str, ...]  # a letter stands for a length that all arrays with this letter share
    optional: bool = False  # whether it may be missing


ENDING: dict[str, Member] = {
    "method": Member("U", ()),
    "stop": Member("U", ("S",)),
    "stop_time": Member("f", ()),
    "evaluations": Member("i", ()),
    "seconds": Member("f", ()),
    "note": Member("U", ()),
    "event_names": Member("U", ("K",), optional=True),
    "event_numbers": Member("i", ("E",), optional=True),
    "event_times": Member("f", ("E",), optional=True),
    "event_rising": Member("i", ("E",), optional=True),
}
"""The arrays of any run: how it was made, and how it ended."""


def pack(run: Any, arrays: Mapping[str, Any]) -> bytes:
    """Return the archive of a run with these arrays, and those of `ENDING`."""
    stop, names = run.stop, list(dict.fromkeys(event.name for event in run.events))
    words = [] if stop is None else [stop.kind, stop.reason[:MAX_TEXT]]
    ending = {
        "method": np.array(run.method),
        "stop": np.array(words, dtype=np.str_),
        "stop_time": np.array(np.nan if stop is None else stop.time),
        "evaluations": np.array(run.evaluations),
        "seconds": np.array(run.seconds),
        "note": np.array(run.note[:MAX_TEXT]),
        "event_names": np.array([name[:MAX_TEXT] for name in names], dtype=np.str_),
        "event_numbers": np.array([names.index(event.name) for event in run.events], dtype=np.int64),
        "event_times": np.array([event.time for event in run.events], dtype=float),
        "event_rising": np.array([event.rising for event in run.events], dtype=np.int64),
    }
    reference = {} if run.reference is None else {"reference": run.reference}
    return pack_arrays({**arrays, **ending, **reference})


def ending_of(found: Mapping[str, Any]) -> dict[str, Any]:
    """Return what `ENDING` holds, and the reference, as the arguments of a run."""
    words = [str(word) for word in found["stop"]]
    events: tuple[Occurrence, ...] = ()
    if all(name in found for name in ENDING):
        rows = zip(found["event_numbers"], found["event_times"], found["event_rising"], strict=True)
        events = tuple(
            Occurrence(str(found["event_names"][i]), float(time), bool(rose)) for i, time, rose in rows
        )
    return {
        "method": str(found["method"]),
        "stop": Stop(words[0], float(found["stop_time"]), words[1]) if words else None,
        "evaluations": int(found["evaluations"]),
        "seconds": float(found["seconds"]),
        "note": str(found["note"]),
        "events": events,
        "reference": found.get("reference"),
    }


def unpack(
    path: str | os.PathLike[str],
    form: Mapping[str, Member],
    methods: Collection[str],
    kinds: Collection[str],
    max_samples: int,
) -> dict[str, Any]:
    """Read the arrays of a run by a form; `methods` may have made it, and `kinds` of reasons ended it."""
    if isinstance(max_samples, bool) or not isinstance(max_samples, int) or max_samples < 1:
        raise InputError(f"max_samples: expected a positive whole number, got {shown(max_samples)}")
    lengths = _Lengths({"N": max_samples, "S": 2, "K": _MOST, "F": _MOST, "E": max_samples})

    def accept(name: str, kind: np.dtype[Any], shape: tuple[int, ...]) -> None:
        _check_shape(name, form[name], kind, shape, lengths)

    def found(arrays: dict[str, Any]) -> None:
        name, value = next(reversed(arrays.items()))
        if form[name].kind == "f" and name != "stop_time" and not np.isfinite(value).all():
            raise UnfitError(f"{name}: expected finite numbers")
        _check_value(name, value, arrays, methods, kinds)

    return unpack_arrays(path, partial(_expected, form), accept, found, what="a run saved as .npz")


def _check_value(
    name: str, value: Any, found: Mapping[str, Any], methods: Collection[str], kinds: Collection[str]
) -> None:
    """Raise `InputError` unless what has just been read of a run can be so."""
    if name == "time":
        if len(value) == 0:
            raise InputError("time: expected at least one sample, got none")
        require_rising("time", value)
    elif name in {"joint_names", "frames", "event_names"} and len({str(word) for word in value}) < len(value):
        raise InputError(f"{name}: expected different names")
    elif name == "method" and str(value) not in methods:
        raise InputError(f"method: expected one of {', '.join(methods)}, got {shown(str(value))}")
    elif name == "stop" and len(value) and (len(value) != 2 or str(value[0]) not in kinds):
        raise InputError(
            f"stop: expected nothing, or one of {', '.join(kinds)} and why, got {shown(str(value[0]))}"
        )
    elif name == "stop_time" and np.isfinite(value) != bool(len(found["stop"])):
        raise InputError("stop_time: expected a time if the run was ended, and none if not")
    elif name in {"closure_error", "gap", "evaluations", "seconds"} and np.any(value < 0):
        raise InputError(f"{name}: expected no negative number")
    elif name == "event_numbers" and np.any((value < 0) | (value >= len(found.get("event_names", ())))):
        raise InputError("event_numbers: expected numbers of the names of events")


def _expected(forms: Mapping[str, Member], there: list[str]) -> list[str]:
    """Return which arrays of a run to read; raise if there are others, or too few."""
    for name in there:
        if name not in forms:
            raise UnfitError(f"it holds {f'{name[:36]}.npy'!r}, more than a run has")
    for name, form in forms.items():
        if name not in there and not form.optional:
            raise UnfitError(f"{name} is missing")
    return [name for name in forms if name in there]


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
