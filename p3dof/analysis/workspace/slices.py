"""The range of θ at each y: the aspect of home, with margins from singularities, and within the stroke.

Where det J keeps home's sign, ℓC grows with θ, so that all conditions on θ at one y leave a single range.
"""

from __future__ import annotations

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.analysis.workspace.closed_forms import Sizes, drops, lean, offsets, root

_CLOSE = 1e-6
"""How near θ + β must be to what was asked of it [rad]: other roots of the same equation are far off."""


def reach_range(sizes: Sizes, y: FloatArray, serial: float = 0.0) -> FloatArray:
    """Return the largest size of θ that leg C reaches at each y, up to π [rad].

    Parameters
    ----------
    sizes : Sizes
        Of one machine.
    y : ndarray, shape (N,)
        Positions [m].
    serial : float
        Least S/L of the legs.

    Returns
    -------
    ndarray, shape (N,)
        cosθ = (R - √(L² (1 - serial²) - y²)) / r; π where leg C reaches all around, NaN where not all legs
        keep the margin at any θ.
    """
    r, R, L = sizes
    rest = L * np.sqrt((1 - serial) * (1 + serial))
    cosine = (R - root((rest - y) * (rest + y))) / r
    fits = (np.abs(y) <= rest - sizes.width) & (cosine <= 1)
    return np.where(fits, np.arccos(np.clip(cosine, -1, 1)), np.nan)


def aspect_range(
    sizes: Sizes, y: FloatArray, serial: float = 0.0, actuation: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Return least and largest θ of home's aspect at each y, less margins from the singularities.

    Without margins: det J = 0 at θ⁺ = acos(R/(r+u)) above; below, its other branch -(π - acos(R/(u-r))) where
    it comes before the end of leg C's reach, -acos((R-u)/r).

    Parameters
    ----------
    sizes : Sizes
        Of one machine.
    y : ndarray, shape (N,)
        Positions [m].
    serial : float
        Least S/L of the legs.
    actuation : float
        Least angle from det J = 0 [rad].

    Returns
    -------
    lower, upper : ndarray, shape (N,)
        [rad]; NaN where nothing is left.
    """
    ends = reach_range(sizes, y, serial)
    gamma = np.pi / 2 - actuation
    upper, lower = ends.copy(), -ends
    for theta in _crossings(sizes, y, gamma):  # θ + β reaches γ from below, or comes down from it
        rising = _slope(sizes, y, theta) >= 0
        upper = np.fmin(upper, np.where(rising, theta, np.nan))
        lower = np.fmax(lower, np.where(rising, np.nan, theta))
    for theta in _crossings(sizes, y, -gamma):
        before = np.where((theta < upper) & (_slope(sizes, y, theta) >= 0), theta, np.nan)
        lower = np.fmax(lower, before)
    middle = (lower + upper) / 2
    angle = np.abs(lean(sizes, y, middle))
    empty = ~(lower <= upper) | ~(angle <= gamma + _CLOSE)
    return np.where(empty, np.nan, lower), np.where(empty, np.nan, upper)


def stroke_range(
    sizes: Sizes, y: FloatArray, lower: FloatArray, upper: FloatArray, travel: float
) -> tuple[FloatArray, FloatArray]:
    """Return which part of ranges of θ within the aspect leaves a height H ≥ 0.

    Parameters
    ----------
    sizes : Sizes
        Of one machine.
    y, lower, upper : ndarray, shape (N,)
        Positions [m] and ranges of θ [rad].
    travel : float
        Highest less lowest slider position [m].

    Returns
    -------
    lower, upper : ndarray, shape (N,)
        [rad]; NaN where nothing is left.
    """
    a, b, _ = offsets(sizes, y, lower)
    least, most = _offset_c(sizes, y, lower), _offset_c(sizes, y, upper)
    from_, to = np.maximum(a, b) - travel, np.minimum(a, b) + travel
    low = np.where(least >= from_, lower, theta_of(sizes, y, from_))
    high = np.where(most <= to, upper, theta_of(sizes, y, to))
    empty = ~((from_ <= most) & (least <= to) & (np.abs(a - b) <= travel))
    return np.where(empty, np.nan, low), np.where(empty, np.nan, high)


def theta_of(sizes: Sizes, y: FloatArray, offset: FloatArray) -> FloatArray:
    """Return the θ of home's aspect at which ℓC has a value: the forward kinematics of leg C.

    Parameters
    ----------
    sizes : Sizes
        Of one machine.
    y, offset : ndarray, shape (N,)
        Position and ℓC [m].

    Returns
    -------
    ndarray, shape (N,)
        [rad]; NaN where leg C does not reach.
    """
    r, R, L = sizes
    q = offset + sizes.h
    rho = np.hypot(R, q)
    u2 = (L - y) * (L + y)
    with np.errstate(invalid="ignore"):
        found: FloatArray = np.arctan2(q, R) - np.arccos((q * q + r * r + R * R - u2) / (2 * r * rho))
    return found


def _offset_c(sizes: Sizes, y: FloatArray, theta: FloatArray) -> FloatArray:
    """Return ℓC, also at the very end of leg C's reach, which rounding may put outside."""
    wc = sizes.R - sizes.r * np.cos(theta)
    drop = np.sqrt(np.maximum((sizes.L - y) * (sizes.L + y) - wc * wc, 0.0))
    found: FloatArray = drop + sizes.r * np.sin(theta) - sizes.h
    return found


def _crossings(sizes: Sizes, y: FloatArray, gamma: float) -> list[FloatArray]:
    """Return the θ between -π and π at which θ + β = γ; NaN for what is no such angle.

    u sin(γ - θ) = wC, that is (r + u sinγ) cosθ - u cosγ sinθ = R.
    """
    r, R, L = sizes
    u = root((L - y) * (L + y))
    p, q = r + u * np.sin(gamma), u * np.cos(gamma)
    with np.errstate(invalid="ignore"):
        half, turn = np.arccos(R / np.hypot(p, q)), np.arctan2(q, p)
    found = []
    for theta in (half - turn, -half - turn):
        wrapped = theta - 2 * np.pi * np.round(theta / (2 * np.pi))
        true = np.abs(lean(sizes, y, wrapped) - gamma) < _CLOSE
        found.append(np.where(true, wrapped, np.nan))
    return found


def _slope(sizes: Sizes, y: FloatArray, theta: FloatArray) -> FloatArray:
    """Return the sign of ∂(θ + β)/∂θ = 1 + r sinθ / S_C."""
    drop = drops(sizes, y, theta)[2]
    slope: FloatArray = np.sign(drop + sizes.r * np.sin(theta))
    return slope
