"""Closing loops: a Newton homotopy that stays on its assembly, and Gauss-Newton as the fallback."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof.loops.closures import LoopKinematics, max_abs
from p3dof.loops.coordinates import rounding
from p3dof.loops.linear import least_norm, orientation
from p3dof.loops.targets import Residual

FIRST_STEP = 0.3
"""Largest first Newton step that is trusted [m or rad]."""
CONTRACTION = 0.25
"""A Newton step may be at most this fraction of the one before it."""
NEGLIGIBLE = 1e-9
"""After a Newton step this small, quadratic convergence leaves nothing but round-off [m or rad]."""
ON_THE_WAY = 1e-8
"""Newton step after which an intermediate point of a path is good enough [m or rad]."""
_SHORTEST = 2.0**-22
"""Smallest fraction of a path that is tried."""
_MOST = 2000
"""Newton steps after which a path is given up."""
_PATIENCE = 15
"""Steps of the fallback within which the residual must halve."""
FAR = 4.0
"""Residual that can only be a length [m]: where larger, steps of lengths are in shares of it."""
_MAX_STEP = 0.5
"""Largest step of the fallback [m or rad]."""


@dataclass(frozen=True, eq=False)
class Point:
    """Residual of closures and target at one configuration.

    Parameters
    ----------
    q : (nq,) array
        The configuration.
    r : (rows + size,) array
        Closure errors, then target errors [m, rad].
    J : (rows + size, nv) array
        Jacobian of `r`.
    rank_tolerance : float
        Relative rank tolerance for `J`.
    """

    q: FloatArray
    r: FloatArray
    J: FloatArray
    rank_tolerance: float

    @property
    def gap(self) -> float:
        """The largest entry of `r` [m or rad]."""
        return max_abs(self.r)

    def same_branch(self, other: Point) -> bool:
        """Whether the Jacobian keeps its orientation from here to a neighbouring solution.

        Two solutions that meet in a fold have Jacobians of opposite orientation, so a Newton step that jumps
        from one to the other, across targets out of reach, is found out. The determinant is that of the rows
        and columns which matter here: redundant closures and free motions have none.
        """
        return orientation(self.J, other.J, self.rank_tolerance) > 0

    def step_to(self, goal: FloatArray | float) -> FloatArray:
        """Return the shortest step (nv,) that brings `r` to `goal` to first order."""
        if not self.J.size:
            return np.zeros(self.J.shape[1])
        return least_norm(self.J, goal - self.r, self.rank_tolerance)


@dataclass(frozen=True, eq=False)
class Path:
    """Where an iteration ended.

    Parameters
    ----------
    point : Point
        The last good point.
    complete : bool
        Whether the residual was brought to zero.
    iterations : int
        Newton steps taken.
    moved : bool
        Whether it got anywhere at all.
    """

    point: Point
    complete: bool
    iterations: int
    moved: bool = True


class System:
    """Closures and target as one system of equations r(q) = 0.

    Parameters
    ----------
    kinematics : LoopKinematics
        The closures.
    target : Residual
        The target.
    """

    def __init__(self, kinematics: LoopKinematics, target: Residual) -> None:
        self.kinematics = kinematics
        self.target = target

    def at(self, q: FloatArray) -> Point:
        """Evaluate the system at a configuration (nq,)."""
        closures = self.kinematics.at(q)
        if not self.target.size:
            return Point(closures.q, closures.error, closures.J, closures.rank_tolerance)
        error, J = self.target.evaluate(q)
        r = np.concatenate((closures.error, error))
        return Point(closures.q, r, np.concatenate((closures.J, J)), closures.rank_tolerance)

    def yardsticks(self, r0: FloatArray) -> FloatArray:
        """Return what to measure steps (nv,) by: ones, and for lengths more where the target is far away.

        A slide that is told to go a hundred metres may do so in few steps; its limits are those of angles.
        """
        return np.where(self.kinematics.lengths, max(1.0, max_abs(r0) / FAR), 1.0)

    def moved(self, q: FloatArray, step: FloatArray) -> Point:
        """Evaluate the system at a configuration moved by a tangent step (nv,)."""
        return self.at(pin.integrate(self.kinematics.model, q, step))


def follow(system: System, q: FloatArray, tolerance: float) -> Path:
    """Drive the residual from its value r0 at `q` to zero along (1 - s) r0, never leaving the path.

    Each step of s is one predictor and a few Newton steps. It is taken when the predictor is small, every
    Newton step contracts and the Jacobian keeps its orientation; otherwise s takes half the step. The first
    attempt is the whole way, so a near start costs two or three iterations.

    Parameters
    ----------
    system : System
        What to solve.
    q : (nq,) array
        Start.
    tolerance : float
        Largest residual of a solution [m or rad].

    Returns
    -------
    Path
        Not complete if the path ends or turns back before s = 1, as at the border of reach.

    References
    ----------
    P. Deuflhard, Newton Methods for Nonlinear Problems, Springer 2011, section 5.1: natural continuation with
    a contraction test of 1/4.
    """
    point = system.at(q)
    r0 = point.r
    by = system.yardsticks(r0)
    s, step, count = 0.0, 1.0, 0
    while s < 1.0:
        end = min(s + step, 1.0)
        arrived, iterations = _correct(system, point, (1.0 - end) * r0, end == 1.0, tolerance, by)
        count += iterations
        if arrived is not None and point.same_branch(arrived):
            point, s, step = arrived, end, 2.0 * step
        elif step > _SHORTEST and count < _MOST:
            step = min(step, 1.0 - s) / 2.0
        else:
            return Path(point, False, count, s > 0.0)
    return Path(point, True, count)


def least_squares(system: System, q: FloatArray, tolerance: float) -> Path:
    """Minimise the residual by Gauss-Newton steps of bounded length with backtracking, from anywhere.

    Parameters
    ----------
    system : System
        What to solve.
    q : (nq,) array
        Start.
    tolerance : float
        Largest residual of a solution [m or rad].

    Returns
    -------
    Path
        Not complete if it ends in a minimum that is not zero.
    """
    point = system.at(q)
    by = system.yardsticks(point.r)
    count, size, history = 0, np.inf, [np.inf] * _PATIENCE
    while size > NEGLIGIBLE and point.gap < 0.5 * history[-_PATIENCE]:
        count += 1
        history.append(point.gap)
        step = point.step_to(0.0)
        size = max_abs(step / by)
        step *= min(1.0, _MAX_STEP / max(size, 1e-300))
        cost = point.r @ point.r
        for fraction in 0.5 ** np.arange(12):
            trial = system.moved(point.q, fraction * step)
            if trial.r @ trial.r < (1.0 - 1e-3 * fraction) * cost:
                point = trial
                break
        else:
            break
    return Path(point, point.gap <= max(tolerance, float(rounding(point.q[None])[0])), count)


def _correct(
    system: System, start: Point, goal: FloatArray, last: bool, tolerance: float, by: FloatArray
) -> tuple[Point | None, int]:
    """Newton's method for r = goal; None unless it contracts from the first step on."""
    enough, error = (NEGLIGIBLE, tolerance) if last else (ON_THE_WAY, max(ON_THE_WAY, tolerance))
    point, limit = start, FIRST_STEP
    for count in range(1, 11):
        step = point.step_to(goal)
        size = max_abs(step / by)
        if not size <= max(limit, enough):  # also when it is not a number
            return None, count
        point = system.moved(point.q, step)
        if size <= enough:
            error = max(error, float(rounding(point.q[None])[0]))
            return (point if max_abs(point.r - goal) <= error else None), count
        limit = CONTRACTION * size
    return None, count
