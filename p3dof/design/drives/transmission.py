"""What stands between a motor and a slider: screw or belt, and perhaps a gear.

References
----------
Efficiencies of a screw: lead angle β, friction angle ρ, η = tan β / tan(β + ρ), backwards tan(β - ρ) / tan β,
which is near 2 - 1/η for small angles. Critical speed and buckling: Bernoulli's and Euler's beams.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from p3dof._base.checks import FloatArray, Readable, not_negative
from p3dof._base.errors import DriveError
from p3dof.design.drives.motor import Motor, above_zero, set_worth, share, text

STEEL, YOUNG = 7850.0, 2.1e11  # density [kg/m³] and Young's modulus [N/m²] of a steel screw

_BENDING: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "supported-supported": (math.pi**2, 1.0),
        "fixed-supported": (15.41820571698, 2.04574851594),
        "fixed-fixed": (22.37328544806, 4.0),
        "fixed-free": (3.51601526850, 0.25),
    }
)
"""How a screw is held, to λ² of its first bending vibration and the factor of its buckling load."""

_NUT = ("dynamic", "static", "static_safety")
_DESIGNATION = re.compile(r"(?<![\d.])(\d{1,3}(?:\.\d{1,3})?)\s?[x×X]\s?(\d{1,3}(?:\.\d{1,3})?)(?![\d.])")
"""As ISO 3408-1 designates ball screws: nominal diameter × lead, in mm."""

ENDS = tuple(_BENDING)  # how a screw may be held at its ends
USUAL_PRELOAD, MOST_PRELOAD = 0.05, 0.1  # preload of a nut by its dynamic rating: THK's largest is a tenth
STATIC_SAFETY, RACK_SAFETY = 2.0, 1.4  # of nuts (THK: without impact) and racks, where nothing is given
_V300 = {"1": 6e-6, "3": 12e-6, "5": 23e-6, "7": 52e-6, "10": 210e-6}
LEAD_GRADES: Mapping[str, float] = MappingProxyType(
    {kind + grade: value for kind in "PT" for grade, value in _V300.items() if kind == "T" or len(grade) < 2}
)
"""Tolerance grades of screws by ISO 3408-3, P for positioning, T for transport: deviation over 300 mm [m]."""


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
        Of the core, or root [m], for inertia, critical speed and buckling.
    nominal_diameter : float, optional
        Of the screw as it is sold [m], for the speed of the nut. Without it, the one of a designation such
        as 16x5 (diameter by lead) in the name, or 5/4 of the core.
    length : float, optional
        Between the bearings [m].
    ends : str
        How it is held, one of `ENDS`.
    drag : float, optional
        Torque of the preloaded nut, at the screw [N m]. Without it k F_pr lead / 2π, with the preload F_pr
        and k = 0.05 / √tan β (JIS B 1192), where `nominal_diameter` is given; else zero.
    max_speed : float, optional
        What the nut allows [rad/s]; infinite for any. Without it, 5,000 rpm and the DN value are looked at.
    dn : float, optional
        DN value: what nominal diameter times speed may be [mm rpm]; 70,000 is assumed without it.
    dynamic : float, optional
        Dynamic axial load rating C_a of the nut, for a million turns [N]; without it, no life is told.
    static : float, optional
        Static axial load rating C_0a of the nut [N].
    preload : float or str, optional
        F_pr of the nut [N], or its share of `dynamic` such as ``"5 %"``, which it is without it; at most a
        tenth. Zero for a nut with play.
    static_safety : float, optional
        How often the largest force goes into `static` at least: 2 without it; 5 is usual where there are
        impacts.
    lead_accuracy : float or str, optional
        Permissible deviation of the way over 300 mm [m], or its tolerance grade by ISO 3408-3, one of
        `LEAD_GRADES`, such as ``"T7"``.
    name : str
        What tables call it.
    cost, mass : float, optional
        As of a `Motor`.

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
    drag: float = None  # type: ignore[assignment]  # worked out below
    max_speed: float | None = None
    nominal_diameter: float | None = None
    dn: float | None = None
    name: str = "screw"
    dynamic: float | None = None
    static: float | None = None
    preload: float | str | None = None
    static_safety: float | None = None
    lead_accuracy: float | str | None = None
    cost: float | None = None
    mass: float | None = None

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        where = text("screw: name", self.name)
        for name in ("lead", "diameter", "length", "nominal_diameter", "dn", *_NUT):
            value = getattr(self, name)
            if value is not None:
                set_(self, name, above_zero(f"{where}: {name}", value))
        nominal = self.nominal_diameter
        if nominal is not None and self.diameter is not None and nominal < self.diameter:
            raise DriveError(
                f"{where}: nominal_diameter: expected at least that of the core, got {nominal:g} m"
            )
        _set_efficiencies(self, where)
        if isinstance(self.lead_accuracy, str):
            if self.lead_accuracy not in LEAD_GRADES:
                known = ", ".join(LEAD_GRADES)
                raise DriveError(
                    f"{where}: lead_accuracy: expected a length over 300 mm or one of {known}, "
                    f"got {self.lead_accuracy!r}"
                )
        elif self.lead_accuracy is not None:
            set_(self, "lead_accuracy", above_zero(f"{where}: lead_accuracy", self.lead_accuracy))
        self._check_preload(where)
        drag = self._preload_drag() if self.drag is None else self.drag
        set_(self, "drag", not_negative(f"{where}: drag", drag, DriveError))
        if self.max_speed not in (None, math.inf):
            set_(self, "max_speed", above_zero(f"{where}: max_speed", self.max_speed))
        if self.ends not in ENDS:
            raise DriveError(f"{where}: ends: expected one of {', '.join(ENDS)}, got {self.ends!r}")
        if self.inertia is not None:
            set_(self, "inertia", not_negative(f"{where}: inertia", self.inertia, DriveError))
        elif self.diameter is not None and self.length is not None:
            set_(self, "inertia", math.pi * STEEL * self.diameter**4 * self.length / 32)
        else:
            raise DriveError(f"{where}: expected an inertia, or a diameter and a length")

    def _check_preload(self, where: str) -> None:
        """Check the preload; a share of the dynamic rating stays as it is."""
        if self.preload is None:
            return
        if isinstance(self.preload, str):
            most = share(f"{where}: preload", self.preload, zero=True)
        else:
            force = not_negative(f"{where}: preload", self.preload, DriveError)
            object.__setattr__(self, "preload", force)
            most = 0.0 if self.dynamic is None else force / self.dynamic
        if isinstance(self.preload, str) and self.dynamic is None:
            raise DriveError(f"{where}: preload: a share needs the dynamic rating that it is of")
        if most > MOST_PRELOAD * (1 + 1e-12):
            raise DriveError(
                f"{where}: preload: expected at most {MOST_PRELOAD:.0%} of the dynamic rating, got {most:.3%}"
            )

    @property
    def preload_force(self) -> float:
        """Preload of the nut [N]: 5 % of its dynamic rating where nothing is known; zero without one."""
        if isinstance(self.preload, str):
            return share("preload", self.preload, zero=True) * float(self.dynamic or 0.0)
        if self.preload is not None:
            return self.preload
        return USUAL_PRELOAD * float(self.dynamic or 0.0)

    def _preload_drag(self) -> float:
        """Return the torque that the preload takes [N m]; zero where the lead angle is not known."""
        if self.nominal_diameter is None:
            return 0.0
        tangent = self.lead / (math.pi * self.nominal_diameter)
        return 0.05 / math.sqrt(tangent) * self.preload_force * self.lead / (2 * math.pi)

    @property
    def lead_deviation(self) -> float:
        """Permissible deviation of the way over 300 mm [m]; NaN if nothing is known."""
        if isinstance(self.lead_accuracy, str):
            return LEAD_GRADES[self.lead_accuracy]
        return math.nan if self.lead_accuracy is None else self.lead_accuracy

    @property
    def ratio(self) -> float:
        """Angle of the screw by way of the nut [rad/m]."""
        return 2 * math.pi / self.lead

    @property
    def sold_diameter(self) -> tuple[float, str]:
        """Nominal diameter [m], or NaN, and in words where it comes from if nobody gave it."""
        if self.nominal_diameter is not None:
            return self.nominal_diameter, ""
        named = _DESIGNATION.search(self.name)
        if named is not None and math.isclose(float(named[2]) / 1e3, self.lead):
            nominal = float(named[1]) / 1e3
            if self.diameter is None or self.diameter < nominal < 2 * self.diameter:
                return nominal, f"nominal diameter of {self.name} by its designation, for its speed only"
        if self.diameter is None:
            return math.nan, ""
        return 1.25 * self.diameter, f"nominal diameter of {self.name} 5/4 of its core"

    @property
    def static_limit(self) -> float:
        """Largest force at the nut, its static rating by the safety that is asked for [N]; or infinite."""
        return math.inf if self.static is None else self.static / (self.static_safety or STATIC_SAFETY)

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
    """A belt or another drive with a constant ratio that acts on the slider along its way."""

    diameter: float  # pitch diameter of the pulley or pinion [m]
    efficiency: float = 0.95  # as of a `Screw`
    efficiency_back: float | None = None
    inertia: float = 0.0
    """Of pulleys and pinion about the driven axis [kg m²]; the belt's mass belongs to the slider."""
    drag: float = 0.0  # friction torque at the pulley [N m]
    max_speed: float = math.inf  # what is allowed [rad/s]; infinite if nothing is known
    name: str = "belt"  # what tables call it
    max_force: float = math.inf
    """Tangential force that the teeth in mesh pass on [N], as the maker gives it for width and pulley."""
    pretension: float = 0.0
    """Tension of each span at rest [N]; zero if nothing is known. Near a pulley one span takes all of the
    force, so that no span is slack as long as the force is below it."""
    max_tension: float = math.inf  # permissible tension of a span, pretension and force together [N]
    static_safety: float | None = None
    """How often the largest force goes into `max_force` at least: 1 of a belt without it."""
    cost: float | None = None  # as of a `Motor`
    mass: float | None = None

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        where = text(f"{type(self).__name__.lower()}: name", self.name)
        set_(self, "pretension", not_negative(f"{where}: pretension", self.pretension, DriveError))
        for name in ("max_force", "max_tension", "static_safety"):
            if getattr(self, name) not in (math.inf, None):
                set_(self, name, above_zero(f"{where}: {name}", getattr(self, name)))
        set_(self, "diameter", above_zero(f"{where}: diameter", self.diameter))
        _set_efficiencies(self, where)
        set_(self, "inertia", not_negative(f"{where}: inertia", self.inertia, DriveError))
        set_(self, "drag", not_negative(f"{where}: drag", self.drag, DriveError))
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
class Rack(Belt):
    """A rack and the pinion that rolls on it: a `Belt` without tension, with more reserve at its teeth.

    `diameter` is that of the pinion, `max_force` what the maker permits at its teeth; `static_safety` is
    `RACK_SAFETY` without it.
    """

    efficiency: float = 0.97
    name: str = "rack"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.pretension or self.max_tension < math.inf:
            raise DriveError(f"{self.name}: expected no pretension and no max_tension: a rack has none")


@dataclass(frozen=True)
class Gear:
    """A gear between motor and screw or belt."""

    ratio: float = 1.0  # speed of the motor by speed of the screw
    efficiency: float = 1.0  # as of a `Screw`
    efficiency_back: float | None = None
    inertia: float = 0.0  # at the motor's side [kg m²]
    max_speed: float = math.inf
    """What its input may turn [rad/s] and its output may bear [N m]; infinite if nothing is known."""
    max_torque: float = math.inf
    name: str = "no gear"  # what tables call it
    cost: float | None = None  # as of a `Motor`
    mass: float | None = None

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        where = text("gear: name", self.name)
        set_(self, "ratio", above_zero(f"{where}: ratio", self.ratio))
        _set_efficiencies(self, where)
        set_(self, "inertia", not_negative(f"{where}: inertia", self.inertia, DriveError))
        for name in ("max_speed", "max_torque"):
            if getattr(self, name) != math.inf:
                set_(self, name, above_zero(f"{where}: {name}", getattr(self, name)))


def _set_efficiencies(part: Screw | Belt | Gear, where: str) -> None:
    """Check the efficiencies of a part, and work out what it gives back where nobody says."""
    set_worth(part, where)
    forward = share(f"{where}: efficiency", part.efficiency)
    if part.efficiency_back is None:
        back = max(0.0, 2 - 1 / forward)
    else:
        back = share(f"{where}: efficiency_back", part.efficiency_back, zero=True)
    object.__setattr__(part, "efficiency", forward)
    object.__setattr__(part, "efficiency_back", back)


@dataclass(frozen=True, eq=False)
class Drive(Readable):
    """Motor, gear and screw or belt of one actuator.

    Parameters
    ----------
    motor : Motor
        The motor.
    transmission : Screw or Belt
        What moves the slider.
    gear : Gear
        Between the two; none by default.
    name : str
        What tables call it; made of the parts without one.

    Raises
    ------
    DriveError
        If a part is something else.
    """

    motor: Motor
    transmission: Screw | Belt
    gear: Gear = field(default_factory=Gear)
    name: str = ""

    def __post_init__(self) -> None:
        for part, kinds in (("motor", Motor), ("transmission", (Screw, Belt)), ("gear", Gear)):
            if not isinstance(getattr(self, part), kinds):
                raise DriveError(
                    f"{part}: expected {_kinds(kinds)}, got {type(getattr(self, part)).__name__}"
                )
        text("drive: name", self.name)
        if not self.name:
            parts = [self.motor.name, self.transmission.name]
            if self.gear.ratio != 1 or self.gear.name != Gear().name:
                parts.insert(1, self.gear.name)
            object.__setattr__(self, "name", " + ".join(parts))

    @property
    def ratio(self) -> float:
        """Angle of the motor by way of the slider [rad/m]."""
        return self.gear.ratio * self.transmission.ratio

    @property
    def fast_inertia(self) -> float:
        """Of all that turns with the motor [kg m²]."""
        return self.motor.inertia + self.motor.coupling_inertia + self.gear.inertia

    @property
    def reflected_mass(self) -> float:
        """What the turning parts add to the mass of the slider, each by the ratio of its own shaft [kg]."""
        slow = float(self.transmission.inertia or 0.0)
        return self.fast_inertia * self.ratio**2 + slow * self.transmission.ratio**2

    def torque(self, force: FloatArray, speed: FloatArray, acceleration: FloatArray) -> FloatArray:
        """Return the torque of the motor, shape (...) [N m].

        Stage by stage from the slider: efficiency acts on the power that passes, in its direction; what the
        turning parts take for themselves is added where they turn. At rest there is no direction: the torque
        is that without losses, in the middle of those that hold.

        Parameters
        ----------
        force : ndarray, shape (...)
            On the slider, along its way, without the reflected mass [N].
        speed, acceleration : ndarray, shape (...)
            Of the slider [m/s, m/s²].
        """
        at_screw = self.screw_torque(force, speed, acceleration)
        at_motor = passed(at_screw * speed, at_screw / self.gear.ratio, self.gear)
        own = self.fast_inertia * self.ratio * acceleration + self.motor.drag * np.sign(speed)
        return np.asarray(at_motor + own)

    def screw_torque(self, force: FloatArray, speed: FloatArray, acceleration: FloatArray) -> FloatArray:
        """Return the torque at the output of the gear, arguments as of `torque`, in (...) [N m]."""
        slow = self.transmission
        found = passed(force * speed, force / slow.ratio, slow)
        return np.asarray(
            found + float(slow.inertia or 0.0) * slow.ratio * acceleration + slow.drag * np.sign(speed)
        )


def passed(power: FloatArray, torque: FloatArray, stage: Screw | Belt | Gear) -> FloatArray:
    """Return the torque before a stage, given that behind it without losses, and the sign of the power."""
    back = float(stage.efficiency_back or 0.0)
    return np.asarray(torque * np.where(power > 0, 1 / stage.efficiency, np.where(power < 0, back, 1.0)))


def _kinds(kinds: object) -> str:
    return " or ".join(kind.__name__ for kind in (kinds if isinstance(kinds, tuple) else (kinds,)))
