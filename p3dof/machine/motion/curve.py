"""`Curve`: the spline through poses, or near measured ones, which is what a file of poses alone means."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, FrozenArrays, frozen_array
from p3dof._base.errors import MotionError
from p3dof.machine.motion import splines
from p3dof.machine.motion.smoothing import Smooth, SmoothingFit, checked, fitted
from p3dof.machine.motion.times import require_inside, require_rising


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
        for as far as the poses have more than noise: `p3dof.machine.motion.smoothing`. Without it, the curve
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
            return splines.interpolating(self.time, self.pose, splines.ORDER)

    def __repr__(self) -> str:
        how = "through" if self.smooth is None else "near"
        return f"Curve({how} {len(self.time)} poses, {self.time[0]:g} to {self.time[-1]:g} s)"
