"""`Winding`: what a bus voltage lets a motor with permanent magnets give, by speed.

In a frame that turns with the magnets, with peak values of one phase,

    T = 3/2 p ψ i_q,   (R i_d - ω L i_q)² + (R i_q + ω (L i_d + ψ))² <= U_dc² / 3,   i_d² + i_q² <= i_max²

with ω = p times the speed: two discs in the plane of i_d and i_q. Without field weakening i_d = 0.

References
----------
T. M. Jahns, IEEE Trans. Industry Applications IA-23 (1987) 681: torque and flux weakening of such motors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import DriveError
from p3dof.design.drives.checked import above_zero, from_zero

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

    Parameters
    ----------
    bus_voltage : float
        Of the drive's direct-current bus, the lowest at full load [V].
    pole_pairs : int
        p.
    resistance : float
        At the temperature of use [Ω].
    inductance : float
        [H]
    measured : {"phase", "between lines"}
        What these two are of.
    flux : float, optional
        ψ, peak value of one phase [V s]. Exactly one of this and the next three is needed.
    torque_constant_rms, torque_constant_peak : float, optional
        Torque by the rms or the peak value of the phase current [N m/A].
    voltage_constant : float, optional
        Voltage between two lines, rms, at 1000 rpm [V].
    max_current_rms, max_current_peak : float, optional
        Largest phase current for a moment, exactly one of the two [A].
    field_weakening : bool
        Whether the drive sets i_d below zero for more speed.

    Raises
    ------
    DriveError
        If a number does not fit, or one is missing or given twice.
    """

    bus_voltage: float
    pole_pairs: int
    resistance: float
    inductance: float
    measured: str
    flux: float | None = None
    torque_constant_rms: float | None = None
    torque_constant_peak: float | None = None
    voltage_constant: float | None = None
    max_current_rms: float | None = None
    max_current_peak: float | None = None
    field_weakening: bool = False

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        for name in ("bus_voltage", "inductance"):
            set_(self, name, above_zero(f"winding: {name}", getattr(self, name)))
        set_(self, "resistance", from_zero("winding: resistance", self.resistance))
        if isinstance(self.pole_pairs, bool) or not isinstance(self.pole_pairs, int) or self.pole_pairs < 1:
            raise DriveError(f"winding: pole_pairs: expected a whole number, got {shown(self.pole_pairs)}")
        if self.measured not in MEASURED:
            raise DriveError(
                f"winding: measured: expected one of {', '.join(MEASURED)}, got {shown(self.measured)}"
            )
        if not isinstance(self.field_weakening, bool):
            raise DriveError("winding: field_weakening: expected true or false")
        for names in (_CONSTANTS, _CURRENTS):
            given = [name for name in names if getattr(self, name) is not None]
            if len(given) != 1:
                got = " and ".join(given) or "none"
                raise DriveError(f"winding: expected exactly one of {', '.join(names)}, got {got}")
            set_(self, given[0], above_zero(f"winding: {given[0]}", getattr(self, given[0])))

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
        """Return the largest driving torque at speeds.

        Parameters
        ----------
        speed : ndarray, shape (...)
            Of the motor [rad/s].

        Returns
        -------
        ndarray, shape (...)
            [N m]; zero where the voltage is used up. Braking, a motor gives this much at least.
        """
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
