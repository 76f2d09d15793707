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

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof.checks import FloatArray, frozen_array
from p3dof.errors import TaskError
from p3dof.parameters import LEGS
from p3dof.tasks.laws import SpeedLaw

_POINTS = (0.0, 0.5, 1.0)
"""Where in every step the limits are asked for, in shares of it."""
_DENSE: FloatArray = np.linspace(0.0, 1.0, 33, dtype=np.float64)
_ROUNDS, _FINER, _SETTLED, _EXCEEDED = 20, 4, 1e-6, 5e-5
"""Most linear programs one after the other, and most with more points; shares by which their time may still
change and limits be exceeded."""
_SLOWEST = 100.0
"""A path on which limits are kept only this many times more slowly is none that the machine can do."""
_CLOSE = 1e-9


@dataclass(frozen=True, eq=False)
class AxisLimits:
    """What each of the three actuators may be asked for.

    Parameters
    ----------
    force : array-like, shape () or (3,)
        Largest force of A, B, C [N], that on `reflected_mass` included.
    speed : array-like, shape () or (3,)
        Largest speed of the sliders [m/s].
    power : array-like, shape () or (3,)
        Largest power that each gives [W]; infinite by default.
    reflected_mass : array-like, shape () or (3,)
        What the turning parts of the drives add to each slider's mass [kg], see `p3dof.drives.Drive`.

    Raises
    ------
    TaskError
        If a number does not fit.
    """

    force: FloatArray
    speed: FloatArray
    power: FloatArray
    reflected_mass: FloatArray

    def __init__(
        self,
        force: ArrayLike,
        speed: ArrayLike,
        power: ArrayLike = np.inf,
        reflected_mass: ArrayLike = 0.0,
    ) -> None:
        given = {"force": force, "speed": speed, "power": power, "reflected_mass": reflected_mass}
        for name, value in given.items():
            array = np.asarray(value, dtype=float) if name == "power" else None
            endless = array is not None and array.shape in ((), (3,)) and np.isinf(array)
            finite = value if array is None else np.where(endless, 1.0, array)
            shape = (3,) if np.ndim(value) else ()
            numbers = np.broadcast_to(frozen_array(name, finite, shape, TaskError), 3).copy()
            least = "zero or more" if name == "reflected_mass" else "above zero"
            if (numbers < 0).any() or (name != "reflected_mass" and (numbers == 0).any()):
                raise TaskError(f"{name}: expected {least}, got {numbers.min():g}")
            if array is not None:
                numbers[np.broadcast_to(endless, 3)] = np.inf
            numbers.setflags(write=False)
            object.__setattr__(self, name, numbers)


class Demand(NamedTuple):
    """What a way takes of the actuators at points on it: f = mass s̈ + bias ṡ² + rest, without friction.

    Parameters
    ----------
    mass, bias, rest : ndarray, shape (P, 3)
        By s̈, by ṡ², and at rest.
    rate : ndarray, shape (P, 3)
        Slider speed by ṡ.
    """

    mass: FloatArray
    bias: FloatArray
    rest: FloatArray
    rate: FloatArray


class Way(Protocol):
    """What a path takes of the actuators."""

    @property
    def lossy(self) -> bool:
        """Whether there is friction."""

    def demand(self, place: FloatArray, middle: FloatArray) -> Demand:
        """Return what is needed at parameters (P,); each is in a step whose middle is given too, (P,)."""

    def friction(self, place: FloatArray, speed: FloatArray) -> FloatArray:
        """Return what friction adds to the forces, (P, 3) [N], at parameters and speeds ṡ (P,)."""


class _Points:
    """Points on a path, each in a step between two nodes, with what is needed there."""

    def __init__(self, nodes: FloatArray, step: NDArray[np.intp], share: FloatArray, way: Way) -> None:
        size = np.diff(nodes)
        self.step, self.share, self.size = step, share, size[step]
        self.place = nodes[step] + share * self.size
        self.first, self.last = nodes[0], nodes[-1]
        self.demand = way.demand(self.place, nodes[step] + self.size / 2)
        self._way = way

    def motion(self, law: SpeedLaw) -> tuple[FloatArray, FloatArray]:
        """Return ṡ² and s̈ of a law, (P,) each."""
        step, way = self.step, self.share * self.size
        square = law.squares[step] + way * (2 * law.starts[step] + law.slopes[step] * way)
        return np.maximum(square, 0.0), law.starts[step] + law.slopes[step] * way

    def friction(self, square: FloatArray) -> FloatArray:
        """Return what friction adds to the forces at ṡ² (P,), in (P, 3) [N]."""
        return (
            self._way.friction(self.place, np.sqrt(square)) if self._way.lossy else np.zeros((len(square), 3))
        )

    def shares(self, law: SpeedLaw, limits: AxisLimits) -> FloatArray:
        """Return the largest share of any limit that a law uses at each point, (P,)."""
        square, change = self.motion(law)
        found = self.demand
        force = (
            found.mass * change[:, None] + found.bias * square[:, None] + found.rest + self.friction(square)
        )
        speed = found.rate * np.sqrt(square)[:, None]
        used = [np.abs(force) / limits.force, np.abs(speed) / limits.speed, force * speed / limits.power]
        return np.asarray(np.max(used, axis=(0, 2)))


def fastest_law(nodes: FloatArray, way: Way, limits: AxisLimits) -> SpeedLaw:
    """Return how a path is covered in the least time, from rest to rest.

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
    count = len(nodes) - 1
    dense = _Points(nodes, np.repeat(np.arange(count), len(_DENSE)), np.tile(_DENSE, count), way)
    step, share = np.repeat(np.arange(count), len(_POINTS)), np.tile(_POINTS, count)
    curved = way.lossy or bool(np.isfinite(limits.power).any())
    law, before, finer = None, np.inf, 0
    for _ in range(_ROUNDS):
        law = _solved(nodes, _Points(nodes, step, share, way), limits, law)
        used = dense.shares(law, limits)
        settled = not curved or abs(law.duration - before) < _SETTLED * law.duration
        before = law.duration
        if settled and (used.max() < 1 + _EXCEEDED or finer == _FINER):
            break
        if settled:  # friction and power are known by now
            finer += 1
            worst = used.reshape(count, -1)
            over = np.flatnonzero(worst.max(axis=1) > 1 + 0.1 * _EXCEEDED)
            step = np.append(step, over)
            share = np.append(share, _DENSE[worst[over].argmax(axis=1)])
    assert law is not None  # noqa: S101 - for the type checker
    return _slowed(law, dense, limits)


def _slowed(law: SpeedLaw, dense: _Points, limits: AxisLimits) -> SpeedLaw:
    """Return the law, slowed down by as much as a dense check asks for."""
    from scipy.optimize import brentq

    def over(factor: float) -> float:
        return float(dense.shares(law.slowed(factor), limits).max()) - 1

    if over(1.0) <= 0:
        return law
    high = 1.0001
    while over(high) > 0:
        high = 1 + 2 * (high - 1)
        if high > _SLOWEST:
            raise TaskError("a limit is exceeded even very slowly: it leaves no room to move")
    factor = brentq(over, 1.0, high, xtol=1e-12)
    while over(factor) > 0:
        factor *= 1 + _CLOSE
    return law.slowed(factor)


def _solved(nodes: FloatArray, points: _Points, limits: AxisLimits, known: SpeedLaw | None) -> SpeedLaw:
    """Return the fastest law by one linear program, with what is not linear taken at a known one.

    Unknown are ṡ² at the nodes and by how much it bulges in the middle of each step.
    """
    from scipy.optimize import linprog
    from scipy.sparse import coo_matrix

    _require_standing(nodes, points, limits)
    count, size = len(nodes) - 1, np.diff(nodes)
    rows, bounds, row_steps = _rows(points, limits, known)
    scale = np.abs(rows).max(axis=1)
    columns = np.column_stack([row_steps, row_steps + 1, count + 1 + row_steps])
    lines = np.broadcast_to(np.arange(len(rows))[:, None], columns.shape)
    entries = (rows / scale[:, None]).ravel()
    matrix = coo_matrix((entries, (lines.ravel(), columns.ravel())), shape=(len(rows), 2 * count + 1)).tocsr()
    free = np.full(count, np.inf)
    upper = np.full(count + 1, np.inf)
    upper[[0, -1]] = 0.0
    box = np.column_stack([np.append(np.zeros(count + 1), -free), np.append(upper, free)])
    gain = (np.append(size, 0) + np.append(0, size)) / 2
    cost = -np.append(gain, 2 / 3 * size) / nodes[-1]
    found: Any = linprog(cost, A_ub=matrix, b_ub=bounds / scale, bounds=box, method="highs")
    if found.x is None:
        raise TaskError("the machine cannot move along the path within the limits, however slowly")
    squares, bulges = np.maximum(found.x[: count + 1], 0.0), found.x[count + 1 :]
    return SpeedLaw(nodes, squares, -4 * bulges / size**2)


def _rows(
    points: _Points, limits: AxisLimits, known: SpeedLaw | None
) -> tuple[FloatArray, FloatArray, NDArray[np.intp]]:
    """Return rows (R, 3) by ṡ² at both ends of a step and its bulge, their bounds (R,) and steps (R,)."""
    found, share, size = points.demand, points.share, points.size
    # Of ṡ² and s̈, by the three unknowns of the step: (P, 3).
    square = np.column_stack([1 - share, share, 4 * share * (1 - share)])
    change = np.column_stack([-1 / (2 * size), 1 / (2 * size), (2 - 4 * share) / size])
    bias, rest = found.bias, found.rest
    near = None if known is None else np.maximum(points.motion(known)[0], 1e-6 * known.squares.max())
    if near is not None:
        low, high = 0.999 * near, 1.001 * near
        moving = ((points.place > points.first) & (points.place < points.last))[
            :, None
        ]  # no friction at rest
        slope = moving * (points.friction(high) - points.friction(low)) / (high - low)[:, None]
        bias, rest = bias + slope, rest + moving * points.friction(near) - slope * near[:, None]
    rows, bounds = [-square], [np.zeros(len(share))]
    for leg in range(3):
        row = found.mass[:, leg, None] * change + bias[:, leg, None] * square
        for sign in (1.0, -1.0):
            rows.append(sign * row)
            bounds.append(limits.force[leg] - sign * rest[:, leg])
        rows.append(found.rate[:, leg, None] ** 2 * square)
        bounds.append(np.full(len(share), limits.speed[leg] ** 2))
        if near is not None and np.isfinite(limits.power[leg]):
            # sign(λ') f <= P / |λ' ṡ|, of which the right side is linearised.
            with np.errstate(divide="ignore"):
                allowed = limits.power[leg] / (np.abs(found.rate[:, leg]) * np.sqrt(near))
            allowed = np.minimum(allowed, 1e3 * limits.force[leg])
            sign_ = np.sign(found.rate[:, leg])
            rows.append(sign_[:, None] * row + (allowed / (2 * near))[:, None] * square)
            bounds.append(1.5 * allowed - sign_ * rest[:, leg])
    kept = [np.abs(row).max(axis=1) > 0 for row in rows]
    steps = [points.step[good] for good in kept]
    rows = [row[good] for row, good in zip(rows, kept, strict=True)]
    bounds = [bound[good] for bound, good in zip(bounds, kept, strict=True)]
    return np.concatenate(rows), np.concatenate(bounds), np.concatenate(steps)


def _require_standing(nodes: FloatArray, points: _Points, limits: AxisLimits) -> None:
    """Raise where the machine needs more than its limit to stand still."""
    heavy = np.abs(points.demand.rest) > limits.force
    if heavy.any():
        at, leg = (int(k[0]) for k in np.nonzero(heavy))
        raise TaskError(
            f"force: {LEGS[leg]} needs {abs(points.demand.rest[at, leg]):g} N to stand still "
            f"{points.place[at] / nodes[-1]:.0%} along the way, more than {limits.force[leg]:g} N"
        )
