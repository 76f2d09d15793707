"""What a box of poses leaves, in closed form: nothing is sampled.

Two facts make boxes exact. ℓC grows with θ wherever det J keeps home's sign, since ∂ℓC/∂θ is the arm of
det J, and falls with |y|; ℓA and ℓB depend on y alone and have one maximum each, where their leg is vertical.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from p3dof.workspace.closed_forms import Sizes, inclination, larger, signed_root, smaller


class BoxMargins(NamedTuple):
    """What a box y0 ≤ y ≤ y1, θ0 ≤ θ ≤ θ1 leaves of stroke, and how far it stays from singularities.

    Parameters
    ----------
    height : float or ndarray
        Largest height in z that the stroke leaves a box of all these y and θ [m]. It is less than the least
        H(y, θ), for which z would have to follow y and θ. Exact where `serial` and `actuation` are positive.
    serial : float or ndarray
        Least S/L of the three legs over the box; negative if it is out of reach.
    actuation : float or ndarray
        Least angle from det J = 0 over the box [rad]; negative if the box crosses it.
    lowest, highest : float or ndarray
        Least and largest ℓ of any leg over the box [m]: z may lie between the lower end of the travel less
        `lowest` and its upper end less `highest`.
    """

    height: Any
    serial: Any
    actuation: Any
    lowest: Any
    highest: Any


def box_margins(sizes: Sizes, y: tuple[Any, Any], theta: tuple[Any, Any], travel: Any) -> BoxMargins:
    """Return what boxes of poses leave: numbers or arrays that broadcast, complex ones too.

    Out of reach, where optimisers may come by, the numbers go on smoothly, with `serial` negative.

    Parameters
    ----------
    sizes : Sizes
        Of one machine or of many.
    y : tuple of two floats or ndarrays
        From and to [m].
    theta : tuple of two floats or ndarrays
        From and to [rad]; between -π and π, and around 0 or beside it.
    travel : float or ndarray
        Highest less lowest slider position [m].

    Returns
    -------
    BoxMargins
    """
    r, L = sizes.r, sizes.L
    near, far = _near_and_far(y)
    tilted = larger(abs_of(theta[0]), abs_of(theta[1]))
    top_a, low_a = _drops(sizes, (sizes.width + y[0], sizes.width + y[1]))
    top_b, low_b = _drops(sizes, (sizes.width - y[1], sizes.width - y[0]))
    top_c = _drop_c(sizes, near, theta[1]) + r * np.sin(theta[1])
    low_c = _drop_c(sizes, far, theta[0]) + r * np.sin(theta[0])
    highest = larger(larger(top_a, top_b), top_c)
    lowest = smaller(smaller(low_a, low_b), low_c)
    serial = smaller(smaller(low_a, low_b), _drop_c(sizes, far, tilted)) / L
    h = signed_root((L - sizes.width) * (L + sizes.width))
    actuation = _actuation(sizes, near, far, theta)
    return BoxMargins(travel - (highest - lowest), serial, actuation, lowest - h, highest - h)


def abs_of(value: Any) -> Any:
    """Return the magnitude by the sign of the real part: analytic, unlike that of a complex number."""
    return np.where(np.real(value) < 0, -1.0, 1.0) * value


def _within(y: tuple[Any, Any], place: Any) -> Any:
    """Return the place of a range that is nearest to another."""
    return smaller(larger(place, y[0]), y[1])


def _near_and_far(y: tuple[Any, Any]) -> tuple[Any, Any]:
    """Return least and largest |y| of a range."""
    return abs_of(_within(y, 0.0)), larger(abs_of(y[0]), abs_of(y[1]))


def _drops(sizes: Sizes, extent: tuple[Any, Any]) -> tuple[Any, Any]:
    """Return largest and least drop of leg A or B over a range of its extent."""
    near, far = _near_and_far(extent)
    L = sizes.L
    return signed_root((L - near) * (L + near)), signed_root((L - far) * (L + far))


def _drop_c(sizes: Sizes, y: Any, theta: Any) -> Any:
    wc = sizes.R - sizes.r * np.cos(theta)
    return signed_root((sizes.L - y) * (sizes.L + y) - wc * wc)


def _lean(sizes: Sizes, y: Any, theta: Any) -> Any:
    return theta + inclination(sizes.R - sizes.r * np.cos(theta), _drop_c(sizes, y, theta))


def _actuation(sizes: Sizes, near: Any, far: Any, theta: tuple[Any, Any]) -> Any:
    """Return the least angle from det J = 0.

    Over y, θ + β grows with |y|. Over θ it has one minimum, where slider C is as high as P: there
    S_C = -r sinθ, cosθ = (R² + r² - u²) / (2 R r).
    """
    r, R, L = sizes
    low, high = theta
    most = larger(_lean(sizes, far, low), _lean(sizes, far, high))
    least = smaller(_lean(sizes, near, low), _lean(sizes, near, high))
    cosine = (R * R + r * r - (L - near) * (L + near)) / (2 * R * r)
    exists = np.abs(np.real(cosine)) < 1
    lowest = -np.arccos(np.where(exists, cosine, 0.0))
    inside = exists & (np.real(lowest) > np.real(low)) & (np.real(lowest) < np.real(high))
    least = smaller(least, np.where(inside, _lean(sizes, near, lowest), least))
    return np.pi / 2 - larger(most, -least)
