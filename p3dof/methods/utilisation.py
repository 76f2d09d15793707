"""How much of each limit a motion uses, and when."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from p3dof._base.checks import FloatArray, Readable
from p3dof._base.errors import InputError
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import LEGS, Limits

UNITS = {"force": "N", "speed": "m/s", "travel": "m", "tilt": "rad"}
"""Of the quantities that have limits."""


@dataclass(frozen=True)
class Utilisation(Readable):
    """How much of one limit a motion uses, at the sample where it uses most of it.

    Parameters
    ----------
    quantity : str
        ``"force"``, ``"speed"``, ``"travel"`` or ``"tilt"``.
    leg : str
        ``"A"``, ``"B"``, ``"C"``, or ``"platform"`` for the tilt.
    value, limit : float
        The value then, and the limit on its side [N, m/s, m or rad]; NaN if there is no largest value, as of
        forces and speeds when a sample is invalid.
    time : float
        When [s].
    """

    quantity: str
    leg: str
    value: float
    limit: float
    time: float

    @property
    def share(self) -> float:
        """Value by limit: 1 at the limit."""
        return self.value / self.limit

    @property
    def unit(self) -> str:
        """Of value and limit."""
        return UNITS[self.quantity]


def utilisations(time: FloatArray, used: Mapping[str, FloatArray], limits: Limits) -> tuple[Utilisation, ...]:
    """Return how much of each limit a motion uses, at the sample where it uses most of it.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Times of the samples [s].
    used : mapping of str to ndarray
        Force, speed and travel of A, B and C (N, 3), and the tilt of the platform (N, 1) [N, m/s, m, rad].
    limits : Limits
        What the actuators can do.

    Returns
    -------
    tuple of Utilisation
        In the order of `used`. Of a peak between samples the time is that of the parabola through the three
        samples around it.

    Raises
    ------
    InputError
        If `limits` is not a `Limits`.
    """
    if not isinstance(limits, Limits):
        raise InputError(f"limits: expected Limits, got {type(limits).__name__}")
    ends = {
        "force": (-limits.force, limits.force),
        "speed": (-limits.speed, limits.speed),
        "travel": limits.travel,
        "tilt": limits.tilt,
    }
    return tuple(
        _most_of(quantity, name, time, column, ends[quantity])
        for quantity, values in used.items()
        for name, column in zip(LEGS if values.shape[1] > 1 else ("platform",), values.T, strict=True)
    )


def _most_of(
    quantity: str, name: str, time: FloatArray, values: FloatArray, ends: tuple[float, float]
) -> Utilisation:
    """Return where values come nearest to either end of a range around zero, or exceed it the most."""
    limits = np.where(values < 0, *ends)
    shares = np.nan_to_num(values / limits, nan=-1.0)
    most = int(np.argmax(shares))
    if shares[most] < 0:
        return Utilisation(quantity, name, np.nan, ends[1], np.nan)
    when = time_of_peak(time, values, most)
    return Utilisation(quantity, name, float(values[most]), float(limits[most]), when)


def time_of_peak(time: FloatArray, values: FloatArray, sample: int) -> float:
    """Return when values peak that are largest or smallest at a sample.

    That of the vertex of the parabola through the sample and its neighbours; that of the sample itself at an
    end, beside a value that is not known, at a jump (two samples of one time, but for rounding), and where
    the three lie on a line [s].
    """
    when = float(time[sample])
    if not 0 < sample < len(time) - 1:
        return when
    if np.nextafter(time[sample - 1], np.inf) >= when or np.nextafter(when, np.inf) >= time[sample + 1]:
        return when
    before, after = time[sample - 1] - when, time[sample + 1] - when
    first, last = (values[sample + side] - values[sample] for side in (-1, 1))
    slopes = first / before, last / after
    bend = (slopes[1] - slopes[0]) / (after - before)
    if not np.isfinite(bend) or bend == 0:
        return when
    slope = slopes[0] - bend * before  # at the sample: the parabola is slope * t + bend * t**2
    return when + float(np.clip(-slope / (2 * bend), before, after))


@dataclass(frozen=True)
class Exceedance(Readable):
    """A limit that a motion exceeds.

    Parameters
    ----------
    quantity : str
        ``"travel"``, ``"speed"``, ``"force"`` or ``"tilt"``.
    leg : str
        ``"A"``, ``"B"``, ``"C"``, or ``"platform"`` for the tilt.
    time : float
        When it is exceeded the most [s].
    value, limit : float
        The value then, and the limit [m, m/s, N or rad].
    """

    quantity: str
    leg: str
    time: float
    value: float
    limit: float

    _UNITS = {"travel": "m", "speed": "m/s", "force": "N", "tilt": "rad"}  # noqa: RUF012 - not a field

    def __str__(self) -> str:
        unit = self._UNITS[self.quantity]
        who = self.leg if self.leg == "platform" else f"slider {self.leg}"
        return (
            f"{self.quantity} of {who}: {self.value:g} {unit} at t = {self.time:g} s, "
            f"limit {self.limit:g} {unit}"
        )


def exceedances_of(
    limits: Limits, motion: Motion, sliders: FloatArray, speeds: FloatArray, forces: FloatArray
) -> list[Exceedance]:
    """Return the limits that samples exceed, each at its worst; empty when the machine can do it."""
    if not isinstance(limits, Limits):
        raise InputError(f"limits: expected Limits, got {type(limits).__name__}")
    columns: list[tuple[str, str, FloatArray, float, float]] = []
    for leg, name in enumerate(LEGS):
        columns.append(("travel", name, sliders[:, leg], *limits.travel))
        columns.append(("speed", name, speeds[:, leg], -limits.speed, limits.speed))
        columns.append(("force", name, forces[:, leg], -limits.force, limits.force))
    columns.append(("tilt", "platform", motion.pose[:, 2], *limits.tilt))
    found = []
    for quantity, name, values, low, high in columns:
        excess = np.nan_to_num(np.maximum(values - high, low - values), nan=-np.inf)
        worst = int(np.argmax(excess))
        if excess[worst] > 0:
            value = float(values[worst])
            limit = high if value > high else low
            found.append(Exceedance(quantity, name, float(motion.time[worst]), value, limit))
    return found
