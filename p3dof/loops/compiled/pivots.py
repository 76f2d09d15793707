"""Which speeds depend on which, and the sparse LU of their columns: planned on samples, done on the tape.

The pivots are chosen once, with threshold pivoting on several closed configurations at the same time and
Markowitz'
count for little fill; every sample then takes the same operations. How small a pivot is compared with the
samples tells how near a configuration is to where the choice fails.

References
----------
I. S. Duff, A. M. Erisman, J. K. Reid, Direct Methods for Sparse Matrices, 2nd ed., Oxford 2017, chapters 5
and 7.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import ModelError
from p3dof._base.tracing import Number, Tape
from p3dof.loops.linear import RANK_TOLERANCE

_THRESHOLD = 0.1  # smallest pivot in its row and column, over all samples
_TIES = 1e-6  # ratios closer than this are equal


@dataclass(frozen=True)
class Plan:
    """The order of elimination."""

    pivots: tuple[tuple[int, int], ...]  # row and column of each
    sizes: tuple[float, ...]  # their median sizes on the samples

    @property
    def rows(self) -> tuple[int, ...]:
        """Rows that are eliminated, in their order; the others are redundant."""
        return tuple(row for row, _ in self.pivots)

    @property
    def columns(self) -> tuple[int, ...]:
        """Columns of the speeds that depend on the others, in their order."""
        return tuple(column for _, column in self.pivots)


def planned(J: FloatArray, last: Collection[int]) -> Plan:
    """Return pivots for some matrices at once."""
    A = np.array(J)
    rows, columns = list(range(A.shape[1])), [c for c in range(A.shape[2]) if c not in set(last)]
    waiting = sorted(last)
    smallest = RANK_TOLERANCE * max(np.abs(A).max(initial=0.0), 1e-300)
    pivots, sizes = [], []
    while rows and (columns or waiting):
        found = _best(A, rows, columns, smallest) if columns else None
        if found is None:
            if not waiting:
                break
            columns, waiting = columns + waiting, []
            continue
        row, column = found
        pivot = A[:, row, column]
        pivots.append((row, column))
        sizes.append(float(np.median(np.abs(pivot))))
        rows.remove(row)
        columns.remove(column)
        factors = A[:, rows, column] / pivot[:, None]
        A[:, rows, :] -= factors[:, :, None] * A[:, row, None, :]
        A[:, rows, column] = 0.0
    return Plan(tuple(pivots), tuple(sizes))


def _best(A: FloatArray, rows: list[int], columns: list[int], smallest: float) -> tuple[int, int] | None:
    part = np.abs(A[np.ix_(range(len(A)), rows, columns)])
    there = part.max(axis=0) > smallest
    if not there.any():
        return None
    reference = np.maximum(part.max(axis=1, keepdims=True), part.max(axis=2, keepdims=True))
    ratio = np.min(part / np.maximum(reference, smallest), axis=0)
    ratio[~there] = 0.0
    allowed = there & (ratio >= min(_THRESHOLD, float(ratio.max()) * (1.0 - _TIES)))
    fill = np.outer(there.sum(axis=1) - 1, there.sum(axis=0) - 1).astype(float)
    fill[~allowed] = np.inf
    fill[fill > fill.min()] = np.inf
    ratio[~np.isfinite(fill)] = -1.0
    at = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
    return rows[int(at[0])], columns[int(at[1])]


class Factors:
    """The columns of the dependent speeds, factored on the tape."""

    def __init__(self, tape: Tape, rows: Sequence[Mapping[int, Number]], plan: Plan) -> None:
        self._plan = plan
        dependent = set(plan.columns)
        left = {row: {c: x for c, x in rows[row].items() if c in dependent} for row in plan.rows}
        self._upper: list[dict[int, Number]] = []
        self._lower: list[dict[int, Number]] = []
        self._inverse: list[Number] = []
        self.pivots: list[Number] = []  # the pivots, in their order
        for row, column in plan.pivots:
            upper = left.pop(row)
            pivot = upper.pop(column, 0.0)
            inverse = tape.divide(1.0, pivot)
            lower = {}
            for other, entries in left.items():
                if column in entries:
                    factor = lower[other] = entries.pop(column) * inverse
                    for c, x in upper.items():
                        entries[c] = entries.get(c, 0.0) - factor * x
            self.pivots.append(pivot)
            self._inverse.append(inverse)
            self._upper.append(upper)
            self._lower.append(lower)

    def solve(self, right: Mapping[int, Number]) -> dict[int, Number]:
        """Return x by column, from the right side by row, which may leave zeros out."""
        values = dict(right)
        for (row, _), lower in zip(self._plan.pivots, self._lower, strict=True):
            if row in values:
                for other, factor in lower.items():
                    values[other] = values.get(other, 0.0) - factor * values[row]
        found: dict[int, Number] = {}
        for k in range(len(self._plan.pivots) - 1, -1, -1):
            row, column = self._plan.pivots[k]
            value = values.get(row, 0.0)
            for c, x in self._upper[k].items():
                value = value - x * found[c]
            found[column] = value * self._inverse[k]
        return found

    def solve_transposed(self, right: Mapping[int, Number]) -> dict[int, Number]:
        """Return x by row with Aᵀ x = right, which is by column and may leave zeros out."""
        values, found = dict(right), dict[int, Number]()
        for k, (row, column) in enumerate(self._plan.pivots):
            found[row] = values.get(column, 0.0) * self._inverse[k]
            for c, x in self._upper[k].items():
                values[c] = values.get(c, 0.0) - x * found[row]
        for k in range(len(self._plan.pivots) - 1, -1, -1):
            row = self._plan.pivots[k][0]
            for other, factor in self._lower[k].items():
                found[row] = found[row] - factor * found[other]
        return found


def solve_symmetric(tape: Tape, A: Sequence[Sequence[Number]], b: Sequence[Number]) -> list[Number]:
    """Return x with A x = b for a symmetric positive definite A, by A = L D Lᵀ."""
    n = len(b)
    L, inverse = symmetric_factors(tape, A)[::2]
    x = list(b)
    for i in range(n):
        for k in range(i):
            x[i] = x[i] - L[i][k] * x[k]
    for i in range(n - 1, -1, -1):
        x[i] = x[i] * inverse[i]
        for k in range(i + 1, n):
            x[i] = x[i] - L[k][i] * x[k]
    return x


def symmetric_factors(
    tape: Tape, A: Sequence[Sequence[Number]]
) -> tuple[list[list[Number]], list[Number], list[Number]]:
    """Return L, D and 1 / D of a symmetric matrix, of which the lower half is looked at."""
    n = len(A)
    L: list[list[Number]] = [[0.0] * n for _ in range(n)]
    D: list[Number] = []
    inverse: list[Number] = []
    for j in range(n):
        d = A[j][j]
        for k in range(j):
            d = d - L[j][k] * L[j][k] * D[k]
        if isinstance(d, float) and d == 0.0:
            raise ModelError(
                "a free motion of the mechanism has no inertia: accelerations are not determined"
            )
        D.append(d)
        inverse.append(tape.divide(1.0, d))
        for i in range(j + 1, n):
            value = A[i][j]
            for k in range(j):
                value = value - L[i][k] * D[k] * L[j][k]
            L[i][j] = value * inverse[j]
    return L, D, inverse
