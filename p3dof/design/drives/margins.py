"""`Margins` and `Ambient`: what of a rating must stay free, and what heat and height take of it.

A rating is what a catalogue gives; its *limit* is the rating less its margin. Required up to the limit fits;
above it, up to the rating, fits without reserve; above the rating does not fit.

A motor that may warm up by ΔT from θ0 gives, at θ, √((θ0 + ΔT - θ - h') / ΔT) of its continuous torque at
standstill, where it loses all heat by its surface; h' is 1 K for each 100 m above 1000 m, for the thinner
air. At speed the losses that turning makes stay as they are: T² = T_c(n)² - T_0² (1 - x²).

References
----------
Margins: Omron (peak torque 20 to 30 %), Panasonic MINAS selection (rms and peak 20 %). Inertia ratio:
Beckhoff (3 to 10 for handling). Heat: Siemens 1FK7 G2, table of derating.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, Readable, frozen_array, meant, not_negative, shown
from p3dof._base.errors import DriveError

SPEED_OF_NUTS = 70_000.0  # DN that ball nuts take whose maker says nothing [mm rpm]
TURNS_OF_NUTS = 5_000 * math.pi / 30  # and the speed above which makers ask to be asked [rad/s]
INERTIA_RATIO = 10.0  # load by rotor inertia that controls of handling take
REMARKED_RATIO = 3.0  # above this a remark is made
_HIGH = 2000.0  # above this the thinner air insulates less than voltages are rated for [m]


VERDICTS = ("fits", "fits without reserve", "does not fit")
"""What may be said of ratings, from the best to the worst."""


def verdict_of(share: float, margin: float, close: float = 0.0) -> int:
    """Return the place in `VERDICTS` of what uses a share of a rating that has a margin."""
    return int(share > (1 - margin) * (1 + close)) + int(share > 1 + close)


@dataclass(frozen=True)
class Margins(Readable):
    """What share of each rating must stay free, from 0 to below 1.

    Ratings that have a safety factor of their own, or are counted with one, have no margin by default:
    brakes (1.5), critical speed (80 %), buckling (half), braking resistors (their duty), static loads, lives.

    Raises
    ------
    DriveError
        If a number does not fit.
    """

    peak_torque: float = 0.2
    rms_torque: float = 0.2
    heating: float = 0.36
    """Heat goes with the square of torque: (1 - 0.2)² = 1 - 0.36."""
    speed: float = 0.2
    power: float = 0.2
    regeneration: float = 0.2
    rms_current: float = 0.2
    peak_current: float = 0.2
    time_above_rated_current: float = 0.0
    amplifier_power: float = 0.2
    line_power: float = 0.2
    peak_braking: float = 0.0
    braking_resistor_power: float = 0.0
    feedback: float = 0.2
    rise_of_the_voltage: float = 0.0
    rise_of_the_bus_voltage: float = 0.0
    gear_torque: float = 0.2
    gear_speed: float = 0.2
    brake: float = 0.0
    inertia_ratio: float = 0.0
    critical_speed: float = 0.0
    nut_speed: float = 0.0
    DN: float = 0.0
    belt_speed: float = 0.0
    belt_force: float = 0.0
    belt_tension: float = 0.0
    pretension: float = 0.0
    rack_speed: float = 0.0
    rack_force: float = 0.0
    buckling: float = 0.0
    life: float = 0.0
    static_load: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = share_of(f"margins: {field.name}", getattr(self, field.name))
            object.__setattr__(self, field.name, value)

    def of(self, rating: str) -> float:
        """Return the margin of a rating by its name, such as ``"peak torque"``; zero if there is none."""
        return float(getattr(self, rating.replace(" ", "_"), 0.0))

    @classmethod
    def none(cls) -> Margins:
        """Return margins that are all zero: ratings count in full."""
        return cls(**{field.name: 0.0 for field in fields(cls)})


def margins_of(given: Mapping[str, Any], where: str = "margins") -> Margins:
    """Return margins by name, as a file has them: shares, or texts in percent; others as usual."""
    names = [field.name for field in fields(Margins)]
    for name in given:
        if name not in names:
            wanted = f"expected one of {', '.join(names)}{meant(name, names)}"
            raise DriveError(f"{where}: unknown margin {shown(name)}, {wanted}")
    try:
        return Margins(**given)
    except DriveError as error:
        raise DriveError(f"{where}{str(error).removeprefix('margins')}") from error


def share_of(what: str, value: Any) -> float:
    """Return a share from 0 to below 1; a text may be in percent. Or raise DriveError."""
    number = not_negative(what, in_percent(what, value, "0.2 or '20 %'"), DriveError)
    if number >= 1:
        raise DriveError(f"{what}: expected less than 1, got {number:g}: a margin is a share, or in %")
    return number


def in_percent(what: str, value: Any, example: str) -> Any:
    """Return the share that a text says, perhaps in percent; what is no text as it is."""
    if not isinstance(value, str):
        return value
    digits = value.strip()
    try:
        return float(digits.removesuffix("%")) / (100 if digits.endswith("%") else 1)
    except ValueError:
        raise DriveError(f"{what}: expected a share such as {example}, got {shown(value)}") from None


@dataclass(frozen=True)
class Ambient(Readable):
    """Where motors work.

    Parameters
    ----------
    temperature : float or str
        Of the air about them [°C]; a text may say so, ``"45 °C"`` or ``"45 degC"``.
    altitude : float
        Above the sea [m].

    Raises
    ------
    DriveError
        If a number is not one, or from no place on Earth.
    """

    temperature: float = 40.0
    altitude: float = 0.0

    def __post_init__(self) -> None:
        for name, low, high, unit in (("temperature", -60, 150, "°C"), ("altitude", -500, 9000, "m")):
            given = getattr(self, name)
            if isinstance(given, str) and name == "temperature":
                given = _degrees(given)
            number = float(frozen_array(f"ambient: {name}", given, (), DriveError))
            if not low <= number <= high:
                raise DriveError(f"ambient: {name}: expected {low} to {high} {unit}, got {number:g} {unit}")
            object.__setattr__(self, name, number)

    def heat_share(self, rise: float = 100.0, rated_at: float = 40.0) -> float:
        """Return the share x of its continuous torque that a motor gives at standstill.

        Above 1 where it is cooler than at its rating.

        Parameters
        ----------
        rise : float
            What its winding may be warmer than the air [K].
        rated_at : float
            For which temperature of the air its rating holds [°C].
        """
        thin = max(0.0, self.altitude - 1000.0) / 100.0
        return math.sqrt(max(0.0, rated_at + rise - self.temperature - thin) / rise)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What no derating here tells."""
        if self.altitude <= _HIGH:
            return ()
        return (f"voltages at {self.altitude:g} m: above {_HIGH:g} m makers derate them, see their tables",)


def _degrees(given: str) -> float:
    """Return a temperature in °C."""
    for unit in ("°C", "degC", ""):
        if given.rstrip().endswith(unit):
            try:
                return float(given.rstrip().removesuffix(unit))
            except ValueError:
                break
    raise DriveError(f"ambient: temperature: expected a number in °C such as '45 °C', got {shown(given)}")


def table_share(table: Sequence[Sequence[float]], value: float) -> float:
    """Return the share of a maker's table of (value, share) rows, straight between them, held at its ends."""
    rows = np.asarray(table)
    return float(np.interp(value, rows[:, 0], rows[:, 1]))


def derated(torque: FloatArray, shifted: FloatArray, still: float, share: float) -> FloatArray:
    """Return continuous torques left of a share at standstill: the least of the ways in use.

    `shifted` is the curve at speeds over the share: shrunk towards zero in both directions.
    """
    if share >= 1:
        return torque
    left = np.sqrt(np.maximum(torque**2 - still**2 * (1 - share**2), 0.0))
    return np.asarray(np.minimum(left, share * shifted))
