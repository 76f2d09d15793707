"""What may vary about a machine: a number of the parameter file, and the columns of designs it moves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Protocol, TypeAlias

import numpy as np

from p3dof._base.checks import FloatArray, as_floats, positive, shown
from p3dof._base.errors import InputError, ParameterError
from p3dof._base.quantities import Quantity
from p3dof.analysis.designs.columns import (
    COMPONENTS,
    DENSITY,
    QUANTITIES,
    SIZES,
    BodiesOfDesigns,
    Designs,
    full_name,
    members_of,
    numbers_of,
    numbers_of_solids,
)
from p3dof.machine.parameters import PAPER, Parameters


class HasParameters(Protocol):
    """A machine with its parameters, such as `Manipulator`."""

    @property
    def parameters(self) -> Parameters:
        """What the machine is."""


AnyMachine: TypeAlias = Parameters | HasParameters | None  # a machine, its parameters, or the paper's machine


def parameters_of(robot: AnyMachine) -> Parameters:
    """Return the parameters of a machine; those of the paper's for None."""
    if robot is None:
        return PAPER
    found = robot if isinstance(robot, Parameters) else getattr(robot, "parameters", None)
    if not isinstance(found, Parameters):
        raise InputError(f"robot: expected a Manipulator or Parameters, got {shown(robot)}")
    return found


@dataclass(frozen=True)
class Direction:
    """A number of a machine that varies, and what moves with it."""

    name: str  # its full name, as columns of designs have it
    nominal: float  # its number at the machine, in SI units
    unit: str  # its SI unit
    rates: Mapping[str, float] = field(default_factory=dict)
    """How columns of designs change by it: 1 for itself; a body's inertia keeps its ratio to the mass."""


Fixed: TypeAlias = Mapping[str, float]
"""Numbers that are not those of the machine, by full names of columns, such as sizes of its solids."""


def direction_of(
    name: str, machine: Parameters, bodies: BodiesOfDesigns, fixed: Fixed = MappingProxyType({})
) -> Direction:
    """Return what moves with a number of the parameter file.

    A mass takes the body's inertia about its mass centre with it, as a body of another density would; a kind
    of bodies (``leg``) or a group of joints (``sliders``) moves all of its members together.

    `name`: as columns of designs are called: ``R``, ``platform.mass``, ``friction.viscous.sliders``.
    """
    if not isinstance(name, str):
        raise InputError(f"expected names of parameters, got {shown(name)}")
    known = full_name(name)
    if known.startswith("limits."):
        raise InputError(f"{known}: a limit moves no force")
    if known.startswith("bodies.") and bodies == "solids":
        raise InputError(f"{known}: bodies of solids follow from their sizes and density; let {DENSITY} vary")
    if known in (*SIZES, DENSITY) and bodies == "kept":
        raise InputError(f"{known}: sizes need bodies of solids: bodies='solids'")
    numbers = numbers_of(machine) | numbers_of_solids(machine) | dict(fixed)
    if np.isnan(numbers.get(known, 0.0)):
        raise InputError(f"{known}: differs by kind of body in the machine: expected one of all in fixed")
    unit = QUANTITIES[known].unit
    members = members_of(known)
    nominal = numbers.get(members[0], 0.0)
    if known.endswith(".mass") and known != "payload.mass":
        return Direction(known, nominal, unit, _with_inertia(known, members, numbers))
    return Direction(known, nominal, unit, dict.fromkeys(members, 1.0))


def _with_inertia(name: str, members: list[str], numbers: Mapping[str, float]) -> dict[str, float]:
    """Return how masses and inertias change with the mass of the first member: all by the same share."""
    first, rates = numbers[members[0]], {}
    if first <= 0:
        raise InputError(f"{name}: has no mass in this machine, which therefore cannot vary by a share")
    for member in members:
        link = member.removesuffix("mass")
        for item in ("mass", *(each for each in COMPONENTS if each.startswith("inertia"))):
            if numbers[f"{link}{item}"]:
                rates[f"{link}{item}"] = numbers[f"{link}{item}"] / first
    return rates


def columns_of_directions(
    directions: tuple[Direction, ...],
    machine: Parameters,
    bodies: BodiesOfDesigns,
    moved: FloatArray,
    fixed: Fixed = MappingProxyType({}),
) -> dict[str, FloatArray]:
    """Return columns of designs that are moved along directions; dict of str to ndarray, shape (D,)."""
    numbers = numbers_of(machine) | numbers_of_solids(machine) | dict(fixed)
    told = dict.fromkeys((*(SIZES if bodies == "solids" else ()), *fixed))
    columns: dict[str, FloatArray] = {name: np.full(len(moved), numbers[name]) for name in told}
    for direction, change in zip(directions, moved.T, strict=True):
        for column, rate in direction.rates.items():
            start = columns.get(column, np.full(len(moved), numbers.get(column, 0.0)))
            columns[column] = start + rate * change
    return columns


def designs_of(
    directions: tuple[Direction, ...],
    machine: Parameters,
    bodies: BodiesOfDesigns,
    moved: FloatArray,
    fixed: Fixed = MappingProxyType({}),
) -> Designs:
    """Return the machines that are moved along directions, as designs; see `columns_of_directions`."""
    return Designs(columns_of_directions(directions, machine, bodies, moved, fixed), machine, bodies)


def fixed_of(given: Mapping[str, Any] | None, bodies: BodiesOfDesigns) -> dict[str, float]:
    """Return numbers that are not those of the machine, by full names, in SI units."""
    if not isinstance(given, Mapping | None):
        raise InputError(f"fixed: expected numbers by names, got {shown(given)}")
    found = {}
    for name, value in (given or {}).items():
        known = full_name(str(name))
        if known in (*SIZES, DENSITY) and bodies == "kept":
            raise InputError(f"fixed: {known}: sizes need bodies of solids: bodies='solids'")
        try:
            number = QUANTITIES[known].read(value, f"fixed: {known}")
        except ParameterError as error:
            raise InputError(str(error.args[0])) from error
        found[known] = float(as_floats(f"fixed: {known}", number))
    return found


def amount_of(value: Any, nominal: float, quantity: Quantity, where: str) -> float:
    """Return a positive number in SI units of one with a unit (``0.1 mm``) or a share (``2 %``)."""
    if isinstance(value, str) and value.strip().endswith("%"):
        share = _share(value, where)
        if not nominal:
            raise InputError(f"{where}: expected {quantity.name}, got {shown(value)} of a number that is 0")
        return share * abs(nominal)
    try:
        number = quantity.read(value, where)
    except ParameterError as error:
        raise InputError(f"{error.args[0]}; a share such as '2 %' will do too") from error
    return positive(where, number, InputError)


def require_smaller(sigma: float, nominal: float, unit: str, where: str) -> None:
    """Raise where a length or mass of a machine would vary by as much as it is: a unit is missing."""
    if nominal and sigma >= abs(nominal):
        raise InputError(
            f"{where}: expected less than the number itself, {nominal:g} {unit}, got {sigma:g} {unit}; "
            "numbers without a unit are in SI units"
        )


def _share(text: str, where: str) -> float:
    try:
        share = float(text.strip().removesuffix("%")) / 100
    except ValueError:
        raise InputError(f"{where}: expected a share such as '2 %', got {shown(text)}") from None
    return positive(where, share, InputError)


def directions_of(
    given: Mapping[str, Any],
    what: str,
    machine: Parameters,
    bodies: BodiesOfDesigns,
    fixed: Fixed = MappingProxyType({}),
) -> tuple[tuple[Direction, ...], tuple[Any, ...]]:
    """Return what varies, each once, and the values that the user gave for it."""
    if not isinstance(given, Mapping) or not given:
        raise InputError(f"{what}: expected numbers by names of parameters, such as {{'R': '0.1 mm'}}")
    found: dict[str, Direction] = {}
    for name in given:
        try:
            direction = direction_of(name, machine, bodies, fixed)
        except InputError as error:
            raise InputError(f"{what}: {error.args[0].removeprefix('designs: ')}") from error
        if direction.name in found:
            raise InputError(f"{what}: {direction.name} is there twice")
        found[direction.name] = direction
    return tuple(found.values()), tuple(given.values())
