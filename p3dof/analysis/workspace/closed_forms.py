"""Closed forms over (y, θ), for one machine or for many: heights of sliders, stroke, singularities.

z moves all sliders alike, λi = z + ℓi(y, θ), so everything but the stroke depends on y and θ alone. Lengths
are numbers or arrays of designs, shape (D, 1), beside poses of shape (G,): results are (D, G). They may be
complex too, for derivatives by complex steps; what is larger is then told by the real parts. Out of reach,
real numbers give NaN.

The range of θ at each y: the aspect of home, with margins from singularities, and within the stroke.

Where det J keeps home's sign, ℓC grows with θ, so that all conditions on θ at one y leave a single range.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof.machine.parameters import Geometry


class Sizes(NamedTuple):
    """The lengths that the workspace depends on [m]; see `p3dof.machine.Geometry`.

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
    """Return how far the legs A, B, C reach across the guides: wA, wB along y, wC along x [m]."""
    return sizes.width + y, sizes.width - y, sizes.R - sizes.r * np.cos(theta)


def drops(sizes: Sizes, y: Any, theta: Any) -> tuple[Any, Any, Any]:
    """Return how far the legs A, B, C hang below their sliders: S_A, S_B, S_C [m].

    NaN out of reach; zero is a serial singularity of the leg.
    """
    L = sizes.L
    wa, wb, wc = extents(sizes, y, theta)
    return root((L - wa) * (L + wa)), root((L - wb) * (L + wb)), root((L - y) * (L + y) - wc * wc)


def offsets(sizes: Sizes, y: Any, theta: Any) -> tuple[Any, Any, Any]:
    """Return ℓA, ℓB, ℓC, the positions of the sliders less z [m]; zero at home."""
    a, b, c = drops(sizes, y, theta)
    h = sizes.h
    return a - h, b - h, c + sizes.r * np.sin(theta) - h


def lean(sizes: Sizes, y: Any, theta: Any) -> Any:
    """Return θ + β, β the angle of the plane of leg C's rods from the vertical [rad].

    Between -π/2 and π/2 on home's side of det J = 0; see `actuation_angle`.
    """
    return theta + inclination(extents(sizes, y, theta)[2], drops(sizes, y, theta)[2])


def actuation_angle(sizes: Sizes, y: Any, theta: Any) -> Any:
    """Return the angle from det J = 0 [rad], positive on home's side: that of `Manipulator.singularity`.

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
    """
    wc, c = extents(sizes, y, theta)[2], drops(sizes, y, theta)[2]
    with np.errstate(divide="ignore"):
        return sizes.r * (np.cos(theta) - np.sin(theta) * wc / c)


def determinant(sizes: Sizes, y: Any, theta: Any) -> Any:
    """Return det J = -(wA/S_A + wB/S_B) ∂ℓC/∂θ of ∂(λA, λB, λC)/∂(y, z, θ) [m/rad].

    Negative on home's side of the singularity.
    """
    wa, wb, _ = extents(sizes, y, theta)
    a, b, _ = drops(sizes, y, theta)
    with np.errstate(divide="ignore"):
        return -(wa / a + wb / b) * arm(sizes, y, theta)


def height(sizes: Sizes, y: Any, theta: Any, travel: Any) -> Any:
    """Return H(y, θ) = travel - (max ℓ - min ℓ) [m], the height in z that a stroke leaves; NaN out of reach.

    Parameters
    ----------
    sizes, y, theta
        As of `arm`.
    travel : float
        Highest less lowest slider position [m].
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
    """Return the angle of a leg from the vertical, from 0 to π for a positive extent [rad]."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.arctan(extent / drop) + np.where(np.real(drop) < 0, np.pi, 0.0)


def larger(one: Any, other: Any) -> Any:
    """Return the larger of two by its real part; NaN where one of them is."""
    return np.where(np.real(one) < np.real(other), other, one + 0 * other)


def smaller(one: Any, other: Any) -> Any:
    """Return the smaller of two by its real part; NaN where one of them is."""
    return np.where(np.real(one) > np.real(other), other, one + 0 * other)


_CLOSE = 1e-6  # how near θ + β must be to what was asked [rad]: other roots are far off


def reach_range(sizes: Sizes, y: FloatArray, serial: float = 0.0) -> FloatArray:
    """Return the largest size of θ that leg C reaches at each y, up to π [rad]; ndarray, shape (N,)."""
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
    """Return which part of ranges of θ within the aspect leaves a height H ≥ 0; ndarray, shape (N,)."""
    a, b, _ = offsets(sizes, y, lower)
    least, most = _offset_c(sizes, y, lower), _offset_c(sizes, y, upper)
    from_, to = np.maximum(a, b) - travel, np.minimum(a, b) + travel
    low = np.where(least >= from_, lower, theta_of(sizes, y, from_))
    high = np.where(most <= to, upper, theta_of(sizes, y, to))
    empty = ~((from_ <= most) & (least <= to) & (np.abs(a - b) <= travel))
    return np.where(empty, np.nan, low), np.where(empty, np.nan, high)


def theta_of(sizes: Sizes, y: FloatArray, offset: FloatArray) -> FloatArray:
    """Return the θ of home's aspect at which ℓC has a value: the forward kinematics of leg C.

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
    """Return θ with u sin(γ - θ) = wC, (r + u sinγ) cosθ - u cosγ sinθ = R; NaN for what is no such angle."""
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


_COUNT = 801  # points of a locus


class Aspects(NamedTuple):
    """Areas in (y, θ), θ once around, of what the legs reach hanging below their sliders [m rad].

    Parameters
    ----------
    home : float
        Where det J has home's sign, around home.
    above, below : float
        Beyond the singularity above home's aspect, and beyond the one below it.
    joined : bool
        Whether leg C reaches around θ = π at y = 0, so that `above` and `below` are one aspect.
    """

    home: float
    above: float
    below: float
    joined: bool


def loci(sizes: Sizes, count: int = _COUNT) -> dict[str, FloatArray]:
    """Return the loci of the singularities for θ between -π and π; dict of str to ndarray, shape (n, 2)."""
    reach = float(sizes.reach)
    y = -reach * np.cos(np.linspace(0, np.pi, count))  # closer at the ends, where loci are steep
    ends = reach_range(sizes, y)
    lower, upper = aspect_range(sizes, y)
    border = -ends
    curves = {
        "actuation above": (y, upper),
        "actuation below": _only(y, lower, lower > border + 1e-9),
        "serial c above": _only(y, ends, ends < np.pi),
        "serial c below": _only(y, border, ends < np.pi),
    }
    found = {name: np.stack(curve, axis=-1) for name, curve in curves.items()}
    top = float(np.nan_to_num(ends[-1], nan=np.pi))
    for name, place in (("serial a", reach), ("serial b", -reach)):
        found[name] = np.array([[place, -top], [place, top]])
    return {name: curve for name, curve in found.items() if np.isfinite(curve[:, 1]).sum() > 1}


def aspects(sizes: Sizes) -> Aspects:
    """Return the areas of the aspects, without stroke and tilt limits."""
    x, w = np.polynomial.legendre.leggauss(16)
    reach, R, r = float(sizes.reach), float(sizes.R), float(sizes.r)
    around = float(root((sizes.L - R - r) * (sizes.L + R + r)))  # u = R + r: nearer, leg C reaches all around
    inner = [around] if 0 < around < reach else []
    total = np.zeros(3)
    for low, high in zip([0.0, *inner], [*inner, reach], strict=True):
        phi = np.pi * (np.arange(12)[:, None] + (x + 1) / 2).ravel() / 12
        y = (low + high) / 2 - (high - low) / 2 * np.cos(phi)
        weight = np.tile(w, 12) * np.pi / 24 * np.sin(phi) * (high - low) / 2
        ends, (lower, upper) = reach_range(sizes, y), aspect_range(sizes, y)
        total += 2 * np.array([weight @ v for v in (upper - lower, ends - upper, lower + ends)])
    home, above, below = (float(v) for v in total)
    return Aspects(home, above, below, bool(R + r <= sizes.L))


def _only(y: FloatArray, theta: FloatArray, where: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    return y, np.where(where, theta, np.nan)
