"""The equal steps of a run: which they are, where the controller acts, and where samples are."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof.loops.compiled.runs import StepPlan

_EDGE = 1e-9
"""Share of a period, or of a step, below which a rest of it is rounding."""


def step_plan(
    times: FloatArray, period: float, step: float, kinks: FloatArray
) -> tuple[StepPlan, FloatArray]:
    """Return the steps of a run, those of `p3dof.runs.fixed_steps`, and the times of the ticks.

    Parameters
    ----------
    times : (S,) array
        Of the samples, from 0; the last is the end of the run [s].
    period : float
        How long forces are held [s]; zero for always: there is one tick, at the beginning.
    step : float
        Longest step [s].
    kinks : (K,) array
        Other times at which a step must end [s].
    """
    edges, tick_edges = ticks_of(times, period, kinks)
    slack = _slack(times, period)
    ticks = edges[:-1][tick_edges.astype(bool)]
    end = float(times[-1])
    lengths = np.diff(edges)
    counts = np.maximum(1, np.ceil(lengths / step - _EDGE)).astype(int)
    begins = np.repeat(edges[:-1], counts)
    within = np.arange(len(begins)) - np.repeat(np.cumsum(counts) - counts, counts)
    time = np.append(begins + within * np.repeat(lengths / counts, counts), end)
    tick = np.zeros(len(begins), dtype=np.uint8)
    tick[(np.cumsum(counts) - counts)[tick_edges.astype(bool)]] = 1
    place = np.clip(np.searchsorted(time, times + slack, side="right") - 1, 0, len(time) - 1)
    share = times - time[place]
    inside = (share > slack) & (place < len(begins))
    lengths_at = np.diff(np.append(time, np.inf))[place]
    share = np.where(inside, share / lengths_at, 0.0)
    return StepPlan(time, tick, place.astype(np.intp), share), ticks


def ticks_of(times: FloatArray, period: float, kinks: FloatArray) -> tuple[FloatArray, NDArray[np.uint8]]:
    """Return when steps must end (K + 1,), the beginning first, and at which of them are ticks (K,).

    Parameters
    ----------
    times, period, kinks
        As of `step_plan`.
    """
    end, slack = float(times[-1]), _slack(times, period)
    ticks: FloatArray = np.zeros(1)
    if period:
        ticks = np.asarray(period * np.arange(math.ceil(end / period - _EDGE)), dtype=float)
    inner = kinks[(kinks > 0) & (kinks < end)]
    edges = np.unique(np.concatenate([ticks, inner, [end]]))
    edges = edges[np.append(True, np.diff(edges) > slack)]
    edges[-1] = end
    tick = np.zeros(len(edges) - 1, dtype=np.uint8)
    tick[np.searchsorted(edges[:-1], ticks - slack)] = 1
    return edges, tick


def _slack(times: FloatArray, period: float) -> float:
    return max(1e-15 * float(times[-1]), _EDGE * period)
