"""One objective: local optima from several starts, or differential evolution; parts are kept in a journal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from p3dof._base.checks import FloatArray, Progress, real, shown
from p3dof._base.errors import InputError, OptimisationError
from p3dof.design.optimisation.constraints import Constraint
from p3dof.design.optimisation.epigraph import Local, descend
from p3dof.design.optimisation.evolution import Journal, evolve
from p3dof.design.optimisation.feasibility import nearest_feasible, require_influence, starts_of
from p3dof.design.optimisation.measures import measure_of
from p3dof.design.optimisation.optimum import Optimum
from p3dof.design.optimisation.statement import Statement

Optimiser: TypeAlias = Literal["slsqp", "evolution"]  # how to look for an optimum

STARTS = 8  # designs that the local optimiser begins with


def asking(problem: Statement, objective: Any, subject_to: Mapping[str, float] | None) -> Statement:
    """Return a problem for one objective, with further bounds on measures."""
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


def by_descents(
    problem: Statement, starts: int, seed: int, journal: Journal, progress: Progress | None
) -> Optimum:
    """Return the best optimum that descents from several starts come to."""
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
        raise OptimisationError("no optimum was found, though there are feasible designs")
    return _optimum(problem, best, "slsqp", seed, attempts, 0)


def by_evolution(
    problem: Statement, seed: int, generations: int, polish: bool, journal: Journal, progress: Progress | None
) -> Optimum:
    """Return the optimum that differential evolution comes to, polished by a descent."""
    design = evolve(problem, seed, journal, generations, progress)
    found = problem.evaluate(design)
    local = Local(design, float(found.objectives[0, 0]), float(found.violation[0]), 0)
    attempts = [local]
    if polish:
        attempts.append(descent(journal, "polished", problem, design))
    best = best_of(problem, attempts)
    if best is None:
        nearest_feasible(problem, np.concatenate([design[None], starts_of(problem, STARTS, seed)]))
        raise OptimisationError("no optimum was found, though there are feasible designs")
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


def require_effort(method: str, starts: Any, generations: Any, seed: Any) -> None:
    """Raise `InputError` where a method or a number of `DesignProblem.minimise` does not fit."""
    if method not in get_args(Optimiser):
        raise InputError(f"method: expected {' or '.join(get_args(Optimiser))}, got {shown(method)}")
    for name, value, least, most in (
        ("starts", starts, 1, 10_000),
        ("generations", generations, 1, 1_000_000),
        ("seed", seed, 0, 2**63),
    ):
        if isinstance(value, bool) or not hasattr(value, "__index__") or not least <= int(value) <= most:
            raise InputError(f"{name}: expected a whole number from {least} to {most}, got {shown(value)}")
