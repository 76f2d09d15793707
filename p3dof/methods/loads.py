"""External loads over a motion, as users give them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from numpy.typing import ArrayLike

from p3dof.checks import FloatArray
from p3dof.samples import OnInvalid, wrench_like

WrenchOverTime: TypeAlias = ArrayLike | Callable[[FloatArray], ArrayLike] | None
"""A wrench (6,) that stays, one a sample (N, 6), or a function of the times, as `WrenchHistory` is."""


def wrenches_at(time: FloatArray, wrench: WrenchOverTime, on_invalid: OnInvalid) -> FloatArray:
    """Return the external wrench at every sample.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Times [s].
    wrench : array-like, shape (6,) or (N, 6), or callable, optional
        What the user gave.
    on_invalid : {"raise", "nan"}
        Raise for numbers that are not finite, or let them through as NaN.

    Returns
    -------
    ndarray, shape (N, 6)
        [N, N m].

    Raises
    ------
    InputError
        If the shape does not fit, or a number is not finite.
    """
    return wrench_like(wrench(time) if callable(wrench) else wrench, time.shape, on_invalid)
