"""Smoothing of measured poses: quintic splines of few pieces, fitted by least squares.

A spline that interpolates takes rounding and noise for motion. A spline of K equal pieces follows the values
up to the frequency K / (2 T) over the time T, and leaves the rest as a residual. Without a band width, K is
the number with the least Bayesian information criterion (corrected by Hurvich and Tsai where samples are
few): more pieces only where they explain more than noise. Rounded values are not asked to be met more closely
than rounding lets them be, rms q / √12 of the last digit q: at slow motions it is no noise.

References
----------
G. Schwarz, Estimating the dimension of a model, Annals of Statistics 6 (1978) 461-464.
C. M. Hurvich and C.-L. Tsai, Regression and time series model selection in small samples, Biometrika 76
(1989) 297-307.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from p3dof._base.checks import FloatArray, positive, shown
from p3dof._base.errors import MotionError

Smooth: TypeAlias = Literal["auto"] | float | None
"""How to smooth: not at all, by the noise of the values, or up to a frequency [Hz]."""

DEGREE = 5
_HOLE = 2
"""Most pieces without a value: more would follow whatever the values beside them do."""
_ENOUGH = 0.6
"""Largest number of unknowns of a fit that the criterion may choose, by the number of samples."""
_GROWTH = 1.25
"""From one number of pieces that is tried to the next."""
_OCTAVES = 8
"""So many times more pieces than the best without a better one end the search."""
_DIGITS = range(1, 10)
_SCALES = (1.0, 180 / math.pi)
"""Numbers are rounded in SI units, or in degrees."""


@dataclass(frozen=True, eq=False)
class SmoothingFit:
    """Quintic splines that were fitted to columns of values.

    Parameters
    ----------
    splines : tuple of scipy.interpolate.BSpline
        One a column, of the time since the first value.
    pieces : tuple of int
        How many equal pieces each has.
    band : ndarray, shape (k,)
        Up to which frequency each follows its column [Hz].
    residual, largest : ndarray, shape (k,)
        Root mean square of what is left, and the largest [units of the columns].
    settled : bool
        Whether no column, unless it is rounded, could have done with more pieces than samples allow: else it
        may be too far apart rather than noisy.
    """

    splines: tuple[Any, ...]
    pieces: tuple[int, ...]
    band: FloatArray
    residual: FloatArray
    largest: FloatArray
    settled: bool

    def at(self, times: FloatArray, order: int) -> FloatArray:
        """Return a derivative of all columns at times (M,) since the first value [s], (M, k)."""
        return np.stack([np.asarray(spline(times, order)) for spline in self.splines], axis=-1)


def checked(smooth: Any) -> Smooth:
    """Return a way to smooth after a check.

    Parameters
    ----------
    smooth : "auto", float or None
        See `Smooth`.

    Returns
    -------
    "auto", float or None

    Raises
    ------
    MotionError
        If it is something else.
    """
    if smooth is None or (isinstance(smooth, str) and smooth == "auto"):
        return smooth  # type: ignore[return-value]  # "auto", as a subclass of str may be
    if isinstance(smooth, str | bool):
        raise MotionError(f"smooth: expected None, 'auto' or a frequency [Hz], got {shown(smooth)}")
    return positive("smooth", smooth, MotionError)


def fitted(
    time: FloatArray, values: FloatArray, smooth: float | Literal["auto"], degree: int = DEGREE
) -> SmoothingFit:
    """Fit splines to columns of values.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Strictly rising times [s].
    values : ndarray, shape (N, k)
        One column a quantity.
    smooth : float or "auto"
        Up to which frequency the splines follow the values [Hz]; the criterion decides by ``"auto"``.
    degree : int
        Of the splines.

    Returns
    -------
    SmoothingFit

    Raises
    ------
    MotionError
        If there are too few values for the frequency, none for too long a time, or they are too uneven in
        time.
    """
    local, span = time - time[0], float(time[-1] - time[0])
    found, settled = [], True
    steps = np.diff(time)
    hole = int(np.argmax(steps))
    over_hole = _HOLE * span / float(steps[hole])
    for column in values.T:
        if smooth == "auto":
            enough, *chosen = _chosen(local, column, degree, over_hole)
            settled = settled and enough
            found.append(chosen)
            continue
        pieces = max(1, math.ceil(2 * float(smooth) * span))
        if pieces + degree > _ENOUGH * len(time):
            most = max(0.0, (_ENOUGH * len(time) - degree) / (2 * span))
            raise MotionError(
                f"smooth: expected at most {most:.3g} Hz for {len(time)} values over {span:.4g} s, "
                f"got {smooth:g} Hz"
            )
        if pieces > max(over_hole, 1):
            raise MotionError(
                f"smooth: expected at most {over_hole / (2 * span):.3g} Hz, as there are no values from "
                f"{time[hole]:.6g} to {time[hole + 1]:.6g} s, got {smooth:g} Hz"
            )
        found.append([pieces, _spline(local, column, pieces, degree)])
    left = values - np.stack([np.asarray(spline(local)) for _, spline in found], axis=-1)
    numbers = tuple(int(number) for number, _ in found)
    return SmoothingFit(
        tuple(spline for _, spline in found),
        numbers,
        np.array(numbers) / (2 * span),
        np.sqrt(np.mean(left**2, axis=0)),
        np.abs(left).max(axis=0),
        settled,
    )


def last_digit(values: FloatArray) -> float:
    """Return to what numbers are rounded: the largest power of ten, in SI units or degrees, that divides all.

    Parameters
    ----------
    values : ndarray, shape (N,)
        The numbers.

    Returns
    -------
    float
        0 for numbers that are not rounded.
    """
    for digits in _DIGITS:
        for scale in _SCALES:
            whole = values * scale * 10**digits
            slack = 1e-3 + 4 * np.finfo(float).eps * np.abs(whole).max()
            if slack < 0.01 and np.abs(whole - np.round(whole)).max() < slack:
                return float(10.0**-digits / scale)
    return 0.0


def _chosen(time: FloatArray, values: FloatArray, degree: int, most: float) -> tuple[bool, int, Any]:
    """Return whether fewer pieces than there may be are best for a column, how many are, and its spline."""
    count = len(time)
    noise = last_digit(values) ** 2 / 12
    tiny = (np.finfo(float).eps * max(np.abs(values).max(), 1e-300)) ** 2
    best: tuple[float, int, Any] | None = None
    for pieces in _numbers(min(_ENOUGH * count - degree, most)):
        if best is not None and pieces > _OCTAVES * (best[1] + 4):
            break
        unknowns = pieces + degree
        try:
            spline = _spline(time, values, pieces, degree)
        except MotionError:
            if best is None:
                raise
            break
        left = float(np.mean((values - np.asarray(spline(time))) ** 2))
        explained = max(left, noise * (1 - unknowns / count), tiny)
        small = 2 * count / max(count - unknowns - 1, 0.5)
        score = count * math.log(explained) + unknowns * max(math.log(count), small)
        if best is None or score < best[0]:
            best = score, pieces, spline
    assert best is not None  # noqa: S101 - one piece is tried, or raises
    return noise > 0 or best[1] < pieces, best[1], best[2]


def _numbers(most: float) -> Iterator[int]:
    """Yield rising numbers of pieces, one at least."""
    pieces = 1
    while pieces == 1 or pieces <= most:
        yield pieces
        pieces = max(pieces + 1, int(_GROWTH * pieces))


def _spline(time: FloatArray, values: FloatArray, pieces: int, degree: int) -> Any:
    from scipy.interpolate import make_lsq_spline  # see splines: not at start-up

    ends = np.repeat(time[[0, -1]], degree)
    knots = np.concatenate([ends[:degree], np.linspace(time[0], time[-1], pieces + 1), ends[degree:]])
    try:
        return make_lsq_spline(time, values, knots, k=degree)
    except (np.linalg.LinAlgError, ValueError) as problem:
        raise MotionError(
            f"smooth: expected values even enough in time for {pieces} pieces, got {problem}"
        ) from problem
