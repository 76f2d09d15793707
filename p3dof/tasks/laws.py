"""How a path is covered in time: `ProfileLaw` by a profile and a duration, `SpeedLaw` by speeds along it."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from p3dof.checks import FloatArray
from p3dof.tasks.profiles import CORNERS, Profile

_SMALL = 1e-4
"""Below this, series of two terms are exact to the last bit."""


class Law(Protocol):
    """How the parameter of a path goes from 0 to its end, from rest to rest."""

    @property
    def duration(self) -> float:
        """How long it takes [s]."""

    @property
    def kinks(self) -> FloatArray:
        """Times at which the acceleration or its rate may jump, (K,) [s]."""

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the parameter and its first two derivatives by time, at times (N,) [s]."""

    def when(self, parameter: FloatArray) -> FloatArray:
        """Return when parameters (K,) are reached [s]."""


class ProfileLaw:
    """A path that is covered by a profile.

    Parameters
    ----------
    profile : callable
        Share of the time to share of the way; see `p3dof.tasks.profiles`.
    length : float
        The parameter at the end.
    duration : float
        How long it takes [s].
    """

    def __init__(self, profile: Profile, length: float, duration: float) -> None:
        self._profile, self._length, self.duration = profile, length, duration
        self.kinks: FloatArray = duration * CORNERS.get(profile, np.zeros(0))

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

    Parameters
    ----------
    nodes : ndarray, shape (n + 1,)
        Parameters, rising from 0.
    squares : ndarray, shape (n + 1,)
        ṡ² at the nodes; zero at both ends.
    slopes : ndarray, shape (n,)
        Half the second derivative of ṡ² by s between the nodes: by how much s̈ rises with s.

    Attributes
    ----------
    starts : ndarray, shape (n,)
        s̈ where each step begins.
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

    def slowed(self, factor: float) -> SpeedLaw:
        """Return the same with every time so many times longer."""
        return SpeedLaw(self.nodes, self.squares / factor**2, self.slopes / factor**2)

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
