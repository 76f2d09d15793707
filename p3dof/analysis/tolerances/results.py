"""What tolerance analyses return: forces, and poses, that are not known exactly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.tables import ShownInNotebook

ToleranceMethod: TypeAlias = Literal["gradient", "montecarlo"]
"""First order by exact gradients, or sampled machines."""


@dataclass(frozen=True, eq=False, repr=False)
class ForceTolerance(ShownInNotebook):
    """How uncertain the forces over a motion are.

    P parameters vary independently of each other. Bounds: of a force at one sample, between which 95 % of all
    machines are; of a peak, below which 95 % are.

    Parameters
    ----------
    method : {"gradient", "montecarlo"}
        First order, or sampled machines.
    names, units : tuple of str
        Of the P parameters.
    nominal, sigma : ndarray, shape (P,)
        Their numbers and standard deviations, in SI units.
    time : ndarray, shape (N,)
        Of the samples [s].
    forces : ndarray, shape (N, 3)
        Of the nominal machine [N].
    deviation : ndarray, shape (N, 3)
        Standard deviations of the forces [N].
    low, high : ndarray, shape (N, 3)
        95 % bounds of the forces [N]: 1.96 standard deviations from their mean.
    worst : ndarray, shape (N, 3)
        Change of the forces in the worst case [N]: all parameters `worst_sigma` standard deviations off, each
        to its bad side, to first order.
    peak : ndarray, shape (4,)
        Largest magnitude of the forces of A, B, C, and of all [N]; of the nominal machine.
    peak_mean, peak_deviation : ndarray, shape (4,)
        Its mean and standard deviation [N].
    peak_high : ndarray, shape (4,)
        Below which it is in 95 % of machines [N].
    peak_worst : ndarray, shape (4,)
        In the worst case [N].
    peak_gradient : ndarray, shape (4, P)
        Derivative of it by the parameters, in SI units.
    shares : ndarray, shape (4, P)
        Share of the variance of the peak that each parameter has, to first order.
    worst_sigma : float
        How many standard deviations the worst case is.
    peaks : ndarray, shape (M, 4), optional
        The peaks of each sampled machine [N]; NaN where it cannot perform the motion.
    drawn : ndarray, shape (M, P), optional
        By how much the parameters of each were off, in SI units.
    """

    method: ToleranceMethod
    names: tuple[str, ...]
    units: tuple[str, ...]
    nominal: FloatArray
    sigma: FloatArray
    time: FloatArray
    forces: FloatArray
    deviation: FloatArray
    low: FloatArray
    high: FloatArray
    worst: FloatArray
    peak: FloatArray
    peak_mean: FloatArray
    peak_deviation: FloatArray
    peak_high: FloatArray
    peak_worst: FloatArray
    peak_gradient: FloatArray
    shares: FloatArray
    worst_sigma: float
    peaks: FloatArray | None = None
    drawn: FloatArray | None = None

    def __repr__(self) -> str:
        peak, deviation, high = self.peak[3], self.peak_deviation[3], self.peak_high[3]
        return (
            f"ForceTolerance({self.method}: peak {peak:.5g} N, standard deviation {deviation:.4g} N, "
            f"95 % below {high:.5g} N)"
        )

    @property
    def machines(self) -> int:
        """How many machines were sampled."""
        return 0 if self.peaks is None else len(self.peaks)

    @property
    def impossible(self) -> int:
        """How many of them cannot perform the motion: they are left out of all means and bounds."""
        return 0 if self.peaks is None else int(np.isnan(self.peaks[:, 3]).sum())


@dataclass(frozen=True, eq=False, repr=False)
class PoseTolerance(ShownInNotebook):
    """How uncertain static poses are, when the sliders stand where the nominal machine would have them.

    Each leg has its own R, r, L and offset of its encoder: P = 12 parameters, or those of them that vary. The
    closures stay those of this machine: unequal rods of the parallelogram, axes that are not parallel and
    guides that are not vertical are outside of it. They do not make a small error of the pose: the machine is
    overconstrained, and they jam it or strain its parts (see `p3dof.analysis.reactions`, assembly errors).

    Parameters
    ----------
    method : {"gradient", "montecarlo"}
        First order, or sampled machines whose closures are solved.
    names : tuple of str
        Of the P parameters: ``R.a``, ``r.a``, ``L.a``, ``encoder.a`` and so on.
    sigma : ndarray, shape (P,)
        Their standard deviations [m].
    pose : ndarray, shape (..., 3)
        y [m], z [m], θ [rad].
    gradient : ndarray, shape (..., 3, P)
        Derivative of the pose by the parameters [1, rad/m].
    deviation : ndarray, shape (..., 3)
        Standard deviations of y, z, θ [m, m, rad].
    high : ndarray, shape (..., 3)
        Below which the magnitude of the error is in 95 % of machines [m, m, rad].
    covariance : ndarray, shape (..., 3, 3)
        Of the errors of y, z, θ.
    worst : ndarray, shape (..., 3)
        Error in the worst case [m, m, rad]: all parameters `worst_sigma` standard deviations off, each to its
        bad side, to first order.
    shares : ndarray, shape (..., 3, P)
        Share of the variance that each parameter has, to first order.
    worst_sigma : float
        How many standard deviations the worst case is.
    errors : ndarray, shape (M, ..., 3), optional
        The errors of each sampled machine [m, m, rad]; NaN where it does not assemble.
    drawn : ndarray, shape (M, P), optional
        By how much the parameters of each were off [m].
    """

    method: ToleranceMethod
    names: tuple[str, ...]
    sigma: FloatArray
    pose: FloatArray
    gradient: FloatArray
    deviation: FloatArray
    high: FloatArray
    covariance: FloatArray
    worst: FloatArray
    shares: FloatArray
    worst_sigma: float
    errors: FloatArray | None = None
    drawn: FloatArray | None = None

    def __repr__(self) -> str:
        sizes = self.deviation.reshape(-1, 3).max(axis=0)
        return (
            f"PoseTolerance({self.method}: standard deviations up to {1e6 * sizes[0]:.4g} µm in y, "
            f"{1e6 * sizes[1]:.4g} µm in z, {1e3 * sizes[2]:.4g} mrad)"
        )

    @property
    def machines(self) -> int:
        """How many machines were sampled."""
        return 0 if self.errors is None else len(self.errors)

    @property
    def impossible(self) -> int:
        """How many of them do not assemble at some pose: they are left out of all means and bounds."""
        if self.errors is None:
            return 0
        return int(np.isnan(self.errors.reshape(len(self.errors), -1)).any(axis=1).sum())
