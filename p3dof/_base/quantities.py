"""Numbers with units, as people write them in a parameter file: ``120 mm``, ``950 g``, ``410 kg mm^2``.

A unit is a product of the units below, with powers (``mm^2``, ``mm²``) and at most one ``/``; without one
a number is in SI units. The result is the double nearest to what is written: ``120 mm`` is 0.12.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, TypeAlias

from p3dof._base.checks import is_number, with_point
from p3dof._base.errors import ParameterError

Powers: TypeAlias = tuple[int, int, int, int, int]
"""Of metre, kilogram, second, radian and ampere."""

_UNITS: dict[str, tuple[Powers, Fraction]] = {
    "m": ((1, 0, 0, 0, 0), Fraction(1)),
    "cm": ((1, 0, 0, 0, 0), Fraction(1, 100)),
    "mm": ((1, 0, 0, 0, 0), Fraction(1, 1000)),
    "um": ((1, 0, 0, 0, 0), Fraction(1, 10**6)),
    "µm": ((1, 0, 0, 0, 0), Fraction(1, 10**6)),
    "km": ((1, 0, 0, 0, 0), Fraction(1000)),
    "kg": ((0, 1, 0, 0, 0), Fraction(1)),
    "g": ((0, 1, 0, 0, 0), Fraction(1, 1000)),
    "t": ((0, 1, 0, 0, 0), Fraction(1000)),
    "s": ((0, 0, 1, 0, 0), Fraction(1)),
    "ms": ((0, 0, 1, 0, 0), Fraction(1, 1000)),
    "min": ((0, 0, 1, 0, 0), Fraction(60)),
    "Hz": ((0, 0, -1, 0, 0), Fraction(1)),
    "kHz": ((0, 0, -1, 0, 0), Fraction(1000)),
    "rad": ((0, 0, 0, 1, 0), Fraction(1)),
    "mrad": ((0, 0, 0, 1, 0), Fraction(1, 1000)),
    "deg": ((0, 0, 0, 1, 0), Fraction(math.pi) / 180),
    "rpm": ((0, 0, -1, 1, 0), Fraction(math.pi) / 30),
    "°": ((0, 0, 0, 1, 0), Fraction(math.pi) / 180),
    "N": ((1, 1, -2, 0, 0), Fraction(1)),
    "mN": ((1, 1, -2, 0, 0), Fraction(1, 1000)),
    "kN": ((1, 1, -2, 0, 0), Fraction(1000)),
    "W": ((2, 1, -3, 0, 0), Fraction(1)),
    "kW": ((2, 1, -3, 0, 0), Fraction(1000)),
    "Pa": ((-1, 1, -2, 0, 0), Fraction(1)),
    "MPa": ((-1, 1, -2, 0, 0), Fraction(10**6)),
    "GPa": ((-1, 1, -2, 0, 0), Fraction(10**9)),
    "Nm": ((2, 1, -2, 0, 0), Fraction(1)),
    "Nmm": ((2, 1, -2, 0, 0), Fraction(1, 1000)),
    "Ncm": ((2, 1, -2, 0, 0), Fraction(1, 100)),
    "in": ((1, 0, 0, 0, 0), Fraction(254, 10**4)),
    "ft": ((1, 0, 0, 0, 0), Fraction(3048, 10**4)),
    "lb": ((0, 1, 0, 0, 0), Fraction(45359237, 10**8)),
    "lbf": ((1, 1, -2, 0, 0), Fraction(44482216152605, 10**13)),
    "kgf": ((1, 1, -2, 0, 0), Fraction(980665, 10**5)),
    "oz": ((0, 1, 0, 0, 0), Fraction(45359237, 16 * 10**8)),
    "ozf": ((1, 1, -2, 0, 0), Fraction(44482216152605, 16 * 10**13)),
    "psi": ((-1, 1, -2, 0, 0), Fraction(44482216152605, 10**13) / Fraction(254, 10**4) ** 2),
    "hp": ((2, 1, -3, 0, 0), 550 * Fraction(3048, 10**4) * Fraction(44482216152605, 10**13)),
    "mNm": ((2, 1, -2, 0, 0), Fraction(1, 1000)),
    "J": ((2, 1, -2, 0, 0), Fraction(1)),
    "kJ": ((2, 1, -2, 0, 0), Fraction(1000)),
    "A": ((0, 0, 0, 0, 1), Fraction(1)),
    "mA": ((0, 0, 0, 0, 1), Fraction(1, 1000)),
    "V": ((2, 1, -3, 0, -1), Fraction(1)),
    "mV": ((2, 1, -3, 0, -1), Fraction(1, 1000)),
    "kV": ((2, 1, -3, 0, -1), Fraction(1000)),
    "ohm": ((2, 1, -3, 0, -2), Fraction(1)),
    "Ω": ((2, 1, -3, 0, -2), Fraction(1)),
    "mohm": ((2, 1, -3, 0, -2), Fraction(1, 1000)),
    "mΩ": ((2, 1, -3, 0, -2), Fraction(1, 1000)),
    "H": ((2, 1, -2, 0, -2), Fraction(1)),
    "mH": ((2, 1, -2, 0, -2), Fraction(1, 1000)),
    "uH": ((2, 1, -2, 0, -2), Fraction(1, 10**6)),
    "µH": ((2, 1, -2, 0, -2), Fraction(1, 10**6)),
    "uF": ((-2, -1, 4, 0, 2), Fraction(1, 10**6)),
    "µF": ((-2, -1, 4, 0, 2), Fraction(1, 10**6)),
    "mF": ((-2, -1, 4, 0, 2), Fraction(1, 1000)),
    "F": ((-2, -1, 4, 0, 2), Fraction(1)),
}
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?"
_WRITTEN = re.compile(rf"\s*({_NUMBER})\s*([^\d\s.,+-].*?)\s*\Z", re.ASCII | re.DOTALL)
_FACTOR = re.compile(r"([A-Za-zµ°Ω]+)\^?(-?[1-9])?\Z")
_LONGEST = 60  # longest text that is taken for a number with a unit [characters]
_DEEPEST = 3  # how long a list of numbers may be, in each direction


@dataclass(frozen=True)
class Quantity:
    """What kind of number a field holds."""

    name: str  # what to call it in an error
    unit: str  # its SI unit
    others: tuple[str, ...] = ()
    """Further units that are as good; the last of all units is the example in an error."""

    def read(self, value: Any, where: str) -> Any:
        """Return texts of a file, also in lists, in SI units; what is neither text nor list as it is."""
        if isinstance(value, list | tuple):
            rows = [item for item in value if isinstance(item, list | tuple)]
            if len(value) > _DEEPEST or any(
                len(row) > _DEEPEST or any(isinstance(x, list | tuple) for x in row) for row in rows
            ):
                raise ParameterError(f"{where}: expected at most 3 × 3 numbers")
            self._require_one_way(value, where)
            return [self.read(item, where) for item in value]
        return self._number(value, where) if isinstance(value, str) else value

    def _number(self, text: str, where: str) -> float:
        """Return the number that a text stands for."""
        if is_number(text):
            return float(text)
        written = _WRITTEN.match(text) if len(text) <= _LONGEST else None
        if written is None:
            raise self._refused(text, where)
        powers, factor = unit_of(written[2]) or (None, Fraction(1))
        if powers not in {unit_of(unit)[0] for unit in (self.unit, *self.others)}:  # type: ignore[index]
            raise self._refused(text, where)
        try:
            return float(Fraction(written[1]) * factor)
        except OverflowError:
            raise self._refused(text, where) from None

    def _require_one_way(self, values: Sequence[Any], where: str) -> None:
        """Raise where a unit in a list seems to be meant for its other numbers too."""
        entries = [x for item in values for x in (item if isinstance(item, list | tuple) else [item])]
        plain = [x for x in entries if _is_plain(x) and (float(x) if isinstance(x, str) else x) != 0]
        if plain and any(isinstance(x, str) and not _is_plain(x) for x in entries):
            raise ParameterError(
                f"{where}: expected a unit with every number but 0, or with none, got {plain[0]} without one"
            )

    def _refused(self, text: str, where: str) -> ParameterError:
        example = (self.unit, *self.others)[-1]
        return ParameterError(
            f"{where}: expected {self.name}, a number in {self.unit} or one with a unit such as "
            f"'1 {example}', got {text[:40]!r}{'...' if len(text) > 40 else ''}{with_point(text)}"
        )


def _is_plain(value: Any) -> bool:
    """Whether a value is a number without a unit."""
    if isinstance(value, str):
        return is_number(value)
    return isinstance(value, int | float) and not isinstance(value, bool)


def unit_of(text: str) -> tuple[Powers, Fraction] | None:
    """Return the powers and the factor of a unit; None if it is none."""
    plain = text.replace("²", "^2").replace("³", "^3").replace("μ", "µ").replace("\u2126", "Ω")
    sides = plain.split("/")
    if len(sides) > 2:
        return None
    powers, factor = [0] * 5, Fraction(1)
    for sign, side in zip((1, -1), sides, strict=False):
        words = re.split(r"[\s*·]+", side.strip().strip("()").strip())
        if sign > 0 and words == ["1"]:
            continue
        for word in words:
            match = _FACTOR.match(word)
            if match is None or match[1] not in _UNITS:
                return None
            count = sign * int(match[2] or 1)
            base, scale = _UNITS[match[1]]
            powers = [p + count * b for p, b in zip(powers, base, strict=True)]
            factor *= scale**count
    return (powers[0], powers[1], powers[2], powers[3], powers[4]), factor


LENGTH = Quantity("a length", "m", ("mm",))
MASS = Quantity("a mass", "kg", ("g",))
MASS_DENSITY = Quantity("a density", "kg/m^3", ("g/cm^3",))
INERTIA = Quantity("an inertia", "kg m^2", ("kg mm^2",))
SPEED = Quantity("a speed", "m/s", ("mm/s",))
RATE = Quantity("a speed", "m/s", ("rad/s", "mm/s"))
ACCELERATION = Quantity("an acceleration", "m/s^2", ("mm/s^2",))
JERK = Quantity("a jerk", "m/s^3", ("mm/s^3",))
POWER = Quantity("a power", "W", ("kW",))
FORCE = Quantity("a force", "N", ("kN",))
MOMENT = Quantity("a moment", "N m", ("N mm",))
ANGLE = Quantity("an angle", "rad", ("deg",))
SLIDE_DAMPING = Quantity("viscous friction of a slide", "N s/m", ("N s/mm",))
HINGE_DAMPING = Quantity("viscous friction of a hinge", "N m s", ("N m s/rad",))
TIME = Quantity("a time", "s", ("ms",))
FREQUENCY = Quantity("a frequency", "Hz", ("kHz",))
ROTATION = Quantity("a rotational speed", "rad/s", ("rpm",))
STIFFNESS = Quantity("a stiffness", "N/m", ("N/um",))
TURNING_STIFFNESS = Quantity("a stiffness against turning", "N m", ("N m/rad", "N m/mrad"))
PRESSURE = Quantity("a modulus", "Pa", ("GPa",))
INDUCTANCE = Quantity("an inductance", "H", ("mH",))
FLUX = Quantity("a flux linkage", "V s", ("V s/rad", "mV s"))
ENERGY = Quantity("an energy", "J", ("kJ",))
CURRENT = Quantity("a current", "A", ("mA",))
VOLTAGE = Quantity("a voltage", "V", ("mV",))
RESISTANCE = Quantity("a resistance", "ohm", ("mohm",))
CAPACITANCE = Quantity("a capacitance", "F", ("uF",))
TORQUE_CONSTANT = Quantity("a torque constant", "N m/A", ("Nm/A",))
