"""The classical Runge-Kutta method of order 4 in equal steps, with the interface of SciPy's solvers."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

from p3dof._base.checks import FloatArray

Rate: TypeAlias = Callable[[float, FloatArray], FloatArray]
"""Time and state to the derivative of the state."""

_EDGE = 1e-9
"""Share of a step below which a rest of it is rounding."""


class RungeKutta4:
    """From one time to another in equal steps.

    Parameters
    ----------
    rate : callable
        Time and state to the derivative of the state.
    time : float
        Where it begins [s].
    state : ndarray, shape (n,)
        The state there.
    until : float
        Where it ends [s].
    step : float
        Longest step [s].

    Attributes
    ----------
    t, y, f : float, ndarray, ndarray
        Time, state and its derivative after the last step.
    t_old : float or None
        Time before it.
    h_abs : float
        Length of a step [s].
    status : {"running", "finished"}
    """

    def __init__(self, rate: Rate, time: float, state: FloatArray, until: float, step: float) -> None:
        self._rate, self._begin, self._until = rate, time, until
        self._count = max(1, math.ceil((until - time) / step - _EDGE))
        self._done = 0
        self.t, self.y, self.f = time, state, rate(time, state)
        self.t_old: float | None = None
        self.h_abs = (until - time) / self._count
        self._before = state, self.f
        self.status = "running"

    def step(self) -> None:
        """Take a step."""
        h, half, t, y = self.h_abs, self.h_abs / 2, self.t, self.y
        k1 = self.f
        k2 = self._rate(t + half, y + half * k1)
        k3 = self._rate(t + half, y + half * k2)
        k4 = self._rate(t + h, y + h * k3)
        self._before = y, k1
        self._done += 1
        last = self._done == self._count
        self.t_old, self.t = t, self._until if last else self._begin + self._done * h
        self.y = y + h / 6 * (k1 + 2 * (k2 + k3) + k4)
        self.f = self._rate(self.t, self.y)
        self.status = "finished" if last else "running"

    def dense_output(self) -> Callable[[float], FloatArray]:
        """Return the states of the last step: cubic in time, of order 4 as the method."""
        start, end = self.t_old, self.t
        if start is None:
            raise RuntimeError("no step was taken")
        (y0, f0), y1, f1, h = self._before, self.y, self.f, end - start

        def dense(time: float) -> FloatArray:
            s = (time - start) / h
            r = 1 - s
            inner = (1 - 2 * s) * (y1 - y0) + h * ((s - 1) * f0 + s * f1)
            return r * y0 + s * y1 - s * r * inner

        return dense
