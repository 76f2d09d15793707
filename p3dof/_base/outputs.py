"""``out=``: results in arrays that users keep, with NumPy's meaning of the word."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError

_DOUBLES = np.dtype(np.float64)
_WORK = 10_000
"""How hard to try to find two arrays of crossed strides apart; those that are not found apart are refused."""


def result_in(
    out: Any,
    shape: tuple[int, ...],
    given: Iterable[object],
    compute: Callable[[FloatArray | None], FloatArray],
    row: int = 1,
) -> FloatArray:
    """Return a result, in the user's array if there is one; `out` itself, or what was computed.

    `given`: what the result is computed from; the arrays among it must not share memory with `out`.

    `compute`: returns the result. It is called with an array to write into, of the shape of the result, or
    None if it must make one; it may always make one.
    """
    if out is None:
        return compute(None)
    array = checked_out("out", out, shape, given)
    try:
        found = compute(array if in_rows(array, row) else None)
        if found is not array:
            array[...] = found
    except BaseException:
        array.fill(np.nan)
        raise
    return array


def written(found: FloatArray, out: FloatArray | None) -> FloatArray:
    """Return what was found, in an array that it is to be written into, if there is one."""
    if out is None:
        return found
    out[...] = found
    return out


def checked_out(name: str, out: Any, shape: tuple[int, ...], given: Iterable[object]) -> FloatArray:
    """Return the array that a result of a shape is to be written into."""
    if not isinstance(out, np.ndarray):
        raise InputError(f"{name}: expected an array of float64, got {shown(out)}")
    if out.dtype != _DOUBLES:
        raise InputError(f"{name}: expected an array of float64, got one of {out.dtype}")
    if out.shape != shape:
        raise InputError(f"{name}: expected shape {shape}, got {out.shape}")
    if not out.flags.writeable:
        raise InputError(f"{name}: expected a writable array, got a read-only one")
    if out.size and any(step == 0 and count > 1 for step, count in zip(out.strides, shape, strict=True)):
        raise InputError(f"{name}: expected a place for every number, got an array that repeats some")
    for other in given:
        if isinstance(other, np.ndarray) and _share(out, other):
            raise InputError(
                f"{name}: expected memory of its own, got an array that shares some with an input or a result"
            )
    return out


def checked_parts(
    arrays: Sequence[Any], names: Sequence[str], shapes: Sequence[tuple[int, ...]], given: Iterable[object]
) -> None:
    """Look at the arrays of an earlier result that is to be written again, as `checked_out` does at one.

    `arrays`: the arrays; they must not share memory with each other either.
    """
    known = list(given)
    for array, name, shape in zip(arrays, names, shapes, strict=True):
        known.append(checked_out(f"out.{name}", array, shape, known))


def in_rows(array: FloatArray, row: int) -> bool:
    """Return whether kernels can write an array: aligned, every number apart, one axis of samples.

    Then ``array.reshape(-1, *array.shape[-row:])`` is a view of it.
    """
    if not array.flags.aligned or not array.size:  # NumPy calls every empty array aligned
        return False
    if array.flags.c_contiguous:
        return True
    step, count = np.abs(array.strides), array.shape
    order = np.argsort(step)
    apart = all(step[i] * count[i] <= step[j] for i, j in pairwise(order))
    leading = range(array.ndim - row - 1)
    return apart and all(array.strides[k] == array.strides[k + 1] * count[k + 1] for k in leading)


def _share(one: FloatArray, other: FloatArray) -> bool:
    if not np.may_share_memory(one, other):
        return False
    try:
        return np.shares_memory(one, other, max_work=_WORK)
    except np.exceptions.TooHardError:
        return True
