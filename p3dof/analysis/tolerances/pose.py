"""Static errors of the pose of a machine whose legs are not what they should be: each has its own lengths.

The closures of the legs, with R, r, L of each leg and the offset of its encoder:

- A: λ = z - h + √(L² - w²), w = R - r + y
- B: λ = z - h + √(L² - w²), w = R - r - y
- C: λ = z - h + r sinθ + √(L² - y² - w²), w = R - r cosθ

h is that of the nominal machine: it only says where z counts from.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, batch_of, shown
from p3dof._base.errors import InputError
from p3dof.analysis.tolerances.directions import amount_of, require_smaller
from p3dof.machine.parameters import Geometry
from p3dof.machine.parameters.quantities import LENGTH

KINDS = ("R", "r", "L", "encoder")
NAMES = tuple(f"{kind}.{leg}" for leg in "abc" for kind in KINDS)
"""The twelve parameters of the pose."""

_STEPS = 25
_CLOSED = 1e-13
"""What a closure may be open in the end [m], for each metre of a leg's length."""


def sigmas_of(given: Mapping[str, Any], geometry: Geometry) -> tuple[tuple[str, ...], FloatArray]:
    """Return which parameters of the pose vary, and their standard deviations.

    Parameters
    ----------
    given : mapping
        By ``R``, ``r``, ``L``, ``encoder`` for all legs, each leg on its own, or by ``L.a`` and so on.
    geometry : Geometry
        The nominal lengths.

    Returns
    -------
    names : tuple of str
    sigma : ndarray, shape (P,)
        [m]

    Raises
    ------
    InputError
        If something is not among them, or is no length.
    """
    if not isinstance(given, Mapping) or not given:
        raise InputError("sigma: expected lengths by names of parameters, such as {'L': '50 um'}")
    found: dict[str, float] = {}
    for name in sorted(given, key=lambda name: "." in str(name).removeprefix("geometry.")):  # of one leg last
        plain = str(name).removeprefix("geometry.")
        kind, dot, leg = plain.partition(".")
        if kind not in KINDS or (dot and leg.lower() not in ("a", "b", "c")):
            raise InputError(
                f"sigma: expected R, r, L or encoder, for all legs or one such as L.a, got {shown(name)}; "
                "unequal rods of the parallelogram and tilted guides are outside of this model"
            )
        amount = amount_of(given[name], getattr(geometry, kind, 0.0), LENGTH, f"sigma of {plain}")
        if kind != "encoder":
            require_smaller(amount, getattr(geometry, kind), "m", f"sigma of {plain}")
        found |= {f"{kind}.{each}": amount for each in (leg.lower() or "abc")}
    names = tuple(name for name in NAMES if name in found)
    return names, np.array([found[name] for name in names])


def closures(geometry: Geometry, pose: FloatArray, off: FloatArray) -> FloatArray:
    """Return where the sliders of a machine stand, as its encoders tell it.

    Parameters
    ----------
    geometry : Geometry
        The nominal lengths.
    pose : ndarray, shape (..., 3)
        Of its platform.
    off : ndarray, shape (..., 12)
        By how much it is off, as `NAMES` [m].

    Returns
    -------
    ndarray, shape (..., 3)
        [m]; NaN out of reach.
    """
    sliders: FloatArray = _closures(geometry, pose, off)[0]
    return sliders


def closure_derivatives(
    geometry: Geometry, pose: FloatArray, off: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return how `closures` change with the pose, (..., 3, 3), and with the parameters, (..., 3, 12)."""
    sliders, (y, theta), (w, S, r, L) = _closures(geometry, pose, off)
    by_pose = np.zeros((*sliders.shape, 3))
    by_off = np.zeros((*sliders.shape, len(NAMES)))
    slope = w / S
    sine, cosine = np.sin(theta), np.cos(theta)
    by_pose[..., 0, 0], by_pose[..., 1, 0] = -slope[..., 0], slope[..., 1]
    by_pose[..., 2, 0] = -y / S[..., 2]
    by_pose[..., 1] = 1.0
    by_pose[..., 2, 2] = r[..., 2] * (cosine - sine * slope[..., 2])
    for leg in range(3):
        first = 4 * leg
        by_off[..., leg, first] = -slope[..., leg]
        by_off[..., leg, first + 1] = slope[..., leg]
        by_off[..., leg, first + 2] = L[..., leg] / S[..., leg]
        by_off[..., leg, first + 3] = 1.0
    by_off[..., 2, 9] = sine + cosine * slope[..., 2]
    return by_pose, by_off


def _closures(geometry: Geometry, pose: FloatArray, off: FloatArray) -> tuple[Any, Any, Any]:
    y, z, theta = (pose[..., k] for k in range(3))
    of_legs = off.reshape(*off.shape[:-1], 3, 4)
    R, r, L = geometry.R + of_legs[..., 0], geometry.r + of_legs[..., 1], geometry.L + of_legs[..., 2]
    across = R[..., 2] - r[..., 2] * np.cos(theta)
    ab = R[..., :2] - r[..., :2]
    w = np.stack(np.broadcast_arrays(ab[..., 0] + y, ab[..., 1] - y, across), axis=-1)
    rest = np.stack(np.broadcast_arrays(0 * y, 0 * y, y**2), axis=-1)
    S = np.sqrt(np.where(L**2 - rest - w**2 > 0, L**2 - rest - w**2, np.nan))
    rise = np.stack(np.broadcast_arrays(0 * theta, 0 * theta, r[..., 2] * np.sin(theta)), axis=-1)
    sliders = (z - geometry.h)[..., None] + rise + S + of_legs[..., 3]
    r, L = np.broadcast_to(r, sliders.shape), np.broadcast_to(L, sliders.shape)
    return sliders, (y, theta), (w, S, r, L)


def pose_gradient(geometry: Geometry, pose: FloatArray) -> FloatArray:
    """Return how the pose changes with the parameters, sliders held: (..., 3, 12) [1, rad/m]."""
    by_pose, by_off = closure_derivatives(geometry, pose, np.zeros(len(NAMES)))
    return np.asarray(-np.linalg.solve(by_pose, by_off), dtype=np.float64)


def poses_of(geometry: Geometry, pose: FloatArray, off: FloatArray) -> FloatArray:
    """Return where machines stand whose encoders tell what the nominal one's would at a pose.

    Parameters
    ----------
    geometry : Geometry
        The nominal lengths.
    pose : ndarray, shape (..., 3)
        Which the sliders are sent to.
    off : ndarray, shape (M, 12)
        By how much each machine is off [m].

    Returns
    -------
    ndarray, shape (M, ..., 3)
        By Newton's method from `pose`; NaN where a machine does not assemble near it.
    """
    asked = closures(geometry, pose, np.zeros(len(NAMES)))
    off = off.reshape(len(off), *(1,) * (pose.ndim - 1), len(NAMES))
    found = np.broadcast_to(pose, (len(off), *pose.shape)).copy()
    gap: FloatArray = np.full(found.shape, np.inf)
    with np.errstate(all="ignore"):
        for _ in range(_STEPS):
            gap = closures(geometry, found, off) - asked
            open_ = np.nan_to_num(np.abs(gap), nan=0.0)
            if (open_ <= _CLOSED * geometry.L).all():
                break
            by_pose = closure_derivatives(geometry, found, off)[0]
            singular = ~np.isfinite(by_pose).all(axis=(-2, -1)) | (np.linalg.det(by_pose) == 0)
            by_pose[singular] = np.eye(3)
            step = np.linalg.solve(by_pose, gap[..., None])[..., 0]
            found -= np.where(singular[..., None], np.nan, step)
    closed = (np.abs(gap) <= 100 * _CLOSED * geometry.L).all(axis=-1, keepdims=True)
    return np.where(closed, found, np.nan)


def checked_pose(geometry: Geometry, pose: Any) -> FloatArray:
    """Return poses that the nominal machine reaches and holds.

    Raises
    ------
    InputError, ReachError, SingularityError
        If they are none.
    """
    from p3dof.closed_form.kinematics.gate import holdable
    from p3dof.machine.motion.states import states_of

    poses = batch_of("pose", pose, 3)
    holdable(geometry, states_of(poses))
    return poses
