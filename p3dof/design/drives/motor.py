"""`Motor`: what a servo motor can do: torque by speed, for ever and for a moment."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, frozen_array, shown
from p3dof._base.errors import DriveError
from p3dof.design.drives.checked import above_zero, from_zero, text
from p3dof.design.drives.winding import Winding

_DOUBT = 1.1
"""A peak torque so many times over what the winding gives has another unit than it says."""


@dataclass(frozen=True, eq=False)
class Motor:
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
    max_inertia_ratio : float
        Largest inertia of the load at its shaft by that of the rotor that its control takes; infinite if
        nothing is known.
    max_power, max_braking_power : float
        Largest power that its amplifier gives, and that it and its braking resistor take back, both at the
        shaft [W]; infinite if nothing is known.
    winding : Winding, optional
        What its drive's voltage lets it give: less than the curve says at high speeds. Without a curve, the
        peak torque then holds up to the fastest speed as far as the winding allows.
    name : str
        What tables call it.

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
    max_inertia_ratio: float = math.inf
    max_power: float = math.inf
    max_braking_power: float = math.inf
    winding: Winding | None = None
    name: str = "motor"

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        where = text("motor: name", self.name)
        for field in ("rated_torque", "peak_torque", "max_speed"):
            set_(self, field, above_zero(f"{where}: {field}", getattr(self, field)))
        for field in ("inertia", "brake_torque", "coupling_inertia", "drag"):
            set_(self, field, from_zero(f"{where}: {field}", getattr(self, field)))
        rated = self.max_speed if self.rated_speed is None else self.rated_speed
        set_(self, "rated_speed", above_zero(f"{where}: rated_speed", rated))
        if self.time_constant is not None:
            set_(self, "time_constant", above_zero(f"{where}: time_constant", self.time_constant))
        for field in ("max_inertia_ratio", "max_power", "max_braking_power"):
            if getattr(self, field) != math.inf:
                set_(self, field, above_zero(f"{where}: {field}", getattr(self, field)))
        if self.peak_torque < self.rated_torque:
            raise DriveError(
                f"{where}: peak_torque: expected at least the rated torque, {self.rated_torque:g} N m"
            )
        if rated > self.max_speed:
            raise DriveError(f"{where}: rated_speed: expected at most the fastest, {self.max_speed:g} rad/s")
        self._check_winding(where)
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

    def continuous(self, speed: FloatArray) -> FloatArray:
        """Return what it gives for ever at speeds (...) [rad/s], in (...) [N m]; zero above the fastest."""
        return self._at(speed, 1)

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
