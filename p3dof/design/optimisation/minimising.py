"""One objective: local optima from several starts, or differential evolution; parts are kept in a journal.

Discrete variables: every combination, but for those that a bound shows to be no better or not possible.

Bounds hold for all designs of a combination: what the catalogue alone decides (cost, mass) is exact, and the
speeds of motors and screws are, where no variable moves the sliders otherwise; with a lead that may change
they are those of the longest one. Combinations are looked at in the order of their bounds, so that as soon as
one is as good as the bound of the next, all others are left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from p3dof._base.checks import FloatArray, Progress, real, shown
from p3dof._base.errors import InputError, OptimisationError
from p3dof.design.optimisation.constraints import Constraint, amount, in_si
from p3dof.design.optimisation.epigraph import Local, descend
from p3dof.design.optimisation.evaluated import TOLERANCE
from p3dof.design.optimisation.evolution import Journal, evolve
from p3dof.design.optimisation.feasibility import nearest_feasible, require_influence, starts_of
from p3dof.design.optimisation.measures import measure_of
from p3dof.design.optimisation.optimum import Combination, Optimum
from p3dof.design.optimisation.population import Population
from p3dof.design.optimisation.statement import Statement
from p3dof.design.optimisation.task_measures import LEAD, OfDrives, OfParts, OverTasks

Optimiser: TypeAlias = Literal["slsqp", "evolution"]  # how to look for an optimum

STARTS = 8  # designs that the local optimiser begins with


def asking(problem: Statement, objective: Any, subject_to: Mapping[str, float | str] | None) -> Statement:
    """Return a problem for one objective, with further bounds on measures."""
    return problem.asking(
        problem.objectives[0] if objective is None else objective, bounds_of(problem, subject_to)
    )


def bounds_of(problem: Statement, worst: Mapping[str, float | str] | None) -> list[Constraint]:
    """Return constraints from the worst values that measures may have; errors as of `asking`."""
    bounds = []
    own = {measure.name: measure for measure in problem.objectives}
    for name, value in (worst or {}).items():
        measure = own[name] if name in own else measure_of(name, "subject_to")
        where = f"subject_to: {name}"
        bound = real(where, in_si(measure, value, where))
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


MOST = 20_000  # combinations


def by_combinations(
    problem: Statement,
    starts: int,
    seed: int,
    journal: Journal,
    progress: Progress | None,
    prune: bool = True,
) -> Optimum:
    """Return the best optimum of all combinations of discrete variables."""
    ways = [range(len(item.values)) for item in problem.discrete]
    count = int(np.prod([len(way) for way in ways]))
    if count > MOST:
        raise InputError(f"variables: expected at most {MOST} combinations, got {count}")
    sign = 1.0 if problem.objectives[0].better == "small" else -1.0
    told: dict[tuple[int, ...], Combination] = {}
    rows = [(problem.choosing(chosen), chosen) for chosen in product(*ways)]
    order = []
    for asked, chosen in rows:
        reason = _broken(asked) if prune else ""
        if reason:
            told[chosen] = Combination(tuple(asked.choice.values()), np.nan, True, reason)
        else:
            order.append((_bound(asked, problem.objectives[0]) if prune else -np.inf, asked, chosen))
    order.sort(key=lambda one: (one[0], one[2]))
    best: tuple[Local, Statement, tuple[int, ...]] | None = None
    attempts: list[Local] = []
    nearest: tuple[float, str] = (np.inf, "")
    for bound, asked, chosen in order:
        words = tuple(asked.choice.values())
        if best is not None and bound >= sign * best[0].value:
            least = amount(sign * bound, problem.objectives[0].unit)
            told[chosen] = Combination(words, np.nan, True, f"no better than {least}")
        else:
            tried = _tried(asked, starts, seed, journal, chosen)
            attempts += tried
            local = best_of(asked, tried)
            if local is None:
                least_missed = min(tried, key=lambda one: one.violation)
                reason = asked.evaluate(least_missed.design).reason(0)
                told[chosen] = Combination(words, np.nan, False, reason)
                nearest = min(nearest, (least_missed.violation, f"{', '.join(words)}: {reason}"))
            else:
                told[chosen] = Combination(words, local.value, False, "")
                if best is None or sign * local.value < sign * best[0].value:
                    best = local, asked, chosen
        if progress is not None:
            progress(len(told), count)
    if best is None:
        first = nearest[1] or next((f"{', '.join(one.values)}: {one.reason}" for one in told.values()), "")
        raise OptimisationError(
            f"none of {count} combinations of {', '.join(item.label for item in problem.discrete)} satisfies "
            f"all constraints; nearest {first}"
        )
    found = tuple(told[chosen] for _, chosen in rows)
    local, asked, _ = best
    evaluations = sum(one.evaluations for one in attempts)
    return Optimum(asked, local.design, "slsqp", int(seed), (), evaluations, found)


def _tried(
    asked: Statement, starts: int, seed: int, journal: Journal, chosen: tuple[int, ...]
) -> list[Local]:
    """Return what descents of one combination come to; the one design there is without other variables."""
    if not len(asked.variables):
        found = asked.evaluate(np.zeros((1, 0)))
        return [Local(found.designs[0], float(found.objectives[0, 0]), float(found.violation[0]), 1)]
    name = "combination-" + "-".join(map(str, chosen))
    begin = starts_of(asked, starts, seed)
    return [descent(journal, f"{name}-start-{k:03d}", asked, start) for k, start in enumerate(begin)]


def _bound(asked: Statement, measure: Any) -> float:
    """Return what a measure, by its sign, is at least over all designs of a combination."""
    inner = measure.measure if isinstance(measure, OverTasks) else measure
    if isinstance(inner, OfParts):
        return float(inner.values(_middle(asked))[0])
    if isinstance(inner, OfDrives) and inner.better == "small" and not getattr(measure, "mean", False):
        population = _middle(asked)
        return inner.least(population) if _same_way(asked) and population.feasible[0] else -np.inf
    return -np.inf


def _same_way(asked: Statement) -> bool:
    """Whether the sliders of all designs move alike."""
    return not any(name.startswith(("geometry.", "offset.")) for name in asked.variables.names)


def _middle(asked: Statement) -> Population:
    """Return a design of a combination, with the longest lead."""
    variables = asked.variables
    shares = [1.0 if name == LEAD else 0.5 for name in variables.names]
    return Population(asked.setting, variables.values(np.array(shares))[None])


def _broken(asked: Statement) -> str:
    """Return which constraint no design of a combination keeps, and why; empty if none is known."""
    for item in asked.constraints:
        if item.at_least:
            continue
        least = _bound(asked, item.measure)
        if least > item.bound + TOLERANCE * item.scale:
            return f"{item.name}: at least {amount(least, item.measure.unit)}, whatever the other variables"
    return ""
