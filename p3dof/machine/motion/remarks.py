"""What to know about poses from a file: how the curve through them begins and ends, how far to trust it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import MotionError
from p3dof.machine.motion import splines
from p3dof.machine.motion.curve import Curve
from p3dof.machine.motion.smoothing import SmoothingFit

AT_REST = 1e-3
"""Share of its largest speed below which a column is at rest."""

FEW, MANY = 20, 200
"""Poses that are waypoints whatever they are, and that are none."""

_BULGE = 1.1
"""How many times larger the acceleration between waypoints is than at them."""

_ROUGH = 1e-2
"""Share of its root mean square by which the acceleration may differ with the degree of the spline."""

_STILL = 1e-6
"""Acceleration below which nothing moves [SI]."""

_SMALL_UNITS = ("mm", "mm", "mrad")
_NAMES, _UNITS = ("y", "z", "theta"), ("m/s", "m/s", "rad/s")


def remarks_on_curve(curve: Curve) -> tuple[str, ...]:
    """Return what to know about a curve through poses, one sentence each.

    Parameters
    ----------
    curve : Curve
        The curve.

    Returns
    -------
    tuple of str
    """
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


def smoothing_told(fit: SmoothingFit, names: Sequence[str], units: Sequence[str]) -> str:
    """Say how far splines follow columns of values, and what they leave of them.

    Parameters
    ----------
    fit : SmoothingFit
        The splines.
    names, units : sequence of str
        Of the columns: what to call them, and in which unit a thousandth of each is.

    Returns
    -------
    str
    """
    bands = ", ".join(f"{name} to {band:.3g} Hz" for name, band in zip(names, fit.band, strict=True))
    left, most = (
        ", ".join(f"{1e3 * value:.2g} {unit}" for value, unit in zip(values, units, strict=True))
        for values in (fit.residual, fit.largest)
    )
    return (
        f"are smoothed: quintic splines follow {bands}; what they leave is taken for noise: "
        f"{left} rms, at most {most}"
    )


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
    """Say that poses are too rough to differentiate."""
    told = roughness_told(curve.time, curve.pose, acceleration, _NAMES, _UNITS)
    return told and f"the poses {told}; velocities and accelerations in the file would help)"


def roughness_told(
    time: FloatArray,
    values: FloatArray,
    acceleration: FloatArray,
    names: Sequence[str],
    units: Sequence[str],
) -> str:
    """Say that values are too rough to differentiate: splines of two degrees tell different accelerations.

    Parameters
    ----------
    time : ndarray, shape (N,)
        [s]
    values, acceleration : ndarray, shape (N, k)
        Columns, and their second derivatives by the spline of degree `p3dof.machine.motion.splines.ORDER`.
    names, units : sequence of str
        What to call each column, and the unit of its velocity.

    Returns
    -------
    str
        Empty if they are not; else without its last bracket.
    """
    if len(time) <= FEW:
        return ""
    try:
        other = splines.derivatives(time, values, 2, splines.ORDER - 2)[1]
    except MotionError:
        return ""
    apart = np.abs(acceleration - other)
    with np.errstate(all="ignore"):  # squares of numbers that are too large are no statement
        typical = np.sqrt(np.mean(acceleration**2, axis=0))
        noise = np.sqrt(np.mean(apart**2, axis=0))
        share = noise / np.maximum(typical, max(_ROUGH * typical.max(), _STILL))
    column = int(np.argmax(share))
    if not share[column] > _ROUGH:
        return ""
    worst = int(np.argmax(apart[:, column]))
    return (
        f"are too rough or too far apart to differentiate: at t = {time[worst]:g} s splines "
        f"of degree 7 and 5 differ by {apart[worst, column]:.2g} {units[column]}² in the acceleration of "
        f"{names[column]} (rounded or noisy? smooth='auto', or --smooth auto, leaves the noise out"
    )
