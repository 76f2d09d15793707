"""Curves through poses: what differentiates, interpolates and plans a motion. Arrays in, arrays out.

SciPy is imported where it is used: it takes as long to load as Pinocchio, and a control loop needs none.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import MotionError

ORDER = 7
"""Degree of the spline that differentiates a pose."""


def derivatives(time: FloatArray, values: FloatArray, count: int, order: int = ORDER) -> list[FloatArray]:
    """Differentiate columns by the interpolating spline of the given degree.

    Up to `order` + 1 samples, the spline is the polynomial through all of them.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Strictly rising times [s]; at least two.
    values : ndarray, shape (N, k)
        One column a quantity.
    count : int
        How many derivatives.
    order : int
        Degree of the spline, odd; lowered to N - 1 for fewer samples.

    Returns
    -------
    list of ndarray, each of shape (N, k)
        First derivative, second derivative, ...

    Raises
    ------
    MotionError
        If the times are so uneven that the spline cannot be computed.
    """
    spline, unit = interpolating(time, values, order)
    local = (time - time[0]) / unit
    return [np.asarray(spline(local, n)) / unit**n for n in range(1, count + 1)]


def interpolating(time: FloatArray, values: FloatArray, order: int) -> tuple[Any, float]:
    """Return the interpolating spline of columns, in a time of its own.

    Parameters
    ----------
    time, values, order
        As for `derivatives`.

    Returns
    -------
    spline : scipy.interpolate.BSpline
        Of the time since the first sample in `unit`, and of the order of the derivative.
    unit : float
        The mean step, which keeps the equations well scaled [s].

    Raises
    ------
    MotionError
        If the times are so uneven that the spline cannot be computed.
    """
    from scipy.interpolate import make_interp_spline

    unit = float((time[-1] - time[0]) / (len(time) - 1))
    local = (time - time[0]) / unit
    order = min(order, len(time) - 1)
    knots = np.repeat(local[[0, -1]], order + 1) if len(time) == order + 1 else None
    try:
        return make_interp_spline(local, values, k=order, t=knots), unit
    except (np.linalg.LinAlgError, ValueError) as problem:
        raise MotionError(f"time: expected steps even enough for a spline, got {problem}") from problem


def hermite(time: FloatArray, pose: FloatArray, velocity: FloatArray, acceleration: FloatArray) -> Any:
    """Return the quintic Hermite spline, which takes on all three quantities at every sample.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Strictly rising times [s]; at least two.
    pose, velocity, acceleration : ndarray, shape (N, 3)
        The quantities to take on.

    Returns
    -------
    scipy.interpolate.BPoly
        The curve, a function of time and of the order of the derivative.
    """
    from scipy.interpolate import BPoly

    step = np.diff(time)[:, None]  # (N-1, 1)
    first, last = slice(None, -1), slice(1, None)
    slope, bend = step / 5, step**2 / 20
    coefficients = [  # of the Bernstein polynomials of degree 5
        pose[first],
        pose[first] + slope * velocity[first],
        pose[first] + 2 * slope * velocity[first] + bend * acceleration[first],
        pose[last] - 2 * slope * velocity[last] + bend * acceleration[last],
        pose[last] - slope * velocity[last],
        pose[last],
    ]
    return BPoly(np.array(coefficients), time)


def between_samples(
    time: FloatArray, pose: FloatArray, velocity: FloatArray, acceleration: FloatArray, at: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Interpolate a sampled motion so that rounded samples do no harm: each quantity from itself.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Strictly rising times [s]; at least two.
    pose, velocity, acceleration : ndarray, shape (N, 3)
        The samples.
    at : ndarray, shape (M,)
        The times asked for [s].

    Returns
    -------
    pose, velocity : ndarray, shape (M, 3)
        By cubic Hermite splines through poses and velocities.
    slope, acceleration : ndarray, shape (M, 3)
        The acceleration as the slope of the velocity, and by a cubic spline through the accelerations.
    """
    from scipy.interpolate import CubicHermiteSpline

    path = CubicHermiteSpline(time, pose, velocity)
    speed = CubicHermiteSpline(time, velocity, acceleration)
    spline, unit = interpolating(time, acceleration, 3)
    local = (at - time[0]) / unit
    return path(at), speed(at), speed(at, 1), np.asarray(spline(local))


def rest_to_rest(start: FloatArray, end: FloatArray, duration: float, order: int) -> Any:
    """Return the polynomial between two poses whose (order - 1) / 2 lowest derivatives vanish at both ends.

    Parameters
    ----------
    start, end : ndarray, shape (3,)
        The two poses.
    duration : float
        Time that it takes [s].
    order : int
        Degree: 5, 7 or 9.

    Returns
    -------
    scipy.interpolate.BPoly
        The curve, a function of time and of the order of the derivative.
    """
    from scipy.interpolate import BPoly

    zeros = [np.zeros(3)] * ((order - 1) // 2)
    return BPoly.from_derivatives([0.0, duration], [[start, *zeros], [end, *zeros]])


def through(times: FloatArray, waypoints: FloatArray) -> Any:
    """Return the quintic spline (four continuous derivatives) through the waypoints, at rest at both ends.

    Parameters
    ----------
    times : ndarray, shape (K,)
        Strictly rising times [s]; at least two.
    waypoints : ndarray, shape (K, 3)
        Poses to pass.

    Returns
    -------
    scipy.interpolate.BSpline
        The curve, a function of time and of the order of the derivative.

    Raises
    ------
    MotionError
        If the times are so uneven that the spline cannot be computed.
    """
    from scipy.interpolate import make_interp_spline

    rest = [(1, np.zeros(3)), (2, np.zeros(3))]
    try:
        return make_interp_spline(times, waypoints, k=5, bc_type=(rest, rest))
    except (np.linalg.LinAlgError, ValueError) as problem:
        raise MotionError(f"times: expected steps even enough for a spline, got {problem}") from problem


def eased(
    time: FloatArray, duration: float, start: float, stop: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a time-law that runs at the rate 1 but for smooth ramps from rest and to rest.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Times, from 0 to `duration` [s].
    duration : float
        Time that it takes [s].
    start, stop : float
        How long the ramps at the beginning and at the end are [s]; zero for none.

    Returns
    -------
    phase, rate, change : ndarray, shape (N,)
        Time along the path [s], its derivative, and its second derivative [1/s].
    """
    begun, rate_begun, change_begun = _ramp(time, start)
    left, rate_left, change_left = _ramp(duration - time, stop)
    phase = begun - left + (duration - time) - stop / 2
    return phase, rate_begun + rate_left - 1, change_begun - change_left


def _ramp(time: FloatArray, length: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return phase, rate and change of a ramp from rest at 0 to the rate 1 at `length`, and after it."""
    if length == 0:
        return time, np.ones_like(time), np.zeros_like(time)
    u = np.minimum(time / length, 1.0)
    rate = u**4 * (35 - u * (84 - u * (70 - 20 * u)))
    phase = length * u**5 * (7 - u * (14 - u * (10 - 2.5 * u))) + np.maximum(time - length, 0.0)
    return phase, rate, 140 * u**3 * (1 - u) ** 3 / length
