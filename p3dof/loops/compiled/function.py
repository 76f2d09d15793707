"""`Function`: what is printed as C or run as NumPy, with its inputs and outputs by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from p3dof._base.errors import ModelError
from p3dof._base.tracing import Number, Symbol, Tape
from p3dof._base.tracing.python import function_of
from p3dof.loops.compiled.formulas import At, Robot
from p3dof.loops.compiled.limits import MARGIN, normalised
from p3dof.loops.compiled.vectors import dot

MOST_OPERATIONS = 30_000
"""More take compilers longer than anybody waits."""


@dataclass(frozen=True, eq=False)
class Function:
    """A traced function.

    Parameters
    ----------
    name : str
        Its name.
    tape : Tape
        Its operations.
    inputs, outputs : mapping of str to int
        Names and sizes, in their order.
    symbols : tuple of Symbol
        All inputs.
    results : tuple of Number
        All outputs.
    closed : float
        Largest gap at which it is to be trusted.
    least_margin : float
        Smallest margin likewise.
    """

    name: str
    tape: Tape
    inputs: Mapping[str, int]
    outputs: Mapping[str, int]
    symbols: tuple[Symbol, ...]
    results: tuple[Number, ...]
    closed: float = 0.0
    least_margin: float = MARGIN

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
        self.give("margin", [tape.sqrt(at.margin)])
        self.give("gap", [tape.sqrt(gap)])
        # What is not finite makes the difference NaN, and the minimum with it.
        self.give("trusted", [tape.minimum(least, tape.add(tape.subtract(total, total), 1.0))])

    def function(self, name: str) -> Function:
        """Return the function; refuse one with too many operations."""
        found = Function(
            name,
            self.tape,
            self.inputs,
            self.outputs,
            tuple(self._symbols),
            tuple(self._results),
            self.closed,
            self.least_margin,
        )
        if found.operations > MOST_OPERATIONS:
            raise ModelError(
                f"{name}: {found.operations} operations are more than compilers take "
                f"(at most {MOST_OPERATIONS}): lock joints, or use the robot's own method of that name"
            )
        return found
