"""Pareto fronts: by the ε-constraint method, or by a genetic algorithm whose designs are then polished.

The ε-constraint method makes one objective as good as it can be while the others have bounds; every optimum
of it lies on the front. Polishing does the same from designs that a genetic algorithm found.

Reference
---------
Y. Haimes, L. Lasdon, D. Wismer, IEEE Trans. Systems, Man, Cybernetics 1 (1971) 296.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from p3dof._base.blocks import nondominated
from p3dof._base.checks import FloatArray, Progress, shown
from p3dof._base.errors import InputError, OptimisationError
from p3dof.design.optimisation.constraints import Constraint
from p3dof.design.optimisation.epigraph import Local
from p3dof.design.optimisation.feasibility import nearest_feasible
from p3dof.design.optimisation.front import Front, efficient, require_objectives, signs_of
from p3dof.design.optimisation.journal import Journal
from p3dof.design.optimisation.minimising import STARTS, best_of, descent
from p3dof.design.optimisation.nsga import genetic_front
from p3dof.design.optimisation.starts import starts_of
from p3dof.design.optimisation.statement import Statement

FrontMethod: TypeAlias = Literal["epsilon", "nsga2", "nsga3"]
"""How to look for a front."""

POINTS, POPULATION, GENERATIONS = 50, 100, 150


def pareto(
    problem: Statement,
    objectives: Sequence[Any] | None = None,
    *,
    method: FrontMethod = "epsilon",
    points: int = POINTS,
    population: int = POPULATION,
    generations: int = GENERATIONS,
    polish: bool = True,
    seed: int = 0,
    store: str | os.PathLike[str] | None = None,
    resume: bool = False,
    progress: Progress | None = None,
) -> Front:
    """Return a Pareto front; arguments and errors as of `DesignProblem.pareto`."""
    asked = problem if objectives is None else problem.asking(tuple(objectives))
    require_objectives(asked)
    _require(method, points, population, generations, seed)
    if method == "epsilon" and len(asked.objectives) != 2:
        raise InputError("method: 'epsilon' makes fronts of two objectives; take 'nsga3' for more")
    about = {
        "what": "pareto",
        "problem": asked.settings(),
        "method": method,
        "points": points,
        "population": population,
        "generations": generations,
        "polish": bool(polish),
        "seed": int(seed),
    }
    with Journal(store, about, resume) as journal:
        unpolished: FloatArray = np.zeros((0, len(asked.objectives)))
        if method == "epsilon":
            begin = starts_of(asked, 4 * STARTS, seed)
        else:
            begin = genetic_front(asked, method, population, generations, seed, journal, progress)
            unpolished = asked.evaluate(begin).objectives
            if not polish:
                return Front(asked, efficient(asked, begin), unpolished, method, int(seed))
        polished_by = _line if len(asked.objectives) == 2 else _members
        polished = polished_by(asked, begin, points, journal, progress)
    return Front(asked, efficient(asked, polished), unpolished, method, int(seed))


def _line(
    problem: Statement, begin: FloatArray, points: int, journal: Journal, progress: Progress | None
) -> FloatArray:
    """Return optima of the first objective for even bounds on the second, from one end to the other."""
    first, second = problem.objectives
    found = [_end(problem, first, begin, journal, "end-0"), _end(problem, second, begin, journal, "end-1")]
    values = problem.evaluate(np.array(found)).objectives[:, 1]
    bounds = np.linspace(values[0], values[1], points)
    designs, known, local = [found[0]], np.concatenate([begin, found]), None
    for index, bound in enumerate(bounds[1:], start=1):
        asked = problem.asking(first, [_bound(second, float(bound))])
        local = _best(asked, [designs[-1], *_nearest(asked, known)], journal, f"point-{index:04d}")
        if local is not None:
            designs.append(local.design)
        if progress is not None:
            progress(index + 1, points)
    return np.array(designs if local is not None else [*designs, found[1]])


def _bound(measure: Any, value: float) -> Constraint:
    return Constraint(measure, value, at_least=measure.better == "large")


def _end(problem: Statement, measure: Any, begin: FloatArray, journal: Journal, name: str) -> FloatArray:
    """Return the optimum of one objective alone: one end of the front.

    Raises
    ------
    OptimisationError
        If no design keeps all constraints.
    """
    asked = problem.asking(measure)
    starts = np.concatenate([np.array(_nearest(asked, begin, STARTS)), begin[:1]])
    if not asked.evaluate(starts).feasible.any():
        starts = nearest_feasible(asked, starts)[None]  # raises if there is none
    local = _best(asked, list(starts), journal, name, every=True)
    if local is None:
        raise OptimisationError("no optimum was found, though there are designs that keep all constraints")
    return local.design


def _nearest(problem: Statement, known: FloatArray, count: int = 2) -> list[FloatArray]:
    """Return the known designs that are best by a problem: what misses constraints comes last."""
    found = problem.evaluate(known)
    value = np.where(np.isnan(found.objectives[:, 0]), np.inf, signs_of(problem)[0] * found.objectives[:, 0])
    return list(known[np.lexsort((value, found.violation))[:count]])


def _best(
    problem: Statement, starts: list[FloatArray], journal: Journal, name: str, every: bool = False
) -> Local | None:
    """Return the best optimum from some starts; the first that beats all starts that are feasible will do."""
    found: list[Local] = []
    at_starts = problem.evaluate(np.array(starts))
    sign = signs_of(problem)[0]
    good = at_starts.objectives[at_starts.feasible, 0]
    target = (sign * good).min() if len(good) else np.inf
    for index, start in enumerate(starts):
        found.append(descent(journal, f"{name}-{index}", problem, start))
        best = best_of(problem, found)
        if not every and best is not None and sign * best.value <= target + 1e-9 * abs(target):
            return best
    return best_of(problem, found)


def _members(
    problem: Statement, begin: FloatArray, points: int, journal: Journal, progress: Progress | None
) -> FloatArray:
    """Return some designs of a front, each with its first objective made as good as the others allow."""
    first, *others = problem.objectives
    chosen = _spread(signs_of(problem) * problem.evaluate(begin).objectives, points)
    designs = []
    for done, index in enumerate(chosen, start=1):
        values = problem.evaluate(begin[index]).objectives[0, 1:]
        bounds = [_bound(measure, float(value)) for measure, value in zip(others, values, strict=True)]
        asked = problem.asking(first, bounds)
        local = _best(asked, [begin[index]], journal, f"point-{done:04d}")
        designs.append(begin[index] if local is None else local.design)
        if progress is not None:
            progress(done, len(chosen))
    return np.array(designs)


def _spread(costs: FloatArray, points: int) -> list[int]:
    """Return members of a front that are far from each other: first its ends, then always the farthest."""
    members = nondominated(costs)
    scaled = (costs - costs.min(axis=0)) / np.maximum(np.ptp(costs, axis=0), 1e-300)
    chosen = [int(members[index]) for index in dict.fromkeys(scaled[members].argmin(axis=0).tolist())]
    distance = np.min([np.linalg.norm(scaled[members] - scaled[k], axis=1) for k in chosen], axis=0)
    while len(chosen) < min(points, len(members)) and distance.max() > 0:
        index = int(distance.argmax())
        chosen.append(int(members[index]))
        distance = np.minimum(distance, np.linalg.norm(scaled[members] - scaled[chosen[-1]], axis=1))
    return chosen


def _require(method: str, points: Any, population: Any, generations: Any, seed: Any) -> None:
    if method not in get_args(FrontMethod):
        raise InputError(f"method: expected {' or '.join(get_args(FrontMethod))}, got {shown(method)}")
    limits = (
        ("points", points, 2, 100_000),
        ("population", population, 4, 1_000_000),
        ("generations", generations, 1, 1_000_000),
        ("seed", seed, 0, 2**32 - 1),
    )
    for name, value, least, most in limits:
        if isinstance(value, bool) or not hasattr(value, "__index__") or not least <= int(value) <= most:
            raise InputError(f"{name}: expected a whole number from {least} to {most}, got {shown(value)}")
