"""The optimum near a design, by sequential quadratic programs in epigraph form (SciPy's SLSQP).

A peak is not smooth where another sample takes over, but "t is at least the force at every sample" is: the
least t under these conditions is the least peak. Only pieces that come near to the worst take part; whether
another one became worse is looked at in the end, and it takes part then.

Reference
---------
D. Kraft, A software package for sequential quadratic programming, DFVLR-FB 88-28 (1988).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, Readable
from p3dof.design.optimisation.population import Pieces, Population
from p3dof.design.optimisation.statement import Statement

_NEAR = 0.25  # pieces that are so near to the worst, as a share of its size, take part from the beginning
_FEW = 8  # measures of so many pieces take part whole
_ROUNDS, _STEPS, _MOST = 6, 100, 500
_PRECISION, _SETTLED = 1e-9, 1e-9
_NEARER = 0.2  # by how much steps become shorter where they lead to what is no machine
_FAR = 1e3  # what stands for the value of a design that is none: line searches turn back from it


@dataclass(frozen=True, eq=False)
class Local(Readable):
    """What an optimiser came to from one start."""

    design: FloatArray  # (n,): variables [SI units]
    value: float  # the objective there
    violation: float  # as of `Evaluated.violation`
    evaluations: int  # how often pieces and gradients were computed


class _Rows:
    """Objective and constraints at scaled variables, as rows that are smooth; each point computed once."""

    def __init__(self, problem: Statement) -> None:
        self.problem, self.evaluations, self.lost = problem, 0, False
        self._at: bytes = b""
        self._found: list[Pieces] | None = None

    def pieces(self, x: FloatArray) -> list[Pieces] | None:
        """Return the pieces of the objective, to become small, then margins; None where there is none."""
        key = x.tobytes()
        if key != self._at:
            self._at, self._found = key, self._compute(x)
            self.lost |= self._found is None
        return self._found

    def _compute(self, x: FloatArray) -> list[Pieces] | None:
        problem, self.evaluations = self.problem, self.evaluations + 1
        population = Population(problem.setting, problem.variables.values(x)[None])
        if not population.feasible[0]:
            return None
        measure, span = problem.objectives[0], problem.variables.span
        found = measure.pieces(population)
        sign = 1.0 if measure.better == "small" else -1.0
        rows = [Pieces(sign * found.values, lambda: sign * found.gradients)]
        rows += [item.margins(population) for item in problem.constraints]
        if not all(np.isfinite(row.values).all() for row in rows):
            return None
        return [Pieces(row.values[0], partial(_scaled, row, span)) for row in rows]


def _scaled(row: Pieces, span: FloatArray) -> FloatArray:
    return np.asarray(np.nan_to_num(row.gradients[0]) * span)


def descend(problem: Statement, start: FloatArray) -> Local:
    """Return the best of the first objective that was come to near a design; it may miss constraints."""
    x = np.clip(problem.variables.scaled(start), 0.0, 1.0)
    rows = _Rows(problem)
    found = rows.pieces(x)
    if found is None:
        return _local(problem, x, rows)
    active: list[NDArray[np.bool_]] = [np.zeros(len(row.values), bool) for row in found]
    reach = 1.0
    for _ in range(_ROUNDS):
        grown, rows.lost = _widen(active, found), False
        x_new = _program(rows, x, found, active, reach)
        at_new = rows.pieces(x_new)
        before = found[0].values.max()
        settled = at_new is None or abs(at_new[0].values.max() - before) <= _SETTLED * abs(before)
        if at_new is not None:
            x, found = x_new, at_new
        if rows.evaluations > _MOST or (settled and not grown and not rows.lost):
            break
        reach *= _NEARER if settled and rows.lost else 1.0  # a step led to no machine: shorter ones
    return _local(problem, x, rows)


def _widen(active: list[NDArray[np.bool_]], found: list[Pieces]) -> bool:
    """Let pieces that are near to the worst take part; return whether there are new ones."""
    grown = False
    for index, (mask, row) in enumerate(zip(active, found, strict=True)):
        values = -row.values if index == 0 else row.values  # the least is the worst
        room = _NEAR * max(abs(values.min()), 0.5 if index else 0.0)
        near = values <= values.min() + room if len(values) > _FEW else np.ones(len(values), bool)
        grown |= bool((near & ~mask).any())
        np.logical_or(mask, near, out=mask)
    return grown


def _program(
    rows: _Rows, x: FloatArray, found: list[Pieces], active: list[NDArray[np.bool_]], reach: float
) -> FloatArray:
    """Return the optimum of some pieces within reach of x, scaled; t is the objective by its size at x."""
    from scipy.optimize import minimize

    size = max(float(np.abs(found[0].values).max()), 1e-12)
    last: dict[str, Any] = {}

    def margins(p: FloatArray) -> FloatArray:
        at = rows.pieces(p[:-1])
        if at is None:
            return np.full(sum(int(mask.sum()) for mask in active), -_FAR)
        last["pieces"] = at
        parts = [p[-1] - at[0].values[active[0]] / size]
        parts += [row.values[mask] for row, mask in zip(at[1:], active[1:], strict=True)]
        return np.concatenate(parts)

    def slopes(p: FloatArray) -> FloatArray:
        at = rows.pieces(p[:-1]) or last["pieces"]
        by_t = np.ones((int(active[0].sum()), 1))
        parts = [np.hstack([-at[0].gradients[active[0]] / size, by_t])]
        for row, mask in zip(at[1:], active[1:], strict=True):
            parts.append(np.hstack([row.gradients[mask], np.zeros((int(mask.sum()), 1))]))
        return np.concatenate(parts)

    ahead = np.append(np.zeros(len(x)), 1.0)
    begin = np.append(x, found[0].values.max() / size)
    last["pieces"] = found
    result = minimize(
        lambda p: p[-1],
        begin,
        jac=lambda _: ahead,
        method="SLSQP",
        bounds=[(max(at - reach, 0.0), min(at + reach, 1.0)) for at in x] + [(None, None)],
        constraints={"type": "ineq", "fun": margins, "jac": slopes},
        options={"ftol": _PRECISION, "maxiter": _STEPS},
    )
    return np.asarray(np.clip(result.x[:-1], 0.0, 1.0))


def _local(problem: Statement, x: FloatArray, rows: _Rows) -> Local:
    found = problem.evaluate(problem.variables.values(x))
    return Local(found.designs[0], float(found.objectives[0, 0]), float(found.violation[0]), rows.evaluations)
