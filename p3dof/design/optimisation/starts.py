"""Where local optimisers begin: the machine there is, and good designs far from each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import OptimisationError
from p3dof.design.optimisation.statement import Statement

_POINTS, _FEW = 1024, 32
"""Designs to choose from; few where a measure takes long."""
_BEST = 8
"""How many designs further ones are looked for around."""
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
    points = qmc.Sobol(len(variables), rng=np.random.default_rng(seed)).random(
        _FEW if is_slow(problem) else _POINTS
    )
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


def closer(problem: Statement, starts: FloatArray, halved: Sequence[int] = range(1, 11)) -> FloatArray:
    """Return starts, and the best of random designs around the best, ever closer; no more if that takes long.

    Parameters
    ----------
    problem : Statement
        Its first objective counts, to be made small.
    starts : ndarray, shape (S, n)
        [SI units].
    halved : sequence of int
        How often the ranges of the variables are halved for each turn of random designs.

    Returns
    -------
    ndarray, shape (S or more, n)
        [SI units]; the starts, then the best first.
    """
    if is_slow(problem):
        return starts
    rng, variables = np.random.default_rng(0), problem.variables
    points = np.clip(variables.scaled(starts), 0.0, 1.0)
    for reach in 0.5 ** np.array(halved):
        centres = points[rng.integers(len(points), size=_POINTS)]
        around = np.clip(centres + rng.uniform(-reach, reach, centres.shape), 0.0, 1.0)
        points = np.concatenate([points, around])
        found = problem.evaluate(variables.values(points))
        value = np.where(np.isnan(found.objectives[:, 0]), np.inf, found.objectives[:, 0])
        points = points[np.lexsort((value, found.violation))[:_BEST]]
    return np.concatenate([starts, variables.values(points)])


def is_slow(problem: Statement) -> bool:
    """Whether a measure of a problem takes long."""
    measures = (*problem.objectives, *(item.measure for item in problem.constraints))
    return any(getattr(measure, "slow", False) for measure in measures)


def require_influence(problem: Statement, starts: FloatArray) -> None:
    """Raise `OptimisationError` if the first objective is the same whatever the variables are."""
    values = problem.evaluate(starts).objectives[:, 0]
    values = values[np.isfinite(values)]
    if len(values) > 1 and np.ptp(values) == 0 and np.ptp(starts, axis=0).any():
        name, by = problem.objectives[0].name, ", ".join(problem.variables.labels)
        raise OptimisationError(
            f"{name} does not depend on any variable ({by}): there is nothing to optimise"
        )
