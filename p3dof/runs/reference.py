"""A motion as a function of time, for what follows it step by step."""

from __future__ import annotations

from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError
from p3dof.machine.motion import Motion
from p3dof.machine.motion.splines import hermite


class Reference:
    """Pose, velocity and acceleration of a motion at any time, by quintic Hermite interpolation.

    Before its first sample and after its last one the motion rests there.

    Parameters
    ----------
    motion : Motion
        The motion; its time counts from its first sample.

    Raises
    ------
    InputError
        If it is not a `Motion`.
    """

    def __init__(self, motion: Motion) -> None:
        if not isinstance(motion, Motion):
            raise InputError(f"motion: expected a Motion, got {shown(motion)}")
        self.motion = motion
        self._curves: list[Any] = []
        if len(motion) > 1:
            from scipy.interpolate import PPoly

            time = motion.time - motion.time[0]
            curve = PPoly.from_bernstein_basis(
                hermite(time, motion.pose, motion.velocity, motion.acceleration)
            )
            self._curves = [curve, curve.derivative(), curve.derivative(2)]

    @property
    def curve(self) -> Any:
        """The poses as SciPy's ``PPoly``, from time zero; None if there is only one."""
        return self._curves[0] if self._curves else None

    def at(self, time: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return pose, velocity and acceleration at a time.

        Parameters
        ----------
        time : float
            Time since the beginning of the motion [s].

        Returns
        -------
        pose, velocity, acceleration : ndarray, shape (3,)
        """
        if time < 0 or not self._curves:
            return self.motion.pose[0], np.zeros(3), np.zeros(3)
        if time > self.motion.duration * (1 + 1e-14):
            return self.motion.pose[-1], np.zeros(3), np.zeros(3)
        inside = min(time, self.motion.duration)
        pose, velocity, acceleration = (np.asarray(curve(inside)) for curve in self._curves)
        return pose, velocity, acceleration

    def over(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return poses, velocities and accelerations at times since the beginning (N,), shape (N, 3) each."""
        pose, velocity, acceleration = (self.derivative(times, order) for order in range(3))
        return pose, velocity, acceleration

    def derivative(self, times: FloatArray, order: int) -> FloatArray:
        """Return one of them at times (N,), shape (N, 3): poses, velocities, accelerations are 0, 1, 2."""
        before, after = times < 0, times > self.motion.duration * (1 + 1e-14)
        if self._curves:
            found = np.asarray(self._curves[order](np.clip(times, 0.0, self.motion.duration)))
        else:
            found = np.zeros((len(times), 3)) + (self.motion.pose[0] if order == 0 else 0.0)
        found[before] = self.motion.pose[0] if order == 0 else 0.0
        found[after] = self.motion.pose[-1] if order == 0 else 0.0
        return found

    def poses(self, times: FloatArray) -> FloatArray:
        """Return the poses at times since the beginning, shape (N, 3)."""
        return self.derivative(times, 0)
