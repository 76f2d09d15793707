"""The fastest way along a path: ṡ² by linear programs, guaranteed between the nodes by a dense check.

Between two nodes ṡ² is quadratic in s, so that ṡ² and s̈ anywhere are linear in its values at the nodes and in
the middle. Forces are linear in both but for friction, and power: these are linearised at the speeds of the
solution before, until the time does not change. A dense check finds where a limit is exceeded between the
points of the program: they become points of it too. What is left then, all is slowed down for.

References
----------
J. E. Bobrow, S. Dubowsky, J. S. Gibson, Int. J. Robotics Research 4 (1985) 3: the limits along the path.
D. Verscheure et al., IEEE Trans. Automatic Control 54 (2009) 2318: ṡ² as the unknown.
"""

from __future__ import annotations

from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.errors import TaskError
from p3dof.design.tasks.laws import PathLaw, SpeedLaw
from p3dof.design.tasks.limits import AxisLimits, Way
from p3dof.design.tasks.programs import Points, Shape, require_standing, rows_of, solved

_POINTS: FloatArray = np.array([0.0, 0.5, 1.0])
"""Where in every step the limits are asked for, in shares of it."""
DENSE: FloatArray = np.linspace(0.0, 1.0, 33, dtype=np.float64)
"""Where in every step they are looked at, in shares of it."""
_ROUNDS, _SETTLED, _NEAR, EXCEEDED = 20, 1e-6, 1e-3, 5e-5
"""Most linear programs one after the other; shares by which their time may still change at the end, and when
more points are of use; and by which limits may be exceeded before all is slowed down."""
SLOWEST = 100.0
"""A path on which limits are kept only this many times more slowly is none that the machine can do."""
_CREEPING = 1e7
"""How many times more slowly a motion may be begun with: power allows any force at a small speed."""
_USELESS, _STUCK = 0.7, 2
"""Share of what exceeded limits before, over which more points were of no use; and how often they may be."""
_CLOSE = 1e-9
_COARSE = 6


class _Slowable(PathLaw, Protocol):
    def slowed(self: _Law, factor: float) -> _Law: ...


_Law = TypeVar("_Law", bound=_Slowable)


def fastest_law(nodes: FloatArray, way: Way, limits: AxisLimits) -> SpeedLaw:
    """Return how a path is covered in the least time, from rest to rest, whatever the jerk.

    Parameters
    ----------
    nodes : ndarray, shape (n + 1,)
        Parameters of the path, rising from 0.
    way : Way
        What the path takes of the actuators.
    limits : AxisLimits
        What they may be asked for.

    Returns
    -------
    SpeedLaw

    Raises
    ------
    TaskError
        If the limits do not let the machine stand somewhere on the path, or move along it.
    """
    curved = way.lossy or bool(np.isfinite(limits.power).any())
    law = None
    if curved and len(nodes) > 20 * _COARSE:  # what is not linear is nearly known from fewer steps
        few = np.append(nodes[:-1:_COARSE], nodes[-1])
        law = _between(_programs(few, way, limits, None, rough=True), nodes)
    law = _programs(nodes, way, limits, law)
    return slowed(law, Points.everywhere(nodes, DENSE, way), limits)


def _programs(
    nodes: FloatArray, way: Way, limits: AxisLimits, law: SpeedLaw | None, rough: bool = False
) -> SpeedLaw:
    """Return a law by programs one after the other, with more points where it exceeds a limit."""
    count = len(nodes) - 1
    dense = Points.everywhere(nodes, DENSE, way)
    curved = way.lossy or bool(np.isfinite(limits.power).any())
    step, share = np.repeat(np.arange(count), len(_POINTS)), np.tile(_POINTS, count)
    points = Points(nodes, step, share, way)
    require_standing(points, limits)
    before, excess, stuck = np.inf if law is None else law.duration, np.inf, 0
    for _ in range(_ROUNDS):
        law = _next(points, nodes, limits, law)
        moved, before = abs(law.duration - before), law.duration
        near = not curved or moved < _NEAR * before
        if rough:
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


def _next(points: Points, nodes: FloatArray, limits: AxisLimits, law: SpeedLaw | None) -> SpeedLaw:
    """Return the solution of a program at a known law, or at one so slow that it keeps the limits."""
    try:
        return _solved(points, nodes, limits, law)
    except TaskError:
        if law is None:
            raise
    return _solved(points, nodes, limits, slowed(law, points, limits, _CREEPING))


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
            raise TaskError(
                "no motion within the limits was found: a larger force or power leaves room to move"
            )
    factor = brentq(over, 1.0, high, xtol=1e-12)
    while over(factor) > 0:
        factor *= 1 + _CLOSE
    return law.slowed(factor)


def _solved(points: Points, nodes: FloatArray, limits: AxisLimits, known: SpeedLaw | None) -> SpeedLaw:
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
    found = solved(cost, rows, np.column_stack([step, step + 1, count + 1 + step]), box, unit=unit)
    squares, bulges = np.maximum(found[: count + 1], 0.0), found[count + 1 :]
    return SpeedLaw(nodes, squares, -4 * bulges / size**2)


def _between(law: SpeedLaw, nodes: FloatArray) -> SpeedLaw:
    """Return the same law with more nodes."""
    step = np.clip(np.searchsorted(law.nodes, nodes, "right") - 1, 0, len(law.slopes) - 1)
    squares = law.state(step, (nodes - law.nodes[step]) / np.diff(law.nodes)[step])[0]
    return SpeedLaw(nodes, squares, law.slopes[step[:-1]])
