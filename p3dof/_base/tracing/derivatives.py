"""Exact derivatives of a traced formula: its operations are differentiated one by one, forward."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from p3dof._base.tracing.tape import Number, Operation, Symbol, Tape


def derivatives(results: Sequence[Number], inputs: Sequence[Number]) -> list[list[Number]]:
    """Return the derivatives of results by inputs, on the same tape.

    What several of them share is done once; what is zero stays the number 0.

    Parameters
    ----------
    results : sequence of Symbol or float
        What to differentiate; ``minimum`` must not be in it.
    inputs : sequence of Symbol or float
        By what; a number has the derivative 0.

    Returns
    -------
    list of list
        One row a result, one column an input.
    """
    tapes = [value.tape for value in (*results, *inputs) if isinstance(value, Symbol)]
    if not tapes:
        return [[0] * len(inputs) for _ in results]
    columns = [_along(results, variable) for variable in inputs]
    return [list(row) for row in zip(*columns, strict=True)]


def _along(results: Sequence[Number], variable: Number) -> list[Number]:
    if not isinstance(variable, Symbol):
        return [0] * len(results)
    return tangent(results, {variable.index: 1})


def tangent(results: Sequence[Number], seeds: Mapping[int, Number]) -> list[Number]:
    """Return how results change along a direction, on the same tape.

    Parameters
    ----------
    results : sequence of Symbol or float
        What to differentiate; ``minimum``, ``floor`` and ``fabs`` must not be in it.
    seeds : mapping of int to Symbol or float
        How inputs change, by their place on the tape; they may be values on the tape, too. Results may be
        seeded as well: what they are made from is not looked at then.

    Returns
    -------
    list of Symbol or float
    """
    tapes = [value.tape for value in results if isinstance(value, Symbol)]
    if not tapes:
        return [0] * len(results)
    tape, known = tapes[0], dict(seeds)

    def of(value: Number) -> Number:
        return known.get(value.index, 0) if isinstance(value, Symbol) else 0

    for index in tape.needed(results, seeds):
        operation = tape.operations[index]
        moving = [of(operand) for operand in operation.operands]
        if any(isinstance(d, Symbol) or d != 0 for d in moving):
            known[index] = _RULES[operation.name](tape, Symbol(tape, index), operation, moving)
    return [of(value) for value in results]


def _product(tape: Tape, _: Symbol, operation: Operation, d: list[Number]) -> Number:
    a, b = operation.operands
    return tape.add(tape.multiply(d[0], b), tape.multiply(a, d[1]))


def _quotient(tape: Tape, value: Symbol, operation: Operation, d: list[Number]) -> Number:
    a, b = operation.operands
    if not isinstance(a, Symbol) and a == 1:
        return -tape.multiply(tape.multiply(value, value), d[1])
    return tape.multiply(tape.subtract(d[0], tape.multiply(value, d[1])), tape.divide(1, b))


def _angle(tape: Tape, _: Symbol, operation: Operation, d: list[Number]) -> Number:
    y, x = operation.operands
    square = tape.add(tape.multiply(x, x), tape.multiply(y, y))
    return tape.divide(tape.subtract(tape.multiply(x, d[0]), tape.multiply(y, d[1])), square)


_RULES: dict[str, Callable[[Tape, Symbol, Operation, list[Number]], Number]] = {
    "add": lambda tape, _v, _o, d: tape.add(d[0], d[1]),
    "sub": lambda tape, _v, _o, d: tape.subtract(d[0], d[1]),
    "mul": _product,
    "div": _quotient,
    "neg": lambda _t, _v, _o, d: -d[0],
    "sqrt": lambda tape, v, _o, d: tape.multiply(tape.multiply(0.5, tape.divide(1, v)), d[0]),
    "rsqrt": lambda tape, v, _o, d: tape.multiply(
        tape.multiply(-0.5, tape.multiply(v, tape.multiply(v, v))), d[0]
    ),
    "sin": lambda tape, _v, o, d: tape.multiply(tape.cos(o.operands[0]), d[0]),
    "cos": lambda tape, _v, o, d: -tape.multiply(tape.sin(o.operands[0]), d[0]),
    "atan2": _angle,
    "tanh": lambda tape, v, _o, d: tape.multiply(tape.subtract(1, tape.multiply(v, v)), d[0]),
}
