"""What stands between a motor and a slider: screw or belt, and perhaps a gear.

References
----------
Efficiencies of a screw: lead angle β, friction angle ρ, η = tan β / tan(β + ρ), backwards tan(β - ρ) / tan β,
which is near 2 - 1/η for small angles. Critical speed and buckling: Bernoulli's and Euler's beams.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from p3dof._base.errors import DriveError
from p3dof.design.drives.checked import above_zero, from_zero, share, text

STEEL, YOUNG = 7850.0, 2.1e11
"""Density [kg/m³] and Young's modulus [N/m²] of a steel screw."""

_BENDING: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "supported-supported": (math.pi**2, 1.0),
        "fixed-supported": (15.41820571698, 2.04574851594),
        "fixed-fixed": (22.37328544806, 4.0),
        "fixed-free": (3.51601526850, 0.25),
    }
)
"""How a screw is held, to λ² of its first bending vibration and the factor of its buckling load."""

ENDS = tuple(_BENDING)
"""How a screw may be held at its ends."""


@dataclass(frozen=True)
class Screw:
    """A screw that turns in a nut on the slider.

    Parameters
    ----------
    lead : float
        Way of the nut a turn [m].
    efficiency : float
        Share of the motor's work that comes to the nut.
    efficiency_back : float, optional
        Share of the nut's work that comes to the motor; 2 - 1/η without it, zero for a screw that holds
        itself.
    inertia : float, optional
        Of the screw about its axis [kg m²]; that of a steel cylinder of `diameter` and `length` without it.
    diameter : float, optional
        Of the core [m], for inertia, critical speed and buckling.
    length : float, optional
        Between the bearings [m].
    ends : str
        How it is held, one of `ENDS`.
    drag : float
        Torque of the preloaded nut, at the screw [N m].
    max_speed : float
        What the nut allows [rad/s]; infinite if nothing is known.
    name : str
        What tables call it.

    Raises
    ------
    DriveError
        If a number does not fit, or neither inertia nor diameter and length are given.
    """

    lead: float
    efficiency: float = 0.9
    efficiency_back: float | None = None
    inertia: float | None = None
    diameter: float | None = None
    length: float | None = None
    ends: str = "fixed-supported"
    drag: float = 0.0
    max_speed: float = math.inf
    name: str = "screw"

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        where = text("screw: name", self.name)
        for field in ("lead", "diameter", "length"):
            value = getattr(self, field)
            if value is not None:
                set_(self, field, above_zero(f"{where}: {field}", value))
        _set_efficiencies(self, where)
        set_(self, "drag", from_zero(f"{where}: drag", self.drag))
        if self.max_speed != math.inf:
            set_(self, "max_speed", above_zero(f"{where}: max_speed", self.max_speed))
        if self.ends not in ENDS:
            raise DriveError(f"{where}: ends: expected one of {', '.join(ENDS)}, got {self.ends!r}")
        if self.inertia is not None:
            set_(self, "inertia", from_zero(f"{where}: inertia", self.inertia))
        elif self.diameter is not None and self.length is not None:
            set_(self, "inertia", math.pi * STEEL * self.diameter**4 * self.length / 32)
        else:
            raise DriveError(f"{where}: expected an inertia, or a diameter and a length")

    @property
    def ratio(self) -> float:
        """Angle of the screw by way of the nut [rad/m]."""
        return 2 * math.pi / self.lead

    @property
    def critical_speed(self) -> float:
        """Speed at which the screw would whirl [rad/s]; infinite without diameter and length."""
        if self.diameter is None or self.length is None:
            return math.inf
        # √(E I / ρ A) of a full circle is √(E / ρ) d / 4.
        return _BENDING[self.ends][0] / self.length**2 * math.sqrt(YOUNG / STEEL) * self.diameter / 4

    @property
    def buckling_force(self) -> float:
        """Euler's load of the screw in compression [N]; infinite without diameter and length."""
        if self.diameter is None or self.length is None:
            return math.inf
        stiffness = YOUNG * math.pi * self.diameter**4 / 64
        return math.pi**2 * stiffness * _BENDING[self.ends][1] / self.length**2


@dataclass(frozen=True)
class Belt:
    """A belt, a rack or another drive with a constant ratio that acts on the slider along its way.

    Parameters
    ----------
    diameter : float
        Pitch diameter of the pulley or pinion [m].
    efficiency, efficiency_back : float
        As of a `Screw`.
    inertia : float
        Of pulleys and pinion about the driven axis [kg m²]; the belt's mass belongs to the slider.
    drag : float
        Friction torque at the pulley [N m].
    max_speed : float
        What is allowed [rad/s]; infinite if nothing is known.
    name : str
        What tables call it.

    Raises
    ------
    DriveError
        If a number does not fit.
    """

    diameter: float
    efficiency: float = 0.95
    efficiency_back: float | None = None
    inertia: float = 0.0
    drag: float = 0.0
    max_speed: float = math.inf
    name: str = "belt"

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        where = text("belt: name", self.name)
        set_(self, "diameter", above_zero(f"{where}: diameter", self.diameter))
        _set_efficiencies(self, where)
        set_(self, "inertia", from_zero(f"{where}: inertia", self.inertia))
        set_(self, "drag", from_zero(f"{where}: drag", self.drag))
        if self.max_speed != math.inf:
            set_(self, "max_speed", above_zero(f"{where}: max_speed", self.max_speed))

    @property
    def ratio(self) -> float:
        """Angle of the pulley by way of the slider [rad/m]."""
        return 2 / self.diameter

    @property
    def critical_speed(self) -> float:
        """Infinite: nothing whirls."""
        return math.inf

    @property
    def buckling_force(self) -> float:
        """Infinite: nothing buckles."""
        return math.inf


@dataclass(frozen=True)
class Gear:
    """A gear between motor and screw or belt.

    Parameters
    ----------
    ratio : float
        Speed of the motor by speed of the screw.
    efficiency, efficiency_back : float
        As of a `Screw`.
    inertia : float
        At the motor's side [kg m²].
    max_speed, max_torque : float
        What its input may turn [rad/s] and its output may bear [N m]; infinite if nothing is known.
    name : str
        What tables call it.

    Raises
    ------
    DriveError
        If a number does not fit.
    """

    ratio: float = 1.0
    efficiency: float = 1.0
    efficiency_back: float | None = None
    inertia: float = 0.0
    max_speed: float = math.inf
    max_torque: float = math.inf
    name: str = "no gear"

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        where = text("gear: name", self.name)
        set_(self, "ratio", above_zero(f"{where}: ratio", self.ratio))
        _set_efficiencies(self, where)
        set_(self, "inertia", from_zero(f"{where}: inertia", self.inertia))
        for field in ("max_speed", "max_torque"):
            if getattr(self, field) != math.inf:
                set_(self, field, above_zero(f"{where}: {field}", getattr(self, field)))


def _set_efficiencies(part: Screw | Belt | Gear, where: str) -> None:
    """Check the efficiencies of a part, and work out what it gives back where nobody says."""
    forward = share(f"{where}: efficiency", part.efficiency)
    if part.efficiency_back is None:
        back = max(0.0, 2 - 1 / forward)
    else:
        back = share(f"{where}: efficiency_back", part.efficiency_back, zero=True)
    object.__setattr__(part, "efficiency", forward)
    object.__setattr__(part, "efficiency_back", back)
