"""Pareto fronts: by the ε-constraint method, or by a genetic algorithm whose designs are then polished.

The ε-constraint method makes one objective as good as it can be while the others have bounds; every optimum
of it lies on the front. Polishing does the same from designs that a genetic algorithm found.

Reference
---------
Y. Haimes, L. Lasdon, D. Wismer, IEEE Trans. Systems, Man, Cybernetics 1 (1971) 296.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from p3dof._base.blocks import nondominated
from p3dof._base.checks import FloatArray, Progress, frozen_array, shown
from p3dof._base.errors import InputError, OptimisationError
from p3dof._base.tables import NONE, Cell, Table, Tabular, formatted
from p3dof.analysis.designs.columns import KINDS
from p3dof.design.optimisation.constraints import Constraint, Formula, Linear
from p3dof.design.optimisation.epigraph import Local
from p3dof.design.optimisation.evaluated import Evaluated
from p3dof.design.optimisation.evolution import Journal, genetic_front
from p3dof.design.optimisation.feasibility import nearest_feasible, starts_of
from p3dof.design.optimisation.minimising import STARTS, best_of, descent
from p3dof.design.optimisation.optimum import Check, Optimum, checked
from p3dof.design.optimisation.statement import Statement
from p3dof.machine.parameters import Parameters

_DIGITS = 9  # in which objectives of two designs must differ


@dataclass(frozen=True, eq=False, repr=False)
class Front(Tabular):
    """A Pareto front.

    Parameters
    ----------
    problem : Statement
        What was asked; two objectives or more.
    designs : ndarray, shape (K, n)
        Variables of designs that keep all constraints and do not dominate each other, by the second
        objective rising [SI units].
    unpolished : ndarray, shape (U, M)
        Objectives of what the genetic algorithm came to; empty where there was none.
    method : str
        How it was found.
    seed : int
        Of all random numbers.
    """

    _row_name = "design"

    problem: Statement
    designs: FloatArray
    unpolished: FloatArray
    method: str
    seed: int

    def __len__(self) -> int:
        return len(self.designs)

    def __repr__(self) -> str:
        names = ", ".join(measure.name for measure in self.problem.objectives)
        return f"Front({len(self)} designs by {names})"

    @cached_property
    def found(self) -> Evaluated:
        """Objectives and constraints of the designs."""
        return self.problem.evaluate(self.designs)

    @cached_property
    def start(self) -> Evaluated:
        """The same of the machine that there was."""
        return self.problem.evaluate(np.nan_to_num(self.problem.start, nan=0.0))

    @property
    def objectives(self) -> FloatArray:
        """Objectives of the designs, (K, M)."""
        return self.found.objectives

    def machine(self, index: int) -> Parameters:
        """Return one of the designs as a machine."""
        return self.problem.machine(self.designs[index])

    @cached_property
    def check(self) -> Check:
        """The design in the middle of the front, looked at again; see `Optimum.check`."""
        return checked(self.problem, self.designs[len(self) // 2])

    def hypervolume(self, reference: Any) -> float:
        """Return the size of what the front dominates, up to a reference point, in the product of the units.

        Parameters
        ----------
        reference : array-like, shape (M,)
            The worst values that count, in the units of the objectives.

        Raises
        ------
        InputError
            If the point has another shape.
        """
        signs = signs_of(self.problem)
        corner = signs * frozen_array("reference", reference, (len(signs),))
        return hypervolume(signs * self.objectives, corner)

    def to_columns(self) -> dict[str, NDArray[Any]]:
        """Return all designs with objectives and constraints, one a row; `p3dof designs` reads such a CSV."""
        return self.found.to_columns()


def signs_of(problem: Statement) -> FloatArray:
    """Return 1 for objectives that are to be small, -1 for others, (M,)."""
    return np.array([1.0 if measure.better == "small" else -1.0 for measure in problem.objectives])


def efficient(problem: Statement, designs: FloatArray) -> FloatArray:
    """Return the undominated designs that keep all constraints, by the second objective rising."""
    found = problem.evaluate(designs)
    costs = signs_of(problem) * found.objectives
    good = np.flatnonzero(found.feasible & np.isfinite(costs).all(axis=1))
    scales = np.maximum(np.abs(costs[good]).max(axis=0, initial=0.0), 1e-300)
    rounded = (costs[good] / scales).round(
        _DIGITS
    )  # optima of different starts are the same but for rounding
    _, first = np.unique(rounded, axis=0, return_index=True)
    good, rounded = good[first], rounded[first]
    good = good[nondominated(rounded)]
    return designs[good[np.argsort(found.objectives[good, 1], kind="stable")]]


def hypervolume(costs: FloatArray, corner: FloatArray) -> float:
    """Return the volume between costs that are to be small and a corner, slice by slice of the last one."""
    inside = costs[(costs < corner).all(axis=1)]
    if not len(inside):
        return 0.0
    if costs.shape[1] == 1:
        return float(corner[0] - inside.min())
    order = inside[np.argsort(inside[:, -1], kind="stable")]
    steps = np.append(order[1:, -1], corner[-1]) - order[:, -1]
    parts = [
        step * hypervolume(order[: index + 1, :-1], corner[:-1])
        for index, step in enumerate(steps)
        if step > 0
    ]
    return float(sum(parts))


def require_objectives(problem: Statement) -> None:
    """Raise `InputError` unless there are two objectives or more."""
    if len(problem.objectives) < 2:
        raise InputError("objectives: expected two or more for a Pareto front, got one")


FrontMethod: TypeAlias = Literal["epsilon", "nsga2", "nsga3"]  # how to look for a front

POINTS, POPULATION, GENERATIONS = 50, 100, 150


def require_front(
    problem: Statement, method: str, points: Any, population: Any, generations: Any, seed: Any
) -> None:
    """Raise `InputError` where an argument of `DesignProblem.pareto` does not fit the problem."""
    require_objectives(problem)
    _require(method, points, population, generations, seed)
    if method == "epsilon" and len(problem.objectives) != 2:
        raise InputError("method: 'epsilon' makes fronts of two objectives; take 'nsga3' for more")


def front_of(
    asked: Statement,
    method: FrontMethod,
    numbers: tuple[int, int, int],
    polish: bool,
    seed: int,
    journal: Journal,
    progress: Progress | None,
) -> Front:
    """Return a Pareto front; numbers of points, population, generations; what the journal has is taken."""
    points, population, generations = numbers
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
    """Return the optimum of one objective alone: one end of the front."""
    asked = problem.asking(measure)
    starts = np.concatenate([np.array(_nearest(asked, begin, STARTS)), begin[:1]])
    if not asked.evaluate(starts).feasible.any():
        starts = nearest_feasible(asked, starts)[None]  # raises if there is none
    local = _best(asked, list(starts), journal, name, every=True)
    if local is None:
        raise OptimisationError("no optimum was found, though there are feasible designs")
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


_ROWS = 12  # most designs in a table of a front
_COMBINATIONS = 20  # most combinations in a table


def optimum_tables(optimum: Optimum) -> list[Table]:
    """Return what changed against the machine that there was, what binds, and how it was checked."""
    changes, limits = _changes(optimum), _limits(optimum)
    asked = [changes, limits] if limits.rows else [replace(changes, note=limits.note)]
    found = [*asked, _checks(optimum)]
    found += [_bodies(optimum)] if optimum.problem.solids else []
    return [*found, *([_combinations(optimum)] if optimum.combinations else [])]


def _bodies(optimum: Optimum) -> Table:
    """Return which bodies are computed from solids, and which are kept as the machine has them."""
    rows: list[tuple[Cell, ...]] = []
    before, after = optimum.problem.setting.machine, optimum.machine
    for kind, links in KINDS.items():
        masses = [sum(getattr(each.bodies, link).mass for link in links) for each in (before, after)]
        told = "solid" if kind in optimum.problem.solids else "kept"
        rows.append((kind if len(links) == 1 else f"{kind}, all {len(links)}", told, *masses))
    note = "Bodies of one's own are kept; 'bodies: {platform: solids}' in the file replaces one."
    kept = len(optimum.problem.solids) < len(KINDS)
    return Table("Bodies", ("", "from", "machine [kg]", "optimum [kg]"), tuple(rows), note if kept else "")


def _combinations(optimum: Optimum) -> Table:
    """Return what came of combinations of discrete variables: the optimised ones first, by value."""
    measure = optimum.problem.objectives[0]
    sign = 1.0 if measure.better == "small" else -1.0
    order = sorted(
        optimum.combinations, key=lambda one: (one.pruned, np.nan_to_num(sign * one.value, nan=np.inf))
    )
    labels = [item.label for item in optimum.problem.discrete]
    name = f"{measure.name} [{measure.unit}]" if measure.unit else measure.name
    rows = tuple(
        (
            *one.values,
            _plain(one.value),
            one.reason or ("best" if k == 0 else "feasible, not the best"),
            "left out" if one.pruned else "optimised",
        )
        for k, one in enumerate(order[:_COMBINATIONS])
    )
    more = len(order) - len(rows)
    note = f"And {more} more." if more else ""
    return Table("Combinations", (*labels, name, "why", ""), rows, note, layout="wide")


def _changes(optimum: Optimum) -> Table:
    variables, start = optimum.problem.variables, optimum.problem.start
    rows: list[tuple[Cell, ...]] = []
    for index, (label, unit) in enumerate(zip(variables.labels, variables.units, strict=True)):
        rows.append(_row(f"{label} [{unit}]", start[index], optimum.design[index]))
    for index, measure in enumerate(optimum.problem.objectives):
        name = f"{measure.name} [{measure.unit}]" if measure.unit else measure.name
        rows.append(_row(name, optimum.start.objectives[0, index], optimum.found.objectives[0, index]))
    rows = [*((label, NONE, value, NONE) for label, value in optimum.problem.choice.items()), *rows]
    title = f"Optimum of {optimum.problem.objectives[0].name}"
    return Table(title, ("", "start", "optimum", "change"), tuple(rows))


def _limits(optimum: Optimum) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for index, item in enumerate(optimum.problem.constraints):
        margins = (optimum.start.margins[0, index], optimum.found.margins[0, index])
        binding = "binding" if item.name in optimum.binding else ""
        if item.measure.unit == "rad":
            margins = (float(np.degrees(margins[0])), float(np.degrees(margins[1])))
        unit = {"rad": "deg"}.get(item.measure.unit, item.measure.unit)
        name = (
            item.name if isinstance(item.measure, Linear | Formula) else item.name.removesuffix(unit).strip()
        )
        told = f"{name} [{unit}]" if unit else name
        rows.append((told, *(_plain(round(margin, 12) + 0.0) for margin in margins), binding))
    bounds = ", ".join(name for name in optimum.binding if name.endswith(" bound"))
    note = f"Besides: {bounds}." if bounds else ""
    if optimum.combinations:
        pruned = sum(one.pruned for one in optimum.combinations)
        note = (
            f"{note} {len(optimum.combinations)} combinations, {pruned} of them left out by bounds.".strip()
        )
    return Table("Margins", ("constraint", "start", "optimum", ""), tuple(rows), note)


def _checks(optimum: Optimum) -> Table:
    check, measure = optimum.check, optimum.problem.objectives[0]
    unit = f" [{measure.unit}]" if measure.unit else ""
    rows: tuple[tuple[Cell, ...], ...] = (
        (f"{measure.name} by the optimiser{unit}", optimum.value),
        (f"{measure.name} on a finer grid{unit}", float(check.finer.objectives[0, 0])),
        ("violation on a finer grid", check.reason or "none"),
        ("largest force by Pinocchio [N]", check.largest),
        ("largest difference of the two methods [N]", formatted(check.difference, ".2g")),
    )
    return Table("Checks", ("", "value"), rows)


def front_tables(front: Front) -> list[Table]:
    """Return the machine that there was, and some designs of the front from one end to the other."""
    problem = front.problem
    shown = np.unique(np.linspace(0, len(front) - 1, min(_ROWS, len(front))).round().astype(int))
    pairs = zip(problem.variables.labels, problem.variables.units, strict=True)
    header = [f"{label} [{unit}]" for label, unit in pairs]
    header += [f"{m.name} [{m.unit}]" if m.unit else m.name for m in problem.objectives]
    rows: list[tuple[Cell, ...]] = [("start", *_cells(problem.start, front.start.objectives[0]))]
    rows += [(str(k), *_cells(front.designs[k], front.objectives[k])) for k in shown]
    return [Table(f"Pareto front of {len(front)} designs", ("design", *header), tuple(rows), layout="wide")]


def _row(name: str, before: float, after: float) -> tuple[Cell, ...]:
    if not np.isfinite(before) or not before:
        return name, _plain(before), _plain(after), NONE
    return name, _plain(before), _plain(after), formatted((after - before) / abs(before), "+.2%")


def _plain(value: float) -> Cell:
    return float(value) if np.isfinite(value) else NONE


def _cells(design: FloatArray, objectives: FloatArray) -> list[Cell]:
    return [float(value) for value in (*design, *objectives)]
