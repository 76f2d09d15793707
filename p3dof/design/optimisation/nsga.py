"""Pareto fronts by the genetic algorithms NSGA-II and NSGA-III (pymoo's), whole generations at once.

References
----------
K. Deb et al., IEEE Trans. Evolutionary Computation 6 (2002) 182 (NSGA-II); K. Deb, H. Jain, ibid. 18 (2014)
577 (NSGA-III). J. Blank, K. Deb, pymoo, IEEE Access 8 (2020) 89497.
"""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import numpy as np

from p3dof._base.checks import FloatArray, Progress
from p3dof._base.errors import MissingExtraError, OptimisationError
from p3dof.design.optimisation.evolution import Generations
from p3dof.design.optimisation.journal import Journal
from p3dof.design.optimisation.statement import Statement

Genetic: TypeAlias = Literal["nsga2", "nsga3"]
"""Which algorithm."""

_NO_VALUE = 1e12


def genetic_front(
    problem: Statement,
    algorithm: Genetic,
    population: int,
    generations: int,
    seed: int,
    journal: Journal,
    progress: Progress | None = None,
) -> FloatArray:
    """Return the designs of a Pareto front, unpolished.

    Generations that are in the journal are taken from it: the algorithm runs through them again, with the
    same random numbers, and comes to the same state.

    Parameters
    ----------
    problem : Statement
        Two objectives or more.
    algorithm : {"nsga2", "nsga3"}
        Which one.
    population, generations : int
        Designs of a generation, and how many generations.
    seed : int
        Of all random numbers.
    journal : Journal
        Where generations are kept.
    progress : callable, optional
        Called with generations done and all.

    Returns
    -------
    ndarray, shape (K, n)
        [SI units]

    Raises
    ------
    MissingExtraError
        If pymoo is not installed.
    OptimisationError
        If no design that was found keeps all constraints.
    """
    try:
        from pymoo.core.problem import Problem
        from pymoo.optimize import minimize
    except ImportError as error:
        raise MissingExtraError(
            "NSGA-II and NSGA-III need pymoo: pip install 'p3dof[studio]'; method='epsilon' does not"
        ) from error
    made = Generations(problem, journal, "generation")
    count = len(problem.variables)

    class Whole(Problem):  # type: ignore[misc]  # pymoo has no types
        def __init__(self) -> None:
            constraints = len(problem.constraints) + 1
            super().__init__(
                n_var=count, n_obj=len(problem.objectives), n_ieq_constr=constraints, xl=0.0, xu=1.0
            )

        def _evaluate(self, x: FloatArray, out: dict[str, Any], *_: Any, **__: Any) -> None:
            objectives, violations = made.evaluate(np.ascontiguousarray(x, dtype=np.float64))
            out["F"], out["G"] = np.minimum(objectives, _NO_VALUE), violations
            if progress is not None:
                progress(min(made.count, generations), generations)

    found = minimize(
        Whole(), _algorithm(algorithm, population, len(problem.objectives)), ("n_gen", generations), seed=seed
    )
    if found.X is None:
        raise OptimisationError("no design that was found keeps all constraints")
    return problem.variables.values(np.atleast_2d(found.X))


def _algorithm(algorithm: Genetic, population: int, objectives: int) -> Any:
    if algorithm == "nsga2":
        from pymoo.algorithms.moo.nsga2 import NSGA2

        return NSGA2(pop_size=population)
    from pymoo.algorithms.moo.nsga3 import NSGA3
    from pymoo.util.ref_dirs import get_reference_directions

    directions = get_reference_directions("energy", objectives, population, seed=1)
    return NSGA3(directions, pop_size=population)
