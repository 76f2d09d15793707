"""`Kernel`: a traced function that runs on rows of arrays, compiled or by NumPy."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.threads import OneThread, in_threads, shares, slices
from p3dof.loops.compiled.function import Function

SHARE = 8_192
"""Samples that are worth a thread of their own."""
_BLOCK = 4_096
"""Samples that NumPy takes at a time."""


class Kernel:
    """A traced function on rows of arrays.

    Parameters
    ----------
    function : Function
        What to compute.
    library : ctypes.CDLL, optional
        Where it is compiled; NumPy does it without one.
    """

    def __init__(self, function: Function, library: ctypes.CDLL | None) -> None:
        self.function = function
        self._many: Any = None
        if library is not None:
            self._many = getattr(library, f"{function.name}_many")
            self._many.argtypes = [ctypes.c_ssize_t, *[ctypes.c_void_p] * 3]
            self._many.restype = None
            self._path = library._name

    def __call__(self, count: int, inputs: Mapping[str, FloatArray], threads: int) -> dict[str, FloatArray]:
        """Return the outputs of all samples.

        Parameters
        ----------
        count : int
            Samples.
        inputs : mapping of str to (count, size) or (size,) array
            All inputs; one row is meant for all samples.
        threads : int
            How many at most.

        Returns
        -------
        dict of str to (count, size) array
        """
        function = self.function
        outputs: dict[str, FloatArray] = {}
        for name, size in function.outputs.items():
            outputs[name] = np.empty((count, size))
        given = [np.ascontiguousarray(inputs[name]) for name in function.inputs]
        run = self._by_numpy if self._many is None else self._compiled
        in_threads(partial(run, given, list(outputs.values())), shares(count, threads, SHARE))
        return outputs

    def _compiled(
        self, given: Sequence[FloatArray], outputs: Sequence[FloatArray], part: tuple[int, int]
    ) -> None:
        start, stop = part
        strides = [array.shape[1] if array.ndim == 2 else 0 for array in given]
        sources = [
            array.ctypes.data + 8 * start * stride for array, stride in zip(given, strides, strict=True)
        ]
        targets = [array.ctypes.data + 8 * start * array.shape[1] for array in outputs]
        self._many(stop - start, pointers(sources), sizes(strides), pointers(targets))

    def _by_numpy(
        self, given: Sequence[FloatArray], outputs: Sequence[FloatArray], part: tuple[int, int]
    ) -> None:
        for block in slices(part[1] - part[0], _BLOCK):
            start, stop = part[0] + block.start, part[0] + block.stop
            columns = [
                column for array in given for column in (array[start:stop].T if array.ndim == 2 else array)
            ]
            with np.errstate(all="ignore"):
                found = iter(self.function.on_arrays(*columns))
            for array in outputs:
                for i in range(array.shape[1]):
                    array[start:stop, i] = next(found)

    def bound(self) -> BoundFunction:
        """Return the function of one sample, bound to arrays of its own."""
        return BoundFunction(self.function, self._path if self._many is not None else None)


class BoundFunction:
    """A compiled function of one sample that reads and writes arrays of its own.

    Fill `inputs`, call `run`, read `outputs`. Nothing is checked: look at the ``margin`` and the ``gap``. It
    belongs to the thread that runs it first.

    Parameters
    ----------
    function : Function
        What to compute.
    path : str, optional
        The library that it is compiled in.
    """

    def __init__(self, function: Function, path: str | None) -> None:
        self._in, self._out = np.zeros(max(1, len(function.symbols))), np.zeros(max(1, len(function.results)))
        self.inputs = _views(self._in, function.inputs)
        """Arrays by name; enter the sample here."""
        self.outputs = _views(self._out, function.outputs)
        """Arrays by name; `run` fills them."""
        self.run: Callable[[], None]
        """Compute one sample; `InputError` in another thread than before."""
        mine = OneThread(f"the arrays of this {function.name}, bind one in each thread").check
        if path is None:
            self.run = partial(_run_by_numpy, mine, function, self._in, self._out)
            return
        call = getattr(ctypes.PyDLL(path), f"{function.name}_bound")  # so short that other threads may wait
        call.argtypes, call.restype = [ctypes.c_void_p], None
        self._pointers = pointers([self._in.ctypes.data, self._out.ctypes.data])
        self.run = partial(_run_in_c, mine, call, ctypes.addressof(self._pointers))
        # Who keeps the call alone keeps what it reads and writes.
        vars(self.run)["kept"] = self._pointers, self._in, self._out


def _run_in_c(mine: Callable[[], None], call: Any, place: int) -> None:
    mine()
    call(place)


def _run_by_numpy(mine: Callable[[], None], function: Function, given: FloatArray, found: FloatArray) -> None:
    mine()
    with np.errstate(all="ignore"):
        found[: len(function.results)] = function.on_arrays(*given)


def _views(array: FloatArray, groups: Mapping[str, int]) -> dict[str, FloatArray]:
    found, start = {}, 0
    for name, size in groups.items():
        found[name] = array[start : start + size]
        start += size
    return found


def pointers(addresses: Sequence[int]) -> Any:
    """Return an array of pointers for C."""
    return (ctypes.c_void_p * max(1, len(addresses)))(*addresses)


def sizes(numbers: Sequence[int]) -> Any:
    """Return an array of ptrdiff_t for C."""
    return (ctypes.c_ssize_t * max(1, len(numbers)))(*numbers)
