"""Traced formulas again on another tape, with some of their values replaced by numbers or other symbols.

So one trace serves many machines: with the numbers of one put in, what is known is computed and what is zero
vanishes.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, MutableMapping, Sequence

from p3dof._base.tracing import Number, Symbol, Tape

_ON_NUMBERS: dict[str, Callable[..., float]] = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": operator.truediv,
    "neg": operator.neg,
    "min": min,
    "sqrt": math.sqrt,
    "sin": math.sin,
    "cos": math.cos,
    "tanh": math.tanh,
}
_ON_TAPE = {
    "add": "add",
    "sub": "subtract",
    "mul": "multiply",
    "div": "divide",
    "neg": "negate",
    "min": "minimum",
}


def replay(
    source: Tape, results: Sequence[Number], known: MutableMapping[int, Number], tape: Tape
) -> list[Number]:
    """Return results of one tape on another.

    Parameters
    ----------
    source : Tape
        Where the results are.
    results : sequence of Symbol or float
        What is wanted.
    known : mutable mapping of int to Symbol or float
        What takes the place of values of the source, by their index: all inputs that are needed. What is
        computed is added.
    tape : Tape
        Where it is recorded.

    Returns
    -------
    list of Symbol or float

    Raises
    ------
    ArithmeticError, ValueError
        If an operation on numbers is not defined.
    """
    for index in source.needed(results, known):
        operation = source.operations[index]
        operands = [_value(operand, known) for operand in operation.operands]
        if any(isinstance(operand, Symbol) for operand in operands):
            known[index] = getattr(tape, _ON_TAPE.get(operation.name, operation.name))(*operands)
        else:
            known[index] = _ON_NUMBERS[operation.name](*operands)
    return [_value(result, known) for result in results]


def _value(value: Number, known: Mapping[int, Number]) -> Number:
    return known[value.index] if isinstance(value, Symbol) else value
