"""A traced formula as one straight-line Python function.

On one sample that takes a fiftieth of the formula's own time: what an integrator or a controller needs, which
has one sample at a time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from p3dof._base.tracing.tape import FUNCTIONS, SIGNS, Number, Operation, Symbol, Tape


def straight_line(
    formula: Callable[..., Sequence[Number]], count: int, namespace: Any = math
) -> Callable[..., tuple[float, ...]]:
    """Return a formula as one function of numbers.

    Takes `count` numbers, returns a tuple of numbers; like `math` it raises ValueError or ZeroDivisionError
    outside its domain.

    `formula`: called once as ``formula(tape, *symbols)``; the tape is its namespace of sqrt, sin, cos and
    tanh. It must not branch on what the symbols are. Returns a sequence of values.
    """
    tape = Tape()
    inputs = tape.symbols(f"x{i}" for i in range(count))
    return function_of(tape, inputs, formula(tape, *inputs), namespace)


def function_of(
    tape: Tape, inputs: Sequence[Symbol], results: Sequence[Number], namespace: Any = math
) -> Callable[..., tuple[float, ...]]:
    """Return results on a tape as one function of its inputs; see `straight_line`."""
    names = {symbol.index: f"x{i}" for i, symbol in enumerate(inputs)}
    lines, used = [], set()
    for index in tape.needed(results, dict(names)):
        names[index] = f"t{index}"
        used.add(tape.operations[index].name)
        lines.append(f"t{index} = {_expression(tape.operations[index], names)}")
    arguments = ", ".join(f"x{i}" for i in range(len(inputs)))
    values = ", ".join(_text(value, names) for value in results)
    source = "\n    ".join([f"def compiled({arguments}):", *lines, f"return ({values},)"])
    scope: dict[str, Any] = {name: getattr(namespace, name) for name in FUNCTIONS if name in used}
    scope["minimum"] = getattr(namespace, "minimum", min)  # `math` has none
    exec(compile(source, "<straight line>", "exec"), scope)  # noqa: S102 - the text is made of our own names
    function: Callable[..., tuple[float, ...]] = scope["compiled"]
    return function


def or_nan(function: Callable[..., tuple[float, ...]], count: int) -> Callable[..., tuple[float, ...]]:
    """Return a function that returns NaN where another raises, being outside its domain."""
    nowhere = (math.nan,) * count

    def guarded(*values: float) -> tuple[float, ...]:
        try:
            return function(*values)
        except (ValueError, ZeroDivisionError):
            return nowhere

    return guarded


def _expression(operation: Operation, names: dict[int, str]) -> str:
    operands = [_text(operand, names) for operand in operation.operands]
    if operation.name in SIGNS:
        return SIGNS[operation.name].format(*operands)
    return f"{'minimum' if operation.name == 'min' else operation.name}({', '.join(operands)})"


def _text(value: Number, names: dict[int, str]) -> str:
    return names[value.index] if isinstance(value, Symbol) else f"({float(value)!r})"
