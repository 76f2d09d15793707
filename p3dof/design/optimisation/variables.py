"""`Variables`: what an optimisation may change of a machine, and between which bounds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, frozen_array, shown
from p3dof._base.errors import InputError, P3dofError
from p3dof.analysis.designs.names import QUANTITIES, full_name


@dataclass(frozen=True, eq=False)
class Variables:
    """Columns of designs that may change, in an order, and their bounds.

    Parameters
    ----------
    names : tuple of str
        Full names, such as ``geometry.R``.
    labels : tuple of str
        As the user calls them.
    low, high : ndarray, shape (n,)
        Bounds [SI units].
    """

    names: tuple[str, ...]
    labels: tuple[str, ...]
    low: FloatArray
    high: FloatArray

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Variables:
        """Return what a mapping from names to pairs of bounds means.

        Parameters
        ----------
        given : mapping of str to pair
            Bounds by the name of a column of designs: numbers in SI units, or texts with units.

        Returns
        -------
        Variables

        Raises
        ------
        InputError
            If a name is unknown or occurs twice, or bounds are none.
        """
        if not isinstance(given, Mapping) or not given:
            raise InputError(
                f"variables: expected bounds by name, such as {{'R': (0.2, 0.3)}}, got {shown(given)}"
            )
        names: dict[str, str] = {}
        bounds = []
        for label, pair in given.items():
            name = full_name(label)
            if name.startswith("limits."):
                raise InputError(f"variables: {label}: limits are no part of a design to be optimised")
            if name in names.values():
                raise InputError(f"variables: {label} is there twice")
            names[str(label)] = name
            bounds.append(_bounds(label, name, pair))
        low, high = np.array(bounds).T
        return cls(tuple(names.values()), tuple(names), low, high)

    def __len__(self) -> int:
        return len(self.names)

    @property
    def units(self) -> tuple[str, ...]:
        """SI unit of each."""
        return tuple(QUANTITIES[name].unit for name in self.names)

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
        """Return designs as rows, (D, n).

        Raises
        ------
        InputError
            If they have another shape, or are no numbers.
        """
        array = frozen_array("designs", values, ("D", len(self)) if np.ndim(values) == 2 else (len(self),))
        return np.atleast_2d(array)


def quantity_in_si(name: str, value: Any, where: str) -> float:
    """Return a number of a column in SI units, from a number or a text with a unit.

    Parameters
    ----------
    name : str
        Full name of the column.
    value : number or str
        Such as ``"80 mm"``.
    where : str
        What to call it in an error.

    Returns
    -------
    float

    Raises
    ------
    InputError
        If it is no finite number of this kind.
    """
    try:
        found = QUANTITIES[name].read(value, where)
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
