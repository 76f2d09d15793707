"""`Function`: what is printed as C or run as NumPy, with its inputs and outputs by name."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from p3dof._base.checks import LARGEST, FloatArray
from p3dof._base.errors import ModelError
from p3dof._base.threads import OneThread, in_threads, shares, slices
from p3dof._base.tracing import Number, Symbol, Tape
from p3dof._base.tracing.printing import function_of
from p3dof.loops.compiled.formulas import MARGIN, At, Robot, normalised
from p3dof.loops.tree_formulas import dot

MOST_OPERATIONS = 30_000  # more take compilers longer than anybody waits


@dataclass(frozen=True, eq=False)
class Function:
    """A traced function."""

    name: str  # its name
    tape: Tape  # its operations
    inputs: Mapping[str, int]  # names and sizes, in their order
    outputs: Mapping[str, int]
    symbols: tuple[Symbol, ...]  # all inputs
    results: tuple[Number, ...]  # all outputs
    closed: float = 0.0  # largest gap at which it is to be trusted
    least_margin: float = MARGIN  # smallest margin likewise

    @cached_property
    def operations(self) -> int:
        """How many operations a sample takes; sines and cosines count one each, signs none."""
        tape = self.tape
        needed = (tape.operations[index] for index in tape.needed(self.results))
        return sum(bool(operation.operands) and operation.name != "neg" for operation in needed)

    @cached_property
    def on_arrays(self) -> Callable[..., tuple[Any, ...]]:
        """The function on NumPy arrays: takes all inputs, returns all outputs."""
        return function_of(self.tape, self.symbols, self.results, np)


class Builder:
    """Collects inputs and outputs of one function."""

    def __init__(self) -> None:
        self.tape = Tape()
        self.inputs: dict[str, int] = {}
        self.outputs: dict[str, int] = {}
        self._symbols: list[Symbol] = []
        self._results: list[Number] = []
        self.closed, self.least_margin = 0.0, MARGIN

    def take(self, name: str, size: int) -> tuple[Symbol, ...]:
        """Return the symbols of a new input."""
        self.inputs[name] = size
        found = self.tape.symbols(f"{name}[{i}]" for i in range(size))
        self._symbols += found
        return found

    def loaded(self, robot: Robot) -> tuple[Robot, dict[str, tuple[Symbol, ...]]]:
        """Take what acts and what is known only when it runs; return the robot with that, and all by name."""
        found = {name: self.take(name, size) for name, size in robot.inputs.items()}
        return robot.with_inputs(found), found

    def size_limits(self, asked: bool = True) -> list[Number]:
        """Return what is positive where no input is too large, and no number where one is none."""
        return [self.tape.subtract(LARGEST * LARGEST, dot(self._symbols, self._symbols))] if asked else []

    def give(self, name: str, values: Sequence[Number]) -> None:
        """Add an output."""
        self.outputs[name] = len(values)
        self._results += values

    def evidence(self, at: At, closed: float, limits: Sequence[Number] = (), margin: float = MARGIN) -> None:
        """Give margin and gap, and whether the sample is to be trusted: a positive number, no NaN.

        Closed are the loops up to a gap, with no axes opposite that should agree. Limits are positive.
        """
        tape = self.tape
        self.closed = closed * at.robot.length
        gap = dot(at.errors, at.errors)
        limits = [
            tape.subtract(self.closed * self.closed, gap),
            *at.loops.aligned(),
            *normalised(at),
            *limits,
        ]
        self.least_margin = margin
        least = tape.subtract(at.margin, margin * margin)
        for limit in limits:
            least = tape.minimum(limit, least)
        total: Number = 0.0
        for value in (*self._results, *limits):  # a minimum would lose a limit that is NaN
            total = total + value
        # The minimum loses pivots that are NaN; the gap is NaN where the configuration is.
        self.give("margin", [tape.add(tape.sqrt(at.margin), tape.subtract(gap, gap))])
        self.give("gap", [tape.sqrt(gap)])
        # What is not finite makes the difference NaN, and the minimum with it.
        self.give("trusted", [tape.minimum(least, tape.add(tape.subtract(total, total), 1.0))])

    def function(self, name: str) -> Function:
        """Return the function; refuse one with too many operations."""
        found = self.traced(name)
        if found.operations > MOST_OPERATIONS:
            raise ModelError(
                f"{name}: {found.operations} operations are more than compilers take "
                f"(at most {MOST_OPERATIONS}): lock joints, or use the robot's own method of that name"
            )
        return found

    def traced(self, name: str) -> Function:
        """Return the function, however large it is."""
        return Function(
            name,
            self.tape,
            self.inputs,
            self.outputs,
            tuple(self._symbols),
            tuple(self._results),
            self.closed,
            self.least_margin,
        )


SHARE = 8_192  # samples that are worth a thread of their own
_BLOCK = 4_096  # samples that NumPy takes at a time


class Kernel:
    """A traced function on rows of arrays."""

    def __init__(self, function: Function, library: ctypes.CDLL | None) -> None:
        self.function = function
        self._many: Any = None
        if library is not None:
            self._many = getattr(library, f"{function.name}_many")
            self._many.argtypes = [ctypes.c_ssize_t, *[ctypes.c_void_p] * 3]
            self._many.restype = None
            self._path = library._name

    def __call__(self, count: int, inputs: Mapping[str, FloatArray], threads: int) -> dict[str, FloatArray]:
        """Return the outputs of all samples; dict of str to (count, size) array."""
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

    Fill `inputs`, call `run`, which returns nothing, and read `outputs`: they are valid where ``trusted`` is
    positive. It is NaN for numbers that are not finite; ``margin`` and ``gap``, for such a configuration. It
    belongs to the thread that runs it first.
    """

    def __init__(self, function: Function, path: str | None) -> None:
        self._in, self._out = np.zeros(max(1, len(function.symbols))), np.zeros(max(1, len(function.results)))
        self.inputs = views(self._in, function.inputs)  # arrays by name; enter the sample here
        self.outputs = views(self._out, function.outputs)  # arrays by name; `run` fills them
        self.run: Callable[[], None]  # compute one sample; `InputError` in another thread than before
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


def views(array: FloatArray, groups: Mapping[str, int]) -> dict[str, FloatArray]:
    """Return parts of an array by name, of given sizes one behind the other."""
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
