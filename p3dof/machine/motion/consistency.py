"""Do velocities and accelerations belong to the poses? The check that catches a wrong unit or column.

Each sample's velocity is compared with the derivative of the spline through the poses, and its acceleration
with that of the spline through the velocities (one differentiation each: rounded numbers survive it).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import MotionError
from p3dof._base.time_series.smoothing import ORDER, derivatives

TOLERANCE = 1e-3
"""Share of a column's largest derivative by which a velocity or an acceleration may miss it."""

FLOOR = 1e-6
"""Smallest derivative that counts as motion [SI]: a column that moves less is held to `TOLERANCE` of this."""

MINIMUM = 6
"""Fewest samples that allow a statement."""

HINT = "check=False takes the motion as it is"
"""What a program can do about a motion that is refused here."""

_COLUMNS = ("y", "z", "theta")
_UNITS = {"velocity": ("m/s", "m/s", "rad/s"), "acceleration": ("m/s²", "m/s²", "rad/s²")}


@dataclass(frozen=True, eq=False)
class _Comparison:
    """Derivatives beside what was given for them, all (N, 3)."""

    expected: FloatArray
    gap: FloatArray
    sure: FloatArray  # (3,): what may be missed by at any sample
    allowed: FloatArray


def check_consistency(
    time: FloatArray, pose: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> None:
    """Raise unless velocity and acceleration are the derivatives of the pose.

    A sample may miss by `TOLERANCE` of the column's largest derivative (of `FLOOR`, if that is larger), plus
    what the samples themselves leave open: roundoff, and the local difference between splines of two degrees,
    which tells how well coarse or rounded samples determine a derivative. Where an acceleration jumps, as in
    a trapezoidal profile, the derivative from either side will do. Fewer than `MINIMUM` samples, or numbers
    too large for the arithmetic, allow no statement and pass.
    """
    if len(time) < MINIMUM:
        return
    with np.errstate(all="ignore"):
        speed = _compare(time, pose, velocity)
        _require("velocity", time, velocity, speed)
        _require("acceleration", time, acceleration, _compare(time, velocity, acceleration))
        _require_steps(time, pose, velocity, acceleration, speed.sure)


def _compare(time: FloatArray, values: FloatArray, given: FloatArray) -> _Comparison:
    from scipy.ndimage import maximum_filter1d  # see splines: not at start-up

    after = _one_sided(time, values)
    before = -_one_sided(-time[::-1], values[::-1])[::-1]
    order = min(ORDER, len(time) - 1)
    try:
        (expected,) = derivatives(time, values, 1, order)
        doubt, noise = (np.abs(expected - derivatives(time, values, 1, n)[0]) for n in (3, order - 2))
    except MotionError:  # times too uneven for a spline
        expected = np.where(np.isnan(after), before, after)
        doubt = noise = np.abs(np.nan_to_num(after - before))
    scale = np.maximum(np.abs(expected).max(axis=0), FLOOR)  # (3,)
    roundoff = np.abs(values).max(axis=0) + np.abs(time).max() * scale
    sure = (
        TOLERANCE * scale
        + 60 * np.median(noise, axis=0)  # the noise of rounded numbers; one outlier does not move a median
        + 50 * np.finfo(float).eps * roundoff / np.diff(time).min()
    )
    gap = np.fmin.reduce([np.abs(guess - given) for guess in (expected, after, before)])
    return _Comparison(expected, gap, sure, sure + 4 * maximum_filter1d(doubt, 7, axis=0))


def _one_sided(time: FloatArray, values: FloatArray) -> FloatArray:
    """Differentiate at each sample the cubic through it and the next three; NaN for the last three."""
    t = np.lib.stride_tricks.sliding_window_view(time, 4)  # (N-3, 4)
    p = np.lib.stride_tricks.sliding_window_view(values, 4, axis=0)  # (N-3, 3, 4)
    total = np.zeros(p.shape[:2])
    for j in (1, 2, 3):
        k, m = (i for i in (1, 2, 3) if i != j)
        reach = (t[:, k] - t[:, 0]) * (t[:, m] - t[:, 0])
        weight = reach / ((t[:, j] - t[:, 0]) * (t[:, j] - t[:, k]) * (t[:, j] - t[:, m]))
        total += weight[:, None] * (p[:, :, j] - p[:, :, 0])
    return np.concatenate([total, np.full((3, values.shape[1]), np.nan)])


def _require(quantity: str, time: FloatArray, given: FloatArray, comparison: _Comparison) -> None:
    share = comparison.gap / comparison.allowed  # NaN, where the numbers overflow, is no statement
    if not np.any(share > 1):
        return
    i, column = (int(n) for n in np.unravel_index(np.nanargmax(share), share.shape))
    name, unit = _COLUMNS[column], _UNITS[quantity][column]
    raise MotionError(
        f"{quantity} of {name} at t = {time[i]:g} s: expected {comparison.expected[i, column]:.6g} {unit}, "
        f"as the {'poses' if quantity == 'velocity' else 'velocities'} have it, "
        f"got {given[i, column]:.6g} {unit} (a unit, a column or a sample is wrong)",
        HINT,
    )


def _require_steps(
    time: FloatArray, pose: FloatArray, velocity: FloatArray, acceleration: FloatArray, sure: FloatArray
) -> None:
    """Find a single wrong pose, which the derivatives on either side of it do not see."""
    from scipy.ndimage import maximum_filter1d

    step = np.diff(time)[:, None]  # (N-1, 1)
    change = np.diff(acceleration, axis=0)
    expected = step * ((velocity[1:] + velocity[:-1]) / 2 - step * change / 12)
    gap = np.abs(np.diff(pose, axis=0) - expected)
    share = gap / (step * (sure + step * maximum_filter1d(np.abs(change), 3, axis=0) / 4))
    if not np.any(share > 1):
        return
    i, column = (int(n) for n in np.unravel_index(np.nanargmax(share), share.shape))
    unit = ("m", "m", "rad")[column]
    raise MotionError(
        f"pose {_COLUMNS[column]} from t = {time[i]:g} to {time[i + 1]:g} s: expected a step of "
        f"{expected[i, column]:.6g} {unit}, as the velocities have it, "
        f"got {pose[i + 1, column] - pose[i, column]:.6g} {unit} (a sample is wrong)",
        HINT,
    )
