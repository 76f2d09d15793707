"""Closed forms over (y, θ), for one machine or for many: heights of sliders, stroke, singularities.

z moves all sliders alike, λi = z + ℓi(y, θ), so everything but the stroke depends on y and θ alone. Lengths
are numbers or arrays of designs, shape (D, 1), beside poses of shape (G,): results are (D, G). They may be
complex too, for derivatives by complex steps; what is larger is then told by the real parts. Out of reach,
real numbers give NaN.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from p3dof.machine.parameters import Geometry


class Sizes(NamedTuple):
    """The lengths that the workspace depends on [m]; see `p3dof.Geometry`.

    Parameters
    ----------
    r, R, L : float or ndarray, shape (D, 1)
        Sizes of platform and base, and length of the legs; for many designs one row each.
    """

    r: Any
    R: Any
    L: Any

    @classmethod
    def of(cls, geometry: Geometry) -> Sizes:
        """Return the numbers of a geometry."""
        return cls(geometry.r, geometry.R, geometry.L)

    @property
    def width(self) -> Any:
        """R - r, the horizontal extent of the legs at home [m]."""
        return self.R - self.r

    @property
    def h(self) -> Any:
        """Depth of the platform below the sliders at home [m]."""
        return root((self.L - self.width) * (self.L + self.width))

    @property
    def reach(self) -> Any:
        """Largest size of y that the legs A and B reach: L - (R - r) [m]."""
        return self.L - self.width


def extents(sizes: Sizes, y: Any, theta: Any) -> tuple[Any, Any, Any]:
    """Return how far the legs A, B, C reach across the guide-ways: wA, wB along y, wC along x [m].

    Parameters
    ----------
    sizes : Sizes
        Of one machine or of many.
    y, theta : float or ndarray
        Position of the platform [m] and its rotation [rad].

    Returns
    -------
    tuple of three arrays
    """
    return sizes.width + y, sizes.width - y, sizes.R - sizes.r * np.cos(theta)


def drops(sizes: Sizes, y: Any, theta: Any) -> tuple[Any, Any, Any]:
    """Return how far the legs A, B, C hang below their sliders: S_A, S_B, S_C [m].

    Parameters
    ----------
    sizes : Sizes
        Of one machine or of many.
    y, theta : float or ndarray
        Position of the platform [m] and its rotation [rad].

    Returns
    -------
    tuple of three arrays
        NaN out of reach; zero is a serial singularity of the leg.
    """
    L = sizes.L
    wa, wb, wc = extents(sizes, y, theta)
    return root((L - wa) * (L + wa)), root((L - wb) * (L + wb)), root((L - y) * (L + y) - wc * wc)


def offsets(sizes: Sizes, y: Any, theta: Any) -> tuple[Any, Any, Any]:
    """Return ℓA, ℓB, ℓC, the positions of the sliders less z [m]; zero at home.

    Parameters
    ----------
    sizes : Sizes
        Of one machine or of many.
    y, theta : float or ndarray
        Position of the platform [m] and its rotation [rad].

    Returns
    -------
    tuple of three arrays
    """
    a, b, c = drops(sizes, y, theta)
    h = sizes.h
    return a - h, b - h, c + sizes.r * np.sin(theta) - h


def lean(sizes: Sizes, y: Any, theta: Any) -> Any:
    """Return θ + β, β the angle of the plane of leg C's rods from the vertical [rad].

    Between -π/2 and π/2 on home's side of det J = 0; see `actuation_angle`.

    Parameters
    ----------
    sizes : Sizes
        Of one machine or of many.
    y, theta : float or ndarray
        Position of the platform [m] and its rotation [rad].

    Returns
    -------
    ndarray
    """
    return theta + inclination(extents(sizes, y, theta)[2], drops(sizes, y, theta)[2])


def actuation_angle(sizes: Sizes, y: Any, theta: Any) -> Any:
    """Return the angle from det J = 0 [rad], positive on home's side: that of `Manipulator.singularity`.

    Parameters
    ----------
    sizes : Sizes
        Of one machine or of many.
    y, theta : float or ndarray
        Position of the platform [m] and its rotation [rad].

    Returns
    -------
    ndarray
        From -π/2 to π/2.
    """
    return np.arcsin(np.cos(lean(sizes, y, theta)))


def arm(sizes: Sizes, y: Any, theta: Any) -> Any:
    """Return ∂ℓC/∂θ = r (cosθ - sinθ wC/S_C) [m/rad]: zero where det J is.

    Parameters
    ----------
    sizes : Sizes
        Of one machine or of many.
    y, theta : float or ndarray
        Position of the platform [m] and its rotation [rad].

    Returns
    -------
    ndarray
    """
    wc, c = extents(sizes, y, theta)[2], drops(sizes, y, theta)[2]
    with np.errstate(divide="ignore"):
        return sizes.r * (np.cos(theta) - np.sin(theta) * wc / c)


def determinant(sizes: Sizes, y: Any, theta: Any) -> Any:
    """Return det J = -(wA/S_A + wB/S_B) ∂ℓC/∂θ of ∂(λA, λB, λC)/∂(y, z, θ) [m/rad].

    Parameters
    ----------
    sizes : Sizes
        Of one machine or of many.
    y, theta : float or ndarray
        Position of the platform [m] and its rotation [rad].

    Returns
    -------
    ndarray
        Negative on home's side of the singularity.
    """
    wa, wb, _ = extents(sizes, y, theta)
    a, b, _ = drops(sizes, y, theta)
    with np.errstate(divide="ignore"):
        return -(wa / a + wb / b) * arm(sizes, y, theta)


def height(sizes: Sizes, y: Any, theta: Any, travel: Any) -> Any:
    """Return H(y, θ), the height in z that a stroke leaves; negative where it leaves none [m].

    Parameters
    ----------
    sizes : Sizes
        Of one machine or of many.
    y, theta : float or ndarray
        Position of the platform [m] and its rotation [rad].
    travel : float
        Highest less lowest slider position [m].

    Returns
    -------
    ndarray
        travel - (max ℓ - min ℓ); NaN out of reach.
    """
    a, b, c = offsets(sizes, y, theta)
    return travel - (larger(larger(a, b), c) - smaller(smaller(a, b), c))


def root(square: Any) -> Any:
    """Return the root of a square; NaN of a negative real number, without a warning."""
    with np.errstate(invalid="ignore"):
        return np.sqrt(square)


def signed_root(square: Any) -> Any:
    """Return the root of a square, and less the root of its size where it is negative: never NaN."""
    negative = np.real(square) < 0
    return np.where(negative, -1.0, 1.0) * np.sqrt(np.where(negative, -square, square))


def inclination(extent: Any, drop: Any) -> Any:
    """Return the angle of a leg from the vertical, from 0 to π for a positive extent [rad].

    Parameters
    ----------
    extent, drop : float or ndarray
        How far it reaches across the guide-way and hangs below its slider [m].

    Returns
    -------
    ndarray
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.arctan(extent / drop) + np.where(np.real(drop) < 0, np.pi, 0.0)


def larger(one: Any, other: Any) -> Any:
    """Return the larger of two by its real part; NaN where one of them is."""
    return np.where(np.real(one) < np.real(other), other, one + 0 * other)


def smaller(one: Any, other: Any) -> Any:
    """Return the smaller of two by its real part; NaN where one of them is."""
    return np.where(np.real(one) > np.real(other), other, one + 0 * other)
