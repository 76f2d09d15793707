"""The fastest way along a path with a limited jerk, and `FastestPlan`: a task in the least time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.design.tasks import fastest
from p3dof.design.tasks.laws import SmoothLaw, SpeedLaw, cubic_shape, eased
from p3dof.design.tasks.limits import AxisLimits, Demand, Used, Way, used_of
from p3dof.design.tasks.plan import Plan, Stretch
from p3dof.machine.parameters import LEGS

_POINTS: FloatArray = np.array([0.0, 0.5, 1.0])
_FEW, _FINER = 60, 2  # nodes to begin with, and how many times more there are each time
_ROUNDS, _NEAR, _USELESS, _STUCK = 25, 1e-3, 0.7, 2
"""Most programs one after the other; share by which the time may change when more points are of use; share of
what exceeded limits before, over which they were of none, and how often that may be."""
_ROUGH, _SETTLED = 1e-4, 1e-5  # share by which the time may change at the end, with few nodes and with all
_LEAST_STEPS = 6  # least number of steps on each smooth piece of a path
_QUICK, _SLOWEST = 0.01, 1e5
"""Time in which a motion begins [s], to be slowed down until it keeps the limits, at most so many times."""
_MIX = (1.0, 0.7, 0.4, 0.2, 0.1)
_TAPERS = (0.0, 0.6, -0.4)  # how much slower (faster) than at the ends p is in the middle to begin with
STARTS = len(_TAPERS)


def jerk_limited_law(
    count: int, length: float, breaks: Sequence[float], way: Way, limits: AxisLimits, starts: int = STARTS
) -> SmoothLaw:
    """Return how a path is covered in the least time, from rest to rest, with continuous acceleration."""
    own = EasedWay(way, length)
    sizes = [count]
    while sizes[0] > _FEW:
        sizes.insert(0, sizes[0] // _FINER)
    within = _at_eased(np.asarray(breaks) / length)
    nodes = _placed(sizes[0], within, np.linspace(0, 1, 201, dtype=np.float64))
    fastest.require_standing(fastest.Points.everywhere(nodes, _POINTS, own), limits)
    begun = []
    for taper in _TAPERS[:starts]:
        square = (1 - taper * np.sin(np.pi * nodes) ** 2) / _QUICK**2
        change = -taper * np.pi / 2 * np.sin(2 * np.pi * nodes) / _QUICK**2
        start = SmoothLaw(nodes, square, change, np.zeros(len(nodes) - 1), length)
        begun.append(_improved(start, own, limits, _ROUGH))
    law = min(begun, key=lambda one: one.duration)
    for size in sizes[1:] or sizes:
        law = law.at_nodes(_placed(size, within, law.nodes, law))
        law = _improved(law, own, limits, _SETTLED if size == count else _ROUGH)
    return fastest.slowed(law, fastest.Points.everywhere(law.nodes, fastest.DENSE, own), limits)


def _improved(law: SmoothLaw, way: Way, limits: AxisLimits, settled: float) -> SmoothLaw:
    """Return the fastest law of the same nodes near one, until its time changes by less than a share."""
    count = len(law.nodes) - 1
    dense = fastest.Points.everywhere(law.nodes, fastest.DENSE, way)
    law = fastest.slowed(law, dense, limits, _SLOWEST)
    step, share = np.repeat(np.arange(count), len(_POINTS)), np.tile(_POINTS, count)
    points, left, stuck = fastest.Points(law.nodes, step, share, way), np.inf, 0
    programs = fastest.Programs()
    for _ in range(_ROUNDS):
        before = law.duration
        law = _next(programs, law, points, limits)
        moved = abs(law.duration - before)
        if moved > _NEAR * before:
            continue
        used = dense.shares(law, limits)
        excess = float(used.max()) - 1
        stuck += excess > _USELESS * left
        if moved < settled * before and (excess < fastest.EXCEEDED or stuck >= _STUCK):
            break
        left = excess
        step, share = fastest.with_worst(step, share, used)
        points = fastest.Points(law.nodes, step, share, way)
    return law


def _next(
    programs: fastest.Programs, law: SmoothLaw, points: fastest.Points, limits: AxisLimits
) -> SmoothLaw:
    """Return the best law on the way to the solution of a program."""
    aim = _solved(programs, law, points, limits)
    if points.shares(law, limits).max() > 1 + fastest.EXCEEDED:  # with new points it is too fast
        return aim
    return min((law, *(law.mixed(aim, share) for share in _MIX)), key=lambda one: one.duration)


def _solved(
    programs: fastest.Programs, law: SmoothLaw, points: fastest.Points, limits: AxisLimits
) -> SmoothLaw:
    """Return the solution of one program, for the time as it changes near a law."""
    nodes, count = law.nodes, len(law.nodes) - 1
    size, step = np.diff(nodes), np.arange(len(law.nodes) - 1)
    rows = fastest.rows_of(points, fastest.Shape(*cubic_shape(points.size, points.share)), limits, law)
    columns = np.column_stack([step, step + 1, count + 1 + step, count + 2 + step, 2 * (count + 1) + step])
    one = np.ones(count)
    rows.add(np.column_stack([-one, one, -size, -size, -4 / 3 * size]), np.zeros(count), step, least=0.0)
    # The time is the integral of 1/√ṗ², by Simpson's rule; its derivative by ṗ² is -1/2 of the third power.
    cost = np.zeros(3 * count + 2)
    for share, weight in ((0.0, 1 / 6), (0.5, 4 / 6), (1.0, 1 / 6)):
        square = law.state(step, share * one)[0]
        form = cubic_shape(size, share * one)[0]
        np.add.at(cost, columns, -(weight * size * square**-1.5 / 2)[:, None] * form)
    free = np.full(2 * count + 1, np.inf)
    box = np.column_stack([np.append(np.zeros(count + 1), -free), np.full(3 * count + 2, np.inf)])
    found = programs.solved(cost / np.abs(cost).max(), rows, columns, box)
    return SmoothLaw(
        nodes, found[: count + 1], found[count + 1 : 2 * count + 2], found[2 * count + 2 :], law.length
    )


class EasedWay:
    """What a path takes by an eased parameter: see `p3dof.design.tasks.laws.eased`."""

    def __init__(self, way: Way, length: float) -> None:
        self._way, self._length = way, length

    @property
    def lossy(self) -> bool:
        """Whether there is friction."""
        return self._way.lossy

    def demand(self, place: FloatArray, middle: FloatArray) -> Demand:
        """Return what is needed at p (P,); each is in a step whose middle is given too, (P,)."""
        way, rate, bend, third = (part[:, None] for part in self._length * eased(place))
        found = self._way.demand(way[:, 0], self._length * eased(middle)[0])
        return Demand(
            found.mass * rate,
            found.bias * rate**2 + found.mass * bend,
            found.rest,
            found.rate * rate,
            found.change * rate**2 + found.rate * bend,
            found.third * rate**3 + 3 * found.change * rate * bend + found.rate * third,
            found.own,
            found.balance,
            found.turning,
        )

    def friction(self, place: FloatArray, speed: FloatArray) -> FloatArray:
        """Return what friction adds to the forces, (P, 3) [N], at p and ṗ (P,)."""
        way, rate, _, _ = self._length * eased(place)
        return self._way.friction(way, rate * speed)


def _at_eased(shares: FloatArray) -> FloatArray:
    """Return p at shares of a path that are inside it."""
    from scipy.optimize import brentq

    def ahead(share: float) -> Callable[[float], float]:
        return lambda p: float(eased(np.array([p]))[0, 0]) - share

    inside = shares[(shares > 1e-9) & (shares < 1 - 1e-9)]
    return np.array([brentq(ahead(float(share)), 0.0, 1.0, xtol=1e-15) for share in inside])


def _placed(count: int, within: FloatArray, shape: FloatArray, law: SmoothLaw | None = None) -> FloatArray:
    """Return nodes: some on each smooth piece, half of the others even in p, half as a law goes in time."""
    share = np.linspace(0, 1, len(shape))
    if law is not None:
        share = law.kinks / law.duration
    density = (share + shape) / 2
    ends = np.concatenate([[0.0], within, [1.0]])
    pieces = []
    for first, last in pairwise(ends.tolist()):
        low, high = np.interp([first, last], shape, density)
        steps = max(_LEAST_STEPS, round(count * (high - low)))
        inside = np.interp(np.linspace(low, high, steps + 1)[1:-1], density, shape)
        pieces.append(np.concatenate([[first], inside]))
    return np.append(np.concatenate(pieces), 1.0)


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
    """What one way uses at many points of it."""

    time: FloatArray  # (P,): since the plan began [s]
    used: list[Used]  # of every limit
    name: str  # of the way


def looked_at(stretch: Stretch, way: Way, limits: AxisLimits, begin: float, name: str) -> Looked:
    """Return what a way uses of the limits, densely."""
    law = stretch.law
    if isinstance(law, SpeedLaw | SmoothLaw):
        own = EasedWay(way, law.length) if isinstance(law, SmoothLaw) else way
        points = fastest.Points.everywhere(law.nodes, fastest.DENSE, own)
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
    """Return how much of each limit all ways use; those that there are."""
    found = []
    for k, first in enumerate(ways[0].used):
        for leg, name in enumerate(LEGS):
            if not np.isfinite(first.limit[..., leg]).all():
                continue
            shares = [one.used[k].share[:, leg] for one in ways]
            worst = int(np.argmax([share.max() for share in shares]))
            at, way = int(shares[worst].argmax()), ways[worst]
            value = float(way.used[k].value[at, leg])
            limit = float(np.broadcast_to(way.used[k].limit, way.used[k].value.shape)[at, leg])
            found.append(LimitUse(first.quantity, name, value, limit, float(way.time[at]), way.name))
    return tuple(found)
