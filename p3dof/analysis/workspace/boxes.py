"""What a box of poses leaves, in closed form: nothing is sampled.

Two facts make boxes exact. ℓC grows with θ wherever det J keeps home's sign, since ∂ℓC/∂θ is the arm of
det J, and falls with |y|; ℓA and ℓB depend on y alone and have one maximum each, where their leg is vertical.
"""

from __future__ import annotations

from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from p3dof.analysis.workspace.closed_forms import Sizes, inclination, larger, signed_root, smaller


class BoxPieces(NamedTuple):
    """What a box of poses depends on, each of it smooth where no end of the box passes 0.

    Parameters
    ----------
    highest, lowest : tuple of float or ndarray
        Largest and least S + r sinθ of legs over the box [m]: of A, B and C the largest; of A, of B and of C
        two each, of which the lesser one counts.
    serial : tuple of float or ndarray
        S/L of the legs at the ends of the box.
    actuation : tuple of float or ndarray
        Angles from det J = 0 [rad].
    """

    highest: tuple[Any, ...]
    lowest: tuple[Any, ...]
    serial: tuple[Any, ...]
    actuation: tuple[Any, ...]


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
    highest, lowest, serial, actuation = box_pieces(sizes, y, theta)
    h = signed_root((sizes.L - sizes.width) * (sizes.L + sizes.width))
    top, low = reduce(larger, highest), reduce(smaller, lowest)
    return BoxMargins(
        travel - (top - low), reduce(smaller, serial), reduce(smaller, actuation), low - h, top - h
    )


def box_pieces(sizes: Sizes, y: tuple[Any, Any], theta: tuple[Any, Any]) -> BoxPieces:
    """Return what the margins of boxes are the least of; arguments as of `box_margins`."""
    r, L = sizes.r, sizes.L
    near = _within(y, 0.0)
    tops = [_drop(L, _within((sizes.width + a, sizes.width + b), 0.0)) for a, b in (y, (-y[1], -y[0]))]
    ends = [_drop(L, sizes.width + side * end) for side in (1, -1) for end in y]
    corners = [(end, turned) for end in y for turned in theta]
    low_c = [_drop_c(sizes, end, theta[0]) + r * np.sin(theta[0]) for end in y]
    return BoxPieces(
        (*tops, _drop_c(sizes, near, theta[1]) + r * np.sin(theta[1])),
        (*ends, *low_c),
        tuple(drop / L for drop in (*ends, *(_drop_c(sizes, *corner) for corner in corners))),
        (*(np.pi / 2 - _lean(sizes, *corner) for corner in corners), *_below(sizes, near, theta)),
    )


def _within(y: tuple[Any, Any], place: Any) -> Any:
    """Return the place of a range that is nearest to another."""
    return smaller(larger(place, y[0]), y[1])


def _drop(L: Any, extent: Any) -> Any:
    return signed_root((L - extent) * (L + extent))


def _drop_c(sizes: Sizes, y: Any, theta: Any) -> Any:
    wc = sizes.R - sizes.r * np.cos(theta)
    return signed_root((sizes.L - y) * (sizes.L + y) - wc * wc)


def _lean(sizes: Sizes, y: Any, theta: Any) -> Any:
    return theta + inclination(sizes.R - sizes.r * np.cos(theta), _drop_c(sizes, y, theta))


def _below(sizes: Sizes, near: Any, theta: tuple[Any, Any]) -> tuple[Any, Any, Any]:
    """Return the angles from det J = 0 on the side of negative θ + β.

    Over y, θ + β grows with |y|. Over θ it has one minimum, where slider C is as high as P: there
    S_C = -r sinθ, cosθ = (R² + r² - u²) / (2 R r).
    """
    r, R, L = sizes
    low, high = theta
    first, last = _lean(sizes, near, low), _lean(sizes, near, high)
    cosine = (R * R + r * r - (L - near) * (L + near)) / (2 * R * r)
    exists = np.abs(np.real(cosine)) < 1
    lowest = -np.arccos(np.where(exists, cosine, 0.0))
    inside = exists & (np.real(lowest) > np.real(low)) & (np.real(lowest) < np.real(high))
    least = np.where(inside, _lean(sizes, near, lowest), first)
    return np.pi / 2 + first, np.pi / 2 + last, np.pi / 2 + least
