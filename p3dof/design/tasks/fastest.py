"""The fastest way along a path: ṡ² by linear programs, guaranteed between the nodes by a dense check.

Between two nodes ṡ² is quadratic in s, so that ṡ² and s̈ anywhere are linear in its values at the nodes and in
the middle. Forces are linear in both but for friction, and power: these are linearised at the speeds of the
solution before, until the time does not change. A dense check finds where a limit is exceeded between the
points of the program: they become points of it too. What is left then, all is slowed down for.

References
----------
J. E. Bobrow, S. Dubowsky, J. S. Gibson, Int. J. Robotics Research 4 (1985) 3: the limits along the path.
D. Verscheure et al., IEEE Trans. Automatic Control 54 (2009) 2318: ṡ² as the unknown.

Linear programs for the speed along a path: ṡ² and s̈ anywhere are linear in a few numbers of each step.

Forces are linear in both, but for friction; power, jerk and a force that falls with the speed are not. A jerk
is (λ''' ṡ² + 3 λ'' s̈ + λ' ds̈/ds) ṡ, so that its limit is one of something linear by a multiple of 1/√(ṡ²),
which is convex: its tangent at a known speed lies below it, and what keeps the limit of the tangent keeps the
limit. The same is true of power, and of what falls with the speed, since √(ṡ²) is concave.
Programs one after the other, each at the speeds of the one before, come to a motion that keeps all limits.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.errors import TaskError
from p3dof.design.tasks.laws import PathLaw, SpeedLaw
from p3dof.design.tasks.limits import AxisLimits, Demand, Used, Way, used_of
from p3dof.machine.parameters import LEGS

_SLOW = 1e-6  # share of the largest ṡ² under which speeds count as this one where a limit is linearised
_FAR = 3.0  # a limit of power that allows so many times the force limit is left to the dense check
_CREEP = 1e-4  # ṡ² at which the machine hardly moves, but against all dry friction
_MOST_POINTS = 2**24
_HARD = "the machine cannot move along the path within the limits, however slowly"


class Shape(NamedTuple):
    """ṡ², s̈ and ds̈/ds at points, by the unknowns of their steps: (P, m) each."""

    square: FloatArray
    change: FloatArray
    rise: FloatArray


class Points:
    """Points on a path, each in a step between two nodes, with what is needed there."""

    def __init__(self, nodes: FloatArray, step: NDArray[np.intp], share: FloatArray, way: Way) -> None:
        size = np.diff(nodes)
        self.step, self.share, self.size = step, share, size[step]
        self.place = nodes[step] + share * self.size
        self.moving = (self.place > nodes[0]) & (self.place < nodes[-1])
        self.end = float(nodes[-1])
        found = way.demand(self.place, nodes[step] + self.size / 2)
        turns = np.abs(found.rate) <= np.abs(found.change) * self.size[:, None]
        self.demand: Demand = found._replace(turns=turns)
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
        return np.asarray(np.max([one.share for one in self.used(law, limits)], axis=(0, 2)))


class Rows:
    """Rows of a linear program: each a combination of the unknowns of one step, and its bounds."""

    def __init__(self) -> None:
        self._parts: list[tuple[FloatArray, FloatArray, FloatArray, NDArray[np.intp], NDArray[np.intp]]] = []

    def add(self, row: FloatArray, bound: FloatArray, step: NDArray[np.intp], least: float = -np.inf) -> None:
        """Take rows (P, m) with bounds (P,) in steps (P,), but those of zeros and those without a bound."""
        (kept,) = np.nonzero((np.abs(row).max(axis=1) > 0) & np.isfinite(bound))
        own, low = len(self._parts) * _MOST_POINTS + kept, np.full(len(kept), least)
        self._parts.append((row[kept], low, bound[kept], step[kept], own))

    def scaled(self) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.intp], NDArray[np.intp]]:
        """Return rows (R, m) whose largest entry is 1, their bounds and steps, and what tells them apart."""
        row, low, high, step, own = (np.concatenate(part) for part in zip(*self._parts, strict=True))
        scale = np.abs(row).max(axis=1)
        return row / scale[:, None], low / scale, high / scale, step, own


class Programs:
    """Linear programs one after the other: each begins at the basis of the one before."""

    def __init__(self) -> None:
        import highspy

        self._high: Any = highspy
        self._model = self._high.Highs()
        # The first and last steps are so short that the usual tolerance of 1e-7 is percents of a force there.
        options = {
            "output_flag": False,
            "threads": 1,
            "simplex_strategy": 4,
            "primal_feasibility_tolerance": 1e-10,
        }
        for name, value in options.items():
            self._model.setOptionValue(name, value)
        self._before: Any = None

    def solved(
        self, cost: FloatArray, rows: Rows, columns: NDArray[np.intp], box: FloatArray, unit: float = 1.0
    ) -> FloatArray:
        """Return the unknowns (U,) of the least cost; each step's are in columns (n, m)."""
        entries, low, high, step, own = rows.scaled()
        program = self._high.HighsLp()
        program.num_col_, program.num_row_ = len(cost), len(entries)
        program.col_cost_, (program.col_lower_, program.col_upper_) = cost, box.T / unit
        program.row_lower_, program.row_upper_ = low / unit, high / unit
        matrix = program.a_matrix_
        matrix.format_ = self._high.MatrixFormat.kRowwise
        matrix.start_ = np.arange(len(entries) + 1) * entries.shape[1]
        matrix.index_, matrix.value_ = columns[step].ravel(), entries.ravel()
        self._model.passModel(program)
        self._begin(own)
        self._model.run()
        if self._model.getModelStatus() != self._high.HighsModelStatus.kOptimal:
            self._before = None
            raise TaskError(_HARD)
        basis = self._model.getBasis()
        self._before = own, np.array(basis.row_status), basis.col_status
        return np.asarray(unit * np.array(self._model.getSolution().col_value))

    def _begin(self, own: NDArray[np.intp]) -> None:
        """Take the basis of the program before; rows that it had not are not at their bounds."""
        if self._before is None or own[-1] // _MOST_POINTS != self._before[0][-1] // _MOST_POINTS:
            return  # of other limits
        known, status, columns = self._before
        basis = self._high.HighsBasis()
        found = np.full(len(own), self._high.HighsBasisStatus.kBasic)
        _, here, there = np.intersect1d(own, known, assume_unique=True, return_indices=True)
        found[here] = status[there]
        basis.valid, basis.col_status, basis.row_status = True, columns, found.tolist()
        self._model.setBasis(basis)


def rows_of(points: Points, shape: Shape, limits: AxisLimits, known: PathLaw | None) -> Rows:
    """Return the limits at points, with what is not linear taken at a known law."""
    found, rows = points.demand, Rows()
    bias, rest, near = found.bias, found.rest, None
    if known is not None:
        square = known.state(points.step, points.share)[0]
        near = np.maximum(square, _SLOW * square.max())
        slope, friction = _friction(points, near)
        bias, rest = bias + slope, rest + friction - slope * near[:, None]
    inside = (points.share > 0) & (points.share < 1)  # at nodes ṡ² is an unknown, which has its own bound
    rows.add(-shape.square, np.where(inside, 0.0, np.inf), points.step)
    for leg in range(3):
        force = found.mass[:, leg, None] * shape.change + bias[:, leg, None] * shape.square
        own = found.rate[:, leg, None] * shape.change + found.change[:, leg, None] * shape.square
        nut, held = force - found.own[leg] * own, rest[:, leg] + found.balance[:, leg]
        motor = _at_motor(found, (force, own, rest[:, leg]), limits, leg)
        for row, still in motor:
            rows.add(row, limits.force[leg] - still, points.step)
        for sign in (1.0, -1.0):
            rows.add(sign * nut, limits.nut_force[leg] - sign * held, points.step)
        speed = np.where(points.share > 0, limits.speed[leg] ** 2, np.inf)  # where a step begins another ends
        rows.add(found.rate[:, leg, None] ** 2 * shape.square, speed, points.step)
        if near is not None:
            _add_power(rows, points, (*motor[0], shape.square), near, limits, leg)
            _add_curve(rows, points, motor, shape.square, near, limits, leg)
            _add_jerk(rows, points, shape, near, limits, leg)
    return rows


def _friction(points: Points, near: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return by how much friction rises with ṡ² near a known one, and what it is there; none at rest."""
    low, high = 0.999 * near, 1.001 * near
    slope = (points.friction(high) - points.friction(low)) / (high - low)[:, None]
    return points.moving[:, None] * slope, points.moving[:, None] * points.friction(near)


_Motor = list[tuple[FloatArray, FloatArray]]


def _at_motor(
    found: Demand, force: tuple[FloatArray, FloatArray, FloatArray], limits: AxisLimits, leg: int
) -> _Motor:
    """Return what the motor gives along the way and against it: rows (P, m) and what they have at rest (P,).

    Along the way it is n / η + J λ̈ or n η_b + J λ̈, whichever is larger, with the force n at the nut; against
    it, it is at most what it is without losses, which all together is convex. Where the slider turns round,
    both directions count.
    """
    row, own, rest = force
    way = np.where(found.rate[:, leg] < 0, -1.0, 1.0)
    row, rest = way[:, None] * row, way * rest
    passed = row - np.broadcast_to(found.turning, 3)[leg] * way[:, None] * own
    more = [1 / limits.efficiency[leg] - 1, limits.efficiency_back[leg] - 1]
    if not any(more):
        return [(row, rest), (-row, -rest)]
    along = [(row + share * passed, (1 + share) * rest) for share in more]
    turns = np.broadcast_to(found.turns, found.rate.shape)[:, leg]
    against = [(np.where(turns[:, None], -one, -row), np.where(turns, -still, -rest)) for one, still in along]
    return [*along, *against]


def _add_power(
    rows: Rows,
    points: Points,
    along: tuple[FloatArray, FloatArray, FloatArray],
    near: FloatArray,
    limits: AxisLimits,
    leg: int,
) -> None:
    """Add sign(λ') f + drag <= P / |λ' ṡ|, of which the right side is linearised."""
    row, rest, square = along
    rate = np.abs(points.demand.rate[:, leg])
    with np.errstate(divide="ignore"):
        allowed = limits.power[leg] / (rate * np.sqrt(near))
    met = allowed < _FAR * limits.force[leg]
    with np.errstate(invalid="ignore"):
        whole = row + np.where(met, allowed / (2 * near), 0.0)[:, None] * square
    rows.add(whole, np.where(met, 1.5 * allowed - rest - limits.drag[leg], np.inf), points.step)


def _add_curve(
    rows: Rows,
    points: Points,
    motor: _Motor,
    square: FloatArray,
    near: FloatArray,
    limits: AxisLimits,
    leg: int,
) -> None:
    """Add ±f <= F - k |λ' ṡ| for lines of the curve, of which the right side is linearised.

    The lines are those that are nowhere below the curve, and the one that it has at the known speed.
    """
    if limits.curve is None:
        return
    rate, (speeds, forces) = np.abs(points.demand.rate[:, leg]), limits.curve[leg].T
    falls = np.append(np.diff(forces) / np.diff(speeds), 0.0)
    own = np.searchsorted(speeds, rate * np.sqrt(near), "right") - 1
    above = forces - falls * speeds
    looked = np.append(speeds[speeds < limits.speed[leg]], limits.speed[leg])
    least = np.interp(looked, speeds, forces) * (1 - _CLOSE)
    for k, (at_rest, fall) in enumerate(zip(above, falls, strict=True)):
        everywhere = (at_rest + fall * looked >= least).all()
        pace = fall * rate / (2 * np.sqrt(near))
        bound = np.where((own == k) | everywhere, at_rest + pace * near, np.inf)
        for row, rest in motor:
            rows.add(row - pace[:, None] * square, bound - rest, points.step)


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


def require_standing(points: Points, limits: AxisLimits) -> None:
    """Raise where the machine needs more than its limit to stand still, or to creep against friction."""
    rest = points.demand.rest
    creeping = rest + points.moving[:, None] * points.friction(np.full(len(rest), _CREEP))
    lossy = np.where(creeping * points.demand.rate > 0, 1 / limits.efficiency, limits.efficiency_back)
    balance, force = points.demand.balance, limits.force_at(np.zeros(3))
    needs = (
        ("force", rest, force, "stand still"),
        ("nut_force", rest + balance, limits.nut_force, "stand still"),
        ("force", lossy * creeping, force, "move, friction included, however slowly,"),
        ("nut_force", creeping + balance, limits.nut_force, "move, friction included, however slowly,"),
    )
    for name, needed, most, what in needs:
        heavy = np.abs(needed) > most
        if heavy.any():
            at, leg = (int(k[0]) for k in np.nonzero(heavy))
            raise TaskError(
                f"{name}: {LEGS[leg]} needs {abs(needed[at, leg]):g} N to {what} "
                f"{points.place[at] / points.end:.0%} along the path, more than {most[leg]:g} N"
            )


_POINTS: FloatArray = np.array([0.0, 0.5, 1.0])  # where in every step limits are asked for, in shares of it
DENSE: FloatArray = np.linspace(0.0, 1.0, 33, dtype=np.float64)
"""Where in every step they are looked at, in shares of it."""
_ROUNDS, _SETTLED, _NEAR, EXCEEDED = 20, 1e-6, 1e-3, 5e-5
"""Most linear programs one after the other; shares by which their time may still change at the end, and when
more points are of use; and by which limits may be exceeded before all is slowed down."""
SLOWEST = 100.0
"""A path on which limits are kept only this many times more slowly is none that the machine can do."""
_CREEPING = 1e7  # how many times more slowly a motion may begin: power allows any force at a small speed
_USELESS, _STUCK = 0.7, 2
"""Share of what exceeded limits before, over which more points were of no use; and how often they may be."""
_CLOSE = 1e-9
_COARSE = 6


class _Slowable(PathLaw, Protocol):
    def slowed(self: _Law, factor: float) -> _Law: ...


_Law = TypeVar("_Law", bound=_Slowable)


def fastest_law(nodes: FloatArray, way: Way, limits: AxisLimits) -> SpeedLaw:
    """Return how a path is covered in the least time, from rest to rest, whatever the jerk."""
    curved = way.lossy or not limits.straight
    law = None
    if curved and len(nodes) > 20 * _COARSE:  # what is not linear is nearly known from fewer steps
        few = np.append(nodes[:-1:_COARSE], nodes[-1])
        law = _between(_programs(few, way, limits), nodes)
    dense = Points.everywhere(nodes, DENSE, way)
    return slowed(_programs(nodes, way, limits, law, dense), dense, limits)


def _programs(
    nodes: FloatArray, way: Way, limits: AxisLimits, law: SpeedLaw | None = None, dense: Points | None = None
) -> SpeedLaw:
    """Return a law by programs one after the other, with more points where a dense look finds an excess."""
    count, programs = len(nodes) - 1, Programs()
    curved = way.lossy or not limits.straight
    step, share = np.repeat(np.arange(count), len(_POINTS)), np.tile(_POINTS, count)
    points = Points(nodes, step, share, way)
    require_standing(points, limits)
    before, excess, stuck = np.inf if law is None else law.duration, np.inf, 0
    for _ in range(_ROUNDS):
        law = _next(programs, points, nodes, limits, law)
        moved, before = abs(law.duration - before), law.duration
        near = not curved or moved < _NEAR * before
        if dense is None:
            if near:
                break
            continue
        used = dense.shares(law, limits)
        left, excess = excess, float(used.max()) - 1
        settled = not curved or moved < _SETTLED * before
        stuck += excess > _USELESS * left
        if settled and (excess < EXCEEDED or stuck == _STUCK):
            break
        if near:
            step, share = with_worst(step, share, used)
            points = Points(nodes, step, share, way)
    assert law is not None  # noqa: S101 - for the type checker
    return law


def _next(
    programs: Programs, points: Points, nodes: FloatArray, limits: AxisLimits, law: SpeedLaw | None
) -> SpeedLaw:
    """Return the solution of a program at a known law, or at one so slow that it keeps the limits."""
    try:
        return _solved(programs, points, nodes, limits, law)
    except TaskError:
        if law is None:
            raise
    return _solved(programs, points, nodes, limits, slowed(law, points, limits, _CREEPING))


def with_worst(
    step: NDArray[np.intp], share: FloatArray, used: FloatArray
) -> tuple[NDArray[np.intp], FloatArray]:
    """Return points, with the worst one of each step in which a limit is exceeded."""
    worst = used.reshape(-1, len(DENSE))
    over = np.flatnonzero(worst.max(axis=1) > 1 + 0.1 * EXCEEDED)
    return np.append(step, over), np.append(share, DENSE[worst[over].argmax(axis=1)])


def slowed(law: _Law, dense: Points, limits: AxisLimits, slowest: float = SLOWEST) -> _Law:
    """Return a law, slowed down by as much as a dense check asks for."""
    from scipy.optimize import brentq

    def over(factor: float) -> float:
        return float(dense.shares(law.slowed(factor), limits).max()) - 1

    if over(1.0) <= 0:
        return law
    high = 1.0001
    while over(high) > 0:
        high = 1 + 2 * (high - 1)
        if high > slowest:
            raise TaskError("no motion within the limits was found: a larger force or power allows a motion")
    factor = brentq(over, 1.0, high, xtol=1e-12)
    while over(factor) > 0:
        factor *= 1 + _CLOSE
    return law.slowed(factor)


def _solved(
    programs: Programs, points: Points, nodes: FloatArray, limits: AxisLimits, known: SpeedLaw | None
) -> SpeedLaw:
    """Return the fastest law by one linear program, with what is not linear taken at a known one.

    Unknown are ṡ² at the nodes and by how much it bulges in the middle of each step.
    """
    count, size = len(nodes) - 1, np.diff(nodes)
    share, wide = points.share, points.size
    square = np.column_stack([1 - share, share, 4 * share * (1 - share)])
    change = np.column_stack([-1 / (2 * wide), 1 / (2 * wide), (2 - 4 * share) / wide])
    rise = np.column_stack([np.zeros_like(wide), np.zeros_like(wide), -4 / wide**2])
    rows = rows_of(points, Shape(square, change, rise), limits, known)
    free = np.full(count, np.inf)
    upper = np.full(count + 1, np.inf)
    upper[[0, -1]] = 0.0
    box = np.column_stack([np.append(np.zeros(count + 1), -free), np.append(upper, free)])
    gain = (np.append(size, 0) + np.append(0, size)) / 2
    cost = -np.append(gain, 2 / 3 * size) / nodes[-1]
    step = np.arange(count)
    unit = min(1.0, float(nodes[-1] if known is None else known.squares.max()))  # ṡ² grows as the way
    columns = np.column_stack([step, step + 1, count + 1 + step])
    found = programs.solved(cost, rows, columns, box, unit)
    squares, bulges = np.maximum(found[: count + 1], 0.0), found[count + 1 :]
    if not (squares[1:] + squares[:-1]).all():  # what is linearised far from here may allow no speed
        raise TaskError(_HARD)
    return SpeedLaw(nodes, squares, -4 * bulges / size**2)


def _between(law: SpeedLaw, nodes: FloatArray) -> SpeedLaw:
    """Return the same law with more nodes."""
    step = np.clip(np.searchsorted(law.nodes, nodes, "right") - 1, 0, len(law.slopes) - 1)
    squares = law.state(step, (nodes - law.nodes[step]) / np.diff(law.nodes)[step])[0]
    return SpeedLaw(nodes, squares, law.slopes[step[:-1]])
