"""Checks of arguments that several modules share; each names what was expected and what came."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from typing_extensions import Self

from p3dof._base.errors import InputError, P3dofError

FloatArray = NDArray[np.float64]
"""An array of double-precision numbers."""

Progress: TypeAlias = Callable[[int, int], None]
"""Called with (done, total) during long work."""


LARGEST = 1e30
"""Largest number that is taken, in SI units: products and squares of a few of them still have a value."""


SMALLEST = 1 / LARGEST
"""Smallest number that is taken where it has to be positive: it is divided by."""


class FrozenArrays:
    """Base of frozen dataclasses with read-only arrays: they stay so in deep copies and after unpickling."""

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self  # nothing in it can change

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
            object.__setattr__(self, name, value)


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


def shown(value: Any) -> str:
    """Return how to show a foreign value in an error: short, on one line, never the whole of a large object.

    Parameters
    ----------
    value : object
        Anything.

    Returns
    -------
    str
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


def visible(text: str) -> str:
    """Return a text with its control characters written out: a terminal would obey them.

    Parameters
    ----------
    text : str
        Any text, such as names in other people's files.

    Returns
    -------
    str
        The same text, with an escape as a backslash and ``x1b``, and so on. Ends of lines and tabs stay.
    """
    return _CONTROL.sub(lambda found: found[0].encode("unicode_escape").decode("ascii"), text)


def one_line(text: str, limit: int = 400) -> str:
    """Return a text on one line, its control characters written out, its end left out if it is long.

    Parameters
    ----------
    text : str
        Part of an error message.
    limit : int
        How many characters to keep.

    Returns
    -------
    str
    """
    line = visible(" ".join(text[: 2 * limit].split()))
    return line if len(line) <= limit and len(text) <= 2 * limit else f"{line[:limit]}..."


def as_floats(name: str, value: Any, error: type[P3dofError] = InputError) -> FloatArray:
    """Return `value` as an array of real numbers, of any shape, NaN and infinity included.

    Parameters
    ----------
    name : str
        What to call the argument in an error.
    value : array-like
        The argument.
    error : type of P3dofError
        The error to raise.

    Returns
    -------
    ndarray of float64

    Raises
    ------
    P3dofError
        The given `error`, if `value` is ragged, complex, text, or not numbers at all.
    """
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as problem:
        ragged = isinstance(value, list | tuple) and isinstance(problem, ValueError)
        got = "rows of different lengths" if ragged else f"{shown(value)} ({one_line(str(problem))})"
        raise error(f"{name}: expected real numbers, got {got}") from problem
    if array.dtype.kind not in "fiu":
        raise error(f"{name}: expected real numbers, got {_in_words(array)}")
    floats: FloatArray = np.asarray(array, dtype=np.float64)
    return floats


def frozen_array(
    name: str, value: Any, shape: tuple[int | str, ...], error: type[P3dofError] = InputError
) -> FloatArray:
    """Return a read-only copy of `value` after checking its shape, and that no entry is NaN or too large.

    Parameters
    ----------
    name : str
        What to call the argument in an error.
    value : array-like
        The argument.
    shape : tuple of int or str
        The expected shape; a letter stands for any length.
    error : type of P3dofError
        The error to raise.

    Returns
    -------
    ndarray of float64
        A copy that cannot be written to.

    Raises
    ------
    P3dofError
        The given `error`, on any mismatch.
    """
    if type(value) is np.ndarray and value.dtype is _DOUBLES and value.shape == shape and value.size <= _FEW:
        known: FloatArray = value.copy()
        flat = known.ravel()
        if flat.dot(flat) <= _SQUARE:  # then no entry is larger or NaN, and nothing is left to look at
            known.setflags(write=False)
            return known
    array = as_floats(name, value, error).copy()
    expected = "(" + ", ".join(str(n) for n in shape) + ("," if len(shape) == 1 else "") + ")"
    fits = array.ndim == len(shape) and all(
        isinstance(n, str) or n == m for n, m in zip(shape, array.shape, strict=True)
    )
    if not fits:
        wanted = f"shape {expected}, got" if shape else "a single number, got shape"
        raise error(f"{name}: expected {wanted} {array.shape if array.ndim else 'a single number'}")
    fine = np.abs(array) <= LARGEST
    if not fine.all():
        index = tuple(int(i) for i in np.argwhere(~fine)[0])
        wanted = "finite numbers" if index else "a finite number"
        if np.isfinite(array[index]):
            wanted = f"{'numbers' if index else 'a number'} of at most {LARGEST:g} in size"
        where = f" at index {list(index)}" if index else ""
        raise error(f"{name}: expected {wanted}, got {array[index]}{where}")
    array.setflags(write=False)
    return array


def batch_of(name: str, value: Any, length: int) -> FloatArray:
    """Return `value` as an array whose last axis has the given length; leading axes are a batch.

    Parameters
    ----------
    name : str
        What to call the argument in an error.
    value : array-like, shape (..., length)
        The argument; it may hold NaN.
    length : int
        The expected length of the last axis.

    Returns
    -------
    ndarray of float64, shape (..., length)

    Raises
    ------
    InputError
        If the shape or the type does not fit.
    """
    array = as_floats(name, value)
    if array.ndim == 0 or array.shape[-1] != length:
        raise InputError(f"{name}: expected shape (..., {length}), got {array.shape}")
    return array


def real(name: str, value: Any, error: type[P3dofError] = InputError) -> float:
    """Return a number from outside, a Python or NumPy one of any size, as a finite float.

    Parameters
    ----------
    name : str
        What to call the argument in an error.
    value : float
        The argument.
    error : type of P3dofError
        The error to raise.

    Returns
    -------
    float

    Raises
    ------
    P3dofError
        The given `error`, if `value` is not a single real number, not finite or too large.
    """
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


def _in_words(array: NDArray[Any]) -> str:
    """Say what an array holds instead of real numbers."""
    if array.dtype.kind in "UT" and array.size:
        return shown(next((item for item in array.flat if not _is_number(item)), array.flat[0]))
    if array.dtype.kind == "b" and array.ndim == 0:
        return str(array)
    if array.dtype.kind != "O":
        return _PLAIN_WORDS.get(array.dtype.kind, "something else")
    for item in array.flat:
        words = shown(item)
        if isinstance(item, bool) or not isinstance(item, int | float) or words == "a huge integer":
            return words
    return "objects"


def _is_number(text: Any) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
