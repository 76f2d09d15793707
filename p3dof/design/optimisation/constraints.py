"""What designs must keep: bounds on measures, and relations between columns and measures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from p3dof._base import quantities as of
from p3dof._base.checks import FloatArray, Readable, is_number, meant, real, shown, with_point
from p3dof._base.errors import InputError, P3dofError
from p3dof.analysis.designs.columns import QUANTITIES, full_name
from p3dof.design.optimisation.expressions import Node, read_comparison
from p3dof.design.optimisation.measures import MEASURES, measure_of
from p3dof.design.optimisation.population import (
    STEP,
    Better,
    Measure,
    Pieces,
    Population,
    worst_gradient,
    worst_of,
)
from p3dof.design.optimisation.task_measures import LEAD, duties_of


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
        if isinstance(self.measure, Linear | Formula):
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
            total = total + factor * column_of(population, name)
        return total

    def pieces(self, population: Population) -> Pieces:
        """Return its one piece and its gradient."""
        return Pieces(self.values(population)[:, None], partial(self._gradients, population))

    def _gradients(self, population: Population) -> FloatArray:
        rows = [factor * slopes_of(population, name) for name, factor in self.coefficients.items()]
        return np.asarray(np.sum(rows, axis=0))[:, None]


@dataclass(frozen=True, eq=False)
class Formula:
    """A formula of columns and of measures, as a measure."""

    name: str  # the relation as it was written
    node: Node
    measures: Mapping[str, Measure]  # by their names in it; all other names are columns
    unit: str = ""
    better: Better = "large"  # which side is bounded

    @property
    def figures(self) -> tuple[Any, ...]:
        """As of the measures in it."""
        return tuple(dict.fromkeys(group for one in self.measures.values() for group in one.figures))

    @property
    def slow(self) -> bool:
        """Whether a measure in it takes long."""
        return any(getattr(measure, "slow", False) for measure in self.measures.values())

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,); NaN where it has no value."""
        known = {
            name: (self.measures[name].values(population), 0.0)
            if name in self.measures
            else (column_of(population, name), 0.0)
            for name in self.node.names()
        }
        found = np.broadcast_to(self.node.of(known)[0], (len(population),))
        return np.where(np.isfinite(found), found, np.nan)

    def pieces(self, population: Population) -> Pieces:
        """Return its one piece and its gradient; of measures, the worst piece counts."""
        return Pieces(self.values(population)[:, None], partial(self._gradients, population))

    def _gradients(self, population: Population) -> FloatArray:
        known = {}
        for name in self.node.names():
            if name in self.measures:
                pieces, better = self.measures[name].pieces(population), self.measures[name].better
                known[name] = worst_of(pieces.values, better), worst_gradient(pieces, better)
            else:
                known[name] = column_of(population, name), slopes_of(population, name)
        slopes = np.broadcast_to(self.node.of(known)[1], (len(population), len(population.setting.names)))
        return np.nan_to_num(slopes, posinf=0.0, neginf=0.0)[:, None]  # a root at zero has no slope


def column_of(population: Population, name: str) -> FloatArray:
    """Return a column of designs by its full name, (D,), also of what is the same for all."""
    names = population.setting.names
    if name == LEAD:
        found: Any = (
            population.values[:, names.index(LEAD)] if LEAD in names else duties_of(population, "lead").lead
        )
    else:
        found = np.ravel(population.numbers.named(name))
    return np.broadcast_to(np.asarray(found, dtype=np.float64), (len(population),))


def slopes_of(population: Population, name: str) -> FloatArray:
    """Return the derivatives of a column by all variables, (D, n)."""
    names, count = population.setting.names, len(population)
    if name in names or name == LEAD:
        return np.broadcast_to(np.array([float(each == name) for each in names]), (count, len(names)))
    rows = [np.ravel(np.imag(population.stepped(each).named(name)) / STEP) for each in names]
    return np.stack([np.broadcast_to(row, (count,)) for row in rows], axis=1)


def amount(value: float, unit: str, digits: int = 6) -> str:
    """Return a number with its unit as people read it: angles in degrees."""
    if unit == "rad":
        value, unit = float(np.degrees(value)), "deg"
    return f"{value:.{digits}g} {unit}".rstrip()


def relation(text: str) -> Constraint:
    """Return the constraint that a relation is, such as ``"R >= r + 0.03"`` or ``"R**2 + r**2 <= L**2"``.

    Of columns, measures (the worst of each), numbers in SI units or with a unit, ``+ - * / **``, brackets,
    ``pi``, ``sqrt``, ``sin``, ``cos``, ``tan``, ``asin``, ``acos``, ``atan``, ``atan2``, ``exp``, ``log``,
    ``abs``, ``min`` and ``max``. What is linear in columns stays so for the optimiser.

    Parameters
    ----------
    text : str
        Two formulas with ``>=`` or ``<=`` between.

    Raises
    ------
    InputError
        If it is none; the message names the character.
    """
    measures: dict[str, Measure] = {}
    units: dict[str, str] = {}

    def resolve(name: str) -> tuple[str, str]:
        known = _name_of(name)
        if known in MEASURES:
            measures[known] = MEASURES[known]
        units[known] = MEASURES[known].unit if known in measures else _unit_of(known)
        return known, units[known]

    try:
        left, right, at_least = read_comparison(text, resolve)
    except InputError as error:
        raise InputError(f"constraints: {error}") from error
    if not units:
        raise InputError(f"constraints: {shown(text)}: expected columns of designs in it")
    name = " ".join(text.split())
    terms = None if measures else Node("-", (left, right)).terms()
    if terms is not None:
        total = {each: value if at_least else -value for each, value in terms.items()}
        constant = total.pop("", 0.0)
        if not np.isfinite([constant, *total.values()]).all():
            raise InputError(f"constraints: {shown(text)}: expected smaller numbers")
        if not any(total.values()):
            raise InputError(f"constraints: {shown(text)}: expected columns that do not cancel each other")
        same = {_unit_of(each) for each in total}
        return Constraint(Linear(name, total, constant, same.pop() if len(same) == 1 else ""), 0.0, True)
    if left.what == "number":
        left, right, at_least = right, left, not at_least
    node, bound = (left, right.value) if right.what == "number" else (Node("-", (left, right)), 0.0)
    return Constraint(Formula(name, node, measures, better="large" if at_least else "small"), bound, at_least)


def _name_of(name: str) -> str:
    """Return the full name of a column, or the name of a measure."""
    if name == "lead":
        return LEAD
    if name in MEASURES:
        return name
    try:
        return full_name(name)
    except InputError as error:
        hint = meant(name, MEASURES, 0.5)
        raise InputError(
            f"no column or measure is called {shown(name)}{hint}" if hint else str(error)
        ) from None


def _unit_of(name: str) -> str:
    return of.LENGTH.unit if name == LEAD else QUANTITIES[name].unit


def constraints_of(given: Mapping[str, Any] | Sequence[Any] | str) -> tuple[Constraint, ...]:
    """Return constraints from what `DesignProblem` takes."""
    found: list[Constraint] = []
    if isinstance(given, str):
        return (relation(given),)
    if isinstance(given, Mapping):
        for name, bounds in given.items():
            if name == "relations":
                if not isinstance(bounds, str | list | tuple):
                    raise InputError(f"constraints: relations: expected a list of texts, got {shown(bounds)}")
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
        found.append(Constraint(measure, real(where, in_si(measure, value, where)), at_least=side == "min"))
    least = max((one.bound for one in found if one.at_least), default=-np.inf)
    most = min((one.bound for one in found if not one.at_least), default=np.inf)
    if least > most:
        unit = measure.unit
        raise InputError(
            f"constraints: {name}: expected min below max, got {amount(least, unit)} and {amount(most, unit)}"
        )
    return found


_KINDS = (
    of.LENGTH,
    of.ANGLE,
    of.SPEED,
    of.TIME,
    of.FREQUENCY,
    of.MASS,
    of.FORCE,
    of.MOMENT,
    of.POWER,
    of.ENERGY,
)
_QUANTITIES = {kind.unit: kind for kind in (*_KINDS, of.ENERGY, of.PRESSURE)}


def in_si(measure: Measure, value: Any, where: str) -> Any:
    """Return a bound in the unit of a measure, of a text with a unit too."""
    if not isinstance(value, str):
        return value
    if measure.unit not in _QUANTITIES:
        bare = value.removesuffix(measure.unit).strip()
        if not is_number(bare):
            told = f"a number in {measure.unit}" if measure.unit else "a number without a unit"
            raise InputError(f"{where}: expected {told}, got {shown(value)}{with_point(value)}")
        return float(bare)
    try:
        return _QUANTITIES[measure.unit].read(value, where)
    except P3dofError as error:
        raise InputError(str(error)) from error
