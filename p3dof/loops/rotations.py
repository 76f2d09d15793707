"""Rotation vectors and their rates; leading axes, if there are any, count samples."""

from __future__ import annotations

import numpy as np

from p3dof._base.checks import FloatArray

_FAR_TURN = -0.99
"""Cosine of the largest rotation whose vector is taken; beyond it is NaN."""
_SMALL = 0.1
"""Squares of angles below this are treated by series."""
NEAR_TURN = 0.05
"""Likewise values of (1 - cosine)/2."""
_a = np.cumprod([1.0, *(2 * k / (2 * k + 1) for k in range(1, 16))])
_k = np.arange(16)
_SERIES = np.stack(
    (_a, -0.5 * np.append(_k * _a, 0.0)[1:], 0.25 * np.append(_k * (_k - 1) * _a, [0.0, 0.0])[2:]), 1
)
"""Coefficients of aₖ yᵏ and its first two derivatives by the cosine; see `shortest_turn`."""


def rotation_vector(R: FloatArray) -> FloatArray:
    """Return log3 of rotations (..., 3, 3) as (..., 3) [rad]; NaN for those of more than 170°."""
    s = 0.5 * np.stack(
        (R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]), axis=-1
    )
    sine = np.sqrt(np.sum(s * s, axis=-1))
    cosine = 0.5 * (np.trace(R, axis1=-2, axis2=-1) - 1.0)
    angle = np.arctan2(sine, cosine)
    factor = np.where(sine > 1e-8, angle / np.maximum(sine, 1e-8), 1.0)
    return np.asarray(s * np.where(cosine > _FAR_TURN, factor, np.nan)[..., None])


def turned_rates(turn: FloatArray) -> FloatArray:
    """Return the matrices (..., 3, 3) from ω to the rate of the rotation vector of E, where dE/dt = ω × E.

    Parameters
    ----------
    turn : (..., 3) array
        The rotation vector φ of E [rad].

    Notes
    -----
    The inverse of the left Jacobian of SO(3), 1 - [φ]/2 + (1/φ² - (1 + cos φ)/(2 φ sin φ)) [φ]².
    """
    square = np.sum(turn * turn, axis=-1)
    angle = np.sqrt(np.maximum(square, 1e-4))
    exact = 1.0 / angle**2 - (1.0 + np.cos(angle)) / (2.0 * angle * np.sin(angle))
    factor = np.where(square > 1e-4, exact, 1.0 / 12.0 + square / 720.0)
    across = skew(turn)
    return np.asarray(np.eye(3) - 0.5 * across + factor[..., None, None] * (across @ across))


def turned_rates_dot(turn: FloatArray, omega: FloatArray) -> FloatArray:
    """Return the rates (..., 3, 3) of the matrices of `turned_rates`.

    Parameters
    ----------
    turn : (..., 3) array
        The rotation vector of E [rad].
    omega : (..., 3) array
        The angular velocity [rad/s].
    """
    rate = (turned_rates(turn) @ omega[..., None])[..., 0]
    factor, slope = _factors(np.sum(turn * turn, axis=-1))
    across, across_dot = skew(turn), skew(rate)
    product = across_dot @ across
    both = product + np.swapaxes(product, -1, -2)  # of [φ]²: (a b)ᵀ = b a, for skew-symmetric ones
    change = slope * 2.0 * np.sum(turn * rate, axis=-1)
    turned = change[..., None, None] * (across @ across)
    return np.asarray(factor[..., None, None] * both + turned - 0.5 * across_dot)


def shortest_turn(cosine: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return an angle over its sine, as a function g(c) of its cosine, and its first two derivatives.

    Parameters
    ----------
    cosine : (...) array
        The cosine c of the angle.

    Returns
    -------
    g, first, second : (...) array

    Notes
    -----
    (1 - c²) g' = c g - 1. Around zero g = Σ aₖ yᵏ with y = (1 - c)/2, a₀ = 1, aₖ = aₖ₋₁ 2k/(2k + 1).
    """
    c = np.maximum(np.minimum(cosine, 1.0), -1.0)
    y = 0.5 * (1.0 - c)
    near = y < NEAR_TURN
    series = np.minimum(y, NEAR_TURN)[..., None] ** _k @ _SERIES
    if near.all():
        return series[..., 0], series[..., 1], series[..., 2]
    square = np.where(near, 1.0, np.maximum(1.0 - c * c, 1e-12))
    g = np.arccos(c) / np.sqrt(square)
    slope = (c * g - 1.0) / square
    exact = g, slope, (g + 3.0 * c * slope) / square
    g, slope, curvature = (np.where(near, series[..., i], value) for i, value in enumerate(exact))
    return g, slope, curvature


def skew(a: FloatArray) -> FloatArray:
    """Return the matrices (..., 3, 3) of the cross product with a (..., 3)."""
    result = np.zeros((*a.shape, 3))
    result[..., 0, 1], result[..., 0, 2] = -a[..., 2], a[..., 1]
    result[..., 1, 0], result[..., 1, 2] = a[..., 2], -a[..., 0]
    result[..., 2, 0], result[..., 2, 1] = -a[..., 1], a[..., 0]
    return result


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a × b (..., 3)."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    first = y * w - z * v
    result = np.empty((*first.shape, 3))
    result[..., 0], result[..., 1], result[..., 2] = first, z * u - x * w, x * v - y * u
    return result


def _factors(square: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return 1/φ² - (1 + cos φ)/(2 φ sin φ), and its derivative, as functions of φ²."""
    angle = np.sqrt(np.maximum(square, _SMALL))
    cot, x = 1.0 / np.tan(0.5 * angle), np.minimum(square, _SMALL)
    value = (1.0 - 0.5 * angle * cot) / angle**2
    rise = 0.5 * cot - 0.25 * angle * (1.0 + cot**2)
    slope = -(rise / angle + 2.0 * value) / (2.0 * angle**2)
    series = (691 / 1307674368000, 1 / 47900160, 1 / 1209600, 1 / 30240, 1 / 720, 1 / 12)
    near = square < _SMALL
    small = np.polyval(series, x), np.polyval(np.polyder(series), x)
    return np.where(near, small[0], value), np.where(near, small[1], slope)
