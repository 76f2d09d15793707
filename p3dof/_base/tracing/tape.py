"""`Tape`: the operations of a formula in their order, and `Symbol`, a value that is not known yet.

Reciprocals that are taken two at a time: one division and three products instead of two divisions.

Processors divide vectors slowly, one division after the other, while several products are under way at once.
"""

from __future__ import annotations

import math
from collections import defaultdict, deque
from collections.abc import Callable, Container, Hashable, Iterable, Mapping, Sequence
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
        """Return an input of the formula by its name."""
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
        """Return the places of all values that results need, in their order."""
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


LATENCY = {"div": 24, "sqrt": 30, "rsqrt": 50, "sin": 48, "cos": 48, "tanh": 110, "atan2": 120, "neg": 1}
"""About how many cycles the result of an operation on vectors takes; all others take 4."""

MIDDLE = 0.4, 0.6  # where the cut is looked for, as shares of the longest chain of operations

_SUMS = ("add", "sub", "neg")
_MUST = 1 << 30

_Capacities: TypeAlias = "defaultdict[Hashable, dict[Hashable, int]]"


class Parts(NamedTuple):
    """The two parts of a formula, each in the order of the tape."""

    first: list[int]
    second: list[int]
    between: list[int]  # what the first part computes and the second needs


def in_two(tape: Tape, places: Sequence[int]) -> Parts:
    """Return operations in two parts with the fewest values between them, cut in the middle.

    This is a minimum cut of the graph of operations. What begins before the middle is not in the second
    part and what ends after it not in the first; an operation is in the first part only if its operands are.
    A product stays with the sums that take it, where only sums do: a compiler that fuses them rounds as it
    does without a cut.
    """
    ends = _ends(tape, places)
    uses: dict[int, list[int]] = {index: [] for index in places}
    for index in places:
        for operand in dict.fromkeys(_operands(tape, index)):
            if operand in uses:
                uses[operand].append(index)
    first = _nearest(_graph(tape, uses, ends))
    return Parts(
        [index for index in places if index in first],
        [index for index in places if index not in first],
        [index for index in places if index in first and not first.issuperset(uses[index])],
    )


def _operands(tape: Tape, index: int) -> list[int]:
    return [operand.index for operand in tape.operations[index].operands if isinstance(operand, Symbol)]


def _latency(tape: Tape, index: int) -> int:
    return LATENCY.get(tape.operations[index].name, 4)


def _ends(tape: Tape, places: Sequence[int]) -> dict[int, int]:
    """Return when each operation ends if none waits but for its operands."""
    found: dict[int, int] = {}
    for index in places:
        start = max((found.get(operand, 0) for operand in _operands(tape, index)), default=0)
        found[index] = start + _latency(tape, index)
    return found


def _graph(tape: Tape, uses: Mapping[int, Sequence[int]], ends: Mapping[int, int]) -> _Capacities:
    """Return capacities from "first" to "second": whoever stays with "first" is in the first part."""
    early, late = (share * max(ends.values(), default=0) for share in MIDDLE)
    found: _Capacities = defaultdict(dict)
    waves: dict[Hashable, int] = {}
    for index, users in uses.items():
        operation, value = tape.operations[index], ("value", index)
        for operand in _operands(tape, index):
            if operand in uses:
                found[index][operand] = _MUST
        stays = operation.name in ("mul", "neg") and {tape.operations[u].name for u in users} <= set(_SUMS)
        found[index][value] = _MUST if stays else 1
        found[value] |= dict.fromkeys(users, _MUST)
        if ends[index] <= early and not stays:
            found["first"][index] = _MUST
        if ends[index] - _latency(tape, index) >= late:
            found[index]["second"] = _MUST
        if operation.name in ("sin", "cos"):  # one call computes both
            other = waves.setdefault(tuple(_operands(tape, index)), index)
            if other != index:
                found[index][other] = found[other][index] = _MUST
    return found


def _nearest(capacities: _Capacities) -> set[Hashable]:
    """Return what a minimum cut leaves with "first", reached after the largest flow (Ford, Fulkerson)."""
    left: _Capacities = defaultdict(dict)
    for start, row in capacities.items():
        for end, capacity in row.items():
            left[start][end] = capacity
            left[end].setdefault(start, 0)
    while "second" in (before := _reached(left)):
        at: Hashable = "second"
        while at != "first":
            start = before[at]
            left[start][at] -= 1
            left[at][start] += 1
            at = start
    return set(before)


def _reached(left: Mapping[Hashable, Mapping[Hashable, int]]) -> dict[Hashable, Hashable]:
    """Return from where each node is reached first."""
    found: dict[Hashable, Hashable] = {"first": "first"}
    waiting: deque[Hashable] = deque(["first"])
    while waiting:
        start = waiting.popleft()
        for end, capacity in left[start].items():
            if capacity > 0 and end not in found:
                found[end] = start
                waiting.append(end)
    return found


def derivatives(results: Sequence[Number], inputs: Sequence[Number]) -> list[list[Number]]:
    """Return the derivatives of results by inputs, on the same tape.

    What several of them share is done once; what is zero stays the number 0.

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

    `results`: what to differentiate; ``minimum``, ``floor`` and ``fabs`` must not be in it.
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


def in_pairs(tape: Tape, results: Sequence[Number]) -> list[Number]:
    """Return the same results with their reciprocals computed in pairs: 1/a = b · 1/(ab), 1/b = a · 1/(ab).

    Partners are neighbours on the tape among those with as many divisions before them, so that neither
    waits for the other. What depends on constants only stays as it is. Where one of a pair is not finite,
    both are not.

    In the same order.
    """
    places = tape.needed(results)
    partners = _partners(tape, places)
    new: dict[int, Number] = {}

    def value(old: Number) -> Number:
        if not isinstance(old, Symbol):
            return old
        if old.index not in new:
            operation = tape.operation(old)
            operands = [value(operand) for operand in operation.operands]
            if old.index in partners:
                other = value(tape.operations[partners[old.index]].operands[1])
                new[old.index] = other * (1 / (operands[1] * other))
            else:
                moved = any(a is not b for a, b in zip(operands, operation.operands, strict=True))
                new[old.index] = tape.repeat(operation, operands) if moved else old
        return new[old.index]

    for index in places:  # in their order, so that nothing waits long
        value(Symbol(tape, index))
    return [value(result) for result in results]


def _partners(tape: Tape, places: Sequence[int]) -> dict[int, int]:
    """Return the partner of every reciprocal that has one."""
    depth: dict[int, int] = {}
    alone: dict[int, int] = {}
    found: dict[int, int] = {}
    for index in places:
        operation = tape.operations[index]
        depth[index] = max((depth[o.index] for o in operation.operands if isinstance(o, Symbol)), default=0)
        if operation.name != "div" or tape.constant[index]:
            continue
        depth[index] += 1
        if operation.operands[0] != 1:
            continue
        other = alone.pop(depth[index], None)
        if other is None:
            alone[depth[index]] = index
        else:
            found |= {index: other, other: index}
    return found
