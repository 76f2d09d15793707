"""How a path is covered in time: `ProfileLaw` by a profile and a duration, `SpeedLaw` by speeds along it.

`SmoothLaw` too is by speeds, with an acceleration that is continuous and zero at both ends.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray

Profile = Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]
"""Share of the time (N,) from 0 to 1, to share of the way and its first two derivatives, (N,) each."""

_SEVENTH = 1 / 7


def quintic(time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return s = 10 τ³ - 15 τ⁴ + 6 τ⁵ and its derivatives: the acceleration is zero at both ends."""
    t = time
    return t**3 * (10 + t * (6 * t - 15)), 30 * (t * (1 - t)) ** 2, 60 * t * (1 - t) * (1 - 2 * t)


def eased(share: FloatArray) -> FloatArray:
    """Return how far along one is at p from 0 to 1, and three derivatives, (4, N): with p³ at both ends."""
    way, rate, change = quintic(share)
    return np.array([way, rate, change, 60 * (1 - 6 * share * (1 - share))])


def septic(time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return s = 35 τ⁴ - 84 τ⁵ + 70 τ⁶ - 20 τ⁷ and its derivatives: the jerk is zero at both ends too."""
    t = time
    s = t**4 * (35 + t * (-84 + t * (70 - 20 * t)))
    return s, 140 * (t * (1 - t)) ** 3, 420 * (t * (1 - t)) ** 2 * (1 - 2 * t)


def s_curve(time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a way of seven equal parts with constant jerk in each: up, none, down, none, down, none, up."""
    h = _SEVENTH
    jerk = 1 / (8 * h**3)  # the way is 8 j h³
    signs = np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0]) * jerk
    s, v, a = (np.zeros(8) for _ in range(3))
    for k, j in enumerate(signs):
        a[k + 1] = a[k] + j * h
        v[k + 1] = v[k] + a[k] * h + j * h**2 / 2
        s[k + 1] = s[k] + v[k] * h + a[k] * h**2 / 2 + j * h**3 / 6
    part = np.clip((time / h).astype(int), 0, 6)
    x, j = time - part * h, signs[part]
    way = s[part] + x * (v[part] + x * (a[part] / 2 + x * j / 6))
    return way, v[part] + x * (a[part] + x * j / 2), a[part] + x * j


PROFILES: Mapping[str, Profile] = MappingProxyType({"quintic": quintic, "septic": septic, "s-curve": s_curve})
"""The profiles by name. All have a continuous acceleration; that of `s_curve` has a bounded jerk of the least
height among those of seven equal parts, that of `septic` a continuous one."""

_SEVENTHS: FloatArray = np.arange(1, 7, dtype=np.float64) * _SEVENTH
CORNERS: Mapping[Profile, FloatArray] = MappingProxyType({s_curve: _SEVENTHS})
"""Shares of the time at which the jerk of a profile jumps."""


_SMALL = 1e-4  # below this, series of two terms are exact to the last bit

_JUMP, _STEEP = 1e-3, 0.05
"""Shares of the largest acceleration from which on a change at once is a jump, and in a step steep."""


class Law(Protocol):
    """How the parameter of a path goes from 0 to its end, from rest to rest."""

    @property
    def duration(self) -> float:
        """How long it takes [s]."""

    @property
    def kinks(self) -> FloatArray:
        """Times at which the acceleration or its rate may jump, (K,) [s]."""

    @property
    def jumps(self) -> FloatArray:
        """Those of them at which the acceleration jumps in a way that samples on one side do not tell [s]."""

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the parameter and its first two derivatives by time, at times (N,) [s]."""

    def when(self, parameter: FloatArray) -> FloatArray:
        """Return when parameters (K,) are reached [s]."""


class PathLaw(Protocol):
    """Speeds at the nodes of a path, and between them."""

    @property
    def duration(self) -> float:
        """How long it takes [s]."""

    def state(self, step: NDArray[np.intp], share: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return ṡ², s̈ and ds̈/ds at shares of steps, (P,) each."""


class ProfileLaw:
    """A path that is covered by a profile."""

    def __init__(self, profile: Profile, length: float, duration: float) -> None:
        self._profile, self._length, self.duration = profile, length, duration
        self.kinks: FloatArray = duration * CORNERS.get(profile, np.zeros(0))
        self.jumps: FloatArray = np.zeros(0)

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the parameter and its first two derivatives by time, at times (N,) [s]."""
        share, rate, change = self._profile(time / self.duration)
        length, period = self._length, self.duration
        return length * share, length * rate / period, length * change / period**2

    def when(self, parameter: FloatArray) -> FloatArray:
        """Return when parameters (K,) are reached [s]."""
        from scipy.optimize import brentq

        def ahead(time: float, share: float) -> float:
            return float(self._profile(np.array([time]))[0][0]) - share

        shares = (parameter / self._length).tolist()
        inside = [brentq(ahead, 0.0, 1.0, args=(share,), xtol=1e-15) for share in shares if 0 < share < 1]
        ends = [[0.0] * sum(share <= 0 for share in shares), [1.0] * sum(share >= 1 for share in shares)]
        return self.duration * np.array([*ends[0], *inside, *ends[1]])


class SpeedLaw:
    """A path that is covered with given squares of the speed: quadratic in the parameter between nodes.

    Between two nodes the acceleration s̈ is linear in s, so that s is a sum of exponentials or sines of time.
    """

    def __init__(self, nodes: FloatArray, squares: FloatArray, slopes: FloatArray) -> None:
        self.nodes, self.squares, self.slopes = nodes, squares, slopes
        step = np.diff(nodes)
        self._speeds = np.sqrt(np.maximum(squares, 0.0))
        self.starts = (np.diff(squares) - slopes * step**2) / (2 * step)
        pace = step / (self._speeds[1:] + self._speeds[:-1])
        rate = np.sqrt(np.abs(slopes))
        x = rate * pace
        with np.errstate(all="ignore"):
            turned = np.where(slopes > 0, np.arctanh(np.minimum(x, 1 - 1e-15)), np.arctan(x)) / x
        near = 1 + np.sign(slopes) * x**2 / 3
        self.kinks: FloatArray = np.append(0.0, np.cumsum(2 * pace * np.where(x < _SMALL, near, turned)))

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return float(self.kinks[-1])

    @property
    def jumps(self) -> FloatArray:
        """Times at which the acceleration jumps, or begins or ends to change much in a step [s]."""
        change, most = self.slopes * np.diff(self.nodes), np.abs(self.starts).max()
        steep = np.abs(change) > _STEEP * most
        jump = np.abs(self.starts[1:] - (self.starts + change)[:-1]) > _JUMP * most
        inside = jump | steep[1:] | steep[:-1]
        return np.asarray(self.kinks[np.concatenate([[True], inside, [True]])])

    def slowed(self, factor: float) -> SpeedLaw:
        """Return the same with every time so many times longer."""
        return SpeedLaw(self.nodes, self.squares / factor**2, self.slopes / factor**2)

    def state(self, step: NDArray[np.intp], share: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return ṡ², s̈ and ds̈/ds at shares of steps, (P,) each."""
        way = share * np.diff(self.nodes)[step]
        start, slope = self.starts[step], self.slopes[step]
        square = self.squares[step] + way * (2 * start + slope * way)
        return np.maximum(square, 0.0), start + slope * way, slope

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the parameter and its first two derivatives by time, at times (N,) [s]."""
        piece = np.clip(np.searchsorted(self.kinks, time, "right") - 1, 0, len(self.slopes) - 1)
        t, slope = time - self.kinks[piece], self.slopes[piece]
        speed, start = self._speeds[piece], self.starts[piece]
        even, odd, twice = _waves(slope, t)
        way = speed * odd + start * twice
        return self.nodes[piece] + way, speed * even + start * odd, start + slope * way

    def when(self, parameter: FloatArray) -> FloatArray:
        """Return when parameters (K,), which are nodes, are reached [s]."""
        return np.asarray(self.kinks[np.argmin(np.abs(self.nodes[:, None] - parameter), axis=0)])


_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(12)
_NEWTON = 60


class SmoothLaw:
    """A path that is covered with given squares of the speed of p, where `eased` (p) is the share of it.

    p̈ is continuous, and quadratic in p between nodes; p never stops, so that speed and acceleration are zero
    at both ends of the path, and the jerk is bounded.
    """

    def __init__(
        self, nodes: FloatArray, squares: FloatArray, changes: FloatArray, bulges: FloatArray, length: float
    ) -> None:
        self.nodes, self.squares, self.changes, self.bulges = nodes, squares, changes, bulges
        self.length, count = length, len(nodes) - 1
        self.jumps: FloatArray = np.zeros(0)
        times = self._times(np.arange(count), np.ones(count))
        self.kinks: FloatArray = np.append(0.0, np.cumsum(times))

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return float(self.kinks[-1])

    def slowed(self, factor: float) -> SmoothLaw:
        """Return the same with every time so many times longer."""
        squares, changes, bulges = (part / factor**2 for part in (self.squares, self.changes, self.bulges))
        return SmoothLaw(self.nodes, squares, changes, bulges, self.length)

    def mixed(self, other: SmoothLaw, share: float) -> SmoothLaw:
        """Return the law that is so far on the way to another one of the same nodes."""
        pairs = ((name, getattr(self, name)) for name in ("squares", "changes", "bulges"))
        squares, changes, bulges = (own + share * (getattr(other, name) - own) for name, own in pairs)
        return SmoothLaw(self.nodes, squares, changes, bulges, self.length)

    def at_nodes(self, nodes: FloatArray) -> SmoothLaw:
        """Return nearly the same law with other nodes."""
        step, share = self._within(nodes)
        square, change, _ = self.state(step, share)
        middle = self.state(*self._within((nodes[1:] + nodes[:-1]) / 2))[1]
        bulges = middle - (change[1:] + change[:-1]) / 2
        return SmoothLaw(nodes, square, change, bulges, self.length)

    def state(self, step: NDArray[np.intp], share: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return ṗ², p̈ and dp̈/dp at shares of steps, (P,) each."""
        square, change, rise = cubic_shape(np.diff(self.nodes)[step], share)
        parts = (
            self.squares[step],
            self.squares[step + 1],
            self.changes[step],
            self.changes[step + 1],
            self.bulges[step],
        )
        values = np.column_stack(parts)
        found = (np.einsum("ij,ij->i", form, values) for form in (square, change, rise))
        pace, acceleration, slope = found
        return np.maximum(pace, 0.0), acceleration, slope

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the parameter and its first two derivatives by time, at times (N,) [s]."""
        step = np.clip(np.searchsorted(self.kinks, time, "right") - 1, 0, len(self.bulges) - 1)
        size, left = np.diff(self.nodes)[step], time - self.kinks[step]
        share = left / np.diff(self.kinks)[step]
        for _ in range(_NEWTON):
            pace = np.sqrt(self.state(step, share)[0]) / size
            move = (left - self._times(step, share)) * pace
            share = np.clip(share + move, 0.0, 1.0)
            if np.abs(move).max(initial=0.0) < 1e-13:
                break
        square, change, _ = self.state(step, share)
        way, rate, bend, _ = self.length * eased(self.nodes[step] + share * size)
        return way, rate * np.sqrt(square), rate * change + bend * square

    def when(self, parameter: FloatArray) -> FloatArray:
        """Return when parameters (K,), which are at nodes, are reached [s]."""
        ways = self.length * eased(self.nodes)[0]
        return np.asarray(self.kinks[np.argmin(np.abs(ways[:, None] - parameter), axis=0)])

    def _within(self, places: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
        step = np.clip(np.searchsorted(self.nodes, places, "right") - 1, 0, len(self.bulges) - 1)
        return step, (places - self.nodes[step]) / np.diff(self.nodes)[step]

    def _times(self, step: NDArray[np.intp], share: FloatArray) -> FloatArray:
        """Return how long it takes from the beginning of steps (P,) to shares of them [s]."""
        inside = (share[:, None] * (1 + _GAUSS) / 2).ravel()
        squares = self.state(np.repeat(step, len(_GAUSS)), inside)[0].reshape(len(step), -1)
        with np.errstate(divide="ignore"):
            return np.asarray((1 / np.sqrt(squares)) @ _WEIGHTS * share / 2 * np.diff(self.nodes)[step])


def cubic_shape(size: FloatArray, share: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return ṗ², p̈ and dp̈/dp at shares of steps, by ṗ² and p̈ at both ends of the step and the bulge of p̈."""
    c, h, none = share, size, np.zeros_like(share)
    bulge = 4 * h * c**2 * (1 - 2 / 3 * c)
    square = [1 - none, none, h * c * (2 - c), h * c**2, bulge]
    change = [none, none, 1 - c, c, 4 * c * (1 - c)]
    rise = [none, none, -1 / h, 1 / h, 4 * (1 - 2 * c) / h]
    return np.column_stack(square), np.column_stack(change), np.column_stack(rise)


def _waves(slope: FloatArray, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return cosh(r t), sinh(r t) / r and (cosh(r t) - 1) / r² for r² = slope, which may be negative."""
    x = np.sqrt(np.abs(slope)) * time
    half = x / 2
    with np.errstate(all="ignore"):
        up = slope > 0
        even = np.where(up, np.cosh(x), np.cos(x))
        odd = np.where(up, np.sinh(x), np.sin(x)) / x
        middle = np.where(up, np.sinh(half), np.sin(half)) / half
    sign = np.sign(slope)
    odd = np.where(x < _SMALL, 1 + sign * x**2 / 6, odd)
    middle = np.where(half < _SMALL, 1 + sign * half**2 / 6, middle)
    return even, time * odd, time**2 / 2 * middle**2
