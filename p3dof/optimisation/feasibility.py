"""Whether any design keeps all constraints; if not, which exclude each other, and by how much at least.

The deletion filter leaves a constraint out and solves again: if there is still no design, it is not to blame.
What is left is irreducible: without any one of these, there is a design.

Reference
---------
J. W. Chinneck, Feasibility and Infeasibility in Optimization (Springer 2008), chapter 6.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from p3dof.checks import FloatArray
from p3dof.designs.status import DesignStatus
from p3dof.errors import OptimisationError
from p3dof.optimisation.constraints import Constraint, Linear, amount
from p3dof.optimisation.epigraph import Local, descend
from p3dof.optimisation.measure import Better, Pieces
from p3dof.optimisation.population import Population
from p3dof.optimisation.starts import starts_of
from p3dof.optimisation.statement import Statement
from p3dof.optimisation.variables import Variables

_MISSED, _ENOUGH, _STARTS = 1e-9, -1e-3, 4
_NEAR = 1e-3
"""Constraints that are missed by less than the worst, by this share of it, are left out at once."""
_ALIKE = 1e-6
_AT_BOUND = 1e-6
"""How near to its bound a variable is at it, as a share of its range."""


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
class Conflict:
    """Constraints that no design keeps together, though there are some for all but any one of them.

    Parameters
    ----------
    names : tuple of str
        Of the constraints; bounds of variables may be among them.
    amounts : tuple of float
        By how much each must give way at least, by itself, for a design to keep all constraints; where other
        conflicts forbid that, for a design to keep these [SI units].
    units : tuple of str
        Of the amounts.
    """

    names: tuple[str, ...]
    amounts: tuple[float, ...]
    units: tuple[str, ...]

    def __str__(self) -> str:
        missed = [amount(value, unit, 4) for value, unit in zip(self.amounts, self.units, strict=True)]
        if len(missed) == 1:
            return f"none keeps {self.names[0]}, which is missed by {missed[0]} at least"
        each = [f"{name} by {by}" for name, by in zip(self.names, missed, strict=True)]
        told = f"{', '.join(self.names[:-1])} and {self.names[-1]}"
        return f"none keeps {told} together: one must give way, {' or '.join(each)} at least"


def nearest_feasible(problem: Statement, starts: FloatArray) -> FloatArray:
    """Return a design that keeps all constraints.

    Parameters
    ----------
    problem : Statement
        What they are.
    starts : ndarray, shape (S, n)
        Where to begin [SI units].

    Returns
    -------
    ndarray, shape (n,)

    Raises
    ------
    OptimisationError
        If none was found: `conflicts` has the constraints that exclude each other, with the bounds of
        variables among them that do, and so does the message.
    """
    found = problem.evaluate(starts)
    able = found.status == DesignStatus.FEASIBLE
    if not able.any():
        raise OptimisationError(
            f"no design was found that makes the motion: {found.reason(0)}; change bounds of the variables"
        )
    search = _Search(problem, starts[able][:_STARTS])
    conflicts, left = [], problem.constraints
    while (nearest := search.nearest(left)).value >= _MISSED:
        core = search.irreducible(search.worst(left, nearest), ())
        conflicts.append(search.conflict(core, nearest.design))
        left = tuple(item for item in left if not any(item is other for other in core))
    if not conflicts:
        return nearest.design
    told = "; ".join(map(str, conflicts))
    raise OptimisationError(f"no design keeps all constraints: {told}", tuple(conflicts))


class _Search:
    """Designs that are nearest to keeping some constraints, each found once, from the same starts.

    Parameters
    ----------
    problem : Statement
        Its designs.
    starts : ndarray, shape (S, n)
        Which make the motion.
    """

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

    def conflict(self, core: tuple[Constraint, ...], nearest: FloatArray) -> Conflict:
        """Return what is to blame: constraints, and the bounds of variables without which they fit."""
        bounds = _bounds(self.problem.variables)
        free = self._without(bounds, nearest)
        if free.nearest(core).value < _MISSED:
            x = self.problem.variables.scaled(nearest)
            touched = np.stack([x < _AT_BOUND, x > 1 - _AT_BOUND], axis=1).ravel()
            near = tuple(bound for bound, there in zip(bounds, touched, strict=True) if there)
            some = near if free.nearest(core + near).value >= _MISSED else bounds
            core += free.irreducible(some, core)
        missed = []
        for item in core:
            others = tuple(other for other in self.problem.constraints if other is not item)
            search = self._without((item,), nearest)
            if search.nearest(others).value >= _MISSED:
                search, others = free, tuple(other for other in core if other is not item)
            missed.append(search.least(item, others))
        units = tuple(item.measure.unit for item in core)
        return Conflict(tuple(item.name for item in core), tuple(missed), units)

    def _without(self, items: tuple[Constraint, ...], nearest: FloatArray) -> _Search:
        """Return the same where those of some constraints that are bounds of variables are farther off."""
        bounds = [item for item in items if not any(item is own for own in self.problem.constraints)]
        if not bounds:
            return self
        wide = self.problem.asking()
        for bound in bounds:
            wide.variables = _farther(wide.variables, bound)
        return _Search(wide, np.concatenate([self.known, nearest[None]]))

    def least(self, item: Constraint, others: tuple[Constraint, ...]) -> float:
        """Return by how much a constraint is missed at least where others are kept [SI units]."""
        asked = self.problem.asking(Missing((item,)))
        asked.constraints = others
        begin = np.concatenate([self.nearest(others).design[None], starts_of(asked, _STARTS, 0)])
        return item.scale * _least(asked, begin).value


def _least(problem: Statement, begin: FloatArray) -> Local:
    """Return the best of descents from some designs: until two end alike, or nothing is missed."""
    found = problem.evaluate(begin)
    values = np.where(np.isnan(found.objectives[:, 0]), np.inf, found.objectives[:, 0])
    order = np.lexsort((values, found.violation))
    good = found.violation[order[0]] == 0
    best = Local(begin[order[0]], float(values[order[0]]) if good else np.inf, 0.0, 0)
    for start in begin[order[:_STARTS]]:
        if best.value < _MISSED:
            break
        local = descend(problem, start)
        if local.violation > 0 or not np.isfinite(local.value):
            continue
        alike = abs(local.value - best.value) <= _ALIKE * best.value
        best = local if local.value < best.value else best
        if alike and local.evaluations > 1:
            break
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
