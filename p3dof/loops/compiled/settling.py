"""Configurations at many values of the actuated joints, by the compiled steps of Newton's method.

A few of the samples go straight from where the assembly is known, in short pieces; the others from the
nearest one that is there already. Every piece must contract as Newton's method does near its solution, and
must not change the sign of the pivots: so that no sample leaves the assembly unnoticed.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof.loops.assembly import CONTRACTION
from p3dof.loops.compiled.compiled_loop import CompiledLoop
from p3dof.loops.compiled.formulas import MARGIN

_PIECE = 0.2  # longest way of a joint in one piece [rad, or share of the robot's unit of length]
_PIECES = 64  # most pieces
_FIRST = 0.1  # largest first correction [m or rad]
_NEARLY, _LAST = 1e-8, 1e-13  # correction behind which the next one is rounding, and one that is [m or rad]
_STEPS = 6  # most corrections of a piece
_SPACINGS = (64, 8, 1)  # every how many samples are found first, and then in between those

_Flags = NDArray[np.bool_]


class Settled(NamedTuple):
    """Configurations (N, nq), and which of them close the loops at their values (N,)."""

    q: FloatArray
    good: _Flags


class Settler:
    """Finds configurations at values of the actuated joints."""

    def __init__(self, compiled: CompiledLoop) -> None:
        self._compiled = compiled
        places = compiled.follow_places()
        self._at = np.array([at for at, *_ in places], dtype=int)
        self._circle = np.array([circle for _, circle, _ in places], dtype=bool)
        self._longest = np.array(
            [_PIECE * (compiled.length if slides else 1.0) for slides in compiled.slides]
        )
        self.order = np.array([motor for *_, motor in places], dtype=int)
        """Motors in the order of the independent coordinates."""

    def __call__(self, start: FloatArray, values: FloatArray) -> Settled:
        """Return configurations at values (N, n_actuated), from one that is closed."""
        wanted, count = values[:, self.order], len(values)
        q, good = np.tile(start, (count, 1)), np.zeros(count, dtype=bool)
        for spacing in _SPACINGS:
            known = np.flatnonzero(good)
            rest = np.setdiff1d(np.append(np.arange(0, count, spacing), count - 1), known)
            if not len(rest):
                continue
            if len(known):
                right = np.clip(np.searchsorted(known, rest), 1, max(len(known) - 1, 1))
                near = known[np.minimum(right, len(known) - 1)]
                left = known[right - 1]
                near = np.where(np.abs(left - rest) <= np.abs(near - rest), left, near)
                q[rest], good[rest] = self._follow(q[near], wanted[rest])
                rest = rest[~good[rest]]
            if len(rest):
                q[rest], good[rest] = self._follow(np.tile(start, (len(rest), 1)), wanted[rest])
        return Settled(q, good)

    def _follow(self, q: FloatArray, wanted: FloatArray) -> Settled:
        """Go straight to the values that are wanted, in pieces."""
        begin = self._values(q)
        way = wanted - begin
        way = np.where(self._circle, np.arctan2(np.sin(way), np.cos(way)), way)
        with np.errstate(invalid="ignore"):
            pieces = np.ceil(np.abs(way / self._longest).max(axis=1, initial=0.0))
        good = np.asarray(pieces <= _PIECES)
        most = int(max(1, pieces[good].max(initial=1.0)))
        signs: FloatArray = np.zeros(0)
        for piece in range(1, most + 1):
            rates = {"v_independent": way / most, "a_independent": np.zeros_like(way)}
            there = self._compiled.rows("completion", {"q": q, **rates})
            signs = there["orientation"][:, 0]
            moved = self._compiled.rows("integrate", {"q": q, "dq": there["v"]})["q"]
            self._enter(moved, begin + way * (piece / most))
            q, fits = self._corrected(moved)
            good &= fits & (signs * self._orientation(q) > 0)
        return Settled(q, good)

    def _corrected(self, q: FloatArray) -> Settled:
        good, limit = np.ones(len(q), dtype=bool), np.full(len(q), _FIRST)
        for _ in range(_STEPS):
            found = self._compiled.rows("step", {"q": q})
            size = np.abs(found["q"] - q).max(axis=1, initial=0.0)
            good &= (size <= np.maximum(limit, _NEARLY)) & (found["margin"][:, 0] > MARGIN)
            q, limit = found["q"], CONTRACTION * size
            if not good.any() or size[good].max() <= _LAST:
                break
        return Settled(q, good & (size <= _NEARLY))

    def _orientation(self, q: FloatArray) -> FloatArray:
        nothing = np.zeros((len(q), len(self.order)))
        given = {"q": q, "v_independent": nothing, "a_independent": nothing}
        return self._compiled.rows("completion", given)["orientation"][:, 0]

    def _values(self, q: FloatArray) -> FloatArray:
        values: Any = q[:, self._at]
        turned = np.arctan2(q[:, np.minimum(self._at + 1, q.shape[1] - 1)], values)
        return np.asarray(np.where(self._circle, turned, values))

    def _enter(self, q: FloatArray, values: FloatArray) -> None:
        q[:, self._at] = np.where(self._circle, np.cos(values), values)
        circles = self._circle
        q[:, self._at[circles] + 1] = np.sin(values[:, circles])
