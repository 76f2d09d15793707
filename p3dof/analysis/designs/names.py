"""The columns of designs: their names, as parameter files nest them with dots, and their units."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import fields
from typing import NamedTuple

import numpy as np

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError, ParameterError
from p3dof.machine.parameters import LINKS, PASSIVE, SLIDES, Dimensions
from p3dof.machine.parameters.names import JOINT_GROUPS
from p3dof.machine.parameters.quantities import (
    ACCELERATION,
    ANGLE,
    FORCE,
    HINGE_DAMPING,
    INERTIA,
    LENGTH,
    MASS,
    MOMENT,
    RATE,
    SLIDE_DAMPING,
    SPEED,
    STIFFNESS,
    Quantity,
)

KINDS = {
    "slider": ("slider_a", "slider_b", "slider_c"),
    "leg": ("leg_a", "leg_b", "rod_left", "rod_right"),
    "crossbar": ("crossbar_upper", "crossbar_lower"),
    "platform": ("platform",),
}
"""The kinds of bodies of a parameter file, and the links of each."""

LENGTHS = ("geometry.r", "geometry.R", "geometry.L", "geometry.b")
SIZES = tuple(f"dimensions.{item.name}" for item in fields(Dimensions))
OFFSETS = ("offset.y", "offset.z", "offset.theta")
GRAVITY = ("gravity.x", "gravity.y", "gravity.z")
DENSITY = "density"

ACTUATORS = "actuators."
"""What the names of motors and balances begin with."""
_ACTUATOR = {"armature": MASS, "counterbalance": FORCE, "spring": STIFFNESS, "counterweight": MASS}

_DENSITY = Quantity("a density", "kg/m^3", ("g/cm^3",))
_BODY = {
    "mass": MASS,
    **{f"com.{axis}": LENGTH for axis in "xyz"},
    **{f"inertia.{axes}": INERTIA for axes in ("xx", "yy", "zz", "xy", "xz", "yz")},
}
COMPONENTS = tuple(_BODY)
"""The numbers of a body."""


def _quantities() -> dict[str, Quantity]:
    known = dict.fromkeys((*LENGTHS, *SIZES), LENGTH) | {DENSITY: _DENSITY}
    known |= {name: ANGLE if name.endswith("theta") else LENGTH for name in OFFSETS}
    known |= dict.fromkeys(GRAVITY, ACCELERATION)
    for body in ("payload", *(f"bodies.{name}" for name in dict.fromkeys((*KINDS, *LINKS)))):
        known |= {f"{body}.{name}": quantity for name, quantity in _BODY.items()}
    for joint in (*JOINT_GROUPS, *SLIDES, *PASSIVE):
        slide = joint == "sliders" or joint in SLIDES
        known[f"friction.viscous.{joint}"] = SLIDE_DAMPING if slide else HINGE_DAMPING
        known[f"friction.coulomb.{joint}"] = FORCE if slide else MOMENT
    known["friction.smoothing"] = RATE
    for name in ("sliders", *SLIDES):
        known |= {f"{ACTUATORS}{what}.{name}": quantity for what, quantity in _ACTUATOR.items()}
    for end in ("low", "high"):
        known |= {f"limits.travel.{end}": LENGTH, f"limits.tilt.{end}": ANGLE}
    return known | {"limits.speed": SPEED, "limits.force": FORCE}


QUANTITIES = _quantities()
"""Every column by its full name."""

_PREFIXES = ("", "geometry.", "dimensions.", "bodies.", ACTUATORS)
"""What may be left out in front of a name."""


class Column(NamedTuple):
    """A column of designs: its full name, and what takes its numbers to SI units."""

    name: str
    multiply: float = 1.0
    divide: float = 1.0

    def in_si(self, values: FloatArray) -> FloatArray:
        """Return numbers of the column in SI units."""
        if self.multiply == self.divide == 1.0:
            return values
        return values * self.multiply / self.divide


def full_name(name: str) -> str:
    """Return the full name of a column; it may lack ``geometry``, ``actuators`` and the like in front.

    Parameters
    ----------
    name : str
        What the user calls it, without a unit.

    Returns
    -------
    str

    Raises
    ------
    InputError
        If there is no such column.
    """
    for prefix in _PREFIXES:
        if f"{prefix}{name}" in QUANTITIES:
            return f"{prefix}{name}"
    ends = {known.removeprefix(prefix): known for known in QUANTITIES for prefix in _PREFIXES}
    near = difflib.get_close_matches(name, ends, 3, 0.5)
    hint = f"; did you mean {' or '.join(near)}?" if near else "."
    raise InputError(
        f"designs: unknown column {shown(name)}{hint} Expected names as in parameter files, with dots: R, "
        "rod_radius, platform.mass, payload.com.x, friction.viscous.sliders, armature.sliders, limits.force, "
        "offset.y"
    )


def column_of(header: object) -> Column:
    """Return the column that a header such as ``R [mm]`` means.

    Parameters
    ----------
    header : str
        A name, and a unit in brackets unless the numbers are in SI units.

    Returns
    -------
    Column

    Raises
    ------
    InputError
        If there is no such column, or it cannot be in this unit.
    """
    if not isinstance(header, str):
        raise InputError(f"designs: expected names of columns, got {shown(header)}")
    name, bracket, unit = header.strip().rpartition("[")
    if not bracket or not unit.endswith("]"):
        return Column(full_name(header.strip()))
    known = full_name(name.strip())
    try:
        factor = QUANTITIES[known].read(f"1 {unit[:-1].strip()}", f"designs: column {shown(header.strip())}")
    except ParameterError as error:
        raise InputError(str(error)) from error
    if factor < 1 and abs(1 / factor - round(1 / factor)) < 1e-9 / factor:  # dividing rounds correctly
        return Column(known, divide=float(round(1 / factor)))
    return Column(known, multiply=float(factor))


def columns_of(headers: Iterable[object]) -> list[Column]:
    """Return what headers mean, each once.

    Parameters
    ----------
    headers : iterable of str
        Names with units.

    Returns
    -------
    list of Column

    Raises
    ------
    InputError
        If one means nothing, or two mean the same.
    """
    told = list(headers)
    found = [column_of(header) for header in told]
    if not found:
        raise InputError("designs: expected at least one column, got none")
    first: dict[str, object] = {}
    for column, header in zip(found, told, strict=True):
        if column.name in first:
            both = f"{shown(first[column.name])} and {shown(header)}"
            raise InputError(f"designs: two columns are {column.name}: {both}; leave one of them out")
        first[column.name] = header
    return found


def as_column(name: str, values: object) -> FloatArray:
    """Return the numbers of a column as they are, NaN and infinities included.

    Parameters
    ----------
    name : str
        What to call it in an error.
    values : array-like
        One number for each design, or one for all.

    Returns
    -------
    ndarray, shape (D,) or ()

    Raises
    ------
    InputError
        If they are no real numbers.
    """
    to_numpy = getattr(values, "to_numpy", None)
    try:
        array = np.asarray(values if to_numpy is None else to_numpy())
    except ValueError as error:  # of lists that are no array
        raise InputError(
            f"designs: column {shown(name)}: expected real numbers, one a design, got {shown(values)}"
        ) from error
    if array.dtype.kind not in "iuf" or array.ndim > 1:
        got = (
            f"shape {array.shape}"
            if array.dtype.kind in "iuf"
            else shown(array.ravel()[0] if array.size else values)
        )
        raise InputError(f"designs: column {shown(name)}: expected real numbers, one a design, got {got}")
    return array.astype(np.float64)
