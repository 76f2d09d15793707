"""Numbers of samples and sample times: the checks that every way to make a motion shares."""

from __future__ import annotations

from typing import Any

import numpy as np

from p3dof.checks import FloatArray
from p3dof.errors import MotionError

MAX_SAMPLES = 10_000_000
"""Most samples that a motion is made with: a slip of the keyboard must not exhaust the memory."""


def sample_count(samples: Any, least: int) -> int:
    """Return a number of samples as an int.

    Parameters
    ----------
    samples : int
        The argument; a float without a fraction will do.
    least : int
        The smallest number allowed.

    Returns
    -------
    int

    Raises
    ------
    MotionError
        If it is not a whole number from `least` to `MAX_SAMPLES`.
    """
    whole = not isinstance(samples, bool | np.bool_) and np.ndim(samples) == 0
    try:
        number = int(samples) if whole else 0
        whole = whole and not isinstance(samples, str) and number == samples
    except (TypeError, ValueError, OverflowError):
        whole = False
    if not whole or not least <= number <= MAX_SAMPLES:
        raise MotionError(
            f"samples: expected a whole number from {least} to {MAX_SAMPLES}, got {samples!r:.40}"
        )
    return number


def evenly(start: float, end: float, count: int) -> FloatArray:
    """Return evenly spaced times, both ends included.

    Parameters
    ----------
    start, end : float
        First and last time [s].
    count : int
        How many.

    Returns
    -------
    ndarray, shape (count,)
    """
    times: FloatArray = np.linspace(start, end, count, dtype=np.float64)
    return times


def require_rising(name: str, time: FloatArray) -> None:
    """Raise unless each time is later than the one before it.

    Parameters
    ----------
    name : str
        What to call the argument in an error.
    time : ndarray, shape (N,)
        The times [s].

    Raises
    ------
    MotionError
        Naming the first pair that does not rise.
    """
    for i in np.flatnonzero(time[1:] <= time[:-1]):
        raise MotionError(
            f"{name}: expected strictly rising times, got {time[i]:g} s and then {time[i + 1]:g} s "
            f"at index {i + 1}"
        )


def require_inside(name: str, time: FloatArray, start: float, end: float) -> None:
    """Raise unless all times lie between two others.

    Parameters
    ----------
    name : str
        What to call the argument in an error.
    time : ndarray, shape (N,)
        The times [s].
    start, end : float
        Earliest and latest [s].

    Raises
    ------
    MotionError
        Naming the first time outside.
    """
    for outside in time[(time < start) | (time > end)]:
        raise MotionError(f"{name}: expected times from {start:g} to {end:g} s, got {outside:g} s")
