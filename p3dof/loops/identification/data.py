"""From a log of motors to states and forces that belong together: derivatives, averages, filters, the delay.

Periodic motions are fitted by a Fourier series, whose derivatives are exact, and forces are averaged over
whole periods; the spread of the periods is the noise. Other motions are followed by smoothing splines up to
a band width; measured forces, and the columns of the forces' model, then pass the same filter without phase
(a Hann window), so that what it takes away is missing on both sides. Samples after it are as far apart as
to be independent; of averaged periods, whose low-pass lets neighbours be alike, each sixth is.

Forces reach a log later than positions do. The delay is the one with which the model fits best, all
parameters free within the prior: viscous friction alone would pass for a delay.

References
----------
J. Swevers, C. Ganseman, D. B. Tükel, J. De Schutter, H. Van Brussel, Optimal robot excitation and
identification, IEEE Transactions on Robotics and Automation 13(5), 1997 (periodic motions, averages).
M. Gautier, Dynamic identification of robots with power model, IEEE International Conference on Robotics and
Automation 1997 (filters of both sides).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, Readable, frozen_array, positive
from p3dof._base.errors import AssemblyError, InputError, MotionError, SampleError
from p3dof._base.threads import slices
from p3dof._base.time_series.smoothing import Smooth, checked, fitted
from p3dof.loops.identification.forces import IdentifiableForces, Rows, States
from p3dof.loops.identification.logs import (
    FEWEST,
    Kind,
    MotorLog,
    Usable,
    beyond_a_turn,
    require_actuators,
    usable,
    wrong_columns,
)

Period: TypeAlias = Literal["auto"] | float | None
"""Period of the motion [s]: found, known, or none."""
Delay: TypeAlias = Literal["auto"] | float
"""By how much forces are later than positions [s]: found, or known."""

LONGEST_DELAY = 0.02
"""Delays that are looked for, of either sign [s]."""
OFFSET = 0.1
"""Standard deviation of a sensor's offset about zero, as a share of the rms of its forces."""
_REPEATS = 0.02
"""Mean square of the difference to the period before, over twice the variance, of what is periodic."""
_HARMONICS = 40
_SPREADS = 6.0
"""So many spreads from a curve a position is an outlier, or of another period than the others."""
_KERNEL, _APART = 0.25, 1.5
"""Half of the width of the window over the period of the band; distance of samples over this half."""
_WITHIN = 40
"""So many samples of a window the model is computed for, where there are more."""
_WEIGHT = 0.7
"""Share of a window that usable samples have at least."""
_JUMP = 4.0
"""So many samples from a reversal, friction jumps between samples."""
_CLEAR = 0.25
"""Share of the samples away from reversals from which they alone tell the delay, and are tested."""
_LATER = 1e-4  # of a difference by the delay [s]
_AVERAGED = 6
"""Samples of averaged periods that are so many apart do not correlate: the low-pass of `_averaged` has zeros
of its autocorrelation at 6, 12, ..."""
_BLOCK = 2000
_PASSES = 3


@dataclass(frozen=True, eq=False)
class PreparedLog(Readable):
    """Measured forces, and the forces' model at the same states; see `prepare_log`.

    Parameters
    ----------
    log : MotorLog
        What was measured.
    time : (N,) array
        Of the samples [s]; of the first period where periods were averaged.
    states : States
        At these times.
    rows : Rows
        Forces = columns @ parameters + known, filtered as the measured forces are.
    forces : (N, m) array
        Measured, at the time of the positions [N or N m].
    noise : (m,) array
        Standard deviation of these forces, what the best parameters leave included.
    spread : (m,) array
        That of a single measured sample: between periods, or from one sample to the next.
    band : float
        Up to which frequency positions are followed [Hz].
    period : float
        Of the motion [s]; NaN if it has none.
    periods : int
        How many were averaged; zero if it has none.
    delay, delay_deviation : float
        By how much forces were later than positions, and its standard deviation (zero if given) [s].
    slope : (N, m) array
        How forces change with the delay, where that was estimated; zero where it was given [N/s or N m/s].
    fit_noise : (m,) array
        What it counts with in a fit that takes samples as independent: more, where a low-pass lets neighbours
        be alike [N or N m].
    independent : (N, m) array of bool
        Samples so far apart that their noise is independent, and away from reversals, near which friction
        jumps: what the test of residuals is of.
    about : str
        How the log was prepared.
    remarks : tuple of str
        What is wrong with it.
    """

    log: MotorLog
    time: FloatArray
    states: States
    rows: Rows
    forces: FloatArray
    noise: FloatArray
    spread: FloatArray
    band: float
    period: float
    periods: int
    delay: float
    delay_deviation: float
    slope: FloatArray
    fit_noise: FloatArray
    independent: NDArray[np.bool_]
    about: str
    remarks: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.time)


class ForcesFit:
    """Maximum a posteriori fits of many measured forces with one model: one factorisation, then products."""

    def __init__(
        self,
        rows: Rows,
        design: FloatArray,
        deviations: FloatArray,
        noise: FloatArray,
        offsets: FloatArray,
        counted: NDArray[np.bool_] | None = None,
    ) -> None:
        free = deviations > 0
        self._noise, self._shape = noise, rows.known.shape
        self._counted = np.ones(self._shape, dtype=bool) if counted is None else counted
        self._rest = rows.columns @ design + rows.known
        m = len(noise)
        own = rows.columns[..., free] * deviations[free]
        shift = np.broadcast_to(np.diag(offsets), (len(own), m, m))
        self.matrix = (np.concatenate([own, shift], axis=-1) / noise[:, None]).reshape(-1, own.shape[-1] + m)
        used = self.matrix * self._counted.reshape(-1, 1)
        self.values, self.directions = np.linalg.eigh(used.T @ used)
        self.values = np.maximum(self.values, 0.0)  # information, in units of the prior's

    def __call__(self, forces: FloatArray) -> tuple[float, FloatArray]:
        """Return twice the negative logarithm of the posterior at its top, and the residuals (N, m)."""
        r = ((forces - self._rest) / self._noise).ravel()
        some = r * self._counted.ravel()
        h = self.directions.T @ (self.matrix.T @ some)
        z = h / (self.values + 1)
        left = r - self.matrix @ (self.directions @ z)
        return float(some @ some - h @ z), left.reshape(self._shape) * self._noise

    def against_prior(self, forces: FloatArray, informed: float) -> tuple[float, float]:
        """Return by what combinations differ from the design, over what the prior expects, and a p value.

        If the prior is right, h² / (l (1 + l)) of a combination with information l is chi-square; those with
        more information than `informed` count. The p value is of the nearer tail, twice; NaN of none.
        """
        from scipy.stats import chi2

        r = ((forces - self._rest) / self._noise * self._counted).ravel()
        h, l = self.directions.T @ (self.matrix.T @ r), self.values  # noqa: E741
        used = l > informed
        if not used.any():
            return math.nan, math.nan
        each = h[used] ** 2 / (l[used] * (1 + l[used]))
        total, k = float(each.sum()), int(used.sum())
        return math.sqrt(total / k), float(2 * min(chi2.sf(total, k), chi2.cdf(total, k), 0.5))


class Motion(NamedTuple):
    """Positions of the actuators as curves."""

    at: Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]
    """Positions, velocities and accelerations (M, m) at times."""
    band: float  # [Hz]
    left: FloatArray  # (m,): rms of what is not followed


class SampledLog(NamedTuple):
    """Where forces and model are compared, and the measured forces there for any delay."""

    time: FloatArray
    states: States
    rows: Rows
    forces: Callable[[float], FloatArray]
    spread: FloatArray  # of a single sample
    shares: float  # variance of a sample here over that of a single one
    reversal: FloatArray  # (N, m): time from the nearest reversal of each actuator
    near: float  # from such a time on, forces before and after a reversal are not mixed
    apart: int  # so many samples on, noise is independent
    kept: float  # share of the noise that a low-pass keeps, all of it where samples are independent


def prepare_log(
    forces: IdentifiableForces,
    log: MotorLog,
    *,
    period: Period = "auto",
    smooth: Smooth = "auto",
    delay: Delay = "auto",
    deviations: FloatArray | None = None,
    check: bool = True,
) -> PreparedLog:
    """Return measured forces and the forces' model at the same states.

    Parameters
    ----------
    forces : IdentifiableForces
        The robot as designed.
    log : MotorLog
        Of its actuators.
    period : "auto", float or None
        Of the motion [s]; it is found by default. Whole periods are averaged. None takes it for not periodic.
    smooth : "auto" or float
        Up to which frequency positions of other motions are followed [Hz].
    delay : "auto" or float
        By how much forces are later than positions [s].
    deviations : ndarray, shape (P,), optional
        Prior of the parameters, for the delay; by default ``forces.deviations()``.
    check : bool
        Whether to raise where columns seem to be exchanged, turned round or in another unit.

    Raises
    ------
    InputError
        If the log is too short, a force is constant, or most of it saturated, or columns seem wrong.
    MotionError
        If its actuators are not those of the robot, or the motion cannot be followed.
    P3dofError
        If the robot cannot be in a position: the message names the sample.
    """
    require_actuators(log, forces.actuators)
    if delay != "auto" or not isinstance(delay, str):
        delay = float(frozen_array("delay", delay, ()))
        if abs(delay) > 1:
            raise InputError(f"delay: expected seconds, at most 1, got {delay:g}")
    prior = forces.deviations() if deviations is None else deviations
    kinds = [Kind(*pair) for pair in zip(forces.position_units, forces.force_units, strict=True)]
    good = usable(log, kinds)
    remarks = list(good.remarks)
    span = _periodic(log, good, period)
    if span is not None:
        T, first, last = span
        sampled, motion, repeats = _averaged(forces, log, good, (T, first, last), prior if check else None)
    else:
        if period is not None and period != "auto":
            raise InputError(f"period: {log.source} has less than two periods of {period:g} s that are alike")
        T, repeats = math.nan, 0
        sampled, motion = _filtered(forces, log, good, smooth, prior if check else None)
    about = f"{log.source}: {_motion_told(forces, motion, T, repeats)}"
    if check and (told := wrong_columns(forces, sampled.states[:3], sampled.forces(0.0), prior)):
        raise InputError(f"{log.source}: {told}")
    noise, found, doubt = _fitted(sampled, forces.design, prior, delay)
    if isinstance(delay, str) and abs(found) > 0.95 * LONGEST_DELAY:
        remarks.append(
            f"no delay within {1e3 * LONGEST_DELAY:g} ms fits best: give it, or look at the time "
            "stamps of the log"
        )
    later, sooner = (sampled.forces(found + way * _LATER) for way in (1, -1))
    slope = (later - sooner) / (2 * _LATER) * (doubt > 0)
    return PreparedLog(
        log, sampled.time, sampled.states, sampled.rows, sampled.forces(found), noise, sampled.spread,
        motion.band, T, repeats, found, doubt, slope, noise / math.sqrt(sampled.kept),
        _independent(sampled, found), about, tuple(remarks),
    )  # fmt: skip


def _clear(sampled: SampledLog, delay: float) -> NDArray[np.bool_]:
    """Return which samples (N, m) are away from reversals; all where few would be."""
    clear = sampled.reversal > sampled.near + delay
    return clear if clear.mean() > _CLEAR else np.ones_like(clear)


def _independent(sampled: SampledLog, delay: float) -> NDArray[np.bool_]:
    clear = _clear(sampled, abs(delay))
    found = np.zeros_like(clear)
    for own, column in zip(found.T, clear.T, strict=True):
        own[np.flatnonzero(column)[:: sampled.apart]] = True
    return found


def _motion_told(forces: IdentifiableForces, motion: Motion, T: float, repeats: int) -> str:
    units = forces.position_units
    most = {u: max(x for x, own in zip(motion.left, units, strict=True) if own == u) for u in units}
    left = " and ".join(f"{1e3 * x:.2g} {'mm' if u == 'm' else 'mrad'}" for u, x in most.items())
    what = (
        f"periodic, {T:.6g} s: {repeats} periods are averaged, harmonics"
        if repeats
        else "not periodic: splines follow it, and filters let pass forces,"
    )
    return f"the motion is {what} up to {motion.band:.3g} Hz; positions are at most {left} rms from that"


def _fitted(
    sampled: SampledLog, design: FloatArray, prior: FloatArray, delay: Delay
) -> tuple[FloatArray, float, float]:
    """Return noise (m,), delay and its standard deviation."""
    from scipy.optimize import minimize_scalar

    at = 0.0 if isinstance(delay, str) else float(delay)
    y = sampled.forces(at)
    offsets = OFFSET * np.sqrt((y**2).mean(axis=0))
    least = np.maximum(sampled.spread * math.sqrt(sampled.shares), 1e-9 * np.abs(y).max(axis=0))
    noise, doubt, tried_once = np.maximum(least, 1e-3 * y.std(axis=0)), 0.0, not isinstance(delay, str)
    for _ in range(_PASSES):
        clear = _clear(sampled, abs(at) if tried_once else LONGEST_DELAY)
        fit = ForcesFit(sampled.rows, design, prior, noise / math.sqrt(sampled.kept), offsets, clear)
        tried_once = True
        if isinstance(delay, str):
            tried = np.linspace(-LONGEST_DELAY, LONGEST_DELAY, 41)
            costs = [fit(sampled.forces(float(one)))[0] for one in tried]
            best, step = float(tried[int(np.argmin(costs))]), float(tried[1] - tried[0])
            within = (max(best - step, -LONGEST_DELAY), min(best + step, LONGEST_DELAY))
            found = minimize_scalar(
                lambda d, fit=fit: fit(sampled.forces(float(d)))[0],
                bounds=within, method="bounded", options={"xatol": 1e-7},
            )  # fmt: skip
            at, h = float(found.x), 0.1 * step
            beside = [fit(sampled.forces(at + k * h))[0] for k in (-1, 0, 1)]
            bend = (beside[0] - 2 * beside[1] + beside[2]) / h**2
            doubt = math.sqrt(2 / bend) if bend > 0 else LONGEST_DELAY
        left = fit(sampled.forces(at))[1]
        noise = np.maximum(least, np.sqrt((left**2).mean(axis=0)))
    return noise, at, doubt


# Periodic motions


def _periodic(  # noqa: PLR0911 - each is a reason
    log: MotorLog, good: Usable, period: Period
) -> tuple[float, float, float] | None:
    """Return the period, and from when to when the motion has it; None if it has none."""
    if period is None:
        return None
    given = None if period == "auto" else positive("period", period, InputError)
    step = float(np.median(np.diff(log.time)))
    time = log.time[0] + step * np.arange(int((log.time[-1] - log.time[0]) / step + 1e-3) + 1)
    x = np.stack(
        [
            np.interp(time, log.time[good.positions[:, j]], log.positions[good.positions[:, j], j])
            for j in range(log.positions.shape[1])
        ],
        axis=-1,
    )
    size = x.std(axis=0)
    x = (x - x.mean(axis=0))[:, size > 0] / size[size > 0]
    if not x.shape[1]:
        return None
    T = _refined(time, x, step, _autocorrelated(x) * step if given is None else given, given)
    if not T:
        return None
    lag = T / step
    n = len(x) - math.ceil(lag - 1e-6)
    if n < 2:
        return None
    later = np.stack([np.interp(np.arange(n) + lag, np.arange(len(x)), column) for column in x.T], axis=-1)
    apart = np.abs(later - x[:n]).max(axis=1)
    same = apart < np.maximum(_SPREADS * np.median(apart), math.sqrt(_REPEATS))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]))).reshape(-1, 2)
    if not len(edges):
        return None
    first, last = edges[np.argmax(np.diff(edges, axis=1))]
    repeats = int((last - first + lag) / lag + 1e-6)
    if np.median(apart) > math.sqrt(2 * _REPEATS) or repeats < 2:
        return None
    begin = float(time[last - 1]) + T - repeats * T + step if given is None else float(time[first])
    begin = max(float(time[first]), min(begin, float(time[-1]) + step - repeats * T))
    return T, begin, begin + repeats * T


def _autocorrelated(x: FloatArray) -> float:
    """Return the shortest lag [samples] after which columns repeat; zero if they do not."""
    half = len(x) // 2
    x = x[len(x) // 5 :]  # motions are entered from rest
    n = len(x)
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.fft.rfft(x, size, axis=0)
    products = np.fft.irfft(np.abs(spectrum) ** 2, size, axis=0)[:n].sum(axis=1)
    squares = np.concatenate([[0.0], np.cumsum((x**2).sum(axis=1))])
    lags = np.arange(half + 2)
    sums = squares[n - lags] + squares[n] - squares[lags]
    apart = (sums - 2 * products[lags]) / np.maximum(sums, 1e-300)
    start = int(np.argmax(apart > 0.2))  # past the neighbours of a sample
    for lag in range(max(start, FEWEST // 2), len(apart) - 1):
        if apart[lag] < _REPEATS and apart[lag - 1] >= apart[lag] <= apart[lag + 1]:
            return float(lag)
    return 0.0


def _refined(time: FloatArray, x: FloatArray, step: float, T: float, given: float | None) -> float:
    """Return a period more exactly: that with which a Fourier series fits best."""
    from scipy.optimize import minimize_scalar

    if given is not None or not T:
        return T if time[-1] - time[0] + 1.5 * step >= T * 2 else 0.0
    skip = len(x) // 5
    thin = max(1, (len(x) - skip) // 1000)
    late, values = time[skip::thin] - time[skip], x[skip::thin]

    def left(one: float) -> float:
        basis = _series(late, one, min(10, max(2, len(late) // 20)), 0)
        found = np.linalg.lstsq(basis, values, rcond=None)[0]
        return float(((values - basis @ found) ** 2).sum())

    width = step if 50 * step > T else 2 * step
    found = minimize_scalar(left, bounds=(T - width, T + width), method="bounded", options={"xatol": 1e-9})
    T = float(found.x)
    count = round(T / step)
    repeats = (time[-1] - time[0]) / T
    return count * step if abs(T - count * step) * repeats < 0.2 * step else T


def _series(time: FloatArray, T: float, harmonics: int, order: int) -> FloatArray:
    """Return a derivative of 1, cos, sin, cos 2, ... (N, 2 K + 1)."""
    omega = 2 * np.pi / T * np.arange(1, harmonics + 1)
    turned = omega * time[:, None] + order * np.pi / 2
    found = np.empty((len(time), 2 * harmonics + 1))
    found[:, 0] = 0.0 if order else 1.0
    found[:, 1::2], found[:, 2::2] = omega**order * np.cos(turned), omega**order * np.sin(turned)
    return found


def resolution(values: FloatArray) -> float:
    """Return the step of values (N,) that an encoder counts; zero of values that are not counted."""
    different = np.unique(values)
    steps = np.diff(different)
    steps = steps[steps > 1e-9 * max(np.abs(values).max(), 1e-300)]
    if not len(steps) or len(different) > 0.9 * len(values):
        return 0.0
    step = float(steps.min())
    counts = (different - different[0]) / step
    return step if np.abs(counts - np.round(counts)).max() < 0.05 else 0.0


def _fourier(
    time: FloatArray, positions: FloatArray, known: NDArray[np.bool_], T: float, step: float
) -> Motion:
    """Fit Fourier series to the columns of positions."""
    most = int(min(_HARMONICS, T / step / 4, len(time) / 8))
    coefficients, residual = np.zeros((2 * most + 1, positions.shape[1])), np.zeros(positions.shape[1])
    harmonics = 1
    for j, column in enumerate(positions.T):
        keep, counted = known[:, j].copy(), resolution(column)
        for _ in range(2):
            basis = _series(time[keep] - time[0], T, most, 0)
            Q, R = np.linalg.qr(basis)
            c = Q.T @ column[keep]
            full = float(((column[keep] - Q @ c) ** 2).sum())
            tail = full + np.append(np.cumsum(c[::-1] ** 2)[::-1][3::2], 0.0)  # left by 1, 2, ... harmonics
            n, p = len(Q), 2 * np.arange(1, most + 1) + 1
            floor = n * max(counted**2 / 12, (1e-15 * np.abs(column).max()) ** 2)
            K = int(np.argmin(n * np.log(np.maximum(tail, max(floor, 1e-300)) / n) + p * np.log(n))) + 1
            some = np.linalg.solve(R[: 2 * K + 1, : 2 * K + 1], c[: 2 * K + 1])
            apart = np.abs(column - _series(time - time[0], T, K, 0) @ some)
            spread = 1.4826 * float(np.median(apart[keep]))
            before = np.count_nonzero(keep)
            keep &= apart <= max(_SPREADS * spread, 2 * counted, 1e-12)
            if np.count_nonzero(keep) == before:
                break
        coefficients[: 2 * K + 1, j], residual[j] = some, math.sqrt(float((apart[keep] ** 2).mean()))
        harmonics = max(harmonics, K)
    used = coefficients[: 2 * harmonics + 1]

    def at(times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        local = times - time[0]
        x, v, a = (_series(local, T, harmonics, order) @ used for order in range(3))
        return x, v, a

    return Motion(at, harmonics / T, residual)


def _averaged(
    forces: IdentifiableForces,
    log: MotorLog,
    good: Usable,
    span: tuple[float, float, float],
    prior: FloatArray | None,
) -> tuple[SampledLog, Motion, int]:
    """Return the average over whole periods; with a prior, what is wrong is told where none is possible."""
    from scipy.interpolate import CubicSpline

    T, first, last = span
    repeats, step = round((last - first) / T), float(np.median(np.diff(log.time)))
    inside = (log.time >= first - 0.5 * step) & (log.time <= last - 0.4 * step)
    time = log.time[inside]
    motion = _fourier(time, log.positions[inside], good.positions[inside], T, step)
    count = round(T / step)
    phase = T / count * np.arange(count)
    seen = np.full((repeats, count, log.forces.shape[1]), np.nan)
    for j, column in enumerate(log.forces.T):
        t, y = log.time[good.kept[:, j]], column[good.kept[:, j]]
        curve = CubicSpline(t, y)
        for r in range(repeats):
            at = first + r * T + phase
            value = curve(np.clip(at, t[0], t[-1]))  # a straight line is less than fast forces are
            right = np.clip(np.searchsorted(t, at), 1, len(t) - 1)
            near = np.minimum(np.abs(t[right] - at), np.abs(t[right - 1] - at)) < 0.75 * step
            seen[r, :, j] = np.where(near, value, np.nan)
    number = np.isfinite(seen).sum(axis=0)
    filled = np.where(np.isfinite(seen), seen, 0.0)
    mean = filled.sum(axis=0) / np.maximum(number, 1)
    apart = np.where(np.isfinite(seen), seen - mean, 0.0)
    whole = (number > 0).all(axis=1)
    for j in range(mean.shape[1]):
        there = number[:, j] > 0
        if not there.all():
            mean[:, j] = np.interp(phase, phase[there], mean[there, j], period=T)
    if whole.mean() < 0.5:
        raise InputError(f"{log.source}: less than half of the period has usable forces")
    reversal = _from_reversals(np.asarray(first + phase, dtype=float), motion, T)
    clear = whole & (reversal > _JUMP * step).all(axis=1)
    whole = clear if clear.mean() > 0.5 else whole
    free = np.maximum((number[whole] - 1).clip(0).sum(axis=0), 1)
    spread = np.sqrt((apart[:, whole] ** 2).sum(axis=(0, 1)) / free)
    states = _states(forces, log, motion.at(first + phase[whole]), mean[whole], prior)
    spectrum, omega = np.fft.rfft(mean, axis=0), 2 * np.pi / T * np.arange(count // 2 + 1)
    fade = np.clip(4 * np.arange(count // 2 + 1) / count - 1, 0.0, 1.0)  # without it, jumps would ring
    lowpass = (1 + np.cos(np.pi * fade)) / 2

    def shifted(delay: float) -> FloatArray:
        turned = spectrum * (lowpass * np.exp(1j * omega * delay))[:, None]
        return np.asarray(np.fft.irfft(turned, count, axis=0)[whole])

    rows = forces.rows(states)
    kept = float((lowpass**2).mean())
    found = SampledLog(
        first + phase[whole], states, rows, shifted, spread, kept / repeats, reversal[whole], _JUMP * step,
        _AVERAGED, kept,
    )  # fmt: skip
    return found, motion, repeats


def _from_reversals(time: FloatArray, motion: Motion, T: float = 0.0) -> FloatArray:
    """Return the time (N, m) from the nearest reversal of each actuator; that of a period goes on."""
    velocities = motion.at(time)[1]
    found = np.full(velocities.shape, np.inf)
    for j, v in enumerate(velocities.T):
        turns = np.flatnonzero(v[1:] * v[:-1] <= 0)
        at = (time[turns] + time[turns + 1]) / 2
        for shift in (-T, 0.0, T) if T else (0.0,):
            for one in at + shift:
                found[:, j] = np.minimum(found[:, j], np.abs(time - one))
    return found


# Other motions


def _filtered(
    forces: IdentifiableForces, log: MotorLog, good: Usable, smooth: Smooth, prior: FloatArray | None
) -> tuple[SampledLog, Motion]:
    """Return filtered forces and model, piece by piece between gaps."""
    way = checked(smooth)
    if way is None:
        raise MotionError("smooth: expected 'auto' or a frequency [Hz]: velocities follow from positions")
    pieces = [piece for piece in good.pieces if piece.stop - piece.start >= FEWEST]
    if not pieces:
        raise InputError(f"{log.source}: no piece between gaps has {FEWEST} samples")
    motions = [_splines(log, good, piece, way) for piece in pieces]
    band = max(motion.band for motion in motions)
    step = float(np.median(np.diff(log.time)))
    half = max(_KERNEL / band, 2 * step)  # from two steps on it averages as much whatever the delay
    for piece, one in zip(pieces, motions, strict=True):
        _states(forces, log, one.at(log.time[piece][::20]), log.forces[piece][::20], prior)
    found = [_piece(forces, log, good, piece, one, half) for piece, one in zip(pieces, motions, strict=True)]
    time = np.concatenate([one.time for one in found])
    if len(time) < FEWEST // 2:
        raise InputError(
            f"{log.source}: too short: {len(time)} independent samples at {band:.3g} Hz; record a "
            "longer motion"
        )
    noise = np.array([_differences(log.forces[good.kept[:, j], j]) for j in range(log.forces.shape[1])])
    joined = SampledLog(
        time, _joined([one.states for one in found]),
        Rows(*(np.concatenate(part) for part in zip(*(one.rows for one in found), strict=True))),
        lambda delay: np.concatenate([one.forces(delay) for one in found]), noise, 0.75 * step / half,
        np.concatenate([one.reversal for one in found]), half + _JUMP * step, 1, 1.0,
    )  # fmt: skip
    residual = np.sqrt(np.mean([motion.left**2 for motion in motions], axis=0))
    return joined, Motion(motions[0].at, band, residual)


def _states(
    forces: IdentifiableForces,
    log: MotorLog,
    motion: tuple[FloatArray, FloatArray, FloatArray],
    measured: FloatArray,
    prior: FloatArray | None,
) -> States:
    """Return the states of a motion; an error says what may be wrong with the columns."""
    if prior is not None and beyond_a_turn(forces, motion[0]):
        told = wrong_columns(forces, motion, measured, prior, "beyond a turn")
        if told:
            raise InputError(f"{log.source}: {told}")
    try:
        forces.from_actuators(*(part[:: max(1, len(measured) // 5)] for part in motion))
        return forces.from_actuators(*motion)
    except (AssemblyError, SampleError) as error:
        told = "" if prior is None else wrong_columns(forces, motion, measured, prior, str(error))
        if told:
            raise InputError(f"{log.source}: {told}") from error
        low, high = motion[0].min(axis=0), motion[0].max(axis=0)
        ranges = ", ".join(
            f"{name} {a:.4g} to {b:.4g} {unit}"
            for name, a, b, unit in zip(log.actuators, low, high, forces.position_units, strict=True)
        )
        raise InputError(f"{log.source}: the robot cannot follow {ranges}: {error}") from error


def _joined(each: list[States]) -> States:
    """Return the states of several pieces as one, without the whole."""
    if len(each) == 1:
        return each[0]
    x, v, a = (np.concatenate([getattr(one, name) for one in each]) for name in States._fields[:3])
    return States(x, v, a, None)


def _differences(values: FloatArray) -> float:
    """Return the standard deviation of noise, from third differences of neighbours."""
    third = np.diff(values, 3)
    return float(1.4826 * np.median(np.abs(third)) / math.sqrt(20)) if len(third) else 0.0


def _splines(log: MotorLog, good: Usable, piece: slice, way: Literal["auto"] | float) -> Motion:
    """Fit smoothing splines to positions between gaps."""
    time, each, residual, bands = log.time[piece], [], [], []
    for j, column in enumerate(log.positions[piece].T):
        keep = good.positions[piece, j]
        size = 10 * resolution(column) or 1.0  # counts are decimal numbers then, whose rounding is known
        values = (column[keep] - column.min()) / size
        fit = fitted(time[keep], values[:, None], way)
        each.append((fit, time[keep][0], size, column.min()))
        residual.append(size * fit.residual[0])
        bands.append(float(fit.band[0]) if np.ptp(values) > 0 else 0.0)

    def at(times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        x, v, a = (
            np.stack([size * fit.at(times - first, order)[:, 0] for fit, first, size, _ in each], axis=-1)
            for order in range(3)
        )
        return x + np.array([least for *_, least in each]), v, a

    return Motion(at, max(bands), np.array(residual))


def _piece(
    forces: IdentifiableForces, log: MotorLog, good: Usable, piece: slice, motion: Motion, half: float
) -> SampledLog:
    """Return forces and model of a piece through windows of a half width [s]."""
    time, y, kept = log.time[piece], log.forces[piece], good.kept[piece]
    ends, m, P = half + LONGEST_DELAY, y.shape[1], len(forces.design)
    at = np.arange(time[0] + ends, time[-1] - ends, _APART * half)
    if not len(at):
        at = time[:0]
    weights = [_windows(time, at, half, kept[:, j]) for j in range(m)]
    at = at[np.all([enough for _, enough in weights], axis=0)]
    reversal = _from_reversals(time, motion)
    nearest = np.stack([np.interp(at, time, reversal[:, j]) for j in range(m)], axis=-1)
    clear = (nearest > half + _JUMP * np.median(np.diff(time))).all(axis=1)
    if len(at) and clear.mean() > 0.5:
        at, nearest = at[clear], nearest[clear]
    states = forces.from_actuators(*motion.at(at))
    columns, known = np.zeros((len(at), m, P)), np.zeros((len(at), m))
    thin = max(1, int(2 * half / np.median(np.diff(time)) / _WITHIN))
    own = [_windows(time[::thin], at, half, kept[::thin, j])[0] for j in range(m)]
    for block in slices(len(time[::thin]), _BLOCK):
        some = forces.rows(forces.from_actuators(*motion.at(time[::thin][block])))
        for j in range(m):
            part = own[j][:, block]
            columns[:, j] += part @ some.columns[:, j]
            known[:, j] += part @ some.known[:, j]

    def measured(delay: float) -> FloatArray:
        return np.stack(
            [_windows(time, at + delay, half, kept[:, j])[0] @ y[:, j] for j in range(m)], axis=-1
        )

    return SampledLog(at, states, Rows(columns, known), measured, np.zeros(m), 1.0, nearest, 0.0, 1, 1.0)


def _windows(
    time: FloatArray, at: FloatArray, half: float, kept: NDArray[np.bool_]
) -> tuple[Any, NDArray[np.bool_]]:
    """Return Hann windows around times as a sparse matrix (M, N), and which of them have enough samples."""
    from scipy.sparse import csr_matrix

    first, last = np.searchsorted(time, at - half), np.searchsorted(time, at + half)
    counts = last - first
    pointer = np.concatenate([[0], np.cumsum(counts)])
    column = np.arange(pointer[-1]) - np.repeat(pointer[:-1], counts) + np.repeat(first, counts)
    row = np.repeat(np.arange(len(at)), counts)
    weight = 1 + np.cos(np.pi * (time[column] - at[row]) / half)
    full = np.bincount(row, weight, len(at))
    weight = weight * kept[column]
    sums = np.bincount(row, weight, len(at))
    enough = sums > _WEIGHT * np.maximum(full, 1e-300)
    weight = weight / np.maximum(sums, 1e-300)[row]
    return csr_matrix((weight, column, pointer), shape=(len(at), len(time))), enough
