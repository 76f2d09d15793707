"""`Tape`: the operations of a formula in their order, and `Symbol`, a value that is not known yet."""

from __future__ import annotations

import math
from collections.abc import Container, Iterable
from typing import NamedTuple, TypeAlias

Number: TypeAlias = "float | Symbol"

COMMUTATIVE = ("add", "mul")
FUNCTIONS = ("sqrt", "rsqrt", "sin", "cos", "tanh", "floor", "fabs", "atan2")
SIGNS = {"add": "{} + {}", "sub": "{} - {}", "mul": "{} * {}", "div": "{} / {}", "neg": "-{}"}
"""How Python and C write the arithmetic."""


class Operation(NamedTuple):
    """One line of a tape: what is done, and with what."""

    name: str
    operands: tuple[Number, ...]


class Symbol:
    """A value that is not known yet: its place on a tape."""

    __slots__ = ("index", "tape")

    def __init__(self, tape: Tape, index: int) -> None:
        self.tape, self.index = tape, index

    def __repr__(self) -> str:
        return f"Symbol({self.index})"

    def __add__(self, other: Number) -> Number:
        return self.tape.add(self, other)

    def __sub__(self, other: Number) -> Number:
        return self.tape.subtract(self, other)

    def __rsub__(self, other: Number) -> Number:
        return self.tape.subtract(other, self)

    def __mul__(self, other: Number) -> Number:
        return self.tape.multiply(self, other)

    def __truediv__(self, other: Number) -> Number:
        return self.tape.divide(self, other)

    def __rtruediv__(self, other: float) -> Number:
        return self.tape.divide(other, self)

    def __neg__(self) -> Number:
        return self.tape.negate(self)

    __radd__, __rmul__ = __add__, __mul__


class Tape:
    """The operations of a formula, each recorded once; also where it takes its functions from.

    Sums and products with the numbers 0, 1 and -1 are not recorded, and signs are moved outward to where
    they turn a sum into a difference. What is known already is computed at once.
    """

    def __init__(self) -> None:
        self.operations: list[Operation] = []
        self.constant: list[bool] = []
        """Which values depend on constants only."""
        self._places: dict[tuple[object, ...], int] = {}

    def symbol(self, name: str, constant: bool = False) -> Symbol:
        """Return an input of the formula by its name.

        Parameters
        ----------
        name : str
            Its name in the code that is made.
        constant : bool
            It stays the same over many samples: what depends on such inputs only can be done once.

        Returns
        -------
        Symbol
        """
        self.operations.append(Operation(name, ()))
        self.constant.append(constant)
        return Symbol(self, len(self.operations) - 1)

    def symbols(self, names: Iterable[str], constant: bool = False) -> tuple[Symbol, ...]:
        """Return several inputs."""
        return tuple(self.symbol(name, constant) for name in names)

    def add(self, a: Number, b: Number) -> Number:
        """Return a + b."""
        if not isinstance(a, Symbol) and not isinstance(b, Symbol):
            return a + b
        if _is(a, 0):
            return b
        if _is(b, 0):
            return a
        minus_a, minus_b = self._negated(a), self._negated(b)
        if minus_b is not None:
            return self.subtract(a, minus_b)
        if minus_a is not None:
            return self.subtract(b, minus_a)
        return self._record("add", a, b)

    def subtract(self, a: Number, b: Number) -> Number:
        """Return a - b."""
        if not isinstance(a, Symbol) and not isinstance(b, Symbol):
            return a - b
        if _is(b, 0):
            return a
        if _is(a, 0):
            return -b
        minus_a, minus_b = self._negated(a), self._negated(b)
        if minus_b is not None:
            return self.add(a, minus_b)
        if minus_a is not None:
            return -self.add(minus_a, b)
        return self._record("sub", a, b)

    def multiply(self, a: Number, b: Number) -> Number:
        """Return a b."""
        if not isinstance(a, Symbol) and not isinstance(b, Symbol):
            return a * b
        if not isinstance(a, Symbol):
            a, b = b, a
        if _is(b, 0):
            return 0
        if _is(b, 1) or _is(b, -1):
            return a if b == 1 else -a
        minus_a, minus_b = self._negated(a), self._negated(b)
        if minus_a is not None and minus_b is not None:
            return self.multiply(minus_a, minus_b)
        if minus_a is not None or minus_b is not None:
            return -self.multiply(a if minus_a is None else minus_a, b if minus_b is None else minus_b)
        return self._record("mul", a, b)

    def divide(self, a: Number, b: Number) -> Number:
        """Return a / b."""
        if not isinstance(a, Symbol) and not isinstance(b, Symbol):
            return a / b
        if _is(a, 0):
            return 0
        if _is(b, 1):
            return a
        minus_a, minus_b = self._negated(a), self._negated(b)
        if minus_a is not None:
            return -self.divide(minus_a, b)
        if minus_b is not None:
            return -self.divide(a, minus_b)
        return self._record("div", a, b)

    def negate(self, a: Symbol) -> Number:
        """Return -a."""
        minus = self._negated(a)
        return self._record("neg", a) if minus is None else minus

    def sqrt(self, x: Number) -> Number:
        """Square root."""
        return self._function("sqrt", x)

    def rsqrt(self, x: Number) -> Number:
        """One over the square root."""
        return self._record("rsqrt", x) if isinstance(x, Symbol) else 1 / math.sqrt(x)

    def sin(self, x: Number) -> Number:
        """Sine."""
        return self._function("sin", x)

    def cos(self, x: Number) -> Number:
        """Cosine."""
        return self._function("cos", x)

    def tanh(self, x: Number) -> Number:
        """Hyperbolic tangent."""
        return self._function("tanh", x)

    def fabs(self, x: Number) -> Number:
        """Size without the sign."""
        return self._function("fabs", x)

    def floor(self, x: Number) -> Number:
        """Return the largest whole number that is not above x."""
        return self._function("floor", x)

    def atan2(self, y: Number, x: Number) -> Number:
        """Return the angle of the point (x, y)."""
        if isinstance(y, Symbol) or isinstance(x, Symbol):
            return self._record("atan2", y, x)
        return math.atan2(y, x)

    def minimum(self, a: Number, b: Number) -> Number:
        """Return the smaller of two numbers; b where either is NaN."""
        if isinstance(a, Symbol) or isinstance(b, Symbol):
            return self._record("min", a, b)
        return a if a < b else b

    def operation(self, symbol: Symbol) -> Operation:
        """Return what makes a value."""
        return self.operations[symbol.index]

    def repeat(self, operation: Operation, operands: Iterable[Number]) -> Symbol:
        """Return the value of an operation done again, with other operands."""
        return self._record(operation.name, *operands)

    def needed(self, results: Iterable[Number], given: Container[int] = ()) -> list[int]:
        """Return the places of all values that results need, in their order.

        Parameters
        ----------
        results : iterable of Symbol or float
            What is wanted.
        given : container of int
            Places that are known already: neither they nor what only they need are returned.

        Returns
        -------
        list of int
        """
        found: set[int] = set()
        waiting = [value.index for value in results if isinstance(value, Symbol)]
        while waiting:
            index = waiting.pop()
            if index not in found and index not in given:
                found.add(index)
                operands = self.operations[index].operands
                waiting += [operand.index for operand in operands if isinstance(operand, Symbol)]
        return sorted(found)

    def _function(self, name: str, x: Number) -> Number:
        if isinstance(x, Symbol):
            return self._record(name, x)
        known: float = getattr(math, name)(x)
        return known

    def _record(self, name: str, *operands: Number) -> Symbol:
        key = [operand.index if isinstance(operand, Symbol) else float(operand) for operand in operands]
        marks = [(isinstance(operand, Symbol), value) for operand, value in zip(operands, key, strict=True)]
        place = (name, *(sorted(marks) if name in COMMUTATIVE else marks))
        index = self._places.get(place)
        if index is None:
            index = self._places[place] = len(self.operations)
            self.operations.append(Operation(name, operands))
            self.constant.append(
                all(self.constant[operand.index] for operand in operands if isinstance(operand, Symbol))
            )
        return Symbol(self, index)

    def _negated(self, a: Number) -> Number | None:
        """Return -a where it is on the tape already, or a negative number."""
        if not isinstance(a, Symbol):
            return -a if a < 0 else None
        operation = self.operations[a.index]
        return operation.operands[0] if operation.name == "neg" else None


def _is(value: Number, number: int) -> bool:
    return not isinstance(value, Symbol) and value == number
