"""Where a run crosses a limit: within one step of an integrator, by its dense output."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.runs.margins import Margins

CHECKED = 2e-3
"""The limits are looked at this often at least, and where a margin may turn around in between [s]."""

_NEARBY = 1e-6
"""Share of a step over which a margin's rate is taken."""

Dense: TypeAlias = Callable[[float], FloatArray]
"""Time to state, within one step."""


def pieces(start: float, end: float) -> FloatArray:
    """Return the ends of the pieces of a step, none of which is longer than `CHECKED`."""
    return np.asarray(np.linspace(start, end, int(np.ceil((end - start) / CHECKED)) + 1))


class Watch:
    """Notes when functions of time and state change their sign, and lets the run go on.

    Parameters
    ----------
    values : callable
        Time and state to m numbers.
    """

    def __init__(self, values: Callable[[float, FloatArray], FloatArray]) -> None:
        self._values = values
        self.changes: list[tuple[float, int, bool]] = []
        """When [s], which, and whether it rose."""

    def __call__(self, dense: Dense, start: float, end: float) -> None:
        """Look at a step, or at its beginning.

        Parameters
        ----------
        dense : callable
            The states of the step.
        start, end : float
            Between which times [s].
        """
        from scipy.optimize import brentq

        before = self._values(start, dense(start))
        for low, high in pairwise(pieces(start, end)):
            after = self._values(high, dense(high))
            changed = np.flatnonzero((before != 0) & (before * after <= 0))
            found = [
                (
                    float(brentq(lambda t, i=i: self._values(t, dense(t))[i], low, high)),
                    int(i),
                    bool(before[i] < 0),
                )
                for i in changed
            ]
            self.changes += sorted(found)
            before = after


class Crossings:
    """Finds the first limit that a step crosses.

    Parameters
    ----------
    margins : Margins
        What must stay positive.
    """

    def __init__(self, margins: Margins) -> None:
        self._margins = margins

    def possible(self, start: float, before: FloatArray, end: float, after: FloatArray) -> bool:
        """Return whether a limit may be crossed in a step between two states: what costs a dense output."""
        step = end - start
        if step > CHECKED:
            return True
        first, falling = self._trend(start, before, step)
        last, rising = self._trend(end, after, step)
        return bool(last.min() <= 0 or _turning(first, falling, last, rising).any())

    def first(self, dense: Dense, start: float, end: float) -> tuple[float, int] | None:
        """Return when the first limit is crossed in a step, and which; None if none is.

        Parameters
        ----------
        dense : callable
            The states of the step.
        start, end : float
            Its ends [s].

        Returns
        -------
        tuple of float and int, or None
            Time [s] and index of the margin.
        """
        from scipy.optimize import brentq

        before = start
        for time in self._looked_at(dense, start, end):
            crossed = np.flatnonzero(self._margins(time, dense(time)) <= 0)
            if len(crossed):
                inside = self._margins(before, dense(before))
                found = [
                    (
                        brentq(lambda t, i=i: self._margins(t, dense(t))[i], before, time)
                        if inside[i] > 0
                        else before,
                        i,
                    )
                    for i in crossed
                ]
                when, index = min(found)
                return float(when), int(index)
            before = time
        return None

    def _looked_at(self, dense: Dense, start: float, end: float) -> list[float]:
        """Return the ends of the pieces of a step, and where a margin is least in between."""
        from scipy.optimize import minimize_scalar

        ends = pieces(start, end)
        found: list[float] = []
        for low, high in pairwise(ends):
            first, falling = self._trend(low, dense(low), high - low)
            last, rising = self._trend(high, dense(high), high - low)
            for i in np.flatnonzero(_turning(first, falling, last, rising) & (last > 0)):
                least = minimize_scalar(
                    lambda t, i=i: self._margins(t, dense(t))[i], bounds=(low, high), method="bounded"
                )
                found.append(float(least.x))
            found.append(float(high))
        return sorted(found)

    def _trend(self, time: float, state: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
        """Return the margins of a state, and how much they would change in a step at their present rate."""
        here, near = self._margins.trend(time, state, _NEARBY * step)
        with np.errstate(invalid="ignore"):
            change = np.where(np.isfinite(here) & np.isfinite(near), (near - here) / _NEARBY, 0.0)
        return here, change


def _turning(
    first: FloatArray, falling: FloatArray, last: FloatArray, rising: FloatArray
) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return which margins fall at the start and rise at the end, so steeply that they may reach zero."""
    deep = np.minimum(first + falling, last - rising)  # where the tangents lead
    return np.asarray((falling < 0) & (rising > 0) & (deep <= 0))
