"""How much of each limit a motion uses, and when."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from p3dof.checks import FloatArray
from p3dof.errors import InputError
from p3dof.parameters import LEGS, Limits

if TYPE_CHECKING:
    from p3dof.methods.results import InverseDynamics

UNITS = {"force": "N", "speed": "m/s", "travel": "m", "tilt": "rad"}
"""Of the quantities that have limits."""


@dataclass(frozen=True)
class Utilisation:
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


def utilisations(result: InverseDynamics, limits: Limits) -> tuple[Utilisation, ...]:
    """Return how much of each limit a motion uses, at the sample where it uses most of it.

    Parameters
    ----------
    result : InverseDynamics
        The motion and its forces.
    limits : Limits
        What the actuators can do.

    Returns
    -------
    tuple of Utilisation
        Forces, speeds and travel of A, B and C, and the tilt of the platform.

    Raises
    ------
    InputError
        If `limits` is not a `Limits`.
    """
    if not isinstance(limits, Limits):
        raise InputError(f"limits: expected Limits, got {type(limits).__name__}")
    unknown = np.full_like(result.forces, np.nan)
    forces, speeds = (result.forces, result.slider_velocities) if result.possible else (unknown, unknown)
    columns = (
        ("force", forces, (-limits.force, limits.force)),
        ("speed", speeds, (-limits.speed, limits.speed)),
        ("travel", result.sliders, limits.travel),
    )
    found = [
        _most_of(quantity, name, result.time, values[:, leg], ends)
        for quantity, values, ends in columns
        for leg, name in enumerate(LEGS)
    ]
    found.append(_most_of("tilt", "platform", result.time, result.motion.pose[:, 2], limits.tilt))
    return tuple(found)


def _most_of(
    quantity: str, name: str, time: FloatArray, values: FloatArray, ends: tuple[float, float]
) -> Utilisation:
    """Return where values come nearest to either end of a range around zero, or exceed it the most."""
    limits = np.where(values < 0, *ends)
    shares = np.nan_to_num(values / limits, nan=-1.0)
    most = int(np.argmax(shares))
    if shares[most] < 0:
        return Utilisation(quantity, name, np.nan, ends[1], np.nan)
    return Utilisation(quantity, name, float(values[most]), float(limits[most]), float(time[most]))
