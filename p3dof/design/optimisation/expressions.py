"""Formulas of columns and measures in problem files: parsed, never run by Python, with exact derivatives.

Python's own parser makes the tree; what is none of the operations and functions below is an error that names
its character. Values are arrays over designs, and derivatives go along with them (forward mode).
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from p3dof._base.checks import meant, shown
from p3dof._base.errors import InputError
from p3dof._base.quantities import unit_of

LONGEST = 500  # characters
_DEEPEST = 50  # operations inside each other
_POWER = 100.0  # largest exponent that is a number

Dimension: TypeAlias = tuple[float, ...]
"""Powers of metre, kilogram, second and ampere."""
Resolve: TypeAlias = Callable[[str], tuple[str, str]]
"""From a name as it is written to its full name, and its unit."""
Value: TypeAlias = tuple[Any, Any]
"""Numbers over designs (D,), or one for all, and their derivatives (D, n)."""


@dataclass(frozen=True)
class Node:
    """A number, a name, or an operation on others."""

    what: str  # "number", "name", or one of `_OPERATIONS`
    parts: tuple[Node, ...] = ()
    value: float = 0.0
    name: str = ""

    def names(self) -> Iterator[str]:
        """Yield all names in it."""
        if self.what == "name":
            yield self.name
        for part in self.parts:
            yield from part.names()

    def terms(self) -> dict[str, float] | None:
        """Return the factors of all names, and what is added, by the empty name; None if it is not linear."""
        if self.what in ("number", "name"):
            return {"": self.value} if self.what == "number" else {self.name: 1.0}
        rows = [part.terms() for part in self.parts]
        if any(row is None for row in rows):
            return None
        return _joined(self.what, rows[0] or {}, rows[-1] or {})

    def of(self, known: Mapping[str, Value]) -> Value:
        """Return values and derivatives from those of all names; NaN and infinities where there are none."""
        if self.what == "number":
            return self.value, 0.0
        if self.what == "name":
            return known[self.name]
        inner = [part.of(known) for part in self.parts]
        values = [np.asarray(value, dtype=np.float64) for value, _ in inner]
        _, function, slopes = _OPERATIONS[self.what]
        total: Any = 0.0
        with np.errstate(all="ignore"):
            for (_, own), by, part in zip(inner, slopes(*values), self.parts, strict=True):
                if part.what != "number":
                    total = total + np.asarray(by)[..., None] * own
            return function(*values), total


def _joined(what: str, a: Mapping[str, float], b: Mapping[str, float]) -> dict[str, float] | None:
    """Return the terms of an operation on linear ones."""
    number = [set(terms) == {""} for terms in (a, b)]
    found: dict[str, float] | None = None
    if what in ("+", "-"):
        found = _sum(a, b if what == "+" else _times(-1.0, b))
    elif what == "negative":
        found = _times(-1.0, a)
    elif what == "*" and any(number):
        found = _times(a[""], b) if number[0] else _times(b[""], a)
    elif what == "/" and number[1]:
        found = {name: value / b[""] for name, value in a.items()}
    return found


def _sum(left: Mapping[str, float], right: Mapping[str, float]) -> dict[str, float]:
    return {name: left.get(name, 0.0) + right.get(name, 0.0) for name in {**left, **right}}


def _times(factor: float, terms: Mapping[str, float]) -> dict[str, float]:
    return {name: factor * value for name, value in terms.items()}


def _power_slopes(a: Any, b: Any) -> tuple[Any, Any]:
    return np.where(b == 0, 0.0, b * a ** (b - 1)), np.where(a > 0, a**b * np.log(a), 0.0)


_OPERATIONS: Mapping[str, tuple[int, Callable[..., Any], Callable[..., tuple[Any, ...]]]] = {
    "+": (2, np.add, lambda *_: (1.0, 1.0)),
    "-": (2, np.subtract, lambda *_: (1.0, -1.0)),
    "*": (2, np.multiply, lambda a, b: (b, a)),
    "/": (2, np.divide, lambda a, b: (1 / b, -a / b**2)),
    "**": (2, np.power, _power_slopes),
    "negative": (1, np.negative, lambda _: (-1.0,)),
    "sqrt": (1, np.sqrt, lambda a: (0.5 / np.sqrt(a),)),
    "sin": (1, np.sin, lambda a: (np.cos(a),)),
    "cos": (1, np.cos, lambda a: (-np.sin(a),)),
    "tan": (1, np.tan, lambda a: (1 / np.cos(a) ** 2,)),
    "asin": (1, np.arcsin, lambda a: (1 / np.sqrt(1 - a**2),)),
    "acos": (1, np.arccos, lambda a: (-1 / np.sqrt(1 - a**2),)),
    "atan": (1, np.arctan, lambda a: (1 / (1 + a**2),)),
    "atan2": (2, np.arctan2, lambda a, b: (b / (a**2 + b**2), -a / (a**2 + b**2))),
    "exp": (1, np.exp, lambda a: (np.exp(a),)),
    "log": (1, np.log, lambda a: (1 / a,)),
    "abs": (1, np.abs, lambda a: (np.sign(a),)),
    "min": (2, np.minimum, lambda a, b: (1.0 * (a <= b), 1.0 * (a > b))),
    "max": (2, np.maximum, lambda a, b: (1.0 * (a >= b), 1.0 * (a < b))),
}
"""How many operands, values, and derivatives by each operand; of two that tie, the first one counts."""

FUNCTIONS = tuple(name for name in _OPERATIONS if name.isalnum() and name != "negative")
"""Functions that formulas may have."""

_BINARY = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}
_SIDES = {ast.GtE: True, ast.Gt: True, ast.LtE: False, ast.Lt: False}
_OF_NUMBERS = ("sin", "cos", "tan", "asin", "acos", "atan", "exp", "log")  # of plain numbers, and to such
_PLAIN: Dimension = (0.0, 0.0, 0.0, 0.0)
_SIGNS = {"^": "**", "≤": "<=", "≥": ">=", "·": "*", "×": "*", "−": "-", "²": "**2", "³": "**3", "π": "pi"}
_FOREIGN = re.compile(r"[^A-Za-z0-9_.+\-*/(),<>=\s]")
_MEASURED = re.compile(
    r"(?<![\w.])(?=((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?))\1"  # a whole number, never a part of one
    r"\s*([^\W\d]\w*(?:\^-?\d)?|°)(\s*(?:\*\*|\^|\())?"
)


class Comparison(NamedTuple):
    """Two formulas, one at least as large as the other."""

    left: Node
    right: Node
    at_least: bool  # whether the left one is the larger


def read_comparison(text: object, resolve: Resolve) -> Comparison:
    """Return the sides of a relation such as ``"R**2 + r**2 <= L**2 - 4 mm * r"``.

    Of numbers in SI units or with a unit, names, and `FUNCTIONS`; sums of what has different units are
    refused, where numbers without a unit may have any.
    """
    if not isinstance(text, str) or not text.strip():
        raise InputError(f"expected a relation such as 'R >= r + 0.03', got {shown(text)}")
    if len(text) > LONGEST:
        raise InputError(f"{shown(text)}: expected at most {LONGEST} characters, got {len(text)}")
    return _Reader(text, resolve).comparison()


class _Reader:
    """A text on its way to nodes. Places are those of the text."""

    def __init__(self, text: str, resolve: Resolve) -> None:
        self.text, self.resolve = text, resolve
        self.measured: dict[int, tuple[float, Dimension]] = {}  # numbers with units, by their places
        self.begin = len(text) - len(text.lstrip())

    def comparison(self) -> Comparison:
        """Return the two sides."""
        plain = re.sub(r"\s", " ", self._without_units())
        foreign = _FOREIGN.search(plain)
        if foreign is not None:
            sign = foreign[0]
            hint = f"; write {_SIGNS[sign]}" if sign in _SIGNS else ""
            raise self._wrong(foreign.start(), f"unexpected character {sign!a}{hint}")
        try:
            tree = ast.parse(plain.strip(), mode="eval").body
        except SyntaxError as error:
            place = self.begin + max((error.offset or 1) - 1, 0)
            raise self._wrong(place, "no formula can go on like this") from None
        except (ValueError, RecursionError, MemoryError):
            raise self._wrong(self.begin, "expected fewer parts inside each other") from None
        if not isinstance(tree, ast.Compare) or len(tree.ops) != 1 or type(tree.ops[0]) not in _SIDES:
            raise self._wrong(self.begin, "expected one >= or <= between two formulas")
        left, one = self._node(tree.left, 0)
        right, other = self._node(tree.comparators[0], 0)
        self._alike(tree.comparators[0], one, other)
        return Comparison(left, right, _SIDES[type(tree.ops[0])])

    def _without_units(self) -> str:
        """Return the text with a name of the same length in place of each number with a unit."""
        plain = self.text
        for found in _MEASURED.finditer(self.text):
            number, word, after = found[1], found[2], (found[3] or "").strip()
            unit = unit_of(word)
            if unit is None or after == "(":
                raise self._wrong(found.start(2), f"{shown(word)} is no unit; an operator is missing")
            if after:
                raise self._wrong(found.start(3), f"expected brackets, as ({number} {word})**2 or 1 mm^2")
            try:
                value = float(Fraction(number) * unit[1])
            except OverflowError:
                raise self._wrong(found.start(), "expected a smaller number") from None
            powers = unit[0]
            self.measured[found.start()] = value, tuple(map(float, (*powers[:3], powers[4])))
            plain = plain[: found.start()] + "_" * (found.end(2) - found.start()) + plain[found.end(2) :]
        return plain

    def _wrong(self, place: int, what: str) -> InputError:
        return InputError(f"{shown(self.text)}, character {min(place, len(self.text)) + 1}: {what}")

    def _at(self, node: ast.AST) -> int:
        return self.begin + int(getattr(node, "col_offset", 0))

    def _node(self, tree: ast.expr, depth: int) -> tuple[Node, Dimension | None]:
        """Return a part as a node, and its dimension: None of numbers that may be in any unit."""
        if depth > _DEEPEST:
            raise self._wrong(self._at(tree), f"expected at most {_DEEPEST} operations inside each other")
        match tree:
            case ast.Constant() | ast.Name() | ast.Attribute():
                return self._leaf(tree)
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self._node(operand, depth + 1)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return self._made(tree, "negative", [operand], depth)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
                return self._made(tree, _BINARY[type(op)], [left, right], depth)
            case ast.Call(func=ast.Name(id=name), args=parts, keywords=[]):
                self._require_function(self._at(tree), name, len(parts))
                return self._made(tree, name, parts, depth)
        raise self._wrong(self._at(tree), "expected numbers, names, + - * / **, brackets and functions only")

    def _require_function(self, place: int, name: str, given: int) -> None:
        if name not in FUNCTIONS:
            hint = meant(name, FUNCTIONS, 0.5) or f"; there are {', '.join(FUNCTIONS)}"
            raise self._wrong(place, f"{shown(name)} is no function{hint}")
        count, several = _OPERATIONS[name][0], name in ("min", "max")
        if given != count and not (several and given > count):
            many = "two or more" if several else str(count)
            raise self._wrong(place, f"{name}: expected {many} arguments, got {given}")

    def _leaf(self, tree: ast.Constant | ast.Name | ast.Attribute) -> tuple[Node, Dimension | None]:
        """Return a number or a name."""
        place = self._at(tree)
        match tree:
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                return self._number(place, value), None
            case ast.Name() if place in self.measured:
                value, dimension = self.measured[place]
                return Node("number", value=value), dimension
            case ast.Name(id="pi"):
                return Node("number", value=float(np.pi)), _PLAIN
            case ast.Name() | ast.Attribute():
                return self._named(tree)
        raise self._wrong(place, f"expected a real number, got {shown(tree.value)}")

    def _number(self, place: int, value: float) -> Node:
        try:
            found = float(value)
        except OverflowError:
            found = np.inf
        if not np.isfinite(found):
            raise self._wrong(place, "expected a finite number")
        return Node("number", value=found)

    def _named(self, tree: ast.expr) -> tuple[Node, Dimension | None]:
        words: list[str] = []
        inner = tree
        while isinstance(inner, ast.Attribute):
            words, inner = [inner.attr, *words], inner.value
        if not isinstance(inner, ast.Name):
            raise self._wrong(self._at(tree), "expected the name of a column or of a measure before the dot")
        try:
            name, unit = self.resolve(".".join([inner.id, *words]))
        except InputError as error:
            raise self._wrong(self._at(tree), str(error)) from None
        known = unit_of(unit) if unit else None
        dimension = tuple(map(float, (*known[0][:3], known[0][4]))) if known else None
        return Node("name", name=name), dimension

    def _made(
        self, tree: ast.expr, what: str, parts: list[ast.expr], depth: int
    ) -> tuple[Node, Dimension | None]:
        """Return an operation: a number where all its operands are."""
        found = [self._node(part, depth + 1) for part in parts]
        node = found[0][0]
        pairs = [[one] for one, _ in found[1:]] or [[]]
        for rest in pairs:  # of `min` and `max`, two at a time
            node = self._folded(tree, Node(what, (node, *rest)))
        return node, self._dimension(parts, what, found)

    def _folded(self, tree: ast.expr, node: Node) -> Node:
        exponent = node.parts[-1]
        if node.what == "**" and exponent.what == "number" and abs(exponent.value) > _POWER:
            raise self._wrong(self._at(tree), f"expected an exponent of at most {_POWER:g}")
        if all(part.what == "number" for part in node.parts):
            return self._number(self._at(tree), float(node.of({})[0]))
        if node.what == "/" and exponent.what == "number" and exponent.value == 0:
            raise self._wrong(self._at(tree), "division by zero")
        return node

    def _alike(self, tree: ast.expr, *dimensions: Dimension | None) -> Dimension | None:
        """Return the one dimension of what is added or compared."""
        known = list(dict.fromkeys(one for one in dimensions if one is not None))
        if len(known) > 1:
            raise self._wrong(self._at(tree), f"different units: {' and '.join(map(_told, known))}")
        return known[0] if known else None

    def _dimension(
        self, parts: list[ast.expr], what: str, found: list[tuple[Node, Dimension | None]]
    ) -> Dimension | None:
        one, other = found[0][1], found[-1][1]
        if what in _OF_NUMBERS:
            self._alike(parts[0], one, _PLAIN)
            return _PLAIN
        if what in ("+", "-", "min", "max", "negative", "abs", "atan2"):
            same = self._alike(parts[-1], *(dimension for _, dimension in found))
            return _PLAIN if what == "atan2" else same
        if what in ("**", "sqrt"):
            return self._raised(parts, found, 0.5 if what == "sqrt" else None)
        if one is None or other is None:
            return None
        sign = 1 if what == "*" else -1
        return tuple(a + sign * b for a, b in zip(one, other, strict=True))

    def _raised(
        self, parts: list[ast.expr], found: list[tuple[Node, Dimension | None]], exponent: float | None
    ) -> Dimension | None:
        """Return the dimension of a power."""
        (_, one), (last, other) = found[0], found[-1]
        if exponent is None:
            self._alike(parts[1], other, _PLAIN)
            if last.what != "number":
                return self._alike(parts[0], one, _PLAIN)
            exponent = last.value
        return None if one is None else tuple(round(power * exponent, 9) for power in one)


def _told(dimension: Dimension) -> str:
    pairs = [(base, power) for base, power in zip(("m", "kg", "s", "A"), dimension, strict=True) if power]
    return " ".join(b if p == 1 else f"{b}^{p:g}" for b, p in pairs) or "a plain number"
