"""The operations of a tape as statements of C."""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping, Sequence

from p3dof._base.tracing.tape import SIGNS, Number, Symbol, Tape

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
