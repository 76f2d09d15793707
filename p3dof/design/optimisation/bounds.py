"""Constraints as users write them: bounds on measures by name, with units, and linear relations."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from p3dof._base.checks import real, shown
from p3dof._base.errors import InputError, P3dofError
from p3dof.design.optimisation.constraints import Constraint, amount, relation
from p3dof.design.optimisation.measure import Measure
from p3dof.design.optimisation.measures import measure_of
from p3dof.machine.parameters.quantities import ANGLE, FORCE, LENGTH, MASS, SPEED


def constraints_of(given: Mapping[str, Any] | Sequence[Any] | str) -> tuple[Constraint, ...]:
    """Return constraints from what `DesignProblem` takes.

    Parameters
    ----------
    given : mapping or sequence
        See there.

    Returns
    -------
    tuple of Constraint

    Raises
    ------
    InputError
        If one does not fit.
    """
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
