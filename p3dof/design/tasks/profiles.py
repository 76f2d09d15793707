"""How far along a path one is over time, from rest to rest: share of the way, by share of the time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from p3dof._base.checks import FloatArray

Profile = Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]
"""Share of the time (N,) from 0 to 1, to share of the way and its first two derivatives, (N,) each."""

_SEVENTH = 1 / 7


def quintic(time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return s = 10 τ³ - 15 τ⁴ + 6 τ⁵ and its derivatives: the acceleration is zero at both ends."""
    t = time
    return t**3 * (10 + t * (6 * t - 15)), 30 * (t * (1 - t)) ** 2, 60 * t * (1 - t) * (1 - 2 * t)


def eased(share: FloatArray) -> FloatArray:
    """Return how far along a path one is at p from 0 to 1, and three derivatives by p, (4, N).

    At both ends the path goes on with the third power of p: with a constant jerk from rest, p is the time.
    """
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
