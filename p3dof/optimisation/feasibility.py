"""Whether any design keeps all constraints; if not, which are missed by how much at least."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from p3dof.checks import FloatArray
from p3dof.designs.status import DesignStatus
from p3dof.errors import OptimisationError
from p3dof.optimisation.constraints import Constraint, amount
from p3dof.optimisation.epigraph import Local, descend
from p3dof.optimisation.measure import Better, Pieces
from p3dof.optimisation.population import Population
from p3dof.optimisation.statement import Statement

_MISSED, _STARTS = 1e-9, 4
_TOLD = 1e-3
"""Constraints that are missed by more than this share of the worst are named."""


@dataclass(frozen=True)
class Missing:
    """What is missing at most of the constraints, as a share of their bounds: a measure to be made small."""

    constraints: tuple[Constraint, ...]
    name: str = "violation"
    unit: str = ""
    better: Better = "small"
    figures: tuple[Any, ...] = ()

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,)."""
        parts = [-item.margin(item.measure.values(population)) / item.scale for item in self.constraints]
        return np.asarray(np.max(parts, axis=0))

    def pieces(self, population: Population) -> Pieces:
        """Return its pieces and their gradients."""
        found = [item.margins(population) for item in self.constraints]
        return Pieces(
            -np.concatenate([each.values for each in found], axis=1),
            lambda: -np.concatenate([each.gradients for each in found], axis=1),
        )


def nearest_feasible(problem: Statement, starts: FloatArray) -> FloatArray:
    """Return a design that keeps all constraints.

    Parameters
    ----------
    problem : Statement
        What they are.
    starts : ndarray, shape (S, n)
        Where to begin [SI units].

    Returns
    -------
    ndarray, shape (n,)

    Raises
    ------
    OptimisationError
        If none was found: the message names the constraints that no design keeps together, and what is
        missing at least.
    """
    able = problem.evaluate(starts).status == DesignStatus.FEASIBLE
    if not able.any():
        found = problem.evaluate(starts)
        raise OptimisationError(
            f"no design was found that makes the motion: {found.reason(0)}; change bounds of the variables"
        )
    missing = problem.unconstrained(Missing(problem.constraints))
    tried: list[Local] = []
    for start in starts[able][:_STARTS]:
        tried.append(descend(missing, start))
        if tried[-1].value < _MISSED:
            return tried[-1].design
    raise OptimisationError(_told(problem, min(tried, key=lambda local: local.value).design))


def _told(problem: Statement, design: FloatArray) -> str:
    found = problem.evaluate(design)
    scales = np.array([item.scale for item in problem.constraints])
    shares = -found.margins[0] / scales
    missed = np.flatnonzero(shares > _TOLD * shares.max())
    told = []
    order = np.argsort(-np.round(shares[missed] / shares.max(), 3), kind="stable")  # ties as they were given
    for index in missed[order]:
        item, margin = problem.constraints[index], -found.margins[0, index]
        told.append(f"{item.name} by {amount(margin, item.measure.unit, 4)}")
    pairs = zip(problem.variables.labels, design, strict=True)
    where = ", ".join(f"{label} {value:.4g}" for label, value in pairs)
    return f"no design keeps all constraints: the nearest one ({where}) misses {' and '.join(told)}"
