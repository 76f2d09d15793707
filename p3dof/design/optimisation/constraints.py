"""What designs must keep: bounds on measures, and linear relations between variables."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, frozen_array, shown
from p3dof._base.errors import InputError
from p3dof.analysis.designs.names import QUANTITIES, full_name
from p3dof.design.optimisation.measure import Better, Measure, Pieces
from p3dof.design.optimisation.population import Population

_SIDES = {ast.GtE: 1.0, ast.LtE: -1.0, ast.Gt: 1.0, ast.Lt: -1.0}
_LONGEST = 200


@dataclass(frozen=True)
class Constraint:
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
    """A linear expression of columns, as a measure: coefficients times columns, plus a number.

    Parameters
    ----------
    name : str
        The expression as it was written.
    coefficients : mapping of str to float
        By full names of columns.
    constant : float
        What is added.
    better : {"large", "small"}
        Which side is bounded.
    """

    name: str
    coefficients: Mapping[str, float]
    constant: float
    unit: str = ""
    better: Better = "large"
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
    """Return a number with its unit as people read it: angles in degrees.

    Parameters
    ----------
    value : float
        In its SI unit.
    unit : str
        The unit; may be empty.
    digits : int
        How many.

    Returns
    -------
    str
    """
    if unit == "rad":
        value, unit = float(np.degrees(value)), "deg"
    return f"{value:.{digits}g} {unit}".rstrip()


def relation(text: str) -> Constraint:
    """Return the constraint that a linear relation between columns is, such as ``"R >= r + 0.03"``.

    Parameters
    ----------
    text : str
        Two linear expressions of columns and numbers in SI units, with ``>=`` or ``<=`` between them.

    Returns
    -------
    Constraint

    Raises
    ------
    InputError
        If it is no such relation.
    """
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
    total = {name: sign * (left.get(name, 0.0) - right.get(name, 0.0)) for name in {**left, **right}}
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
    if (
        isinstance(node, ast.Constant)
        and isinstance(node.value, int | float)
        and not isinstance(node.value, bool)
    ):
        return {"": float(frozen_array(text, node.value, ()))}
    if isinstance(node, ast.Name | ast.Attribute):
        return {full_name(_dotted(node, text)): 1.0}
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
        sign = -1.0 if isinstance(node.op, ast.USub) else 1.0
        return {name: sign * value for name, value in _linear(node.operand, text).items()}
    if isinstance(node, ast.BinOp):
        left, right = _linear(node.left, text), _linear(node.right, text)
        if isinstance(node.op, ast.Add | ast.Sub):
            sign = 1.0 if isinstance(node.op, ast.Add) else -1.0
            return {name: left.get(name, 0.0) + sign * right.get(name, 0.0) for name in {**left, **right}}
        if isinstance(node.op, ast.Mult) and (set(left) == {""} or set(right) == {""}):
            factor, other = (left[""], right) if set(left) == {""} else (right[""], left)
            return {name: factor * value for name, value in other.items()}
        if isinstance(node.op, ast.Div) and set(right) == {""} and right[""]:
            return {name: value / right[""] for name, value in left.items()}
    raise InputError(f"constraints: {shown(text)}: expected sums of columns times numbers, in SI units")


def _dotted(node: ast.AST, text: str) -> str:
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        return f"{_dotted(node.value, text)}.{node.attr}"
    raise InputError(f"constraints: {shown(text)}: expected names of columns")
