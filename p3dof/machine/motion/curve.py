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
    Smooth,
    SmoothingFit,
    checked,
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
