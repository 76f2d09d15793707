"""`Motor`: what a servo motor can do: torque by speed, for ever and for a moment.

`Winding`: what a bus voltage lets a motor with permanent magnets give, by speed. `Amplifier`: what feeds it.

In a frame that turns with the magnets, with peak values of one phase,

    T = 3/2 p ψ i_q,   (R i_d - ω L i_q)² + (R i_q + ω (L i_d + ψ))² <= U_dc² / 3,   i_d² + i_q² <= i_max²

with ω = p times the speed: two discs in the plane of i_d and i_q. Without field weakening i_d = 0.

References
----------
T. M. Jahns, IEEE Trans. Industry Applications IA-23 (1987) 681: torque and flux weakening of such motors.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, Readable, frozen_array, not_negative, shown
from p3dof._base.errors import DriveError
from p3dof.design.drives.margins import Ambient, derated, in_percent, table_share


def above_zero(what: str, value: Any) -> float:
    """Return a number above zero, or raise DriveError."""
    number = float(frozen_array(what, value, (), DriveError))
    if number <= 0:
        raise DriveError(f"{what}: expected a number above zero, got {number:g}")
    return number


def share(what: str, value: Any, zero: bool = False) -> float:
    """Return a number up to 1 and above 0, or 0 too; texts may be in percent. Or raise DriveError."""
    value = in_percent(what, value, "0.9 or '90 %'")
    number = not_negative(what, value, DriveError) if zero else above_zero(what, value)
    if number > 1:
        raise DriveError(f"{what}: expected at most 1, got {number:g}")
    return number


def set_worth(part: Any, where: str) -> None:
    """Check cost and mass of a part, where they are given."""
    for name in ("cost", "mass"):
        if getattr(part, name) is not None:
            object.__setattr__(part, name, not_negative(f"{where}: {name}", getattr(part, name), DriveError))


def _set_one_each(part: Any, where: str, *groups: Sequence[str]) -> None:
    """Check that exactly one number of each group is given, above zero."""
    for names in groups:
        given = [name for name in names if getattr(part, name) is not None]
        if len(given) != 1:
            got = " and ".join(given) or "none"
            raise DriveError(f"{where}: expected exactly one of {', '.join(names)}, got {got}")
        object.__setattr__(part, given[0], above_zero(f"{where}: {given[0]}", getattr(part, given[0])))


def text(what: str, value: Any) -> str:
    """Return a text, or raise DriveError."""
    if not isinstance(value, str):
        raise DriveError(f"{what}: expected a text, got {shown(value)}")
    return value


MEASURED = ("phase", "between lines")
"""How resistance and inductance may be given: those between two terminals are twice those of a phase."""
_CONSTANTS = ("flux", "torque_constant_rms", "torque_constant_peak", "voltage_constant")
_CURRENTS = ("max_current_rms", "max_current_peak")
_KRPM = 1000 * math.pi / 30
_CLOSE = 1e-12


@dataclass(frozen=True)
class Winding:
    """The winding of a motor with permanent magnets, and the voltage that it is fed with.

    Data sheets give the same quantities in ways that differ by √2, √3 or 2: each way has its own name here.
    """

    bus_voltage: float  # of the drive's direct-current bus, the lowest at full load [V]
    pole_pairs: int  # p
    resistance: float  # at the temperature of use [Ω]
    inductance: float  # [H]
    measured: str  # what these two are of
    flux: float | None = None
    """Ψ, peak value of one phase [V s]. Exactly one of this and the next three is needed."""
    torque_constant_rms: float | None = None
    """Torque by the rms or the peak value of the phase current [N m/A]."""
    torque_constant_peak: float | None = None
    voltage_constant: float | None = None  # voltage between two lines, rms, at 1000 rpm [V]
    max_current_rms: float | None = None  # largest phase current for a moment, exactly one of the two [A]
    max_current_peak: float | None = None
    field_weakening: bool = False  # whether the drive sets i_d below zero for more speed

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        for name in ("bus_voltage", "inductance"):
            set_(self, name, above_zero(f"winding: {name}", getattr(self, name)))
        set_(self, "resistance", not_negative("winding: resistance", self.resistance, DriveError))
        if isinstance(self.pole_pairs, bool) or not isinstance(self.pole_pairs, int) or self.pole_pairs < 1:
            raise DriveError(f"winding: pole_pairs: expected a whole number, got {shown(self.pole_pairs)}")
        if self.measured not in MEASURED:
            raise DriveError(
                f"winding: measured: expected one of {', '.join(MEASURED)}, got {shown(self.measured)}"
            )
        if not isinstance(self.field_weakening, bool):
            raise DriveError("winding: field_weakening: expected true or false")
        _set_one_each(self, "winding", _CONSTANTS, _CURRENTS)

    @property
    def peak_flux(self) -> float:
        """ψ, peak value of one phase [V s]."""
        if self.flux is not None:
            return self.flux
        if self.torque_constant_peak is not None:
            return self.torque_constant_peak / (1.5 * self.pole_pairs)
        if self.torque_constant_rms is not None:
            return self.torque_constant_rms / (1.5 * math.sqrt(2) * self.pole_pairs)
        return float(self.voltage_constant or 0.0) * math.sqrt(2 / 3) / (self.pole_pairs * _KRPM)

    @property
    def current(self) -> float:
        """Largest peak value of the phase current [A]."""
        if self.max_current_peak is not None:
            return self.max_current_peak
        return math.sqrt(2) * float(self.max_current_rms or 0.0)

    @property
    def stall_torque(self) -> float:
        """Torque of the largest current with i_d = 0 [N m]."""
        return 1.5 * self.pole_pairs * self.peak_flux * self.current

    def torque(self, speed: FloatArray) -> FloatArray:
        """Return the largest driving torque at speeds; ndarray, shape (...)."""
        half = 0.5 if self.measured == MEASURED[1] else 1.0
        resistance, inductance = half * self.resistance, half * self.inductance
        turning = self.pole_pairs * np.abs(np.asarray(speed, dtype=float))
        impedance = resistance + 1j * turning * inductance
        size = np.maximum(np.abs(impedance), 1e-300)
        middle = -1j * turning * self.peak_flux / np.where(impedance == 0, 1e-300, impedance)
        reach, most = self.bus_voltage / math.sqrt(3) / size, self.current
        if self.field_weakening:
            current = _highest(middle, reach, most)
        else:  # where the axis of i_q leaves the disc
            inside = reach**2 - middle.real**2
            current = np.where(inside >= 0, middle.imag + np.sqrt(np.maximum(inside, 0.0)), 0.0)
        return np.asarray(1.5 * self.pole_pairs * self.peak_flux * np.clip(current, 0.0, most))


def _highest(middle: FloatArray, reach: FloatArray, most: float) -> FloatArray:
    """Return the largest i_q in a disc about `middle` and one of radius `most` about zero; zero for none."""
    slack = 1 + _CLOSE
    top = middle + 1j * reach
    apart = np.where(middle == 0, 1.0, np.abs(middle))
    along = (most**2 - reach**2 + apart**2) / (2 * apart)
    across = np.sqrt(np.maximum(most**2 - along**2, 0.0))
    unit = middle / apart
    found: FloatArray = np.zeros_like(reach)
    candidates = (
        (1j * most * np.ones_like(middle), np.abs(1j * most - middle) <= reach * slack),
        (top, np.abs(top) <= most * slack),
        (unit * (along + 1j * across), np.abs(along) <= most),
        (unit * (along - 1j * across), np.abs(along) <= most),
    )
    for place, good in candidates:
        found = np.where(good, np.maximum(found, place.imag), found)
    return found


_RATED = ("rated_current_rms", "rated_current_peak")


@dataclass(frozen=True)
class Amplifier:
    """The amplifier of a motor: phase currents by rms or by peak value, each with its own name."""

    rated_current_rms: float | None = None  # phase current for ever, exactly one of the two [A]
    rated_current_peak: float | None = None
    max_current_rms: float | None = None  # largest phase current for a moment, exactly one of the two [A]
    max_current_peak: float | None = None
    max_current_time: float = math.inf
    """How long at a stretch the current may be above the rated one [s]; infinite if nothing is known."""
    max_power: float = math.inf  # what it gives to the motor, with the losses of the winding [W]
    max_voltage: float = math.inf  # what its direct-current bus bears [V]; both infinite if not known
    name: str = "amplifier"  # what tables call it

    def __post_init__(self) -> None:
        where = text("amplifier: name", self.name)
        _set_one_each(self, where, _RATED, _CURRENTS)
        for name in ("max_current_time", "max_power", "max_voltage"):
            if getattr(self, name) != math.inf:
                object.__setattr__(self, name, above_zero(f"{where}: {name}", getattr(self, name)))
        if self.max_current < self.rated_current:
            raise DriveError(f"{where}: max_current: expected at least the rated one")

    @property
    def rated_current(self) -> float:
        """Rms phase current for ever [A]."""
        return _rms(self.rated_current_rms, self.rated_current_peak)

    @property
    def max_current(self) -> float:
        """Largest rms phase current for a moment [A]."""
        return _rms(self.max_current_rms, self.max_current_peak)


def _rms(rms: float | None, peak: float | None) -> float:
    return float(peak or 0.0) / math.sqrt(2) if rms is None else rms


_DOUBT = 1.1  # a peak torque so many times over what the winding gives has another unit than it says


@dataclass(frozen=True, eq=False)
class Motor(Readable):
    """A motor with its rotor, and perhaps a brake.

    Parameters
    ----------
    rated_torque : float
        What it gives for ever, at any speed up to `rated_speed` [N m].
    peak_torque : float
        What it gives for a moment, at standstill [N m].
    max_speed : float
        Fastest speed [rad/s].
    inertia : float
        Of the rotor, with that of brake and encoder [kg m²].
    rated_speed : float, optional
        [rad/s]; `max_speed` without it.
    curve : sequence of (speed, continuous torque, peak torque), optional
        The torque-speed curve, by rising speed from 0 [rad/s, N m, N m]; straight between its points. Without
        it the rated torque holds up to the rated speed, falls to its share rated_speed / max_speed at the
        fastest speed, and the peak torque holds up to the rated speed and falls to the rated one there.
    brake_torque : float
        What the holding brake holds [N m]; zero for none.
    coupling_inertia : float
        Of the coupling at its shaft [kg m²].
    drag : float
        Friction torque of its bearings and seals [N m].
    time_constant : float, optional
        Thermal [s]; without it, heating within the cycle is not checked.
    max_inertia_ratio : float, optional
        Largest inertia of the load at its shaft by that of the rotor that its control takes; 10 is assumed
        without it, and infinite is any. The screw is no part of the load.
    max_power, max_braking_power : float
        Largest power that its amplifier gives, and that it and its braking resistor take back, both at the
        shaft [W]; infinite if nothing is known.
    temperature_rise : float
        What its winding may be warmer than the air, for derating [K].
    rated_ambient : float
        Temperature of the air up to which its ratings hold [°C].
    derating_temperature, derating_altitude : sequence of (value, share), optional
        The maker's own shares of the continuous torque, by temperature of the air [°C] and by altitude [m],
        straight between their points; each stands for its part of the physics of one body.
    winding : Winding, optional
        What its drive's voltage lets it give: less than the curve says at high speeds. Without a curve, the
        peak torque then holds up to the fastest speed as far as the winding allows.
    torque_constant_rms, torque_constant_peak : float, optional
        Torque by the rms or the peak value of the phase current [N m/A], for a motor without a `winding`; one
        of the two at most.
    phase_resistance : float, optional
        Of one phase [Ω], for the losses of a motor without a `winding`; it needs a torque constant.
    amplifier : Amplifier, optional
        What feeds it; it needs a torque constant or a `winding`.
    brake_time : float
        From the loss of power until the brake bears [s].
    brake_energy : float
        Largest energy of a stop that the brake takes [J]; infinite if nothing is known.
    name : str
        What tables call it.
    cost, mass : float, optional
        In any unit of money, the same for all parts; with its brake [kg].

    Raises
    ------
    DriveError
        If a number does not fit.
    """

    rated_torque: float
    peak_torque: float
    max_speed: float
    inertia: float
    rated_speed: float | None = None
    curve: Sequence[Sequence[float]] | None = None
    brake_torque: float = 0.0
    coupling_inertia: float = 0.0
    drag: float = 0.0
    time_constant: float | None = None
    max_inertia_ratio: float | None = None
    max_power: float = math.inf
    max_braking_power: float = math.inf
    temperature_rise: float = 100.0
    rated_ambient: float = 40.0
    derating_temperature: Sequence[Sequence[float]] | None = None
    derating_altitude: Sequence[Sequence[float]] | None = None
    winding: Winding | None = None
    torque_constant_rms: float | None = None
    torque_constant_peak: float | None = None
    phase_resistance: float | None = None
    amplifier: Amplifier | None = None
    brake_time: float = 0.0
    brake_energy: float = math.inf
    name: str = "motor"
    cost: float | None = None
    mass: float | None = None

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        where = text("motor: name", self.name)
        for field in ("rated_torque", "peak_torque", "max_speed"):
            set_(self, field, above_zero(f"{where}: {field}", getattr(self, field)))
        for field in ("inertia", "brake_torque", "coupling_inertia", "drag", "brake_time"):
            set_(self, field, not_negative(f"{where}: {field}", getattr(self, field), DriveError))
        rated = self.max_speed if self.rated_speed is None else self.rated_speed
        set_(self, "rated_speed", above_zero(f"{where}: rated_speed", rated))
        if self.time_constant is not None:
            set_(self, "time_constant", above_zero(f"{where}: time_constant", self.time_constant))
        set_(self, "temperature_rise", above_zero(f"{where}: temperature_rise", self.temperature_rise))
        set_(self, "rated_ambient", Ambient(self.rated_ambient).temperature)
        for field in ("derating_temperature", "derating_altitude"):
            set_(self, field, _shares(f"{where}: {field}", getattr(self, field)))
        for field in ("max_inertia_ratio", "max_power", "max_braking_power", "brake_energy"):
            if getattr(self, field) not in (None, math.inf):
                set_(self, field, above_zero(f"{where}: {field}", getattr(self, field)))
        set_worth(self, where)
        if self.peak_torque < self.rated_torque:
            raise DriveError(
                f"{where}: peak_torque: expected at least the rated torque, {self.rated_torque:g} N m, "
                f"got {self.peak_torque:g} N m"
            )
        if rated > self.max_speed:
            raise DriveError(f"{where}: rated_speed: expected up to {self.max_speed:g} rad/s, got {rated:g}")
        self._check_winding(where)
        self._check_currents(where)
        set_(self, "curve", self._points(where))

    def _check_winding(self, where: str) -> None:
        if self.winding is None:
            return
        if not isinstance(self.winding, Winding):
            raise DriveError(f"{where}: winding: expected a Winding, got {shown(self.winding)}")
        most = self.winding.stall_torque
        if self.peak_torque > _DOUBT * most:
            raise DriveError(
                f"{where}: peak_torque: {self.peak_torque:g} N m is more than the {most:g} N m of the "
                f"winding's constant and largest current: is each of them by rms or by peak value?"
            )

    def continuous(self, speed: FloatArray, share: float = 1.0) -> FloatArray:
        """Return what it gives for ever at speeds [rad/s], of which heat leaves a share at standstill.

        In (...) [N m]; zero above the fastest. `share` is that of `heat_share`.
        """
        found = self._at(speed, 1)
        if share >= 1:
            return found
        shifted = np.minimum(np.abs(speed) / max(share, 1e-9), self.max_speed)
        return derated(found, self._at(shifted, 1), float(np.asarray(self.curve)[0, 1]), share)

    def heat_share(self, ambient: Ambient) -> float:
        """Return the share of the continuous torque at standstill that a place leaves; at most 1."""
        left, share = ambient, 1.0
        if self.derating_temperature is not None:
            share *= min(1.0, table_share(self.derating_temperature, ambient.temperature))
            left = replace(left, temperature=self.rated_ambient)
        if self.derating_altitude is not None:
            share *= min(1.0, table_share(self.derating_altitude, ambient.altitude))
            left = replace(left, altitude=0.0)
        return share * min(1.0, left.heat_share(self.temperature_rise, self.rated_ambient))

    def _check_currents(self, where: str) -> None:
        """Raise if currents cannot be told from torques, or in two ways."""
        names = ("torque_constant_rms", "torque_constant_peak", "phase_resistance")
        given = [name for name in names if getattr(self, name) is not None]
        for name in given:
            object.__setattr__(self, name, above_zero(f"{where}: {name}", getattr(self, name)))
        if given and self.winding is not None:
            raise DriveError(f"{where}: {given[0]}: the winding has it already")
        if given[:2] == list(names[:2]):
            raise DriveError(f"{where}: expected at most one of {names[0]}, {names[1]}")
        if given == [names[2]]:
            raise DriveError(f"{where}: phase_resistance: expected a torque constant with it")
        if not isinstance(self.amplifier, Amplifier | None):
            raise DriveError(f"{where}: amplifier: expected an Amplifier, got {shown(self.amplifier)}")
        if self.amplifier is not None and self.torque_constant is None:
            raise DriveError(
                f"{where}: amplifier: expected a winding, torque_constant_rms or torque_constant_peak with it"
            )

    @property
    def torque_constant(self) -> float | None:
        """Torque by the rms phase current [N m/A]; None if nothing is known."""
        if self.winding is not None:
            return 1.5 * math.sqrt(2) * self.winding.pole_pairs * self.winding.peak_flux
        if self.torque_constant_peak is not None:
            return math.sqrt(2) * self.torque_constant_peak
        return self.torque_constant_rms

    @property
    def resistance(self) -> float | None:
        """Of one phase [Ω]; None if nothing is known."""
        if self.winding is None:
            return self.phase_resistance
        return (0.5 if self.winding.measured == MEASURED[1] else 1.0) * self.winding.resistance

    def copper_loss(self, torque: FloatArray) -> FloatArray:
        """Return the power that torques (...) [N m] turn into heat in the winding, 3R(T/k_t)², in (...) [W].

        Zero if resistance or torque constant is not known.
        """
        if self.torque_constant is None or self.resistance is None:
            return np.zeros_like(torque)
        return np.asarray(3 * self.resistance * (torque / self.torque_constant) ** 2)

    def peak(self, speed: FloatArray) -> FloatArray:
        """Return what it gives for a moment at speeds (...) [rad/s], in (...) [N m]; zero if too fast."""
        return self._at(speed, 2)

    def too_fast(self, speed: FloatArray) -> NDArray[np.bool_]:
        """Return whether speeds (...) [rad/s] are above the fastest, but for rounding."""
        return np.asarray(np.abs(speed) > self.max_speed * (1 + 1e-12))

    def _at(self, speed: FloatArray, column: int) -> FloatArray:
        points = np.asarray(self.curve)
        found = np.interp(np.abs(speed), points[:, 0], points[:, column])
        if self.winding is not None:
            found = np.minimum(found, self.winding.torque(speed))
        return np.where(self.too_fast(speed), 0.0, found)

    def _points(self, where: str) -> FloatArray:
        if self.curve is not None:
            points = frozen_array(f"{where}: curve", self.curve, ("N", 3), DriveError)
            if len(points) < 2 or points[0, 0] != 0 or (np.diff(points[:, 0]) <= 0).any():
                raise DriveError(f"{where}: curve: expected rising speeds from 0, two at least")
            if (points < 0).any() or (points[:, 1] > points[:, 2]).any():
                raise DriveError(f"{where}: curve: expected continuous torques from zero to the peak torques")
            if points[-1, 0] < self.max_speed:
                raise DriveError(
                    f"{where}: curve: expected points up to the fastest speed, {self.max_speed:g} rad/s"
                )
            return points
        rated = float(self.rated_speed or math.nan)
        slow = [[0.0, self.rated_torque, self.peak_torque]]
        if rated < self.max_speed:
            slow.append([rated, self.rated_torque, self.peak_torque])
            left = self.rated_torque * rated / self.max_speed
            peak = self.rated_torque if self.winding is None else self.peak_torque
            return np.array([*slow, [self.max_speed, left, peak]])
        return np.array([*slow, [self.max_speed, self.rated_torque, self.peak_torque]])


def _shares(what: str, given: Any) -> FloatArray | None:
    """Return rows of (value, share) by rising value, or None, or raise DriveError."""
    if given is None:
        return None
    rows = frozen_array(what, given, ("N", 2), DriveError)
    if not len(rows) or (np.diff(rows[:, 0]) <= 0).any() or (rows[:, 1] < 0).any() or (rows[:, 1] > 2).any():
        raise DriveError(f"{what}: expected rows of a rising value and a share, such as [[40, 1], [50, 0.9]]")
    return rows
