"""`Evaluated`: objectives and constraints of designs of a problem."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.errors import MissingExtraError
from p3dof.analysis.designs.status import DesignStatus
from p3dof.design.optimisation.constraints import Constraint, amount
from p3dof.design.optimisation.measure import Measure
from p3dof.design.optimisation.variables import Variables

TOLERANCE = 1e-8
"""By how much constraints may be missed, as a share of their bounds: optima lie on them, and are rounded."""


class Asked(NamedTuple):
    """What a problem asks of designs.

    Parameters
    ----------
    variables : Variables
        What may change.
    objectives : tuple of Measure
        What is to become better.
    constraints : tuple of Constraint
        What must be kept.
    """

    variables: Variables
    objectives: tuple[Measure, ...]
    constraints: tuple[Constraint, ...]


@dataclass(frozen=True, eq=False, repr=False)
class Evaluated:
    """What designs of a problem are worth, and what they keep.

    Parameters
    ----------
    asked : Asked
        What the problem asks.
    designs : ndarray, shape (D, n)
        Their variables [SI units].
    objectives : ndarray, shape (D, M)
        Its objectives, in its order; NaN where a design cannot make the motion.
    constraints : ndarray, shape (D, C)
        The bounded measures, in the order of its constraints; NaN where a pose is out of reach.
    status : ndarray of uint8, shape (D,)
        `DesignStatus` over the motion.
    """

    asked: Asked
    designs: FloatArray
    objectives: FloatArray
    constraints: FloatArray
    status: NDArray[np.uint8]

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
        """Return in words which constraint a design misses most, and by how much; empty if it keeps all.

        Parameters
        ----------
        design : int
            Which one.

        Returns
        -------
        str
        """
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
            return f"{item.name}: a pose of the box is out of reach"
        missed, unit = amount(-margins[worst], item.measure.unit, 4), item.measure.unit
        return f"{item.name}: missed by {missed} (it is {amount(value, unit)})"

    def to_columns(self) -> dict[str, NDArray[Any]]:
        """Return everything as columns, with units in their names.

        Returns
        -------
        dict of str to ndarray, shape (D,)
        """
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

    def to_xarray(self) -> Any:
        """Return everything as an `xarray.Dataset` along the dimension ``design``, with units as attributes.

        Returns
        -------
        xarray.Dataset

        Raises
        ------
        MissingExtraError
            If xarray is not installed.
        """
        try:
            import xarray
        except ImportError as error:
            raise MissingExtraError("to_xarray needs xarray: pip install 'p3dof[xarray]'") from error
        found = {}
        for header, values in self.to_columns().items():
            name, _, unit = header.partition(" [")
            found[name] = ("design", values, {"units": unit.rstrip("]")} if unit else {})
        return xarray.Dataset(found)
