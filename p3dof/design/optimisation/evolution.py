"""The optimum by differential evolution (SciPy's), whole generations of designs at once.

Reference
---------
R. Storn, K. Price, J. Global Optimization 11 (1997) 341; for constraints J. Lampinen, CEC 2002.
"""

from __future__ import annotations

import numpy as np

from p3dof._base.checks import FloatArray, Progress
from p3dof.design.optimisation.journal import Journal
from p3dof.design.optimisation.statement import Statement

GENERATIONS = 300
_MEMBERS = 24
"""Members of the population a variable."""
_WORST = 1e30
_PRECISION = 1e-9


class Generations:
    """Designs evaluated generation by generation; those of a journal are not computed again.

    Parameters
    ----------
    problem : Statement
        What designs are evaluated by.
    journal : Journal
        Where generations are kept.
    name : str
        What they are called there.
    """

    def __init__(self, problem: Statement, journal: Journal, name: str) -> None:
        self._problem, self._journal, self._name = problem, journal, name
        self.count = 0

    def evaluate(self, scaled: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the objectives, to become small, and the violations of each constraint of designs.

        Parameters
        ----------
        scaled : ndarray, shape (D, n)
            Scaled variables.

        Returns
        -------
        objectives : ndarray, shape (D, M)
            1e30 where there is none.
        violations : ndarray, shape (D, C + 1)
            By the sizes of their bounds, 0 where kept; first that of the motion.
        """
        number, self.count = self.count, self.count + 1
        name = f"{self._name}-{number:05d}"
        kept = self._journal.read(name)
        if kept is not None and np.array_equal(kept.get("designs", ()), scaled):
            return kept["objectives"], kept["violations"]
        found = self._compute(scaled)
        self._journal.write(name, designs=scaled, objectives=found[0], violations=found[1])
        return found

    def _compute(self, scaled: FloatArray) -> tuple[FloatArray, FloatArray]:
        problem = self._problem
        found = problem.evaluate(problem.variables.values(scaled))
        signs = np.array([1.0 if m.better == "small" else -1.0 for m in problem.objectives])
        objectives = np.where(np.isnan(found.objectives), _WORST, signs * found.objectives)
        scales = np.array([item.scale for item in problem.constraints])
        with np.errstate(invalid="ignore"):
            missed = np.maximum(-found.margins / scales, 0.0)
        missed = np.where(np.isnan(missed), 1.0, missed)
        lost = np.where(found.status == 0, 0.0, 10.0)[:, None]
        return objectives, np.hstack([lost, missed])


def evolve(
    problem: Statement,
    seed: int,
    journal: Journal,
    generations: int = GENERATIONS,
    progress: Progress | None = None,
) -> FloatArray:
    """Return the best design by differential evolution.

    Parameters
    ----------
    problem : Statement
        Its first objective counts.
    seed : int
        Of all random numbers.
    journal : Journal
        Where generations are kept.
    generations : int
        Most of them.
    progress : callable, optional
        Called with generations done and at most to do.

    Returns
    -------
    ndarray, shape (n,)
        Variables [SI units].
    """
    from scipy.optimize import NonlinearConstraint, differential_evolution

    count = len(problem.variables)
    made = Generations(problem, journal, "generation")
    known: dict[bytes, float] = {}

    def violations(x: FloatArray) -> FloatArray:
        columns = np.atleast_2d(x.T) if x.ndim == 2 else x[None]
        objectives, missed = made.evaluate(np.ascontiguousarray(columns))
        known.update({row.tobytes(): value for row, value in zip(columns, objectives[:, 0], strict=True)})
        return missed.T if x.ndim == 2 else missed[0]

    def objective(x: FloatArray) -> FloatArray:
        return np.array([known[row.tobytes()] for row in np.ascontiguousarray(x.T)])

    def tell(*_: object, **__: object) -> None:
        if progress is not None:
            progress(min(made.count, generations), generations)

    found = differential_evolution(
        objective,
        [(0.0, 1.0)] * count,
        constraints=NonlinearConstraint(violations, -np.inf, 0.0),
        maxiter=generations,
        popsize=_MEMBERS,
        tol=_PRECISION,
        atol=0.0,
        init="sobol",
        polish=False,
        updating="deferred",
        vectorized=True,
        callback=tell,
        rng=np.random.default_rng(seed),
    )
    return problem.variables.values(found.x)
