"""`Curve`: the spline through poses, or near measured ones, which is what a file of poses alone means."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, FrozenArrays, frozen_array
from p3dof._base.errors import MotionError
from p3dof._base.time_series import smoothing
from p3dof._base.time_series.smoothing import (
    FEW,
    ORDER,
    Smooth,
    SmoothingFit,
    checked,
    derivatives,
    fitted,
    roughness_told,
    smoothing_told,
)
from p3dof._base.time_series.times import require_inside, require_rising


@dataclass(frozen=True, eq=False, repr=False)
class Curve(FrozenArrays):
    """The spline of degree 7 through poses, or a smooth one near them, from the first to the last.

    Parameters
    ----------
    time : array-like, shape (N,)
        Strictly rising times of the poses [s]; at least two. Through fewer than nine poses, the curve is the
        polynomial through all of them.
    pose : array-like, shape (N, 3)
        y, z [m] and θ [rad].
    smooth : float or "auto", optional
        Up to which frequency quintic splines follow the poses [Hz], which they need not pass then; ``"auto"``
        for as far as the poses have more than noise: `p3dof.machine.SmoothingFit`. Without it, the curve
        passes them.

    Raises
    ------
    MotionError
        If an argument does not fit, or the times are too uneven for a spline.
    """

    time: FloatArray
    pose: FloatArray
    smooth: Smooth = None

    def __post_init__(self) -> None:
        time = frozen_array("time", self.time, ("N",), MotionError)
        if len(time) < 2:
            raise MotionError(
                f"time: expected at least two samples to differentiate, got {len(time)}; "
                "a single one needs its velocity and acceleration given"
            )
        require_rising("time", time)
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "pose", frozen_array("pose", self.pose, (len(time), 3), MotionError))
        object.__setattr__(self, "smooth", checked(self.smooth))
        _ = self._spline if self.fit is None else None  # says at once that there is none

    def at(self, times: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return pose, velocity and acceleration at times on the curve.

        Parameters
        ----------
        times : array-like, shape (M,)
            Times from that of the first pose to that of the last [s].

        Returns
        -------
        pose, velocity, acceleration : ndarray, shape (M, 3)
            Of y, z, θ [m, m, rad], per second, per second².

        Raises
        ------
        MotionError
            If a time lies outside the curve.
        """
        asked = frozen_array("times", times, ("M",), MotionError)
        require_inside("times", asked, float(self.time[0]), float(self.time[-1]))
        if self.fit is not None:
            local = asked - self.time[0]
            return self.fit.at(local, 0), self.fit.at(local, 1), self.fit.at(local, 2)
        spline, unit = self._spline
        local = (asked - self.time[0]) / unit
        with np.errstate(all="ignore"):  # who takes the numbers refuses what overflows
            pose, velocity, acceleration = (np.asarray(spline(local, n)) / unit**n for n in range(3))
        return pose, velocity, acceleration

    @cached_property
    def fit(self) -> SmoothingFit | None:
        """The splines near the poses, with their bands and residuals; None if the curve passes the poses."""
        return None if self.smooth is None else fitted(self.time, self.pose, self.smooth)

    @cached_property
    def _spline(self) -> tuple[Any, float]:
        with np.errstate(all="ignore"):
            return smoothing.interpolating(self.time, self.pose, smoothing.ORDER)

    def __repr__(self) -> str:
        how = "through" if self.smooth is None else "near"
        return f"Curve({how} {len(self.time)} poses, {self.time[0]:g} to {self.time[-1]:g} s)"


AT_REST = 1e-3
"""Share of its largest speed below which a column is at rest."""

MANY = 200
"""So many poses are no waypoints."""

_BULGE = 1.1
"""How many times larger the acceleration between waypoints is than at them."""


_SMALL_UNITS = ("mm", "mm", "mrad")
_NAMES, _UNITS = ("y", "z", "theta"), ("m/s", "m/s", "rad/s")


def remarks_on_curve(curve: Curve) -> tuple[str, ...]:
    """Return what to know about a curve through poses, one sentence each."""
    _, velocity, acceleration = curve.at(curve.time)
    told = [_ends(curve, velocity)]
    if curve.fit is None:
        told += [_waypoints(curve, acceleration), _roughness(curve, acceleration)]
    else:
        told.append(f"the poses {smoothing_told(curve.fit, _NAMES, _SMALL_UNITS)}")
    return tuple(words for words in told if words)


def is_rough(curve: Curve) -> bool:
    """Return whether a curve that passes poses has accelerations that the poses do not tell for sure."""
    return bool(_roughness(curve, curve.at(curve.time)[2]))


def _ends(curve: Curve, velocity: FloatArray) -> str:
    """Say with what velocities the curve starts and ends, if it does not so at rest."""
    fastest = np.abs(velocity).max(axis=0)
    ends = [_speeds(row, fastest) for row in velocity[[0, -1]]]
    if not any(ends):
        return ""
    start, end = (", ".join(words) or "rest" for words in ends)
    return (
        f"the curve through the poses starts (t = {curve.time[0]:g} s) with {start}, "
        f"and ends (t = {curve.time[-1]:g} s) with {end}"
    )


def _speeds(row: FloatArray, fastest: FloatArray) -> list[str]:
    moving = np.abs(row) > AT_REST * fastest
    return [
        f"{name}dot {value:.4g} {unit}"
        for name, value, unit, moves in zip(_NAMES, row, _UNITS, moving, strict=True)
        if moves
    ]


def _waypoints(curve: Curve, acceleration: FloatArray) -> str:
    """Say that poses look like waypoints: few of them, or a curve that swings out between them."""
    count = len(curve.time)
    if count > MANY or not np.abs(acceleration).max():
        return ""
    if count > FEW:
        shares = (np.arange(1, 8) / 8)[:, None]
        between = curve.at((curve.time[:-1] + shares * np.diff(curve.time)).ravel())[2]
        if np.abs(between).max(axis=0).max() <= _BULGE * np.abs(acceleration).max():
            return ""
    step = 1e3 * float(np.diff(curve.time).mean())
    return (
        f"{count} poses {step:.4g} ms apart look like waypoints: the forces are those of a smooth curve that "
        "passes them without a stop (from rest to rest plan p3dof.Motion.through and, from a task file, "
        "p3dof plan)"
    )


def _roughness(curve: Curve, acceleration: FloatArray) -> str:
    """Say that poses are too noisy to differentiate."""
    told = roughness_told(curve.time, curve.pose, acceleration, _NAMES, _UNITS)
    return told and f"the poses {told}; velocities and accelerations in the file would help)"


TOLERANCE = 1e-3
"""Share of a column's largest derivative by which a velocity or an acceleration may miss it."""

FLOOR = 1e-6
"""Smallest derivative that counts as motion [SI]: a column that moves less is held to `TOLERANCE` of this."""

MINIMUM = 6
"""Fewest samples that allow a statement."""

HINT = "check=False takes the motion as it is"
"""What a program can do about a motion that is refused here."""

_COLUMNS = ("y", "z", "theta")
_DERIVATIVES = {"velocity": ("m/s", "m/s", "rad/s"), "acceleration": ("m/s²", "m/s²", "rad/s²")}


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
    name, unit = _COLUMNS[column], _DERIVATIVES[quantity][column]
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
