"""Where a page begins, checked."""

from __future__ import annotations

import math
from typing import Any

from p3dof._base.checks import FloatArray, real, shown
from p3dof._base.errors import InputError

SLOWEST, FASTEST = 0.1, 4.0
"""How many times faster than in reality a run can be played."""


def start_of(time: FloatArray | None, at: float | None, speed: float, playing: bool) -> dict[str, Any]:
    """Return where a page begins, as a document has it.

    Parameters
    ----------
    time : ndarray, shape (N,), or None
        Times of the first run [s]; None if there is none.
    at : float, optional
        The time to begin at [s]; the first by default.
    speed : float
        How many times faster than in reality.
    playing : bool
        Whether it plays already.

    Returns
    -------
    dict

    Raises
    ------
    InputError
        If the run has no such time, or the speed is out of range.
    """
    if not isinstance(playing, bool):
        raise InputError(f"playing: expected True or False, got {shown(playing)}")
    start: dict[str, Any] = {"speed": within("speed", speed, SLOWEST, FASTEST), "playing": playing}
    if at is not None:
        if time is None:
            raise InputError("at: expected a run to go with it")
        start["time"] = within("at", at, float(time[0]), float(time[-1]))
    return start


def within(name: str, value: object, low: float, high: float) -> float:
    """Return a number from a page or a user, if it lies in a range.

    Parameters
    ----------
    name : str
        What to call it.
    value : object
        What came.
    low, high : float
        The range, ends included.

    Returns
    -------
    float

    Raises
    ------
    InputError
        If it is something else.
    """
    number = value if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
    if not low <= number <= high:
        raise InputError(f"{name}: expected a number from {low:g} to {high:g}, got {shown(value)}")
    return real(name, number)
