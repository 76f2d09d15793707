"""The operations of a tape as statements of C."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, MutableMapping, Sequence
from typing import Any

from p3dof._base.tracing.tape import FUNCTIONS, SIGNS, Number, Operation, Symbol, Tape

_MINIMUM = "({0} < {1}) ? {0} : {1}"


def statements(
    tape: Tape,
    places: Sequence[int],
    names: MutableMapping[int, str],
    sincos: str | None = None,
    labels: Mapping[int, str] | None = None,
    real: str = "double",
    suffix: str = "",
    functions: Mapping[str, str] | None = None,
) -> list[str]:
    """Return one declaration for every operation; adds to `names` how values are called."""
    lines, labels = [], labels or {}
    for index in places:
        operation = tape.operations[index]
        if index in names or not operation.operands:
            continue
        if sincos is not None and operation.name in ("sin", "cos"):
            lines += _sincos(tape, index, names, sincos, real)
            continue
        operands = [text(operand, names) for operand in operation.operands]
        if operation.name in SIGNS:
            expression = SIGNS[operation.name].format(*operands)
        elif operation.name == "min" and not suffix:
            expression = _MINIMUM.format(*operands)
        else:
            function = "minimum" if operation.name == "min" else operation.name
            if suffix:  # numbers become as wide as the type
                operands = [
                    known if isinstance(operand, Symbol) else f"zero + {known}"
                    for operand, known in zip(operation.operands, operands, strict=True)
                ]
            function = (functions or {}).get(function, function)
            expression = f"{function}{suffix}({', '.join(operands)})"
        names[index] = labels.get(index, f"t{index}")
        lines.append(f"const {real} {names[index]} = {expression};")
    return lines


def text(value: Number, names: Mapping[int, str]) -> str:
    """Return a value in C."""
    if isinstance(value, Symbol):
        return names[value.index]
    number = repr(float(value))
    return f"({number})" if value < 0 else number


def _sincos(tape: Tape, index: int, names: MutableMapping[int, str], function: str, real: str) -> list[str]:
    """Return one call for both the sine and the cosine of a value, whichever is asked for."""
    operand = tape.operations[index].operands[0]
    assert isinstance(operand, Symbol)  # noqa: S101 - functions of numbers are known when they are traced
    pair = [tape.sin(operand), tape.cos(operand)]
    places = [value.index for value in pair if isinstance(value, Symbol)]
    for place in places:
        names[place] = f"t{place}"
    sine, cosine = (names[place] for place in places)
    return [f"{real} {sine}, {cosine};", f"{function}({text(operand, names)}, &{sine}, &{cosine});"]


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
