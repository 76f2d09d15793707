"""Numbers of samples and sample times: the checks that every way to make a motion shares."""

from __future__ import annotations

from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, frozen_array
from p3dof._base.errors import MotionError

MAX_SAMPLES = 10_000_000
"""Most samples that a motion is made with: a slip of the keyboard must not exhaust the memory."""


CLOCK = 1e4
"""Times that begin this far from zero are those of a clock [s]: they are counted from the first one.

In double precision they are known to 2e-12 s there, which is nothing to steps of 1 ms; stamps of the time of
day, 1.7e9 s, only to 2.4e-7 s.
"""
_COARSE = 1e-5
"""Share of the shortest step from which the rounding of times is told."""


def is_of_clock(time: FloatArray) -> bool:
    """Return whether times (N,) [s] are those of a clock: far from zero, and twice as far as they last."""
    return bool(len(time)) and abs(time[0]) >= max(CLOCK, 2 * abs(time[-1] - time[0]))


def counted(time: FloatArray) -> tuple[FloatArray, float]:
    """Return times that count from the first one if they are those of a clock, and from when they count."""
    if not is_of_clock(time):
        return time, 0.0
    since: FloatArray = time - time[0]  # exact, as no time is twice or half another
    since.setflags(write=False)
    return since, float(time[0])


def set_times(samples: Any) -> int:
    """Check times and start of frozen samples, count times from the start, and return how many they are."""
    time = frozen_array("time", samples.time, ("N",), MotionError)
    if len(time) == 0:
        raise MotionError("time: expected at least one sample, got none")
    require_rising("time", time)
    if samples.start is None:
        time, start = counted(time)
    else:
        start = float(frozen_array("start", samples.start, (), MotionError))
    object.__setattr__(samples, "time", time)
    object.__setattr__(samples, "start", start)
    return len(time)


def counted_told(start: float) -> str:
    """Say from when times count that are those of a clock."""
    return f"times count from the first one, {start:.16g} s of the clock"


def rounding_told(time: FloatArray, start: float) -> str:
    """Return what to know about times of a clock that were rounded before their subtraction, or nothing."""
    unit = float(np.spacing(abs(start)))
    step = float(np.diff(time).min(initial=np.inf))
    if not start or unit <= _COARSE * step or np.any(np.mod(time, unit)):
        return ""
    return (
        f"the times are those of a clock at {start:.16g} s, known to {unit:.2g} s in double precision: "
        f"{unit / step:.1g} of the shortest step, which a spline divides by twice (subtract the first time "
        "before they are rounded, or smooth the poses: smooth='auto')"
    )


def sample_count(samples: Any, least: int) -> int:
    """Return a number of samples as an int."""
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
    """Return evenly spaced times, both ends included; ndarray, shape (count,)."""
    times: FloatArray = np.linspace(start, end, count, dtype=np.float64)
    return times


def require_rising(name: str, time: FloatArray) -> None:
    """Raise unless each time is later than the one before it."""
    for i in np.flatnonzero(time[1:] <= time[:-1]):
        raise MotionError(
            f"{name}: expected strictly rising times, got {time[i]:g} s and then {time[i + 1]:g} s "
            f"at index {i + 1}"
        )


def require_inside(name: str, time: FloatArray, start: float, end: float) -> None:
    """Raise unless all times lie between two others."""
    for outside in time[(time < start) | (time > end)]:
        raise MotionError(f"{name}: expected times from {start:g} to {end:g} s, got {outside:g} s")
