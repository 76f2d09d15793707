"""`States` of the platform: what users give, as plain arrays of one shape, handed to every method.

They are checked once: shapes, the wrench and `on_invalid` when they are made, by `states_of`; whether every
number is finite by `States.finite`, which a method calls once. (The compiled kernels need not: their
margin tells.) Which of the states are out of reach or singular is for every method to find out by itself.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, batch_of
from p3dof._base.errors import InputError
from p3dof._base.samples import POLICIES, OnInvalid, check_policy, raise_not_finite, wrench_like
from p3dof._base.time_series.wrenches import Load, WrenchOverTime
from p3dof.machine.motion.core import Motion, require_motion

_ZERO = np.zeros(3)
_ZERO.setflags(write=False)
_ZEROS = np.broadcast_to(_ZERO, (2**30, 3))
"""Rows of zero, which take no memory: a part of these is quicker made than new ones."""

_ARRAYS = ("pose", "velocity", "acceleration", "forces")
_GIVEN = {
    absent: ("pose", *(name for name, no in zip(_ARRAYS[1:], absent, strict=True) if not no))
    for absent in product((False, True), repeat=3)
}
"""Names of what is given, by what is not."""


class States(NamedTuple):
    """States of the platform, and what acts on it; zero where nothing was given.

    Parameters
    ----------
    pose, velocity, acceleration : ndarray, shape (..., 3)
        Of (y, z, θ): [m, m, rad] and per second, per second².
    forces : ndarray, shape (..., 3)
        Of the actuators A, B, C [N].
    wrench : ndarray, shape (..., 6), or None
        External force and moment on the platform at P, in the fixed frame [N, N m]; None is no wrench.
    on_invalid : {"raise", "nan"}
        What to do with states that are invalid.
    given : tuple of str
        What of the first four was given, and not checked for being finite.
    """

    pose: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    forces: FloatArray
    wrench: FloatArray | None
    on_invalid: OnInvalid
    given: tuple[str, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """The leading shape, that of the batch."""
        return self.pose.shape[:-1]

    def finite(self) -> States:
        """Return the states after looking at every number: what is not finite raises, or makes rows of NaN.

        Raises
        ------
        InputError
            Naming what is not finite, and the first such sample; unless ``on_invalid="nan"``.
        """
        arrays = [(name, getattr(self, name)) for name in self.given]
        if all(np.isfinite(array).all() for _, array in arrays):
            return self
        if self.on_invalid == "raise":
            for name, array in arrays:
                raise_not_finite(name, array)
        return self.without(~np.all([np.isfinite(array).all(axis=-1) for _, array in arrays], axis=0))

    def raise_overflow(self, name: str, found: FloatArray) -> None:
        """Raise for the first finite state whose result is not; name the largest of its numbers."""
        given = self.given if self.wrench is None else (*self.given, "wrench")
        raise_not_finite(name, found, {each: getattr(self, each) for each in given})

    def without(self, bad: NDArray[np.bool_]) -> States:
        """Return the states with rows of NaN where they are bad, (...); forces and wrench stay."""
        hidden = bad[..., None]
        return self._replace(
            pose=np.where(hidden, np.nan, self.pose),
            velocity=np.where(hidden, np.nan, self.velocity),
            acceleration=np.where(hidden, np.nan, self.acceleration),
        )

    def rows(self) -> States:
        """Return the states with the leading shape (N,)."""
        if self.pose.ndim == 2:
            return self
        return self._replace(
            pose=self.pose.reshape(-1, 3),
            velocity=self.velocity.reshape(-1, 3),
            acceleration=self.acceleration.reshape(-1, 3),
            forces=self.forces.reshape(-1, 3),
            wrench=None if self.wrench is None else self.wrench.reshape(-1, 6),
        )

    def of_rows(self, which: NDArray[np.intp] | slice, on_invalid: OnInvalid) -> States:
        """Return some of the rows, with a policy."""
        rows = self.rows()
        return States(
            rows.pose[which],
            rows.velocity[which],
            rows.acceleration[which],
            rows.forces[which],
            None if rows.wrench is None else rows.wrench[which],
            on_invalid,
            self.given,
        )


def states_of(
    pose: ArrayLike,
    velocity: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    *,
    forces: ArrayLike | None = None,
    wrench: ArrayLike | None = None,
    on_invalid: OnInvalid = "raise",
) -> States:
    """Return what a user gave as states of one shape."""
    check_policy(on_invalid)
    poses = batch_of("pose", pose, 3)
    speeds = _ZERO if velocity is None else batch_of("velocity", velocity, 3)
    rates = _ZERO if acceleration is None else batch_of("acceleration", acceleration, 3)
    driving = _ZERO if forces is None else batch_of("forces", forces, 3)
    given = _GIVEN[velocity is None, acceleration is None, forces is None]
    if not poses.shape == speeds.shape == rates.shape == driving.shape:
        poses, speeds, rates, driving = _broadcast(given, poses, speeds, rates, driving)
    loads = None if wrench is None else wrench_like(wrench, poses.shape[:-1], on_invalid)
    return States(poses, speeds, rates, driving, loads, on_invalid, given)


def states_over(motion: Motion, wrench: WrenchOverTime = None, on_invalid: OnInvalid = "raise") -> States:
    """Return the states of a motion, whose numbers were checked when it was made."""
    if type(motion) is not Motion:
        require_motion(motion)
    if on_invalid not in POLICIES:
        check_policy(on_invalid)
    count, loads = len(motion.time), None
    if wrench is not None:
        loads = wrench_like(Load(wrench, motion.start).over(motion.time), (count,), on_invalid)
    idle = _ZEROS[:count] if count <= len(_ZEROS) else np.broadcast_to(_ZERO, (count, 3))
    return States(motion.pose, motion.velocity, motion.acceleration, idle, loads, on_invalid, ())


def _broadcast(given: tuple[str, ...], *arrays: FloatArray) -> tuple[FloatArray, ...]:
    """Return arrays of one shape, that of those that were given."""
    asked = {name: array for name, array in zip(_ARRAYS, arrays, strict=True) if name in given}
    if len({array.shape for array in asked.values()}) > 1:
        try:
            asked = dict(zip(asked, np.broadcast_arrays(*asked.values()), strict=True))
        except ValueError as error:
            shapes = ", ".join(str(array.shape) for array in asked.values())
            words = f"{', '.join(given)}: expected shapes that fit each other, got {shapes}"
            raise InputError(words) from error
    shape = asked["pose"].shape
    plain = len(shape) == 2 and shape[0] <= len(_ZEROS)
    rest = _ZEROS[: shape[0]] if plain else np.broadcast_to(_ZERO, shape)
    return tuple(asked.get(name, rest) for name in _ARRAYS)
