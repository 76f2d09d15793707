"""What designs must keep: bounds on measures, and linear relations between variables."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, Readable, frozen_array, real, shown
from p3dof._base.errors import InputError, P3dofError
from p3dof._base.quantities import ANGLE, FORCE, LENGTH, MASS, SPEED
from p3dof.analysis.designs.columns import QUANTITIES, full_name
from p3dof.design.optimisation.measures import measure_of
from p3dof.design.optimisation.population import Better, Measure, Pieces, Population

_SIDES = {ast.GtE: 1.0, ast.LtE: -1.0, ast.Gt: 1.0, ast.Lt: -1.0}
_LONGEST = 200


@dataclass(frozen=True)
class Constraint(Readable):
    """A bound on a measure: at least, or at most.

    Parameters
    ----------
    measure : Measure
        What is bounded.
    bound : float
        In its SI unit.
    at_least : bool
        Whether it is a lower bound.
    """

    measure: Measure
    bound: float
    at_least: bool

    @property
    def name(self) -> str:
        """What tables call it."""
        if isinstance(self.measure, Linear):
            return self.measure.name
        sign = "≥" if self.at_least else "≤"
        return f"{self.measure.name} {sign} {amount(self.bound, self.measure.unit)}"

    @property
    def scale(self) -> float:
        """What margins are divided by: a measure for their size."""
        return max(abs(self.bound), 0.05)

    def margin(self, values: Any) -> Any:
        """Return by how much values keep the bound; negative where they do not."""
        return (values - self.bound) if self.at_least else (self.bound - values)

    def margins(self, population: Population) -> Pieces:
        """Return the margins of all pieces by `scale`, and their gradients.

        Of a measure whose good side is bounded, so that one good piece is enough, only the worst piece counts
        as it does everywhere else.
        """
        found = self.measure.pieces(population)
        sign = 1.0 if self.at_least else -1.0
        good_side = (self.measure.better == "large") == self.at_least
        if not good_side:
            worst = (
                found.values.argmin(axis=1) if self.measure.better == "large" else found.values.argmax(axis=1)
            )
            found = Pieces(
                np.take_along_axis(found.values, worst[:, None], axis=1),
                np.take_along_axis(found.gradients, worst[:, None, None], axis=1),
            )
        return Pieces(self.margin(found.values) / self.scale, lambda: sign * found.gradients / self.scale)


@dataclass(frozen=True, eq=False)
class Linear:
    """A linear expression of columns, as a measure: coefficients times columns, plus a number."""

    name: str  # the expression as it was written
    coefficients: Mapping[str, float]  # by full names of columns
    constant: float  # what is added
    unit: str = ""
    better: Better = "large"  # which side is bounded
    figures: tuple[Any, ...] = ()

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,)."""
        total: FloatArray = np.full(len(population), self.constant)
        for name, factor in self.coefficients.items():
            total = total + factor * np.ravel(_column_of(population, name))
        return total

    def pieces(self, population: Population) -> Pieces:
        """Return its one piece and its gradient."""
        names = population.setting.names
        gradient = np.array([self.coefficients.get(name, 0.0) for name in names])
        shape = (len(population), 1, len(names))
        return Pieces(self.values(population)[:, None], np.broadcast_to(gradient, shape).copy())


def _column_of(population: Population, name: str) -> Any:
    if name in population.columns:
        return population.columns[name]
    if name.startswith("dimensions."):
        return population.numbers.size(name.partition(".")[2])
    return population.numbers[name]


def amount(value: float, unit: str, digits: int = 6) -> str:
    """Return a number with its unit as people read it: angles in degrees."""
    if unit == "rad":
        value, unit = float(np.degrees(value)), "deg"
    return f"{value:.{digits}g} {unit}".rstrip()


def relation(text: str) -> Constraint:
    """Return the constraint that a linear relation between columns is, such as ``"R >= r + 0.03"``."""
    if not isinstance(text, str) or len(text) > _LONGEST:
        raise InputError(f"constraints: expected a relation such as 'R >= r + 0.03', got {shown(text)}")
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise InputError(f"constraints: {shown(text)} is no relation such as 'R >= r + 0.03'") from error
    if not isinstance(tree, ast.Compare) or len(tree.ops) != 1 or type(tree.ops[0]) not in _SIDES:
        raise InputError(f"constraints: {shown(text)}: expected one >= or <= between two expressions")
    sign = _SIDES[type(tree.ops[0])]
    left, right = (_linear(side, text) for side in (tree.left, tree.comparators[0]))
    total = _times(sign, _sum(left, _times(-1.0, right)))
    constant = total.pop("", 0.0)
    if not any(total.values()):
        raise InputError(f"constraints: {shown(text)}: expected columns of designs in it")
    units = {QUANTITIES[name].unit for name in total}
    if len(units) > 1:
        raise InputError(
            f"constraints: {shown(text)}: the columns are in different units: {', '.join(sorted(units))}"
        )
    measure = Linear(" ".join(text.split()), total, constant, units.pop())
    return Constraint(measure, 0.0, at_least=True)


def _linear(node: ast.AST, text: str) -> dict[str, float]:
    """Return the coefficients of an expression by full names; the constant by the empty name."""
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            return {"": float(frozen_array(text, value, ()))}
        case ast.Name() | ast.Attribute():
            return {full_name(_dotted(node, text)): 1.0}
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return _linear(operand, text)
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return _times(-1.0, _linear(operand, text))
        case ast.BinOp(left=left, op=op, right=right):
            found = _joined(_linear(left, text), op, _linear(right, text))
            if found is not None:
                return found
    raise InputError(f"constraints: {shown(text)}: expected sums of columns times numbers, in SI units")


def _joined(
    left: Mapping[str, float], op: ast.operator, right: Mapping[str, float]
) -> dict[str, float] | None:
    """Return the coefficients of two expressions with a sign between; None of what is not linear."""
    match op:
        case ast.Add():
            return _sum(left, right)
        case ast.Sub():
            return _sum(left, _times(-1.0, right))
        case ast.Mult() if set(left) == {""}:
            return _times(left[""], right)
        case ast.Mult() if set(right) == {""}:
            return _times(right[""], left)
        case ast.Div() if set(right) == {""} and right[""]:
            return {name: value / right[""] for name, value in left.items()}
    return None


def _sum(left: Mapping[str, float], right: Mapping[str, float]) -> dict[str, float]:
    return {name: left.get(name, 0.0) + right.get(name, 0.0) for name in {**left, **right}}


def _times(factor: float, terms: Mapping[str, float]) -> dict[str, float]:
    return {name: factor * value for name, value in terms.items()}


def _dotted(node: ast.AST, text: str) -> str:
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        return f"{_dotted(node.value, text)}.{node.attr}"
    raise InputError(f"constraints: {shown(text)}: expected names of columns")


def constraints_of(given: Mapping[str, Any] | Sequence[Any] | str) -> tuple[Constraint, ...]:
    """Return constraints from what `DesignProblem` takes."""
    found: list[Constraint] = []
    if isinstance(given, str):
        return (relation(given),)
    if isinstance(given, Mapping):
        for name, bounds in given.items():
            if name == "relations":
                found += [relation(text) for text in ((bounds,) if isinstance(bounds, str) else bounds)]
            else:
                found += _bounds(name, bounds)
        return tuple(found)
    if not isinstance(given, Iterable):
        raise InputError(f"constraints: expected bounds by name or a sequence, got {shown(given)}")
    for item in given:
        found += [item] if isinstance(item, Constraint) else constraints_of(item)
    return tuple(found)


def _bounds(name: str, bounds: Any) -> list[Constraint]:
    measure = measure_of(name, "constraints")
    if not isinstance(bounds, Mapping) or not bounds or set(bounds) - {"min", "max"}:
        raise InputError(
            f"constraints: {name}: expected {{'min': ...}}, {{'max': ...}} or both, got {shown(bounds)}"
        )
    found = []
    for side, value in bounds.items():
        where = f"constraints: {name}: {side}"
        found.append(Constraint(measure, real(where, _in_si(measure, value, where)), at_least=side == "min"))
    least = max((one.bound for one in found if one.at_least), default=-np.inf)
    most = min((one.bound for one in found if not one.at_least), default=np.inf)
    if least > most:
        unit = measure.unit
        raise InputError(
            f"constraints: {name}: expected min below max, got {amount(least, unit)} and {amount(most, unit)}"
        )
    return found


_QUANTITIES = {item.unit: item for item in (LENGTH, ANGLE, FORCE, MASS, SPEED)}


def _in_si(measure: Measure, value: Any, where: str) -> Any:
    """Return a bound in SI units, of a text with a unit too."""
    if not isinstance(value, str) or measure.unit not in _QUANTITIES:
        return value
    try:
        return _QUANTITIES[measure.unit].read(value, where)
    except P3dofError as error:
        raise InputError(str(error)) from error
