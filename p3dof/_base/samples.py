"""Batches of samples that users give: finite or not, of one shape; no physics.

Both ways to the forces begin here, and go on by themselves: which samples are out of reach or singular is for
each of them to find out.
"""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, batch_of
from p3dof._base.errors import InputError, ReachError, SingularityError

OnInvalid: TypeAlias = Literal["raise", "nan"]
"""What to do with invalid samples: raise, or fill their rows with NaN."""

POLICIES = get_args(OnInvalid)
"""The two."""

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
    if on_invalid not in POLICIES:
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
    finite = np.isfinite(array)
    if not finite.all():
        index, where = first_bad(~np.all(finite, axis=-1))
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


def rows_like(wrench: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Return a wrench for every sample of a batch, whatever its numbers are; as `wrench_like`."""
    array = batch_of("wrench", wrench, 6)
    if array.shape == (*shape, 6):
        return array
    try:
        return np.broadcast_to(array, (*shape, 6))
    except ValueError as error:
        raise InputError(f"wrench: expected shape {(*shape, 6)} or (6,), got {array.shape}") from error


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
    array = rows_like(np.zeros(6) if wrench is None else wrench, shape)
    finite = np.isfinite(array)
    if finite.all():
        return array
    if on_invalid == "raise":
        raise_not_finite("wrench", array)
    return np.where(finite.all(axis=-1, keepdims=True), array, np.nan)
