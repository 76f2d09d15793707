"""Batches of samples that users give: finite or not, of one shape; no physics.

Both ways to the forces begin here, and go on by themselves: which samples are out of reach or singular is for
each of them to find out.
"""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof.checks import FloatArray, batch_of
from p3dof.errors import InputError, ReachError, SingularityError

OnInvalid: TypeAlias = Literal["raise", "nan"]
"""What to do with invalid samples: raise, or fill their rows with NaN."""

LEGS = ("a", "b", "c")

ACTUATION_TOLERANCE = 1e-6
"""Angle from the actuation singularity below which forces are refused [rad].

One unit in the last place of the pose moves the forces by about 1e-16 / angle of themselves, and the forces
are about the weight / angle: nearer than this no machine could use the number.
"""


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


def first_bad(bad: NDArray[np.bool_], complete: bool = True) -> tuple[tuple[int, ...], str]:
    """Return the index of the first bad sample, and the words that name it in a message.

    Parameters
    ----------
    bad : ndarray of bool, shape (...)
        Which samples are bad; at least one is.
    complete : bool
        Whether all samples were looked at.

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
    count = f"{'' if complete else 'at least '}{int(bad.sum())}"
    return index, f" (sample {shown}, the first of {count} such of {bad.size})"


def raise_out_of_reach(
    pose: FloatArray, bad: NDArray[np.bool_], margins: FloatArray, complete: bool = True
) -> None:
    """Raise for the first pose of a batch that a leg does not reach.

    Parameters
    ----------
    pose : ndarray, shape (..., 3)
        The poses.
    bad : ndarray of bool, shape (...)
        Which of them are out of reach.
    margins : ndarray, shape (..., 3)
        Their reach margins [m].
    complete : bool
        Whether all samples were looked at.

    Raises
    ------
    ReachError
        Naming the leg, its margin, the sample and how many there are.
    """
    if not bad.any():
        return
    index, where = first_bad(bad, complete)
    leg = int(np.argmin(margins[index]))
    margin = float(margins[index][leg])
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


def raise_singular(
    pose: FloatArray, bad: NDArray[np.bool_], actuation: FloatArray, complete: bool = True
) -> None:
    """Raise for the first pose of a batch at which the actuators cannot hold the platform.

    Parameters
    ----------
    pose : ndarray, shape (..., 3)
        The poses.
    bad : ndarray of bool, shape (...)
        Which of them are singular.
    actuation : ndarray, shape (...)
        Their angles from the singularity [rad].
    complete : bool
        Whether all samples were looked at.

    Raises
    ------
    SingularityError
        Naming the pose, the angle, the sample and how many there are.
    """
    if not bad.any():
        return
    index, where = first_bad(bad, complete)
    y, z, theta = pose[index]
    raise SingularityError(
        f"pose (y = {y:g} m, z = {z:g} m, theta = {theta:g} rad) is actuation-singular: the sliders cannot "
        f"hold the platform's rotation ({abs(float(actuation[index])):.2g} rad from det J = 0){where}",
        index,
        int(bad.sum()),
    )


def finite_states(
    pose: ArrayLike,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    on_invalid: OnInvalid,
    third: str = "acceleration",
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return pose, velocity and acceleration with one shape; rows that are not finite are NaN, or raise.

    Parameters
    ----------
    pose, velocity, acceleration : array-like, shape (..., 3)
        What the user gave.
    on_invalid : {"raise", "nan"}
        What to do with samples that are not finite.
    third : str
        What to call the third argument in an error.

    Returns
    -------
    pose, velocity, acceleration : ndarray, shape (..., 3)
        Rows that are not finite in one of them are NaN in all three.

    Raises
    ------
    InputError
        If a sample is not finite, or the shapes do not broadcast.
    """
    check_policy(on_invalid)
    given = {"pose": pose, "velocity": velocity, third: acceleration}
    arrays = {name: batch_of(name, value, 3) for name, value in given.items()}
    if on_invalid == "raise":
        for name, array in arrays.items():
            raise_not_finite(name, array)
    try:
        poses, speeds, rates = np.broadcast_arrays(*arrays.values())
    except ValueError as error:
        first, second, last = (array.shape for array in arrays.values())
        raise InputError(
            f"{', '.join(arrays)}: expected shapes that fit each other, got {first}, {second} and {last}"
        ) from error
    if on_invalid == "nan":
        states = np.stack((poses, speeds, rates))  # (3, ..., 3)
        finite = np.asarray(np.isfinite(states).all(axis=(0, -1)))[..., None]
        poses, speeds, rates = np.where(finite, states, np.nan)
    return poses, speeds, rates


def wrench_like(wrench: ArrayLike | None, shape: tuple[int, ...], on_invalid: OnInvalid) -> FloatArray:
    """Return the external wrench for every sample of a batch.

    Parameters
    ----------
    wrench : array-like, shape (..., 6), or None
        What the user gave; None is no wrench.
    shape : tuple of int
        Leading shape of the batch.
    on_invalid : {"raise", "nan"}
        Raise for numbers that are not finite, or let them through as NaN.

    Returns
    -------
    ndarray, shape (*shape, 6)

    Raises
    ------
    InputError
        If the shape does not fit the batch, or a number is not finite.
    """
    array = batch_of("wrench", np.zeros(6) if wrench is None else wrench, 6)
    if on_invalid == "raise":
        raise_not_finite("wrench", array)
    array = np.where(np.isfinite(array).all(axis=-1, keepdims=True), array, np.nan)
    try:
        return np.broadcast_to(array, (*shape, 6))
    except ValueError as error:
        raise InputError(f"wrench: expected shape {(*shape, 6)} or (6,), got {array.shape}") from error
