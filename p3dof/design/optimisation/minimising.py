"""One objective: local optima from several starts, or differential evolution; parts are kept in a journal."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from p3dof._base.checks import FloatArray, Progress, real, shown
from p3dof._base.errors import InputError, OptimisationError
from p3dof.design.optimisation.constraints import Constraint
from p3dof.design.optimisation.epigraph import Local, descend
from p3dof.design.optimisation.evolution import GENERATIONS, evolve
from p3dof.design.optimisation.feasibility import nearest_feasible
from p3dof.design.optimisation.journal import Journal
from p3dof.design.optimisation.measures import measure_of
from p3dof.design.optimisation.optimum import Optimum
from p3dof.design.optimisation.starts import require_influence, starts_of
from p3dof.design.optimisation.statement import Statement

Optimiser: TypeAlias = Literal["slsqp", "evolution"]
"""How to look for an optimum."""

STARTS = 8
"""Designs that the local optimiser begins with."""


def minimise(
    problem: Statement,
    objective: Any = None,
    subject_to: Mapping[str, float] | None = None,
    *,
    method: Optimiser = "slsqp",
    starts: int = STARTS,
    generations: int = GENERATIONS,
    seed: int = 0,
    polish: bool = True,
    store: str | os.PathLike[str] | None = None,
    resume: bool = False,
    progress: Progress | None = None,
) -> Optimum:
    """Return the best design; arguments and errors as of `DesignProblem.minimise`."""
    asked = asking(problem, objective, subject_to)
    _require(method, starts, generations, seed)
    about = {
        "what": "minimise",
        "problem": asked.settings(),
        "method": method,
        "starts": starts,
        "generations": generations,
        "seed": int(seed),
    }
    with Journal(store, about, resume) as journal:
        if method == "evolution":
            return _by_evolution(asked, seed, generations, polish, journal, progress)
        return _by_descents(asked, starts, seed, journal, progress)


def asking(problem: Statement, objective: Any, subject_to: Mapping[str, float] | None) -> Statement:
    """Return a problem for one objective, with further bounds on measures.

    Parameters
    ----------
    problem : Statement
        The problem.
    objective : str or Measure, optional
        Its first one by default.
    subject_to : mapping of str to float, optional
        The worst value that each measure may have.

    Returns
    -------
    Statement

    Raises
    ------
    InputError
        If there is no such measure, or a bound is no number.
    """
    return problem.asking(
        problem.objectives[0] if objective is None else objective, bounds_of(problem, subject_to)
    )


def bounds_of(problem: Statement, worst: Mapping[str, float] | None) -> list[Constraint]:
    """Return constraints from the worst values that measures may have; errors as of `asking`."""
    bounds = []
    own = {measure.name: measure for measure in problem.objectives}
    for name, value in (worst or {}).items():
        measure = own[name] if name in own else measure_of(name, "subject_to")
        bound = real(f"subject_to: {name}", value)
        bounds.append(Constraint(measure, bound, at_least=measure.better == "large"))
    return bounds


def _by_descents(
    problem: Statement, starts: int, seed: int, journal: Journal, progress: Progress | None
) -> Optimum:
    begin = starts_of(problem, starts, seed)
    require_influence(problem, begin)
    attempts: list[Local] = []
    for index, start in enumerate(begin):
        attempts.append(descent(journal, f"start-{index:03d}", problem, start))
        if index == 0 and attempts[0].violation > 0:
            _kept_design(journal, problem, begin)  # raises now if there is none
        if progress is not None:
            progress(index + 1, starts)
    best = best_of(problem, attempts)
    if best is None:
        feasible = _kept_design(journal, problem, begin)
        attempts.append(descent(journal, "start-feasible", problem, feasible))
        best = best_of(problem, attempts)
    if best is None:
        raise OptimisationError("no optimum was found, though there are designs that keep all constraints")
    return _optimum(problem, best, "slsqp", seed, attempts, 0)


def _by_evolution(
    problem: Statement,
    seed: int,
    generations: int,
    polish: bool,
    journal: Journal,
    progress: Progress | None,
) -> Optimum:
    design = evolve(problem, seed, journal, generations, progress)
    found = problem.evaluate(design)
    local = Local(design, float(found.objectives[0, 0]), float(found.violation[0]), 0)
    attempts = [local]
    if polish:
        attempts.append(descent(journal, "polished", problem, design))
    best = best_of(problem, attempts)
    if best is None:
        nearest_feasible(problem, np.concatenate([design[None], starts_of(problem, STARTS, seed)]))
        raise OptimisationError("no optimum was found, though there are designs that keep all constraints")
    return _optimum(problem, best, "evolution", seed, (), generations)


def _optimum(
    problem: Statement, best: Local, method: str, seed: int, attempts: Any, generations: int
) -> Optimum:
    evaluations = sum(local.evaluations for local in attempts) + generations
    return Optimum(problem, best.design, method, int(seed), tuple(attempts), evaluations)


def best_of(problem: Statement, attempts: list[Local]) -> Local | None:
    """Return the best that keeps all constraints, if there is one."""
    sign = 1.0 if problem.objectives[0].better == "small" else -1.0
    good = [local for local in attempts if local.violation == 0 and np.isfinite(local.value)]
    return min(good, key=lambda local: sign * local.value) if good else None


def descent(journal: Journal, name: str, problem: Statement, start: FloatArray) -> Local:
    """Return the optimum near a design, from the journal if it is there; it is kept there else."""
    there = journal.read(name)
    if there is not None and np.array_equal(there.get("start", ()), start):
        value, violation, evaluations = there["numbers"].tolist()
        return Local(there["design"], value, violation, int(evaluations))
    local = descend(problem, start)
    numbers = np.array([local.value, local.violation, local.evaluations], dtype=np.float64)
    journal.write(name, start=start, design=local.design, numbers=numbers)
    return local


def _kept_design(journal: Journal, problem: Statement, starts: FloatArray) -> FloatArray:
    there = journal.read("feasible")
    if there is not None and there.get("design", np.zeros(0)).shape == starts.shape[1:]:
        return np.asarray(there["design"])
    design = nearest_feasible(problem, starts)
    journal.write("feasible", design=design)
    return design


def _require(method: str, starts: Any, generations: Any, seed: Any) -> None:
    if method not in get_args(Optimiser):
        raise InputError(f"method: expected {' or '.join(get_args(Optimiser))}, got {shown(method)}")
    for name, value, least, most in (
        ("starts", starts, 1, 10_000),
        ("generations", generations, 1, 1_000_000),
        ("seed", seed, 0, 2**63),
    ):
        if isinstance(value, bool) or not hasattr(value, "__index__") or not least <= int(value) <= most:
            raise InputError(f"{name}: expected a whole number from {least} to {most}, got {shown(value)}")
