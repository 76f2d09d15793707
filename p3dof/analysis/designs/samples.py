"""The motion that all designs make: its samples, and the weights of means and integrals over it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError
from p3dof.analysis.energy.work import first_points, step_weights, work_weights
from p3dof.machine.motion import Motion
from p3dof.machine.motion.wrenches import WRENCH_ROWS, Load, WrenchOverTime

LANES = 8
"""Samples are padded to a multiple of this with the last one, whose weights are zero."""

_POINTS = 6
"""Samples of the polynomials that integrate powers between two of them."""

_UNEVEN = 10.0
"""Sum of the sizes of these weights, as a share of the step, above which trapezoids serve instead."""

MOST_SAMPLES = 100_000
"""The longest motion that designs are computed over."""


@dataclass(frozen=True, eq=False)
class Samples:
    """A motion, and the external load on the platform, as the loops over designs take them.

    Parameters
    ----------
    time : ndarray, shape (N,)
        [s]
    rows : ndarray, shape (9, N) or (12, N)
        y, z, θ, their velocities and accelerations; F_y, F_z and M_y of the wrench if there is one.
    """

    time: FloatArray
    rows: FloatArray

    def __len__(self) -> int:
        return len(self.time)

    @property
    def pose(self) -> FloatArray:
        """Poses (N, 3)."""
        return self.rows[:3].T

    @cached_property
    def mean(self) -> FloatArray:
        """Weights of the mean over time, by trapezoids as `InverseDynamics.rms_forces` (N,)."""
        if len(self) < 2:
            return np.ones(1)
        steps = np.diff(self.time)
        sums = (np.append(steps, 0.0) + np.insert(steps, 0, 0.0)) / 2
        mean: FloatArray = sums / (self.time[-1] - self.time[0])
        return mean

    @cached_property
    def work(self) -> FloatArray:
        """Weights of the work of powers, as `Energy.work` (N,) [s]."""
        return work_weights(self.time)

    @cached_property
    def points(self) -> int:
        """How many samples make the polynomials that tell work given from work taken back."""
        if len(self) < 2:
            return 1
        points = min(_POINTS, len(self))
        sizes = np.abs(step_weights(self.time, points).sum(axis=1)).sum(axis=1)
        smooth = np.all(sizes <= _UNEVEN * np.diff(self.time))
        return points if smooth else 2

    @cached_property
    def partial(self) -> FloatArray:
        """Coefficients of the work over a part of a step (N - 1, points, points) [s]."""
        return step_weights(self.time, self.points) if len(self) > 1 else np.zeros((0, 1, 1))

    @cached_property
    def first(self) -> NDArray[np.int_]:
        """The first of the samples that these are for (N - 1,)."""
        return first_points(len(self), self.points)

    def packed(self) -> FloatArray:
        """Return all of it in a row, as the compiled loop takes it; see `DesignLoop`.

        Returns
        -------
        ndarray
        """
        count, points = len(self), self.points
        padded = -(-count // LANES) * LANES
        steps = np.zeros((points, padded))
        steps[:, : count - 1] = self.partial.sum(axis=1).T
        partial = np.zeros((count, points, points))
        partial[: count - 1] = self.partial
        y, z, theta, *moving = self.rows
        load = [np.zeros(count)] * (12 - len(self.rows))
        rows = np.stack([y, z, np.sin(theta), np.cos(theta), *moving, *load, theta])
        edge = np.pad(rows, ((0, 0), (0, padded - count)), "edge")
        weights = np.pad(np.stack([self.mean, self.work]), ((0, 0), (0, padded - count)))
        return np.concatenate([edge.ravel(), weights.ravel(), steps.ravel(), partial.ravel()])


def samples_of(motion: Motion, wrench: WrenchOverTime = None) -> Samples:
    """Return a motion and a load as samples.

    Parameters
    ----------
    motion : Motion
        What the machines do.
    wrench : array-like, shape (6,) or (N, 6), or callable, optional
        External force and moment on the platform, as of `Manipulator.inverse_dynamics`.

    Returns
    -------
    Samples

    Raises
    ------
    InputError
        If an argument is something else, the load does not fit, or the motion has more than 100,000 samples.
    """
    if not isinstance(motion, Motion):
        raise InputError(f"motion: expected a Motion, got {shown(motion)}")
    if len(motion) > MOST_SAMPLES:
        raise InputError(f"motion: expected at most {MOST_SAMPLES} samples for designs, got {len(motion)}")
    rows = [*motion.pose.T, *motion.velocity.T, *motion.acceleration.T]
    if wrench is not None:
        load = Load(wrench, motion.start).over(motion.time)
        if not np.isfinite(load).all():
            raise InputError("wrench: expected finite numbers")
        rows += [load[:, row] for row in WRENCH_ROWS]
    return Samples(np.asarray(motion.time), np.ascontiguousarray(rows))
