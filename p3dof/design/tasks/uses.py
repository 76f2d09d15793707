"""`FastestPlan`: a task in the least time, and how much of each limit it uses, when and where."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.design.tasks.fastest import DENSE
from p3dof.design.tasks.laws import SmoothLaw, SpeedLaw
from p3dof.design.tasks.limits import AxisLimits, Used, Way, used_of
from p3dof.design.tasks.plan import Plan, Stretch
from p3dof.design.tasks.programs import Points
from p3dof.design.tasks.smooth import EasedWay
from p3dof.machine.parameters import LEGS

_DENSE = 4001

_HOLDS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "force": ("actuator", "N"),
        "speed": ("slider", "m/s"),
        "power": ("actuator", "W"),
        "jerk": ("slider", "m/s³"),
        "nut force": ("nut", "N"),
    }
)
"""Where each limit holds, and its unit."""


@dataclass(frozen=True)
class LimitUse:
    """How much of one limit a plan uses, where it uses most of it, looked at densely between the nodes.

    Parameters
    ----------
    quantity : str
        ``"force"``, ``"speed"``, ``"power"``, ``"jerk"`` or ``"nut force"``.
    leg : str
        ``"A"``, ``"B"`` or ``"C"``.
    value, limit : float
        The largest value, and what is allowed [N, m/s, W, m/s³].
    time : float
        When [s].
    way : str
        From which stop to which.
    """

    quantity: str
    leg: str
    value: float
    limit: float
    time: float
    way: str

    @property
    def share(self) -> float:
        """Value by limit: 1 at the limit."""
        return self.value / self.limit

    @property
    def holds_at(self) -> str:
        """Where it holds: ``"actuator"``, ``"nut"`` or ``"slider"``."""
        return _HOLDS[self.quantity][0]

    @property
    def unit(self) -> str:
        """Of value and limit."""
        return _HOLDS[self.quantity][1]


@dataclass(frozen=True, eq=False)
class FastestPlan(Plan):
    """A task in the least time.

    Parameters
    ----------
    limits : AxisLimits
        What was allowed.
    uses : tuple of LimitUse
        How much of each limit is used.
    """

    limits: AxisLimits
    uses: tuple[LimitUse, ...]


class Looked(NamedTuple):
    """What one way uses at many points of it.

    Parameters
    ----------
    time : ndarray, shape (P,)
        Since the plan began [s].
    used : list of Used
        Of every limit.
    name : str
        Of the way.
    """

    time: FloatArray
    used: list[Used]
    name: str


def looked_at(stretch: Stretch, way: Way, limits: AxisLimits, begin: float, name: str) -> Looked:
    """Return what a way uses of the limits, densely.

    Parameters
    ----------
    stretch : Stretch
        The way and its time.
    way : Way
        What it takes of the actuators.
    limits : AxisLimits
        What they may be asked for.
    begin : float
        When it begins [s].
    name : str
        What to call it.

    Returns
    -------
    Looked
    """
    law = stretch.law
    if isinstance(law, SpeedLaw | SmoothLaw):
        own = EasedWay(way, law.length) if isinstance(law, SmoothLaw) else way
        points = Points.everywhere(law.nodes, DENSE, own)
        time = law.kinks[points.step] + points.share * np.diff(law.kinks)[points.step]
        return Looked(begin + time, points.used(law, limits), name)
    time = np.linspace(0.0, law.duration, _DENSE, dtype=np.float64)
    place, speed, change = law.at(time)
    place = np.clip(place, 0.0, stretch.path.end)
    demand = way.demand(place, place)
    with np.errstate(divide="ignore", invalid="ignore"):
        rise = np.where(speed > 0, np.gradient(change, time) / speed, 0.0)
    state = speed**2, change, rise
    return Looked(begin + time, used_of(demand, state, way.friction(place, speed), limits), name)


def uses_of(ways: Sequence[Looked]) -> tuple[LimitUse, ...]:
    """Return how much of each limit all ways use.

    Parameters
    ----------
    ways : sequence of Looked
        At least one.

    Returns
    -------
    tuple of LimitUse
        Those that there are.
    """
    found = []
    for k, first in enumerate(ways[0].used):
        for leg, name in enumerate(LEGS):
            if not np.isfinite(first.limit[leg]):
                continue
            peaks = [float(one.used[k].value[:, leg].max()) for one in ways]
            worst = int(np.argmax(peaks))
            at = int(ways[worst].used[k].value[:, leg].argmax())
            when = float(ways[worst].time[at])
            limit = float(first.limit[leg])
            found.append(LimitUse(first.quantity, name, peaks[worst], limit, when, ways[worst].name))
    return tuple(found)
