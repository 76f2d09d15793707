"""The work of powers that are known at samples: integrals of splines, between gaps and singularities."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof.methods import InverseDynamics

_DEGREE = 5
"""Of the spline through the power that is integrated; lower where there are fewer samples than it takes."""

_ROUNDING = 1e-9
"""Share of the time by which the integral of one may miss it."""


def work_over(
    result: InverseDynamics, rates: FloatArray, total: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the work of all powers over a motion, and how it balances the energy.

    Parameters
    ----------
    result : InverseDynamics
        The motion and its valid samples.
    rates : ndarray, shape (N, 5)
        Powers of the three actuators and of the wrench, and what friction takes [W].
    total : ndarray, shape (N,)
        T + V [J].

    Returns
    -------
    work : ndarray, shape (N, 5)
        Their integrals [J].
    balance : ndarray, shape (N,)
        Change of T + V less the work done on the mechanism, since the first sample of the run [J].
    given : ndarray, shape (3,)
        What each actuator gave, without what it took back [J].
    """
    work, balance = np.full(rates.shape, np.nan), np.full(len(total), np.nan)
    done, given = np.zeros(rates.shape[1]), np.zeros(3)
    for run in runs(result):
        time = result.time[run]
        curve = integral(time, rates[run])
        since = curve(time)
        work[run] = done + since
        done = work[run][-1]
        balance[run] = total[run] - total[run.start] - since[:, :4].sum(axis=-1) + since[:, 4]
        given += _given(time, rates[run, :3], curve)
    return work, balance, given


def work_given(time: FloatArray, power: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the work of actuators over a motion, all samples of which are valid.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Times [s].
    power : ndarray, shape (N, 3)
        Of the actuators [W].

    Returns
    -------
    net, given : ndarray, shape (3,)
        The whole work, and that which is given without what is taken back [J].
    """
    curve = integral(time, power)
    return curve(time[-1:])[0], _given(time, power, curve)


def _given(time: FloatArray, power: FloatArray, curve: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Return the work that each of some powers gives, from their integral."""
    given = np.zeros(power.shape[1])
    for leg in range(power.shape[1]):
        steps = np.diff(curve(_with_turns(time, power[:, leg]))[:, leg])
        given[leg] = steps[steps > 0].sum()
    return given


def runs(result: InverseDynamics) -> list[slice]:
    """Return the stretches of neighbouring valid samples; none reaches across a singularity.

    Parameters
    ----------
    result : InverseDynamics
        The motion.

    Returns
    -------
    list of slice
        Of its samples.
    """
    valid = result.valid
    joined = valid[:-1] & valid[1:]
    starts = np.flatnonzero(valid & np.concatenate([[True], ~joined]))
    ends = np.flatnonzero(valid & np.concatenate([~joined, [True]]))
    return [slice(int(start), int(end) + 1) for start, end in zip(starts, ends, strict=True)]


def integral(time: FloatArray, rates: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Return the integral of powers from the first time on.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Increasing times [s].
    rates : ndarray, shape (n, k)
        The powers there.

    Returns
    -------
    callable
        From times (m,) to integrals (m, k).
    """
    if len(time) == 1:
        return lambda t: np.zeros((len(t), rates.shape[1]))
    unit = (time[-1] - time[0]) / (len(time) - 1)  # the mean step keeps the equations well scaled
    local = (time - time[0]) / unit
    known = np.column_stack([rates, np.ones(len(time))])  # the integral of one is the time
    try:
        curve = _antiderivative(local, known, min(_DEGREE, len(time) - 1))
        smooth = abs(curve(local[-1])[-1] - local[-1]) <= _ROUNDING * local[-1]
    except (np.linalg.LinAlgError, ValueError):
        smooth = False
    if not smooth:
        curve = _antiderivative(local, known, 1)
    return lambda t: np.asarray(curve((t - time[0]) / unit)[:, :-1]) * unit


def work_weights(time: FloatArray) -> FloatArray:
    """Return what the powers at the samples contribute to the work over all: weights of `integral`.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Increasing times [s].

    Returns
    -------
    ndarray, shape (N,)
        [s]
    """
    count = len(time)
    if count == 1:
        return np.zeros(1)
    unit = (time[-1] - time[0]) / (count - 1)
    local = (time - time[0]) / unit
    weights = _spline_weights(local, min(_DEGREE, count - 1))
    if not abs(weights.sum() - local[-1]) <= _ROUNDING * local[-1]:
        weights = _spline_weights(local, 1)
    return np.asarray(weights * unit)


def _spline_weights(time: FloatArray, degree: int) -> FloatArray:
    """Return the integrals of the splines that are one at a sample and zero at all others."""
    from scipy.interpolate import BSpline, make_interp_spline
    from scipy.sparse.linalg import spsolve

    knots = np.repeat(time[[0, -1]], degree + 1) if len(time) == degree + 1 else None
    try:
        knots = make_interp_spline(time, np.ones(len(time)), k=degree, t=knots).t
        table = BSpline.design_matrix(time, knots, degree)
        whole = (knots[degree + 1 :] - knots[: -degree - 1]) / (degree + 1)  # integrals of the B-splines
        return np.asarray(spsolve(table.T.tocsc(), whole))
    except (np.linalg.LinAlgError, ValueError):
        return np.full(len(time), np.nan)


def step_weights(time: FloatArray, points: int) -> FloatArray:
    """Return how the work of a power grows between samples, by the polynomial through those around.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Increasing times [s].
    points : int
        Of each polynomial, at most N: as many samples, from `first_points` on.

    Returns
    -------
    ndarray, shape (N - 1, points, points)
        Coefficients: the work until the share s of step i is the sum over m of s**(m + 1) times row m on the
        powers [s].
    """
    steps = np.diff(time)
    nearby = first_points(len(time), points)[:, None] + np.arange(points)
    places = (time[nearby] - time[:-1, None]) / steps[:, None]
    powers = np.linalg.inv(places[:, :, None] ** np.arange(points))
    weights: FloatArray = steps[:, None, None] * powers / np.arange(1, points + 1)[:, None]
    return weights


def first_points(count: int, points: int) -> NDArray[np.int_]:
    """Return the first of the samples that integrate the step after each of `count` samples but the last."""
    return np.clip(np.arange(count - 1) - (points // 2 - 1), 0, count - points)


def _antiderivative(time: FloatArray, rates: FloatArray, degree: int) -> Any:
    from scipy.interpolate import make_interp_spline

    # Of few samples, the polynomial through all of them.
    knots = np.repeat(time[[0, -1]], degree + 1) if len(time) == degree + 1 else None
    return make_interp_spline(time, rates, k=degree, t=knots).antiderivative()


def _with_turns(time: FloatArray, power: FloatArray) -> FloatArray:
    """Return the times of the samples and of the zeros of the power between them.

    The zeros are those of straight lines: the work is stationary there, so that it hardly matters where.
    """
    i = np.flatnonzero(np.sign(power[:-1]) * np.sign(power[1:]) < 0)
    share = power[i] / (power[i] - power[i + 1])
    return np.sort(np.concatenate([time, time[i] + share * (time[i + 1] - time[i])]))
