"""Whether any design keeps all constraints; if not, which exclude each other, and by how much at least.

The deletion filter leaves a constraint out and solves again: if there is still no design, it is not to blame.
What is left is irreducible: without any one of these, there is a design. Others may be irreducible as well,
and share some: they are found where one of the first is left out.

References
----------
J. W. Chinneck, Feasibility and Infeasibility in Optimization (Springer 2008), chapter 6.
R. Reiter, A theory of diagnosis from first principles, Artificial Intelligence 32 (1987) 57-95.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, Readable
from p3dof._base.errors import OptimisationError
from p3dof.analysis.designs.results import DesignStatus
from p3dof.design.optimisation.constraints import Constraint, Linear, amount
from p3dof.design.optimisation.epigraph import Local, descend
from p3dof.design.optimisation.evaluated import Variables
from p3dof.design.optimisation.population import Better, Pieces, Population
from p3dof.design.optimisation.statement import Statement

_POINTS, _FEW = 1024, 32  # designs to choose from; few where a measure takes long
_BEST = 8  # how many designs further ones are looked for around
_APART = 0.1  # least distance between starts, as a share of the ranges of the variables


def starts_of(problem: Statement, count: int, seed: int) -> FloatArray:
    """Return designs to begin with: the problem's own first, then the best of a Sobol sequence [SI units]."""
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


_MISSED, _ENOUGH, _STARTS = 1e-9, -1e-3, 4
_MOST = 3  # how many conflicts are looked for: each takes as long as the first
_NEAR = 1e-3  # constraints that are missed by less than the worst, by this share of it, are left out at once
_ALIKE = 1e-6
_FINER = range(7, 27)  # how near to an end better ones are looked for: ranges of the variables, halved
_AT_BOUND = 1e-6  # how near to its bound a variable is at it, as a share of its range


@dataclass(frozen=True)
class Missing:
    """What is missing at most of the constraints, as a share of their bounds: a measure to be made small.

    It ends where a little more than enough is there: steps that go on from there lead to no machine.
    """

    constraints: tuple[Constraint, ...]
    name: str = "violation"
    unit: str = ""
    better: Better = "small"
    figures: tuple[Any, ...] = ()

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,)."""
        parts = [-item.margin(item.measure.values(population)) / item.scale for item in self.constraints]
        return np.asarray(np.max([*parts, np.full(len(population), _ENOUGH)], axis=0))

    def pieces(self, population: Population) -> Pieces:
        """Return its pieces and their gradients."""
        found = [item.margins(population) for item in self.constraints]
        enough = np.full((len(population), 1), _ENOUGH)
        none = np.zeros((len(population), 1, len(population.setting.names)))
        return Pieces(
            np.concatenate([*(-each.values for each in found), enough], axis=1),
            lambda: np.concatenate([*(-each.gradients for each in found), none], axis=1),
        )


@dataclass(frozen=True)
class Conflict(Readable):
    """Constraints that no design keeps together, though there are some for all but any one of them."""

    names: tuple[str, ...]  # of the constraints; bounds of variables may be among them
    amounts: tuple[float, ...]
    """By how much each must give way at least, by itself, for a design to keep all constraints; where
    other conflicts forbid that, all but those that only these name [SI units]."""
    units: tuple[str, ...]  # of the amounts

    def __str__(self) -> str:
        missed = [amount(value, unit, 4) for value, unit in zip(self.amounts, self.units, strict=True)]
        if len(missed) == 1:
            return f"none satisfies {self.names[0]}, which is violated by {missed[0]} at least"
        each = [f"{name} by {by}" for name, by in zip(self.names, missed, strict=True)]
        told = f"{', '.join(self.names[:-1])} and {self.names[-1]}"
        return f"{told} conflict: one must be relaxed, {' or '.join(each)} at least"


def nearest_feasible(problem: Statement, starts: FloatArray) -> FloatArray:
    """Return a design that keeps all constraints; ndarray, shape (n,)."""
    found = problem.evaluate(starts)
    able = found.status == DesignStatus.FEASIBLE
    if not able.any():
        raise OptimisationError(
            f"no design was found that can perform the motion: {found.reason(0)}; change bounds of variables"
        )
    search = _ConflictSearch(problem, starts[able][:_STARTS])
    nearest = search.nearest(problem.constraints)
    if nearest.value < _MISSED:
        return nearest.design
    conflicts = _conflicts(search, nearest.design)
    if not conflicts:
        missed = search.worst(problem.constraints, nearest)[0].name
        raise OptimisationError(f"no feasible design was found; the nearest violates {missed}")
    told = "; ".join(map(str, conflicts)) + ("; there may be more" if len(conflicts) == _MOST else "")
    raise OptimisationError(f"no design satisfies all constraints: {told}", conflicts)


def _conflicts(search: _ConflictSearch, nearest: FloatArray) -> tuple[Conflict, ...]:
    """Return what excludes each other: one after the other is left out, until some design keeps what is left.

    What still excludes each other without one of a conflict is another conflict, which may share the others:
    Reiter's tree of hitting sets, in which a known conflict serves wherever nothing of it is left out.
    """
    cores: list[tuple[Constraint, ...]] = []
    waiting: list[tuple[Constraint, ...]] = [()]
    enough: list[set[str]] = []
    while waiting and len(cores) < _MOST:
        out = waiting.pop(0)
        names = {item.name for item in out}
        if any(less <= names for less in enough):
            continue
        core = next((core for core in cores if names.isdisjoint(item.name for item in core)), ())
        if not core:
            core = search.core(out, nearest)
            if not core:
                enough.append(names)
                continue
            cores.append(core)
        waiting += [(*out, item) for item in core]
    found = [search.conflict(core, cores, nearest) for core in cores]
    return tuple(conflict for conflict in found if conflict is not None)


class _ConflictSearch:
    """Designs that are nearest to keeping some constraints, each found once, from the same starts."""

    def __init__(self, problem: Statement, starts: FloatArray) -> None:
        self.problem, self.starts = problem, starts
        self._found: dict[tuple[int, ...], Local] = {}

    def nearest(self, items: Sequence[Constraint]) -> Local:
        """Return the design at which the worst miss is least; the first one that misses nothing will do."""
        key = tuple(map(id, items))
        if key not in self._found:
            self._found[key] = self._descend(tuple(items))
        return self._found[key]

    def _descend(self, items: tuple[Constraint, ...]) -> Local:
        if not items:
            return Local(self.starts[0], -np.inf, 0.0, 0)
        missing = self.problem.unconstrained(Missing(items))
        return _least(missing, np.concatenate([starts_of(missing, _STARTS, 0), self.known]))

    @property
    def known(self) -> FloatArray:
        """Where to begin: the starts, and the designs that keep some of the constraints."""
        good = [local.design for local in self._found.values() if local.value < _MISSED]
        return np.array([*self.starts, *good])

    def worst(self, items: tuple[Constraint, ...], nearest: Local) -> tuple[Constraint, ...]:
        """Return the constraints that are missed most at the nearest design, if they exclude each other."""
        values = [item.margin(item.measure.values(self._at(nearest.design)))[0] for item in items]
        shares = -np.array(values) / [item.scale for item in items]
        few = tuple(
            item for item, share in zip(items, shares, strict=True) if share >= (1 - _NEAR) * shares.max()
        )
        return few if len(few) < len(items) and self.nearest(few).value >= _MISSED else items

    def _at(self, design: FloatArray) -> Population:
        return Population(self.problem.setting, design[None])

    def irreducible(
        self, items: tuple[Constraint, ...], always: tuple[Constraint, ...]
    ) -> tuple[Constraint, ...]:
        """Return those of some constraints that cannot be left out for others to exclude each other."""
        kept = items
        for item in items:
            rest = tuple(other for other in kept if other is not item)
            if self.nearest(always + rest).value >= _MISSED:
                kept = rest
        return kept

    def core(self, out: tuple[Constraint, ...], nearest: FloatArray) -> tuple[Constraint, ...]:
        """Return what excludes each other, bounds too, where some is left out; empty if nothing does."""
        names = {item.name for item in out}
        items = tuple(item for item in self.problem.constraints if item.name not in names)
        search = self._without(out, nearest)
        local = search.nearest(items)
        if local.value < _MISSED:
            return ()
        core = search.irreducible(search.worst(items, local), ())
        bounds = _bounds(self.problem.variables)
        free = self._without(bounds, local.design)
        if free.nearest(core).value >= _MISSED:
            return core
        x = self.problem.variables.scaled(local.design)
        gaps = np.stack([x, 1 - x], axis=1).ravel()
        still = [(bound, gap) for bound, gap in zip(bounds, gaps, strict=True) if bound.name not in names]
        some = tuple(bound for bound, gap in still if gap < _AT_BOUND)
        if free.nearest(core + some).value < _MISSED:
            some = tuple(bound for bound, _ in still)
        return core + free.irreducible(some, core)

    def conflict(
        self, core: tuple[Constraint, ...], cores: Sequence[tuple[Constraint, ...]], nearest: FloatArray
    ) -> Conflict | None:
        """Return by how much each of a core must give way; None if it does not exclude itself after all."""
        own = {item.name for item in core}
        elsewhere = tuple(item for other in cores for item in other if item.name not in own)
        given, missed = self.problem.constraints, []
        for item in core:
            for out, kept in (
                ((item,), given),
                ((item, *elsewhere), given),
                ((*_bounds(self.problem.variables), item), core),
            ):
                names = {item.name} if kept is core else {other.name for other in out}
                others = tuple(other for other in kept if other.name not in names)
                search = self._without(out, nearest)
                if search.nearest(others).value < _MISSED:
                    break
            least = search.least(item, others)
            if least < _MISSED:
                return None
            missed.append(item.scale * least)
        units = tuple(item.measure.unit for item in core)
        return Conflict(tuple(item.name for item in core), tuple(missed), units)

    def _without(self, items: tuple[Constraint, ...], nearest: FloatArray) -> _ConflictSearch:
        """Return the same where those of some constraints that are bounds of variables are farther off."""
        bounds = [item for item in items if not any(item is own for own in self.problem.constraints)]
        if not bounds:
            return self
        wide = self.problem.asking()
        for bound in bounds:
            wide.variables = _farther(wide.variables, bound)
        return _ConflictSearch(wide, np.concatenate([self.known, nearest[None]]))

    def least(self, item: Constraint, others: tuple[Constraint, ...]) -> float:
        """Return by how much a constraint is missed at least where others are kept, by its scale."""
        asked = self.problem.asking(Missing((item,)))
        asked.constraints = others
        begin = np.concatenate([self.nearest(others).design[None], starts_of(asked, _STARTS, 0)])
        best = _least(asked, begin)
        finer = closer(asked, best.design[None], _FINER)[1]  # descents stop before what is no machine
        return float(min(best.value, np.nan_to_num(asked.evaluate(finer[None]).objectives[0, 0], nan=np.inf)))


def _least(problem: Statement, begin: FloatArray) -> Local:
    """Return the best of descents from some designs: until two end alike, or nothing is missed."""
    begin = closer(problem, begin)
    found = problem.evaluate(begin)
    values = np.where(np.isnan(found.objectives[:, 0]), np.inf, found.objectives[:, 0])
    order = np.lexsort((values, found.violation))
    good = found.violation[order[0]] == 0
    best = Local(begin[order[0]], float(values[order[0]]) if good else np.inf, 0.0, 0)
    ends: list[float] = []
    for start in begin[order[:_STARTS]]:
        if best.value < _MISSED:
            break
        local = descend(problem, start)
        if local.violation > 0 or not np.isfinite(local.value):
            continue
        best = local if local.value < best.value else best
        if any(abs(local.value - end) <= _ALIKE * end for end in ends):
            break
        ends.append(local.value)
    return best


def _bounds(variables: Variables) -> tuple[Constraint, ...]:
    """Return the bounds of variables as constraints, the lower and the upper one of each."""
    ends = zip(variables.names, variables.labels, variables.units, variables.low, variables.high, strict=True)
    sides: tuple[tuple[str, Better], ...] = (("≥", "large"), ("≤", "small"))
    return tuple(
        Constraint(
            Linear(f"the bound {label} {sign} {amount(end, unit)}", {name: 1.0}, 0.0, unit, better),
            float(end),
            at_least=better == "large",
        )
        for name, label, unit, *both in ends
        for end, (sign, better) in zip(both, sides, strict=True)
    )


def _farther(variables: Variables, bound: Constraint) -> Variables:
    """Return variables with one bound farther off by the range; it keeps its sign, as lengths do."""
    (name,) = bound.measure.coefficients  # type: ignore[attr-defined]  # of a bound of a variable
    index = variables.names.index(name)
    low, high = variables.low.copy(), variables.high.copy()
    end, span = bound.bound, variables.span[index]
    moved = end - span if bound.at_least else end + span
    (low if bound.at_least else high)[index] = moved if end * moved > 0 else end / 10
    return replace(variables, low=low, high=high)
