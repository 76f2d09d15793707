"""Loci of both singularities as polylines in (y, θ), and the areas of the aspects that they bound."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof.analysis.workspace.closed_forms import Sizes, root
from p3dof.analysis.workspace.slices import aspect_range, reach_range

_COUNT = 801
"""Points of a locus."""


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
    """Return the loci of the singularities for θ between -π and π.

    Parameters
    ----------
    sizes : Sizes
        Of the machine.
    count : int
        Points of each.

    Returns
    -------
    dict of str to ndarray, shape (n, 2)
        y [m] and θ [rad] along each: ``"actuation above"`` and ``"actuation below"`` (det J = 0),
        ``"serial a"``, ``"serial b"`` (the leg is horizontal at every θ), ``"serial c above"`` and
        ``"serial c below"``. NaN where a locus is interrupted; what does not exist is not there.
    """
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
    """Return the areas of the aspects, without stroke and tilt limits.

    Parameters
    ----------
    sizes : Sizes
        Of the machine.

    Returns
    -------
    Aspects
    """
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
