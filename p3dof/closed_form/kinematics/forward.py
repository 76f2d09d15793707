"""Forward kinematics: the pose at given sliders, in closed form, in every assembly mode.

Legs A and B put P on two circles of radius L in the plane y, z: two points. At each of them the closure of
leg C reads q sinθ + R cosθ = K: two angles. Four modes in all; the working one is the platform below the
sliders with det J of home's sign, the only one that keeps every leg hanging on the paper's side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, batch_of
from p3dof._base.errors import ReachError
from p3dof._base.samples import LEGS, OnInvalid, check_policy, first_bad, raise_not_finite
from p3dof.machine.parameters import Geometry


@dataclass(frozen=True, eq=False)
class _Solution:
    """The poses of one sign of each root, and the margins that say whether they are real."""

    pose: FloatArray  # (..., 3)
    drops: FloatArray  # (..., 3) roots S of the legs [m]: positive hangs below its slider
    margins: FloatArray  # (..., 2) of the circles A-B and of leg C [m]


def forward_kinematics(
    geometry: Geometry, sliders: ArrayLike, all_modes: bool = False, on_invalid: OnInvalid = "raise"
) -> FloatArray:
    """Return the pose at slider positions.

    Parameters
    ----------
    geometry : Geometry
        Lengths of the mechanism.
    sliders : array-like, shape (..., 3)
        λ10 of A, B, C [m].
    all_modes : bool
        Return all four assembly modes, the working one first; modes that do not exist are NaN.
    on_invalid : {"raise", "nan"}
        Raise for samples at which no mode (with `all_modes`) or not the working mode exists, or leave NaN.

    Returns
    -------
    ndarray, shape (..., 3) or (..., 4, 3)
        y [m], z [m], θ [rad]. In the working mode θ is between -3π/2 and π/2, without a jump at -π; in a
        list of all modes it is between -π and π, but for the working one.

    Raises
    ------
    ReachError
        Naming the leg that cannot close and its margin.
    InputError
        If the shape does not fit or a number is not finite.
    """
    check_policy(on_invalid)
    positions = batch_of("sliders", sliders, 3)
    finite = np.isfinite(positions).all(axis=-1, keepdims=True)
    if on_invalid == "raise":
        raise_not_finite("sliders", positions)
    positions = np.where(finite, positions, np.nan)
    working = _solve(geometry, positions, 1, 1)
    if not all_modes:
        valid = _working(working)
        if on_invalid == "raise":
            _raise_open(positions, working, valid)
        return np.where(valid[..., None], working.pose, np.nan)
    others = [_solve(geometry, positions, *signs) for signs in ((1, -1), (-1, 1), (-1, -1))]
    for other in others:
        other.pose[..., 2] = np.arctan2(np.sin(other.pose[..., 2]), np.cos(other.pose[..., 2]))
    modes = np.stack([working.pose, *(other.pose for other in others)], axis=-2)
    if on_invalid == "raise":
        _raise_open(positions, working, np.asarray(np.isfinite(modes).all(axis=-1).any(axis=-1)))
    return modes


def _solve(geometry: Geometry, sliders: FloatArray, below: int, branch: int) -> _Solution:
    """Solve the closures with one sign of each root; where a root is not real the pose is NaN."""
    with np.errstate(over="ignore", invalid="ignore"):  # sliders light years apart do not assemble either
        return _circles(geometry, sliders, below, branch)


def _circles(geometry: Geometry, sliders: FloatArray, below: int, branch: int) -> _Solution:
    r, R, L = geometry.r, geometry.R, geometry.L
    width = R - r
    mean = (sliders[..., 0] + sliders[..., 1]) / 2
    half = (sliders[..., 1] - sliders[..., 0]) / 2
    distance = np.hypot(width, half)  # half the distance between the centres of the circles
    reach = below * _root(L - distance, L + distance)
    y = reach * half / distance
    p = mean - reach * width / distance  # z - h
    q = sliders[..., 2] - p
    u = _root(L - y, L + y)
    rho = np.hypot(R, q)
    K = (q * q + r * r + R * R - u * u) / (2 * r)
    theta = np.arctan2(q, R) - branch * np.arctan2(_root(rho - K, rho + K), K)
    margin_c = np.minimum(u + r - rho, rho - np.abs(u - r))
    drops = (sliders[..., 0] - p, sliders[..., 1] - p, q - r * np.sin(theta))
    return _Solution(
        pose=np.stack([y, p + geometry.h, theta], axis=-1),
        drops=np.stack(drops, axis=-1),
        margins=np.stack([L - distance, margin_c], axis=-1),
    )


def _root(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return √(ab), NaN where it is not real or its sign is not certain."""
    product = a * b
    root: FloatArray = np.sqrt(np.where(product >= 0, product, np.nan))
    return root


def _working(solution: _Solution) -> NDArray[np.bool_]:
    real = np.isfinite(solution.pose).all(axis=-1)
    return np.asarray(real & (solution.drops > 0).all(axis=-1))


def _raise_open(sliders: FloatArray, working: _Solution, valid: NDArray[np.bool_]) -> None:
    """Raise for the first sample without a solution, saying which leg cannot close and why."""
    if valid.all():
        return
    index, where = first_bad(~valid)
    a, b, c = sliders[index]
    head = f"sliders (A = {a:g} m, B = {b:g} m, C = {c:g} m)"
    apart, gap = working.margins[index]
    drops = working.drops[index]
    if not apart >= 0:
        leg, margin = ("b" if b < a else "a"), float(apart)
        reason = f"A and B are too far apart for their legs by {-2 * margin:g} m"
    elif not np.isfinite(drops[2]):
        leg, margin = "c", float(gap)
        reason = f"leg C misses the platform by {-margin:g} m"
    else:
        leg = LEGS[int(np.argmin(drops))]
        margin = float(drops.min())
        reason = f"leg {leg.upper()} would have to stand above its slider by {-margin:g} m"
    raise ReachError(
        f"{head} do not assemble in the working mode: {reason}{where}",
        leg,
        margin,
        index,
        int((~valid).sum()),
    )
