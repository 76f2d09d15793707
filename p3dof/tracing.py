"""Turns a formula on scalars into one straight-line Python function.

The formulas of this package are written once, for anything that has ``+ - * /``. Traced with symbols, such a
formula becomes a list of scalar operations, each done once however often the formula asks for it, and
constants are computed beforehand. On one sample that takes a fiftieth of the formula's own time: what an
integrator or a controller needs, which has one sample at a time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

Number: TypeAlias = "float | Symbol"


class Symbol:
    """A value that is not known yet: its name on a tape."""

    __slots__ = ("name", "tape")

    def __init__(self, tape: Tape, name: str) -> None:
        self.tape, self.name = tape, name

    def __add__(self, other: Number) -> Symbol:
        if _is_zero(other):
            return self
        return self.tape.record("{} + {}", *sorted((self.name, _text(other))))

    def __mul__(self, other: Number) -> Number:
        if _is_zero(other):
            return 0
        return self.tape.record("{} * {}", *sorted((self.name, _text(other))))

    def __sub__(self, other: Number) -> Symbol:
        return self if _is_zero(other) else self.tape.record("{} - {}", self.name, _text(other))

    def __rsub__(self, other: Number) -> Symbol:
        return -self if _is_zero(other) else self.tape.record("{} - {}", _text(other), self.name)

    def __truediv__(self, other: Number) -> Symbol:
        return self.tape.record("{} / {}", self.name, _text(other))

    def __rtruediv__(self, other: float) -> Number:
        if _is_zero(other):
            return 0
        return self.tape.record("{} / {}", _text(other), self.name)

    def __neg__(self) -> Symbol:
        return self.tape.record("-{}", self.name)

    __radd__, __rmul__ = __add__, __mul__


class Tape:
    """The operations of a formula in their order; also where the formula takes its functions from."""

    def __init__(self) -> None:
        self._values: dict[tuple[str, ...], str] = {}

    def record(self, operation: str, *operands: str) -> Symbol:
        """Return the value of an operation, recorded once."""
        key = (operation, *operands)
        return Symbol(self, self._values.setdefault(key, f"t{len(self._values)}"))

    def sqrt(self, x: Number) -> Number:
        """Square root."""
        return self._function("sqrt", x)

    def sin(self, x: Number) -> Number:
        """Sine."""
        return self._function("sin", x)

    def cos(self, x: Number) -> Number:
        """Cosine."""
        return self._function("cos", x)

    def tanh(self, x: Number) -> Number:
        """Hyperbolic tangent."""
        return self._function("tanh", x)

    def _function(self, name: str, x: Number) -> Number:
        if isinstance(x, Symbol):
            return self.record(name + "({})", x.name)
        known: float = getattr(math, name)(x)
        return known

    def lines(self, results: Sequence[str]) -> list[str]:
        """Return the assignments that the results need, in their order."""
        operands = {name: key for key, name in self._values.items()}
        needed: set[str] = set()
        waiting = [name for name in results if name in operands]
        while waiting:
            name = waiting.pop()
            if name not in needed:
                needed.add(name)
                waiting += [operand for operand in operands[name][1:] if operand in operands]
        return [f"{name} = {key[0].format(*key[1:])}" for key, name in self._values.items() if name in needed]


def straight_line(
    formula: Callable[..., Sequence[Number]], count: int, namespace: Any = math
) -> Callable[..., tuple[float, ...]]:
    """Return a formula as one function of numbers.

    Parameters
    ----------
    formula : callable
        Called once as ``formula(tape, *symbols)``; the tape is its namespace of sqrt, sin, cos and tanh. It
        must not branch on what the symbols are. Returns a sequence of values.
    count : int
        How many symbols.
    namespace : module
        Where the compiled function takes sqrt, sin, cos and tanh from: `math` for numbers, `numpy` for
        arrays.

    Returns
    -------
    callable
        Takes `count` numbers, returns a tuple of numbers; like `math` it raises ValueError or
        ZeroDivisionError outside its domain.
    """
    tape = Tape()
    arguments = [f"x{i}" for i in range(count)]
    results = [_text(value) for value in formula(tape, *(Symbol(tape, name) for name in arguments))]
    body = [*tape.lines(results), f"return ({', '.join(results)},)"]
    source = "\n    ".join([f"def compiled({', '.join(arguments)}):", *body])
    scope: dict[str, Any] = {name: getattr(namespace, name) for name in ("sqrt", "sin", "cos", "tanh")}
    exec(compile(source, "<straight line>", "exec"), scope)  # noqa: S102 - the text is made of our own names
    function: Callable[..., tuple[float, ...]] = scope["compiled"]
    return function


def _is_zero(value: Number) -> bool:
    return not isinstance(value, Symbol) and value == 0


def _text(value: Number) -> str:
    return value.name if isinstance(value, Symbol) else f"({float(value)!r})"
