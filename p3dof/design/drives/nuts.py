"""Ball nuts: how long they live over a cycle, by the loads of both flanks; and what life is required.

A preloaded nut has two loaded flanks. With the preload F_pr and the limit F_lim = 2^(3/2) F_pr at which it
is released, a force F loads the flank that it presses by F_pr (1 + |F| / F_lim)^(3/2) up to the limit, and
the other one by |F| less; beyond, by |F| and nothing. Without preload, the sign of the force decides which
flank bears it.

References
----------
ISO 3408-5: equivalent load of each flank over its turns, F_m = (∫ F³ |n| dt / ∫ |n| dt)^(1/3), life
L = (C_a / F_m)³ million turns, of both together (L1^(-10/9) + L2^(-10/9))^(-9/10). All turns of a cycle count
for each flank, also those under no load. Steinmeyer (Technology, preload) has the same limit of 2.83 F_pr.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, Readable, frozen_array, shown, with_point
from p3dof._base.errors import DriveError

RELEASED = 2**1.5  # force by preload at which a preloaded nut is released
_TOGETHER = 10 / 9  # how lives of flanks go together (Weibull)
_UNITS = {"h": "hours", "cycles": "cycles", "cycle": "cycles", "km": "distance", "m": "distance"}


@dataclass(frozen=True)
class RequiredLife(Readable):
    """How long parts have to live: exactly one of hours, cycles and a way.

    Parameters
    ----------
    hours : float, optional
        Time of the cycle, its dwells and rests included [h].
    cycles : float, optional
        How many.
    distance : float, optional
        Way of a nut or a carriage, to and fro [m]; bearings of hinges have none.

    Raises
    ------
    DriveError
        If not exactly one is given, or it is no number above zero.
    """

    hours: float | None = None
    cycles: float | None = None
    distance: float | None = None

    def __post_init__(self) -> None:
        given = {name: getattr(self, name) for name in ("hours", "cycles", "distance")}
        given = {name: value for name, value in given.items() if value is not None}
        if len(given) != 1:
            got = " and ".join(given) or "none"
            raise DriveError(f"life: expected exactly one of hours, cycles and distance, got {got}")
        ((name, value),) = given.items()
        number = float(frozen_array(f"life: {name}", value, (), DriveError))
        if not number > 0:
            raise DriveError(f"life: {name}: expected a number above zero, got {number:g}")
        object.__setattr__(self, name, number)

    def __str__(self) -> str:
        if self.distance is not None:
            return f"{self.distance / 1e3:g} km"
        return f"{self.cycles:g} cycles" if self.cycles is not None else f"{self.hours:g} h"

    def hours_of(self, cycle: float, way: float = math.nan) -> float:
        """Return it in hours of a cycle of so many seconds and so long a way; NaN for a way that is none."""
        if self.hours is not None:
            return self.hours
        if self.cycles is not None:
            return self.cycles * cycle / 3600
        return float(self.distance or 0.0) / way * cycle / 3600 if way > 0 else math.nan


def required_life(value: Any, where: str = "life") -> RequiredLife | None:
    """Return a required life of a text such as ``"20000 h"``, ``"1e7 cycles"``, ``"5000 km"``; None of None.

    Parameters
    ----------
    value : str or RequiredLife or None
        The life, with its unit.
    where : str
        What errors call it.

    Raises
    ------
    DriveError
        If it is something else.
    """
    if value is None or isinstance(value, RequiredLife):
        return value
    expected = f"{where}: expected a life such as '20000 h', '1e7 cycles' or '5000 km'"
    words = re.sub(r"(?<=[\d.])(?=[a-z]+$)", " ", value).split() if isinstance(value, str) else []
    if len(words) != 2 or words[1] not in _UNITS:
        raise DriveError(
            f"{expected}, got {shown(value)}{with_point(value) if isinstance(value, str) else ''}"
        )
    try:
        number = float(words[0]) * (1e3 if words[1] == "km" else 1.0)
    except ValueError:
        raise DriveError(f"{expected}, got {shown(value)}") from None
    if not 0 < number < math.inf:
        raise DriveError(f"{expected}, got {shown(value)}")
    return RequiredLife(**{_UNITS[words[1]]: number})


@dataclass(frozen=True)
class NutLife(Readable):
    """A ball nut over a cycle."""

    preload: float  # F_pr [N]
    turns: float  # of the screw against the nut in a cycle, to and fro
    mean_speed: float  # over the whole cycle, to and fro [rad/s]
    mean_loads: tuple[float, float]
    """Equivalent loads of the flank that positive forces press and of the other [N]; NaN without turns."""
    life: float  # L10 of both together, in turns; infinite without turns or loads
    hours: float  # the same in hours of the cycle
    largest: float  # largest size of the force at the nut [N]
    largest_time: float  # when [s]

    @property
    def released(self) -> bool:
        """Whether the largest force releases a preloaded nut: it has play then."""
        return 0 < RELEASED * self.preload < self.largest


def flank_loads(force: FloatArray, preload: float) -> tuple[FloatArray, FloatArray]:
    """Return the loads of the flank that positive forces press, and of the other, shapes (...) [N].

    `force`: at the nut, with its sign [N].
    """
    size = np.abs(force)
    pressed = size
    if preload > 0:
        limit = RELEASED * preload
        pressed = np.where(size < limit, preload * (1 + size / limit) ** 1.5, size)
    other, ahead = pressed - size, force >= 0
    return np.where(ahead, pressed, other), np.where(ahead, other, pressed)


def nut_life(
    time: FloatArray, force: FloatArray, turning: FloatArray, cycle: float, dynamic: float, preload: float
) -> NutLife:
    """Return how long a ball nut lives under a cycle of signed forces [N] and speeds of turning [rad/s]."""
    speed = np.abs(turning)
    angle = float(np.trapezoid(speed, time))
    turns, at = angle / (2 * math.pi), int(np.abs(force).argmax())
    means = (math.nan, math.nan)
    life = math.inf
    if turns > 0:
        cubes = [float(np.trapezoid(load**3 * speed, time)) / angle for load in flank_loads(force, preload)]
        means = (cubes[0] ** (1 / 3), cubes[1] ** (1 / 3))
        shorter = sum((mean / dynamic) ** (3 * _TOGETHER) for mean in means)
        life = 1e6 * shorter ** (-1 / _TOGETHER) if shorter > 0 else math.inf
    hours = life / turns * cycle / 3600 if turns > 0 else math.inf
    return NutLife(
        preload, turns, angle / cycle, means, life, hours, float(np.abs(force[at])), float(time[at])
    )
