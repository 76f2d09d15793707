"""`Evaluated`: objectives and constraints of designs of a problem."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, frozen_array, shown
from p3dof._base.errors import InputError, P3dofError
from p3dof._base.quantities import LENGTH, Quantity
from p3dof._base.tables import Tabular
from p3dof.analysis.designs.columns import QUANTITIES, full_name
from p3dof.analysis.designs.results import DesignStatus
from p3dof.design.drives import Catalogue
from p3dof.design.optimisation.constraints import Constraint, Formula, amount
from p3dof.design.optimisation.population import Measure
from p3dof.design.optimisation.task_measures import LEAD, PARTS, Discrete, chosen_parts


@dataclass(frozen=True, eq=False)
class Variables:
    """Columns of designs that may change, in an order, and their bounds."""

    names: tuple[str, ...]  # full names, such as `geometry.R`
    labels: tuple[str, ...]  # as the user calls them
    low: FloatArray  # (n,): bounds [SI units]
    high: FloatArray

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Variables:
        """Return what a mapping from names to pairs of bounds means."""
        require_variables(given)
        names: dict[str, str] = {}
        bounds = []
        for label, pair in given.items():
            name = LEAD if label == "lead" else full_name(label)
            if name.startswith("limits."):
                raise InputError(f"variables: {label}: limits are no part of a design to be optimised")
            if name in names.values():
                raise InputError(f"variables: {label} is there twice")
            names[str(label)] = name
            bounds.append(_bounds(label, name, pair))
        low, high = np.array(bounds).reshape(-1, 2).T
        return cls(tuple(names.values()), tuple(names), low, high)

    def __len__(self) -> int:
        return len(self.names)

    @property
    def units(self) -> tuple[str, ...]:
        """SI unit of each."""
        return tuple(_quantity(name).unit for name in self.names)

    @property
    def span(self) -> FloatArray:
        """Upper less lower bounds (n,)."""
        return self.high - self.low

    def scaled(self, values: FloatArray) -> FloatArray:
        """Return values as shares of the way from lower to upper bounds, (..., n)."""
        return np.asarray((values - self.low) / self.span)

    def values(self, scaled: FloatArray) -> FloatArray:
        """Return the values of shares, (..., n), never outside the bounds by rounding."""
        found = self.low + np.asarray(scaled) * self.span
        return np.asarray(np.clip(found, self.low, self.high))

    def rows(self, values: Any) -> FloatArray:
        """Return designs as rows, (D, n)."""
        array = frozen_array("designs", values, ("D", len(self)) if np.ndim(values) == 2 else (len(self),))
        return np.atleast_2d(array)


def require_variables(given: Any) -> None:
    """Raise unless there are variables by name."""
    if not isinstance(given, Mapping) or not given:
        raise InputError(
            f"variables: expected bounds by name, such as {{'R': (0.2, 0.3)}}, got {shown(given)}"
        )


def _quantity(name: str) -> Quantity:
    return LENGTH if name == LEAD else QUANTITIES[name]


def discrete_of(given: Mapping[str, Any], drives: Catalogue | None) -> tuple[Discrete, ...]:
    """Return the variables that are one of some values."""
    require_variables(given)
    found = []
    for label, value in given.items():
        if label in PARTS:
            found.append(chosen_parts(label, value, drives))
        elif isinstance(value, Mapping):
            if set(value) != {"one_of"} or not isinstance(value["one_of"], Sequence) or not value["one_of"]:
                raise InputError(
                    f"variables.{label}: expected bounds or {{'one_of': [...]}}, got {shown(value)}"
                )
            name = LEAD if label == "lead" else full_name(label)
            rows = [quantity_in_si(name, one, f"variables.{label}") for one in value["one_of"]]
            if len(set(rows)) < len(rows):
                raise InputError(f"variables.{label}: a value is there twice")
            found.append(Discrete(label, name, tuple(rows)))
    return tuple(found)


def quantity_in_si(name: str, value: Any, where: str) -> float:
    """Return a number of a column in SI units, from a number or a text with a unit."""
    try:
        found = _quantity(name).read(value, where)
    except P3dofError as error:
        raise InputError(str(error)) from error
    return float(frozen_array(where, found, ()))


def _bounds(label: str, name: str, pair: Any) -> tuple[float, float]:
    where = f"variables.{label}"
    if not isinstance(pair, tuple | list | np.ndarray) or len(pair) != 2:
        raise InputError(f"{where}: expected a lower and an upper bound, got {shown(pair)}")
    low, high = (quantity_in_si(name, end, where) for end in pair)
    if not low < high:
        raise InputError(f"{where}: expected the lower bound below the upper one, got {low:g} and {high:g}")
    return low, high


TOLERANCE = 1e-8
"""By how much constraints may be missed, as a share of their bounds: optima lie on them, and are rounded."""


class Asked(NamedTuple):
    """What a problem asks of designs."""

    variables: Variables  # what may change
    objectives: tuple[Measure, ...]  # what is to become better
    constraints: tuple[Constraint, ...]  # what must be kept


@dataclass(frozen=True, eq=False, repr=False)
class Evaluated(Tabular):
    """What designs of a problem are worth, and what they keep."""

    _row_name = "design"

    asked: Asked  # what the problem asks
    designs: FloatArray  # (D, n): their variables [SI units]
    objectives: FloatArray  # (D, M): its objectives, in its order; NaN where the motion is impossible
    constraints: FloatArray
    """(D, C): the bounded measures, in the order of its constraints; NaN where a pose is out of reach."""
    status: NDArray[np.uint8]  # (D,): `DesignStatus` over the motion

    def __len__(self) -> int:
        return len(self.designs)

    def __repr__(self) -> str:
        return f"Evaluated({int(self.feasible.sum())} of {len(self)} designs are feasible)"

    def __getitem__(self, name: str) -> FloatArray:
        """Return an objective or a bounded measure by its name, (D,)."""
        for index, measure in enumerate(self.asked.objectives):
            if measure.name == name:
                return self.objectives[:, index]
        for index, item in enumerate(self.asked.constraints):
            if name in (item.name, item.measure.name):
                return self.constraints[:, index]
        raise KeyError(name)

    @property
    def margins(self) -> FloatArray:
        """By how much each constraint is kept (D, C), in the units of its measure; negative where not."""
        columns = [
            item.margin(self.constraints[:, index]) for index, item in enumerate(self.asked.constraints)
        ]
        return np.stack(columns, axis=1) if columns else np.zeros((len(self), 0))

    @property
    def violation(self) -> FloatArray:
        """Sum of all violations by the sizes of their bounds (D,): 0 for designs that keep all.

        Less than 1e-8 of a bound is none.
        """
        scales = np.array([item.scale for item in self.asked.constraints])
        with np.errstate(invalid="ignore"):
            short = np.maximum(-self.margins / scales, 0.0)
        lost = np.where(np.isnan(short), 1.0, np.where(short > TOLERANCE, short, 0.0)).sum(axis=1)
        return np.asarray(np.where(self.status == DesignStatus.FEASIBLE, lost, 10.0 + lost))

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """Which designs make the motion and keep all constraints (D,)."""
        return np.asarray(self.violation == 0.0)

    def reason(self, design: int) -> str:
        """Return in words which constraint a design misses most, and by how much; empty if it keeps all."""
        status = DesignStatus(int(self.status[design]))
        if status != DesignStatus.FEASIBLE:
            return status.in_words
        items = self.asked.constraints
        margins = self.margins[design]
        sizes = np.array([item.scale for item in items])
        shares = np.where(np.isnan(margins), -np.inf, margins / sizes)
        if not len(items) or shares.min() >= -TOLERANCE:
            return ""
        worst = int(shares.argmin())
        item, value = items[worst], self.constraints[design, worst]
        if np.isnan(value):
            formula = isinstance(item.measure, Formula)
            return f"{item.name}: {'has no value' if formula else 'a pose of the box is out of reach'}"
        missed, unit = amount(-margins[worst], item.measure.unit, 4), item.measure.unit
        return f"{item.name}: violated by {missed} (it is {amount(value, unit)})"

    def to_columns(self) -> dict[str, NDArray[Any]]:
        """Return everything as columns, with units in their names; dict of str to ndarray, shape (D,)."""
        asked, columns = self.asked, dict[str, NDArray[Any]]()
        for index, (label, unit) in enumerate(
            zip(asked.variables.labels, asked.variables.units, strict=True)
        ):
            columns[f"{label} [{unit}]"] = self.designs[:, index]
        measures = [*asked.objectives, *(item.measure for item in asked.constraints)]
        values = np.concatenate([self.objectives, self.constraints], axis=1)
        for index, measure in enumerate(measures):
            columns.setdefault(
                f"{measure.name} [{measure.unit}]" if measure.unit else measure.name, values[:, index]
            )
        columns["violation"] = self.violation
        columns["status"] = self.status
        return columns
