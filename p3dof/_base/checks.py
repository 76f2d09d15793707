"""Checks of arguments that several modules share; each names what was expected and what came."""

from __future__ import annotations

import difflib
import math
import re
import sys
import textwrap
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from typing_extensions import Self

from p3dof._base.errors import InputError, ModelError, ModelWarning, P3dofError

FloatArray = NDArray[np.float64]
"""An array of double-precision numbers."""

Progress: TypeAlias = Callable[[int, int], None]
"""Called with (done, total) during long work."""

Watch: TypeAlias = Callable[[str, int], AbstractContextManager[Progress | None]]
"""Called with the name of long work and its number of samples; gives what its progress is told to."""


LARGEST = 1e30
"""Largest number that is taken, in SI units: products and squares of a few of them still have a value."""


SMALLEST = 1 / LARGEST
"""Smallest number that is taken where it has to be positive: it is divided by."""


class Readable:
    """Base of classes that people read: a short form of each field, and the nearest name for a wrong one."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "__repr__" not in vars(cls):
            cls.__repr__ = cls.__repr__  # type: ignore[method-assign]  # then dataclasses make none

    def __repr__(self) -> str:
        names = [item.name for item in getattr(self, "__dataclass_fields__", {}).values() if item.repr]
        text = (
            f"{type(self).__name__}({', '.join(f'{name}={_brief(getattr(self, name))}' for name in names)})"
        )
        return textwrap.fill(text, 110, subsequent_indent="  ", max_lines=10, break_on_hyphens=False)

    if not TYPE_CHECKING:  # which would know no wrong name then

        def __getattr__(self, name: str) -> Any:
            known = {*dir(self), *getattr(self, "__dataclass_fields__", ())} if name[0] != "_" else ()
            public = [each for each in known if each[0] != "_"]
            raise AttributeError(
                f"{type(self).__name__!r} object has no attribute {name!r}{meant(name, public, most=1)}"
            )


class FrozenArrays(Readable):
    """Base of frozen dataclasses with read-only arrays: they stay so in deep copies and after unpickling."""

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self  # nothing in it can change

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
            object.__setattr__(self, name, value)


def _brief(value: Any) -> str:
    """Return a short form of a field: small things as they are, of large ones the type and the size."""
    if isinstance(value, np.ndarray) and value.size > _SMALL:
        return f"array{value.shape}".replace(" ", "")
    if isinstance(value, str | tuple | list | Mapping) and len(value) > _SMALL:
        return f"{type(value).__name__} of {len(value)}" if not isinstance(value, str) else shown(value)
    text = " ".join(repr(value).split())
    return text if len(text) <= _LONG else f"{type(value).__name__}(...)"


_SMALL, _LONG = 12, 80
"""Up to how many numbers and characters a field is written out."""
_DOUBLES, _SQUARE = np.dtype(np.float64), LARGEST**2
_FEW = 5000
"""Entries of an array for whose scalar product no threads are woken."""

_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")
"""What terminals obey: control characters, and those that change the direction of text."""

_PLAIN_WORDS = {
    "U": "text",
    "T": "text",
    "S": "bytes",
    "b": "true or false",
    "c": "complex numbers",
    "M": "dates",
    "m": "time spans",
}
"""What to call an array of something else than real numbers, by NumPy's letter for its type."""


# Unit -> (multiply, divide): dividing by 1000 rounds correctly, multiplying by .001 does not.
Factors: TypeAlias = dict[str, tuple[float, float]]
TIMES: Factors = {"s": (1, 1), "ms": (1, 1e3), "us": (1, 1e6), "µs": (1, 1e6), "ns": (1, 1e9)}
LENGTHS: Factors = {
    "m": (1, 1), "mm": (1, 1e3), "cm": (1, 100), "um": (1, 1e6), "µm": (1, 1e6), "km": (1e3, 1),
    "in": (127, 5e3), "ft": (381, 1250),
}  # fmt: skip
ANGLES: Factors = {"rad": (1, 1), "deg": (math.pi / 180, 1), "°": (math.pi / 180, 1), "mrad": (1, 1e3)}
FORCES: Factors = {
    "N": (1, 1), "kN": (1e3, 1), "mN": (1, 1e3), "lbf": (4.4482216152605, 1), "kgf": (9.80665, 1)
}  # fmt: skip
MOMENTS: Factors = {
    "N m": (1, 1), "Nm": (1, 1), "N mm": (1, 1e3), "Nmm": (1, 1e3), "mN m": (1, 1e3), "mNm": (1, 1e3),
    "kN m": (1e3, 1), "lbf in": (0.1129848290276167, 1), "lbf ft": (1.3558179483314003, 1),
}  # fmt: skip

_POSE = ("y", "z", "theta")
_NAMES: dict[str, tuple[tuple[str, ...], ...]] = {
    **dict.fromkeys(("pose", "waypoints", "start", "end"), (_POSE,)),
    "velocity": (("ydot", "zdot", "thetadot"), _POSE),
    "acceleration": (("yddot", "zddot", "thetaddot"), _POSE),
    "wrench": (("fx", "fy", "fz", "mx", "my", "mz"),),
    "forces": (("fA", "fB", "fC"), ("A", "B", "C")),
    "sliders": (("slider A", "slider B", "slider C"), ("A", "B", "C")),
}
"""What the columns of a table are called, in their order, by the last word of what it is given as."""
_PLAIN = frozenset({np.ndarray, list, tuple, float, int, np.float64})


def units_of(name: str) -> Factors:
    """Return the units that a column of a motion or a wrench may be in."""
    if name == "t":
        return TIMES
    if name[0] in "fm":
        return FORCES if name[0] == "f" else MOMENTS
    suffix = "/s^2" if name.endswith("ddot") else "/s" if name.endswith("dot") else ""
    return {unit + suffix: by for unit, by in (ANGLES if name.startswith("theta") else LENGTHS).items()}


def name_and_unit(field: str) -> tuple[str, str | None]:
    """Split ``y [mm]`` into ``y`` and ``mm``."""
    name, bracket, unit = field.strip().rpartition("[")
    if bracket and unit.endswith("]"):
        return name.rstrip(), unit[:-1].strip().replace("²", "^2").replace("/s2", "/s^2").replace("μ", "µ")
    return field.strip(), None


def _columns(value: Any) -> dict[str, Any] | None:
    """Return the columns of a table of any library by their names, with units; None of what has no names."""
    if getattr(getattr(value, "dtype", None), "names", None):
        return {name: value[name] for name in value.dtype.names}
    if hasattr(value, "data_vars"):  # xarray's Dataset, and then its DataArray
        units = {name: value[name].attrs.get("units") for name in value.data_vars}
        return {f"{n} [{u}]" if u else str(n): value[n].values for n, u in units.items()}
    for axis, dim in enumerate(getattr(value, "dims", ())):
        if dim in value.coords and value.coords[dim].dtype.kind in "OU":
            labels = [str(label) for label in value.coords[dim].values]
            return dict(zip(labels, np.moveaxis(value.values, axis, 0), strict=True))
    names = getattr(value, "column_names", getattr(value, "columns", getattr(value, "index", None)))
    if names is None or callable(names) or not any(isinstance(name, str) for name in names):
        return None
    return {str(name): value[name] for name in names}


def _named(name: str, value: Any, error: type[P3dofError]) -> Any:
    """Return what is no plain array as one: a table by the names of its columns, masked numbers as NaN."""
    table = _columns(value)
    if table is None:
        masked = isinstance(value, np.ma.MaskedArray) and value.dtype.kind in "fiu"
        return value.astype(float).filled(np.nan) if masked else value
    headers = {key: (unit, each) for each in table for key, unit in [name_and_unit(each)]}
    choices = _NAMES.get(name.rpartition(" ")[2], ()) or _NAMES.get(name.partition(" ")[0], ())
    wanted = next((names for names in choices if not set(names) - set(headers)), None)
    if wanted is None or len(headers) < len(table):
        asked = f"the columns {' or '.join(map(','.join, choices))}" if choices else "numbers without names"
        raise error(f"{name}: expected {asked}, got {shown(value)} with {one_line(','.join(table), 100)}")
    found = []
    for column, own in zip(wanted, choices[0], strict=True):
        unit, header = headers[column]
        known, where = units_of(own), f"{name}, column {column}"
        if unit is not None and unit not in known:
            raise error(f"{where}: expected a unit of {', '.join(known)}, got [{one_line(unit, 40)}]")
        multiply, divide = (1.0, 1.0) if unit is None else known[unit]
        found.append(as_floats(where, table[header], error) * multiply / divide)
    if len({each.shape for each in found}) > 1:
        raise error(f"{name}: expected columns of one length")
    return np.stack(found, axis=-1)


def shown(value: Any) -> str:
    """Return how to show a foreign value in an error: short, on one line, never the whole of a large object.

    The beginning of a text, a number, or in words of what type the value is.
    """
    if isinstance(value, str):
        return repr(str(value[:80])) + ("..." if len(value) > 80 else "")
    if isinstance(value, int) and value.bit_length() > 63:
        return "a huge integer"
    if value is None or isinstance(value, int | float):
        return repr(value)
    if isinstance(value, bytes):
        return "bytes"
    kind = type(value).__name__
    return f"{'an' if kind[0].lower() in 'aeiou' else 'a'} {kind}"


def got_of(value: object) -> str:
    """Return how to show what a file has where something is expected: perhaps nothing."""
    return "nothing" if value is None else shown(value)


def visible(text: str) -> str:
    """Return a text with its control characters written out: a terminal would obey them.

    The same text, with an escape as a backslash and ``x1b``, and so on. Ends of lines and tabs stay.
    """
    return _CONTROL.sub(lambda found: found[0].encode("unicode_escape").decode("ascii"), text)


def one_line(text: str, limit: int = 400) -> str:
    """Return a text on one line, its control characters written out, its end left out if it is long."""
    line = visible(" ".join(text[: 2 * limit].split()))
    return line if len(line) <= limit and len(text) <= 2 * limit else f"{line[:limit]}..."


def meant(name: object, known: Iterable[str], closeness: float = 0.6, most: int = 3) -> str:
    """Return what ends an error about a name that does not exist: "; did you mean 'x'?", or nothing."""
    short = [one for one in dict.fromkeys(known) if len(one) <= 100]  # comparing takes length times length
    word = name if isinstance(name, str) and len(name) <= 100 else ""
    near = difflib.get_close_matches(word, short, most, closeness) if word else []
    return f"; did you mean {' or '.join(map(repr, near))}?" if near else ""


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return ``"did you mean ...?"`` of names that come close, else the known names (at most twenty)."""
    names = list(dict.fromkeys(known))
    if near := meant(name, names):
        return near.removeprefix("; ")
    listed = ", ".join(one_line(known, 100) for known in names[:20]) + (", ..." if len(names) > 20 else "")
    return f"known: {listed or 'none'}"


def with_point(text: object) -> str:
    """Return what ends an error about a number with a decimal comma."""
    found = re.fullmatch(r"\s*([+-]?\d+),(\d+)([^,]*)", str(text)[:80])
    return f"; with a decimal point it is {found[1]}.{found[2]}{found[3]}" if found else ""


def checked_name(where: str, value: Any) -> None:
    """Refuse what is not a name."""
    if not isinstance(value, str) or not value.strip():
        raise ModelError(f"{where}: expected a name, got {shown(value)}")


def require(name: str, value: object, kind: type, error: type[P3dofError] = InputError) -> None:
    """Raise unless a value is of a class."""
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        raise error(f"{name}: expected {article} {kind.__name__}, got {shown(value)}")


def require_commas(fields: Sequence[str], where: str, error: type[P3dofError]) -> None:
    """Raise for a header whose names have something else between them, or that is none."""
    word = next((word for mark, word in _NOT_COMMAS.items() if len(fields) == 1 and mark in fields[0]), None)
    if (
        word is None
        and len(fields) == 1
        and all(map(str.isidentifier, names := fields[0].split()))
        and len(names) > 1
    ):
        word = "spaces"
    if word is not None:
        raise error(f"{where}: expected commas between the columns, got {word}")


_NOT_COMMAS = {";": "semicolons", "\t": "tabs"}
_OF_FILES = {
    "waypoints": "a task", "geometry": "a machine", "motors": "a catalogue of drives",
    "objectives": "a design problem", "closed_loop": "the sidecar of a robot",
}  # fmt: skip
"""Fields by which a file of another kind is recognised."""


def unknown_field(key: object, data: Iterable[object], known: Collection[str]) -> str:
    """Return what an error says of a field that is not known: what may be meant, or which file it may be."""
    kinds = {name: words for name, words in _OF_FILES.items() if name in data}
    kind = None if set(kinds) & set(known) else next(iter(kinds.values()), None)
    told = meant(key, known) or (f"; this looks like {kind}" if kind else "")
    told += "; decimals have a point, not a comma" if shown(key).lstrip("'")[:1].isdigit() else ""
    return f"unknown field {shown(key)}, expected {', '.join(known)}{told}"


def warn_caller(text: str) -> None:
    """Warn of an input at the line outside the package that gave it."""
    level, frame = 2, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] == "p3dof":
        level, frame = level + 1, frame.f_back
    warnings.warn(text, ModelWarning, stacklevel=level)


def as_floats(name: str, value: Any, error: type[P3dofError] = InputError) -> FloatArray:
    """Return `value` as an array of real numbers, of any shape, NaN and infinity included."""
    if type(value) not in _PLAIN or (type(value) is np.ndarray and value.dtype.names):
        value = _named(name, value, error)
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as problem:
        ragged = isinstance(value, list | tuple) and isinstance(problem, ValueError)
        got = "rows of different lengths" if ragged else shown(value)
        raise error(f"{name}: expected real numbers, got {got}") from problem
    if array.dtype.kind not in "fiu":
        raise error(f"{name}: expected real numbers, got {_in_words(array)}")
    floats: FloatArray = np.asarray(array, dtype=np.float64)
    return floats


def frozen_array(
    name: str, value: Any, shape: tuple[int | str, ...], error: type[P3dofError] = InputError
) -> FloatArray:
    """Return a read-only copy of `value` after checking its shape, and that no entry is NaN or too large.

    A copy that cannot be written to.
    """
    if type(value) is np.ndarray and value.dtype is _DOUBLES and value.shape == shape and value.size <= _FEW:
        known: FloatArray = value.copy()
        flat = known.ravel()
        if flat.dot(flat) <= _SQUARE:  # then no entry is larger or NaN, and nothing is left to look at
            known.setflags(write=False)
            return known
    array = checked_array(name, value, shape, error).copy()
    array.setflags(write=False)
    return array


def checked_array(
    name: str, value: Any, shape: tuple[int | str, ...], error: type[P3dofError] = InputError
) -> FloatArray:
    """Return `value` as an array, which may be itself, after the checks of `frozen_array`."""
    array = as_floats(name, value, error)
    expected = "(" + ", ".join(str(n) for n in shape) + ("," if len(shape) == 1 else "") + ")"
    fits = array.ndim == len(shape) and all(
        isinstance(n, str) or n == m for n, m in zip(shape, array.shape, strict=True)
    )
    if not fits:
        wanted = f"shape {expected}, got" if shape else "a single number, got shape"
        raise error(f"{name}: expected {wanted} {array.shape if array.ndim else 'a single number'}")
    if array.flags.c_contiguous:
        flat = array.ravel()
        if np.einsum("i,i->", flat, flat) <= _SQUARE:  # in one pass, without waking threads
            return array
    fine = np.abs(array) <= LARGEST
    if not fine.all():
        index = tuple(int(i) for i in np.argwhere(~fine)[0])
        wanted = "finite numbers" if index else "a finite number"
        if np.isfinite(array[index]):
            wanted = f"{'numbers' if index else 'a number'} of at most {LARGEST:g} in size"
        where = f" at index {list(index)}" if index else ""
        raise error(f"{name}: expected {wanted}, got {array[index]}{where}")
    return array


def batch_of(name: str, value: Any, length: int) -> FloatArray:
    """Return `value` as an array whose last axis has the given length; leading axes are a batch."""
    array = as_floats(name, value)
    if array.ndim == 0 or array.shape[-1] != length:
        raise InputError(f"{name}: expected shape (..., {length}), got {array.shape}")
    return array


def real(name: str, value: Any, error: type[P3dofError] = InputError) -> float:
    """Return a number from outside, a Python or NumPy one of any size, as a finite float."""
    if type(value) is float and abs(value) <= LARGEST:
        return value
    return float(frozen_array(name, value, (), error))


def not_negative(name: str, value: Any, error: type[P3dofError] = InputError) -> float:
    """Return `value` as a finite number that is not negative; parameters and errors as of `real`."""
    number = real(name, value, error)
    if number < 0:
        raise error(f"{name}: expected zero or more, got {number:g}")
    return number


def positive(name: str, value: Any, error: type[P3dofError]) -> float:
    """Return `value` as a positive finite number that is not too small to divide by; see `real`."""
    number = real(name, value, error)
    if number <= 0:
        raise error(f"{name}: expected a positive number, got {number:g}")
    if number < SMALLEST:
        raise error(f"{name}: expected a positive number of at least {SMALLEST:g}, got {number:g}")
    return number


def whole(name: str, value: Any, least: int, most: float = math.inf) -> int:
    """Return `value` as a whole number within bounds."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not least <= value <= most:
        bounds = f"of at least {least}" if most == math.inf else f"from {least} to {most}"
        raise InputError(f"{name}: expected a whole number {bounds}, got {shown(value)}")
    return int(value)


def _in_words(array: NDArray[Any]) -> str:
    """Say what an array holds instead of real numbers."""
    if array.dtype.kind in "UT" and array.size:
        return shown(next((item for item in array.flat if not is_number(str(item))), array.flat[0]))
    if array.dtype.kind == "b" and array.ndim == 0:
        return str(array)
    if array.dtype.kind != "O":
        return _PLAIN_WORDS.get(array.dtype.kind, "something else")
    for item in array.flat:
        words = shown(item)
        if isinstance(item, bool) or not isinstance(item, int | float) or words == "a huge integer":
            return words
    return "objects"


def is_number(text: str) -> bool:
    """Whether a text is a number as everybody writes it: Python reads 1_000 and other scripts' digits too."""
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text and text.isascii()
