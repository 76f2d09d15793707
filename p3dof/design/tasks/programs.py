"""Linear programs for the speed along a path: ṡ² and s̈ anywhere are linear in a few numbers of each step.

Forces are linear in both, but for friction; power and jerk are not. A jerk is (λ''' ṡ² + 3 λ'' s̈ + λ' ds̈/ds)
ṡ, so that its limit is one of something linear by a multiple of 1/√(ṡ²), which is convex: its tangent at a
known speed lies below it, and what keeps the limit of the tangent keeps the limit. The same is true of power.
Programs one after the other, each at the speeds of the one before, come to a motion that keeps all limits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.errors import TaskError
from p3dof.design.tasks.laws import PathLaw
from p3dof.design.tasks.limits import AxisLimits, Demand, Used, Way, used_of
from p3dof.machine.parameters import LEGS

_SLOW = 1e-6
"""Share of the largest ṡ² under which speeds count as this one where a limit is linearised."""
_FAR = 3.0
"""A limit of power that allows so many times the force limit is left out; the dense check would notice."""
_CREEP = 1e-4
"""ṡ² at which the machine hardly moves, but against all dry friction."""
_HARD = "the machine cannot move along the path within the limits, however slowly"


class Shape(NamedTuple):
    """ṡ², s̈ and ds̈/ds at points, by the unknowns of their steps: (P, m) each."""

    square: FloatArray
    change: FloatArray
    rise: FloatArray


class Points:
    """Points on a path, each in a step between two nodes, with what is needed there.

    Parameters
    ----------
    nodes : ndarray, shape (n + 1,)
        Parameters of the path, rising from 0.
    step : ndarray of int, shape (P,)
        In which step each is.
    share : ndarray, shape (P,)
        Where in it, from 0 to 1.
    way : Way
        What the path takes.
    """

    def __init__(self, nodes: FloatArray, step: NDArray[np.intp], share: FloatArray, way: Way) -> None:
        size = np.diff(nodes)
        self.step, self.share, self.size = step, share, size[step]
        self.place = nodes[step] + share * self.size
        self.moving = (self.place > nodes[0]) & (self.place < nodes[-1])
        self.end = float(nodes[-1])
        self.demand: Demand = way.demand(self.place, nodes[step] + self.size / 2)
        self._way = way

    @staticmethod
    def everywhere(nodes: FloatArray, shares: FloatArray, way: Way) -> Points:
        """Return points at the same shares (S,) of all steps."""
        count = len(nodes) - 1
        step = np.repeat(np.arange(count), len(shares))
        return Points(nodes, step, np.tile(shares, count), way)

    def friction(self, square: FloatArray) -> FloatArray:
        """Return what friction adds to the forces at ṡ² (P,), in (P, 3) [N]."""
        if not self._way.lossy:
            return np.zeros((len(square), 3))
        return self._way.friction(self.place, np.sqrt(square))

    def used(self, law: PathLaw, limits: AxisLimits) -> list[Used]:
        """Return what a law uses of every limit."""
        state = law.state(self.step, self.share)
        return used_of(self.demand, state, self.friction(state[0]), limits)

    def shares(self, law: PathLaw, limits: AxisLimits) -> FloatArray:
        """Return the largest share of any limit that a law uses at each point, (P,)."""
        found = [one.value / one.limit for one in self.used(law, limits)]
        return np.asarray(np.max(found, axis=(0, 2)))


@dataclass
class Rows:
    """Rows of a linear program: each a combination of the unknowns of one step, and its upper bound."""

    entries: list[FloatArray]
    bounds: list[FloatArray]
    steps: list[NDArray[np.intp]]

    def add(self, row: FloatArray, bound: FloatArray, step: NDArray[np.intp]) -> None:
        """Take rows (P, m) with bounds (P,) in steps (P,), but those of zeros and those without a bound."""
        kept = (np.abs(row).max(axis=1) > 0) & np.isfinite(bound)
        self.entries.append(row[kept])
        self.bounds.append(bound[kept])
        self.steps.append(step[kept])

    def scaled(self, columns: NDArray[np.intp], width: int) -> tuple[Any, FloatArray]:
        """Return a sparse matrix (R, width) and bounds (R,); each step's unknowns are in columns (n, m)."""
        from scipy.sparse import csr_matrix

        entries, bounds = np.concatenate(self.entries), np.concatenate(self.bounds)
        scale = np.abs(entries).max(axis=1)
        index = columns[np.concatenate(self.steps)]
        starts = np.arange(len(entries) + 1) * index.shape[1]
        matrix = csr_matrix(
            ((entries / scale[:, None]).ravel(), index.ravel(), starts), shape=(len(entries), width)
        )
        return matrix, bounds / scale


def rows_of(points: Points, shape: Shape, limits: AxisLimits, known: PathLaw | None) -> Rows:
    """Return the limits at points, with what is not linear taken at a known law.

    Parameters
    ----------
    points : Points
        Where.
    shape : Shape
        ṡ², s̈ and ds̈/ds there.
    limits : AxisLimits
        What may be asked for.
    known : PathLaw, optional
        What is near; without it there is neither friction, power nor jerk.

    Returns
    -------
    Rows
    """
    found, rows = points.demand, Rows([], [], [])
    bias, rest, near = found.bias, found.rest, None
    if known is not None:
        square = known.state(points.step, points.share)[0]
        near = np.maximum(square, _SLOW * square.max())
        slope, friction = _friction(points, near)
        bias, rest = bias + slope, rest + friction - slope * near[:, None]
    rows.add(-shape.square, np.zeros(len(points.share)), points.step)
    for leg in range(3):
        force = found.mass[:, leg, None] * shape.change + bias[:, leg, None] * shape.square
        own = found.rate[:, leg, None] * shape.change + found.change[:, leg, None] * shape.square
        nut, held = force - found.own[leg] * own, rest[:, leg] + found.balance[:, leg]
        for sign in (1.0, -1.0):
            rows.add(sign * force, limits.force[leg] - sign * rest[:, leg], points.step)
            rows.add(sign * nut, limits.nut_force[leg] - sign * held, points.step)
        speed = np.full(len(points.share), limits.speed[leg] ** 2)
        rows.add(found.rate[:, leg, None] ** 2 * shape.square, speed, points.step)
        if near is not None:
            _add_power(rows, points, (force, shape.square, rest[:, leg]), near, limits, leg)
            _add_jerk(rows, points, shape, near, limits, leg)
    return rows


def _friction(points: Points, near: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return by how much friction rises with ṡ² near a known one, and what it is there; none at rest."""
    low, high = 0.999 * near, 1.001 * near
    slope = (points.friction(high) - points.friction(low)) / (high - low)[:, None]
    return points.moving[:, None] * slope, points.moving[:, None] * points.friction(near)


def _add_power(
    rows: Rows,
    points: Points,
    force: tuple[FloatArray, FloatArray, FloatArray],
    near: FloatArray,
    limits: AxisLimits,
    leg: int,
) -> None:
    """Add sign(λ') f <= P / |λ' ṡ|, of which the right side is linearised."""
    row, square, rest = force
    rate = points.demand.rate[:, leg]
    with np.errstate(divide="ignore"):
        allowed = limits.power[leg] / (np.abs(rate) * np.sqrt(near))
    met = allowed < _FAR * limits.force[leg]
    allowed, sign = np.where(met, allowed, np.inf), np.sign(rate)
    with np.errstate(invalid="ignore"):
        whole = sign[:, None] * row + np.where(met, allowed / (2 * near), 0.0)[:, None] * square
    rows.add(whole, 1.5 * allowed - sign * rest, points.step)


def _add_jerk(
    rows: Rows, points: Points, shape: Shape, near: FloatArray, limits: AxisLimits, leg: int
) -> None:
    """Add |λ''' ṡ² + 3 λ'' s̈ + λ' ds̈/ds| <= J / ṡ, of which the right side is linearised."""
    if not np.isfinite(limits.jerk[leg]):
        return
    found = points.demand
    row = found.third[:, leg, None] * shape.square + 3 * found.change[:, leg, None] * shape.change
    row = row + found.rate[:, leg, None] * shape.rise
    allowed = limits.jerk[leg] / np.sqrt(near)
    tangent = (allowed / (2 * near))[:, None] * shape.square
    for sign in (1.0, -1.0):
        rows.add(sign * row + tangent, 1.5 * allowed, points.step)


def solved(
    cost: FloatArray,
    rows: Rows,
    columns: NDArray[np.intp],
    box: FloatArray,
    joints: Rows | None = None,
    unit: float = 1.0,
) -> FloatArray:
    """Return the unknowns of the least cost.

    Parameters
    ----------
    cost : ndarray, shape (U,)
        By each unknown.
    rows : Rows
        What must not be exceeded.
    columns : ndarray of int, shape (n, m)
        The unknowns of each step.
    box : ndarray, shape (U, 2)
        Least and largest of each unknown.
    joints : Rows, optional
        What must be met exactly.
    unit : float
        About how large the unknowns are: tolerances of the solver are absolute.

    Returns
    -------
    ndarray, shape (U,)

    Raises
    ------
    TaskError
        If there are none.
    """
    from scipy.optimize import linprog

    matrix, bounds = rows.scaled(columns, len(cost))
    equal, values = (None, None) if joints is None else joints.scaled(columns, len(cost))
    values = None if values is None else values / unit
    found: Any = linprog(
        cost, A_ub=matrix, b_ub=bounds / unit, A_eq=equal, b_eq=values, bounds=box / unit, method="highs"
    )
    if found.x is None:
        raise TaskError(_HARD)
    return np.asarray(unit * found.x)


def require_standing(points: Points, limits: AxisLimits) -> None:
    """Raise where the machine needs more than its limit to stand still, or to creep against friction."""
    rest = points.demand.rest
    creeping = rest + points.moving[:, None] * points.friction(np.full(len(rest), _CREEP))
    balance = points.demand.balance
    needs = (
        ("force", rest, limits.force, "stand still"),
        ("nut_force", rest + balance, limits.nut_force, "stand still"),
        ("force", creeping, limits.force, "move, friction included, however slowly,"),
        ("nut_force", creeping + balance, limits.nut_force, "move, friction included, however slowly,"),
    )
    for name, needed, most, what in needs:
        heavy = np.abs(needed) > most
        if heavy.any():
            at, leg = (int(k[0]) for k in np.nonzero(heavy))
            raise TaskError(
                f"{name}: {LEGS[leg]} needs {abs(needed[at, leg]):g} N to {what} "
                f"{points.place[at] / points.end:.0%} along the way, more than {most[leg]:g} N"
            )
