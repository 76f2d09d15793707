"""Limits that a motion exceeds, each at its worst sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import InputError
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import LEGS, Limits


@dataclass(frozen=True)
class Exceedance:
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
    """Return the limits that samples exceed, each at its worst.

    Parameters
    ----------
    limits : Limits
        What the actuators can do.
    motion : Motion
        Of the platform.
    sliders, speeds, forces : ndarray, shape (N, 3)
        Slider positions [m], velocities [m/s] and actuator forces [N]; NaN where a sample is invalid.

    Returns
    -------
    list of Exceedance
        Empty when the machine can do it.

    Raises
    ------
    InputError
        If `limits` is not a `Limits`.
    """
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
