"""Batches of samples that users give: finite or not, of one shape; no physics.

Both ways to the forces begin here, and go on by themselves: which samples are out of reach or singular is for
each of them to find out.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, batch_of
from p3dof._base.errors import InputError, ReachError, SingularityError

OnInvalid: TypeAlias = Literal["raise", "nan"]
"""What to do with invalid samples: raise, or fill their rows with NaN."""

POLICIES = get_args(OnInvalid)  # the two

LEGS = ("a", "b", "c")

REACH_TOLERANCE = 1e-14  # share of a leg's length by which it must reach farther than a pose demands
ACTUATION_TOLERANCE = 1e-6
"""Angle from the actuation singularity below which forces are refused [rad].

One unit in the last place of the pose moves the forces by about 1e-16 / angle of themselves, and the forces
are about the weight / angle: nearer than this no machine could use the number.
"""


def check_policy(on_invalid: str) -> None:
    """Raise unless `on_invalid` is one of the two policies."""
    if on_invalid not in POLICIES:
        raise InputError(f"on_invalid: expected 'raise' or 'nan', got {on_invalid!r}")


def raise_not_finite(name: str, array: FloatArray, given: Mapping[str, FloatArray] | None = None) -> None:
    """Raise for the first row of a batch that is not finite; name the largest that it was computed from."""
    finite = np.isfinite(array)
    if not finite.all():
        index, where = first_bad(~np.all(finite, axis=-1))
        rows = {of: values[index] for of, values in (given or {}).items()}
        if rows:
            cause = max(rows, key=lambda of: float(np.abs(rows[of]).max()))
            where = f" from {cause} {rows[cause].tolist()}{where}"
        raise InputError(f"{name}: expected finite numbers, got {array[index].tolist()}{where}")


def first_bad(bad: NDArray[np.bool_], complete: bool = True) -> tuple[tuple[int, ...], str]:
    """Return the index of the first bad sample, and the words that name it in a message."""
    index = tuple(int(i) for i in np.argwhere(bad)[0])
    if not index:
        return index, ""
    shown = index[0] if len(index) == 1 else index
    count = f"{'' if complete else 'at least '}{int(bad.sum())}"
    return index, f" (sample {shown}, the first of {count} such of {bad.size})"


def unit_hint(pose: FloatArray, length: float = np.inf, angle: float = np.pi) -> str:
    """Return which units poses (..., 3) seem to be in that a machine cannot take, in brackets, or nothing.

    Angles beyond half a turn, or another `angle` [rad], look like degrees; y and z beyond a `length` [m] like
    millimetres.
    """
    rows = np.where(np.isfinite(pose), pose, 0.0).reshape(-1, 3)
    y, z, theta = rows[np.abs(rows).argmax(axis=0), range(3)]
    told = [f"{far:g} m: mm?" for far in (y, z) if abs(far) > length]
    told += [f"{theta:g} rad: degrees?"] if abs(theta) > angle else []
    return f" ({', '.join(told)})" if told else ""


def raise_out_of_reach(
    pose: FloatArray, bad: NDArray[np.bool_], margins: FloatArray, complete: bool = True
) -> None:
    """Raise for the first pose of a batch that a leg does not reach."""
    if not bad.any():
        return
    index, where = first_bad(bad, complete)
    leg = int(np.argmin(margins[index]))
    margin = float(margins[index][leg])
    y, z, theta = pose[index]
    shortage = f"is too short by {-margin:g} m" if margin < 0 else "would be horizontal"
    far, short = float(np.abs(pose[bad][:, 0]).max()), -float(margins[bad].min())
    hint = unit_hint(pose[bad], 4 * max(far - short, 0.0) if short > 0.75 * far else np.inf)
    raise ReachError(
        f"pose (y = {y:g} m, z = {z:g} m, theta = {theta:g} rad) is out of reach: leg {LEGS[leg].upper()} "
        f"{shortage}{where}{hint}",
        LEGS[leg],
        margin,
        index,
        int(bad.sum()),
    )


def raise_singular(
    pose: FloatArray, bad: NDArray[np.bool_], actuation: FloatArray, complete: bool = True
) -> None:
    """Raise for the first pose of a batch at which the actuators cannot hold the platform."""
    if not bad.any():
        return
    index, where = first_bad(bad, complete)
    y, z, theta = pose[index]
    where += unit_hint(pose[bad])
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
    """Return the external wrench for every sample of a batch; ndarray, shape (*shape, 6)."""
    array = rows_like(np.zeros(6) if wrench is None else wrench, shape)
    finite = np.isfinite(array)
    if finite.all():
        return array
    if on_invalid == "raise":
        raise_not_finite("wrench", array)
    return np.where(finite.all(axis=-1, keepdims=True), array, np.nan)
