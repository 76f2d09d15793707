"""Which poses are reachable and which are singular: margins, and one clear error for a batch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from p3dof.algebra import components
from p3dof.checks import FloatArray
from p3dof.errors import InputError, ReachError, SingularityError
from p3dof.paper.formulas import Configuration
from p3dof.parameters import Geometry

OnInvalid: TypeAlias = Literal["raise", "nan"]
"""What to do with invalid samples: raise, or fill their rows with NaN."""

ACTUATION_TOLERANCE = 1e-6
"""Angle from the actuation singularity below which forces are refused [rad].

One unit in the last place of the pose moves the forces by about 1e-16 / angle of themselves, and the forces
are about the weight / angle: nearer than this no machine could use the number.
"""

REACH_TOLERANCE = 1e-14
"""Share of a leg's length by which it must reach farther than a pose demands."""

LEGS = ("a", "b", "c")


@dataclass(frozen=True, eq=False)
class Singularity:
    """How far poses are from the two kinds of singularity.

    Parameters
    ----------
    serial : ndarray, shape (..., 3)
        Reach margin of the legs A, B, C [m]: the leg's length less what the pose demands of it across the
        guide-ways. Zero: the leg is horizontal; negative: the pose is out of reach.
    actuation : ndarray, shape (...)
        Angle from the pose where the platform's arm P-C5 lies in the plane of leg C's rods [rad], positive on
        home's side. Zero: det J = 0, the sliders cannot hold the platform's rotation.
    determinant : ndarray, shape (...)
        det J of ∂(λA, λB, λC)/∂(y, z, θ) [m/rad]; NaN out of reach.
    """

    serial: FloatArray
    actuation: FloatArray
    determinant: FloatArray


def check_policy(on_invalid: str) -> None:
    """Raise unless `on_invalid` is one of the two policies.

    Parameters
    ----------
    on_invalid : str
        What the user gave.

    Raises
    ------
    InputError
        If it is neither ``"raise"`` nor ``"nan"``.
    """
    if on_invalid not in get_args(OnInvalid):
        raise InputError(f"on_invalid: expected 'raise' or 'nan', got {on_invalid!r}")


def raise_not_finite(name: str, array: FloatArray) -> None:
    """Raise for the first row of a batch that is not finite.

    Parameters
    ----------
    name : str
        What to call the argument.
    array : ndarray, shape (..., 3)
        The argument.

    Raises
    ------
    InputError
        If any entry is NaN or infinite.
    """
    bad = ~np.all(np.isfinite(array), axis=-1)
    if bad.any():
        index, where = first_bad(bad)
        raise InputError(f"{name}: expected finite numbers, got {array[index].tolist()}{where}")


def raise_out_of_reach(geometry: Geometry, pose: FloatArray, serial: FloatArray) -> None:
    """Raise for the first pose of a batch that a leg does not reach.

    Parameters
    ----------
    geometry : Geometry
        Lengths of the mechanism.
    pose : ndarray, shape (..., 3)
        The poses.
    serial : ndarray, shape (..., 3)
        Their reach margins [m].

    Raises
    ------
    ReachError
        Naming the leg, its margin, the sample and how many there are.
    """
    bad = ~reached(geometry, serial)
    if not bad.any():
        return
    index, where = first_bad(bad)
    leg = int(np.argmin(serial[index]))
    margin = float(serial[index][leg])
    y, z, theta = pose[index]
    shortage = f"is too short by {-margin:g} m" if margin < 0 else "would be horizontal"
    raise ReachError(
        f"pose (y = {y:g} m, z = {z:g} m, theta = {theta:g} rad) is out of reach: leg {LEGS[leg].upper()} "
        f"{shortage}{where}",
        LEGS[leg],
        margin,
        index,
        int(bad.sum()),
    )


def raise_singular(pose: FloatArray, bad: NDArray[np.bool_], actuation: FloatArray) -> None:
    """Raise for the first pose of a batch at which the actuators cannot hold the platform.

    Parameters
    ----------
    pose : ndarray, shape (..., 3)
        The poses.
    bad : ndarray of bool, shape (...)
        Which of them are singular.
    actuation : ndarray, shape (...)
        Their angles from the singularity [rad].

    Raises
    ------
    SingularityError
        Naming the pose, the angle, the sample and how many there are.
    """
    if not bad.any():
        return
    index, where = first_bad(bad)
    y, z, theta = pose[index]
    raise SingularityError(
        f"pose (y = {y:g} m, z = {z:g} m, theta = {theta:g} rad) is actuation-singular: the sliders cannot "
        f"hold the platform's rotation ({abs(float(actuation[index])):.2g} rad from det J = 0){where}",
        index,
        int(bad.sum()),
    )


def first_bad(bad: NDArray[np.bool_]) -> tuple[tuple[int, ...], str]:
    """Return the index of the first bad sample, and the words that name it in a message.

    Parameters
    ----------
    bad : ndarray of bool, shape (...)
        Which samples are bad; at least one is.

    Returns
    -------
    index : tuple of int
        Its index in the batch; empty for a single sample.
    where : str
        For a batch: which sample it is and how many there are; else empty.
    """
    index = tuple(int(i) for i in np.argwhere(bad)[0])
    if not index:
        return index, ""
    shown = index[0] if len(index) == 1 else index
    return index, f" (sample {shown}, the first of {int(bad.sum())} such of {bad.size})"


def reach_margins(geometry: Geometry, poses: FloatArray) -> FloatArray:
    """Return by how much the legs A, B, C are longer than the poses demand across the guide-ways.

    Parameters
    ----------
    geometry : Geometry
        Lengths of the mechanism.
    poses : ndarray, shape (..., 3)
        y [m], z [m], θ [rad].

    Returns
    -------
    ndarray, shape (..., 3)
        Margins [m]; zero or less is out of reach.
    """
    y, _, theta = components(poses)
    width = geometry.R - geometry.r
    demands = (
        np.abs(width + y),
        np.abs(width - y),
        np.hypot(y, geometry.R - geometry.r * np.cos(theta)),
    )
    margins: FloatArray = geometry.L - np.stack(demands, axis=-1)
    return margins


def actuation_angle(x: Configuration) -> FloatArray:
    """Return the angle from the pose where the platform's arm lies in the plane of the rods of leg C.

    Parameters
    ----------
    x : Configuration
        Of arrays.

    Returns
    -------
    ndarray, shape (...)
        [rad]; see `Singularity`.
    """
    return np.asarray(np.arcsin(np.clip(x.cos_54, -1, 1)))


def reached(geometry: Geometry, serial: FloatArray) -> NDArray[np.bool_]:
    """Return whether every leg reaches, by more than what rounding can tell.

    Parameters
    ----------
    geometry : Geometry
        Lengths of the mechanism.
    serial : ndarray, shape (..., 3)
        Reach margins [m].

    Returns
    -------
    ndarray of bool, shape (...)
        False for NaN margins too.
    """
    inside: NDArray[np.bool_] = np.all(serial > REACH_TOLERANCE * geometry.L, axis=-1)
    return inside
