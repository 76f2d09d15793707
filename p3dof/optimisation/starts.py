"""Where local optimisers begin: the machine there is, and good designs far from each other."""

from __future__ import annotations

import numpy as np

from p3dof.checks import FloatArray
from p3dof.errors import OptimisationError
from p3dof.optimisation.statement import Statement

_POINTS, _FEW = 1024, 32
"""Designs to choose from; few where a measure takes long."""
_APART = 0.1
"""Least distance between starts, as a share of the ranges of the variables."""


def starts_of(problem: Statement, count: int, seed: int) -> FloatArray:
    """Return designs to begin with: the problem's own first, then the best of a Sobol sequence.

    Parameters
    ----------
    problem : Statement
        Its first objective counts.
    count : int
        How many.
    seed : int
        Of the sequence.

    Returns
    -------
    ndarray, shape (count, n)
        [SI units]
    """
    from scipy.stats import qmc

    variables = problem.variables
    own = problem.start
    chosen = [np.clip(variables.scaled(own), 0, 1)] if np.isfinite(own).all() else []
    points = qmc.Sobol(len(variables), rng=np.random.default_rng(seed)).random(_points(problem))
    found = problem.evaluate(variables.values(points))
    sign = 1.0 if problem.objectives[0].better == "small" else -1.0
    value = np.where(np.isnan(found.objectives[:, 0]), np.inf, sign * found.objectives[:, 0])
    for index in np.lexsort((value, found.violation)):
        if len(chosen) >= count:
            break
        if all(np.abs(points[index] - other).max() > _APART for other in chosen):
            chosen.append(points[index])
    while len(chosen) < count:  # a small range: further points, one after the other
        chosen.append(points[len(chosen) % len(points)])
    return variables.values(np.array(chosen[:count]))


def _points(problem: Statement) -> int:
    measures = (*problem.objectives, *(item.measure for item in problem.constraints))
    return _FEW if any(getattr(measure, "slow", False) for measure in measures) else _POINTS


def require_influence(problem: Statement, starts: FloatArray) -> None:
    """Raise `OptimisationError` if the first objective is the same whatever the variables are."""
    values = problem.evaluate(starts).objectives[:, 0]
    values = values[np.isfinite(values)]
    if len(values) > 1 and np.ptp(values) == 0 and np.ptp(starts, axis=0).any():
        name, by = problem.objectives[0].name, ", ".join(problem.variables.labels)
        raise OptimisationError(
            f"{name} does not depend on any variable ({by}): there is nothing to optimise"
        )
