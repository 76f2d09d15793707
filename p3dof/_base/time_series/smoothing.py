"""Curves through samples, or near noisy ones: quintic splines, and smoothing by fewer pieces.

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

Curves through poses: what differentiates, interpolates and plans a motion. Arrays in, arrays out.

SciPy is imported where it is used: it takes as long to load as Pinocchio, and a control loop needs none.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, Readable, positive, shown
from p3dof._base.errors import MotionError

ORDER = 7
"""Degree of the spline that differentiates a pose."""


def derivatives(time: FloatArray, values: FloatArray, count: int, order: int = ORDER) -> list[FloatArray]:
    """Differentiate columns by the interpolating spline of the given degree.

    Up to `order` + 1 samples, the spline is the polynomial through all of them.

    First derivative, second derivative, ...
    """
    spline, unit = interpolating(time, values, order)
    local = (time - time[0]) / unit
    return [np.asarray(spline(local, n)) / unit**n for n in range(1, count + 1)]


def interpolating(time: FloatArray, values: FloatArray, order: int) -> tuple[Any, float]:
    """Return the interpolating spline of columns, in a time of its own."""
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
    """Interpolate a sampled motion so that rounded samples do no harm: each quantity from itself."""
    from scipy.interpolate import CubicHermiteSpline

    path = CubicHermiteSpline(time, pose, velocity)
    speed = CubicHermiteSpline(time, velocity, acceleration)
    accelerations = np.zeros((len(at), 3))
    for part in unbroken(time):
        spline, unit = interpolating(time[part], acceleration[part], 3)
        inside = (at >= time[part.start]) & (at <= time[part.stop - 1])
        accelerations[inside] = spline((at[inside] - time[part.start]) / unit)
    return path(at), speed(at), speed(at, 1), accelerations


_BREAK = 1e-3  # a step that is a smaller share of both beside it is a jump


def breaks(time: FloatArray) -> NDArray[np.bool_]:
    """Return which steps are much shorter than both beside them: on their sides are two limits at a jump."""
    step = np.diff(time)
    beside = np.minimum(np.append(step[1:], np.inf), np.insert(step[:-1], 0, np.inf)[: len(step)])
    return np.asarray((step < _BREAK * beside) & np.isfinite(beside))


def unbroken(time: FloatArray) -> list[slice]:
    """Return the parts that a motion has between breaks, and these; each begins where the one before ends."""
    short = np.flatnonzero(breaks(time))
    ends = np.unique(np.concatenate([[0], short, short + 1, [len(time) - 1]]))
    return [slice(int(a), int(b) + 1) for a, b in pairwise(ends)] or [slice(0, 1)]


def subdivided(time: FloatArray, parts: NDArray[np.intp]) -> FloatArray:
    """Return times with each step in so many equal parts, shape (N - 1,); the last one is left out."""
    place = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    return np.asarray(
        np.repeat(time[:-1], parts) + np.repeat(np.diff(time), parts) * place / np.repeat(parts, parts)
    )


def rest_to_rest(start: FloatArray, end: FloatArray, duration: float, order: int) -> Any:
    """Return the polynomial between two poses whose (order - 1) / 2 lowest derivatives vanish at both ends.

    The curve, a function of time and of the order of the derivative.
    """
    from scipy.interpolate import BPoly

    zeros = [np.zeros(3)] * ((order - 1) // 2)
    return BPoly.from_derivatives([0.0, duration], [[start, *zeros], [end, *zeros]])


def through(times: FloatArray, waypoints: FloatArray) -> Any:
    """Return the quintic spline (four continuous derivatives) through the waypoints, at rest at both ends.

    The curve, a function of time and of the order of the derivative.
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
FEW = 20
"""So few values may be waypoints, whatever they are."""
_ROUGH = 1e-2
"""Share of its root mean square by which the acceleration may differ with the degree of the spline."""

_STILL = 1e-6
"""Acceleration below which nothing moves [SI]."""
_SCALES = (1.0, 180 / math.pi)
"""Numbers are rounded in SI units, or in degrees."""


@dataclass(frozen=True, eq=False)
class SmoothingFit(Readable):
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
    """Return a way to smooth after a check."""
    if smooth is None or (isinstance(smooth, str) and smooth == "auto"):
        return smooth  # type: ignore[return-value]  # "auto", as a subclass of str may be
    if isinstance(smooth, str | bool):
        raise MotionError(f"smooth: expected None, 'auto' or a frequency [Hz], got {shown(smooth)}")
    return positive("smooth", smooth, MotionError)


def fitted(
    time: FloatArray, values: FloatArray, smooth: float | Literal["auto"], degree: int = DEGREE
) -> SmoothingFit:
    """Fit splines to columns of values."""
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


def smoothing_told(fit: SmoothingFit, names: Sequence[str], units: Sequence[str]) -> str:
    """Say how far splines follow columns of values, and what they leave of them."""
    bands = ", ".join(f"{name} to {band:.3g} Hz" for name, band in zip(names, fit.band, strict=True))
    left, most = (
        ", ".join(f"{1e3 * value:.2g} {unit}" for value, unit in zip(values, units, strict=True))
        for values in (fit.residual, fit.largest)
    )
    return (
        f"are smoothed: quintic splines follow {bands}; what they leave is taken for noise: "
        f"{left} rms, at most {most}"
    )


def roughness_told(
    time: FloatArray, values: FloatArray, acceleration: FloatArray, names: Sequence[str], units: Sequence[str]
) -> str:
    """Say that values are too noisy to differentiate: splines of two degrees tell different accelerations.

    Empty if they are not; else without its last bracket.
    """
    if len(time) <= FEW:
        return ""
    try:
        other = derivatives(time, values, 2, ORDER - 2)[1]
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
        f"are too noisy or undersampled to differentiate: at t = {time[worst]:g} s splines "
        f"of degree 7 and 5 differ by {apart[worst, column]:.2g} {units[column]}² in the acceleration of "
        f"{names[column]} (rounded or noisy? smooth='auto', or --smooth auto, leaves the noise out"
    )
