"""Assembling many samples at once: the homotopy of `p3dof.loops.solver`, in lock-step over arrays.

Every sample passes the same tests on its way: a bounded first Newton step, contraction of each further one,
and a Jacobian that keeps its orientation. Where closures and target determine every joint, as many rows of
their Jacobian as there are joints do for all, so that a Newton step is the solution of a square system; the
remaining rows follow, which is checked. A sample that fails a test is left out: it is for
`p3dof.loops.assembly` to decide.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof.loops.batch.closures import ClosureRows
from p3dof.loops.batch.kinematics import Frames, Pair, Samples, Sweep
from p3dof.loops.batch.linear import BoolArray, IndexArray, apply, independent_rows, inverse, largest
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.solver import CONTRACTION, FAR, FIRST_STEP, NEGLIGIBLE, ON_THE_WAY

_NEAR = 1e-2
"""Largest first Newton step from a configuration that is not assembled [m or rad]."""
_CUT = 0.25
"""Length to which a longer one is cut [m or rad]."""
_LAST = 1e-10
"""A Newton step behind which there is nothing to look at [m or rad]."""
_SPACINGS = (64, 8, 1)
"""Every how many samples are solved first, and then in between those."""
_SHORTEST = 2.0**-8
"""Smallest fraction of a path that is tried."""
_ROUNDS = 40
"""Steps along the path after which a sample is given up."""


class Goals(Protocol):
    """What the samples of a batch are driven to.

    Attributes
    ----------
    size : int
        Prescribed values of a sample.
    pairs : list of Pair
        Frames whose placement is prescribed; none for joints.
    rows : (n, nv) array
        Further rows of the Jacobian, the same everywhere.
    """

    size: int
    pairs: list[Pair]
    rows: FloatArray

    def error(self, q: FloatArray, frames: Frames, which: IndexArray) -> tuple[FloatArray, FloatArray | None]:
        """Return the errors (n, size) of some samples, and `last` of `RelativeRows.jacobian` for them."""

    def coordinates(self, which: IndexArray) -> FloatArray:
        """Return points (n, k) whose distances say how far the goals of some samples are apart."""


@dataclass(frozen=True, eq=False)
class Points:
    """Residual and Jacobian of closures and target at n configurations.

    Parameters
    ----------
    q : (n, nq) array
        The configurations.
    r : (n, rows + size) array
        Closure errors, then target errors [m, rad].
    J : (n, rows + size, nv) array
        Jacobian of `r`.
    K : (n, nv, nv) array
        Inverse of its chosen rows; NaN where it is singular.
    """

    q: FloatArray
    r: FloatArray
    J: FloatArray
    K: FloatArray

    def take(self, which: IndexArray | BoolArray) -> Points:
        """Return a copy of some points."""
        return Points(self.q[which], self.r[which], self.J[which], self.K[which])

    def put(self, which: IndexArray, points: Points) -> None:
        """Put others in the place of some points."""
        for mine, theirs in zip(vars(self).values(), vars(points).values(), strict=True):
            mine[which] = theirs


class BatchSystem:
    """Closures and targets of many samples as square systems of equations.

    Parameters
    ----------
    kinematics : LoopKinematics
        The closures.
    sweep : Sweep
        The model.
    goals : Goals
        The targets.
    """

    def __init__(self, kinematics: LoopKinematics, sweep: Sweep, goals: Goals) -> None:
        self.kinematics, self.sweep, self.goals = kinematics, sweep, goals
        self.closures = ClosureRows(kinematics, sweep, goals.pairs)
        self.chosen: IndexArray = np.arange(0)
        self.others: IndexArray = np.arange(0)

    def choose(self, q: FloatArray, rank: int) -> bool:
        """Choose the rows that make the system square, at a configuration where the closures have `rank`.

        Returns
        -------
        bool
            False if closures and target do not determine every joint there.
        """
        closures, nv = self.kinematics.size, self.sweep.model.nv
        samples = self.sweep.at(q[None])
        J = self.jacobian(q[None], samples, self.closures.frames(samples))[0]
        first = independent_rows(J[:closures], rank)
        rest = independent_rows(J, nv - rank, first)
        if len(first) + len(rest) < nv:
            return False
        self.chosen = np.concatenate((first, rest))
        self.others = np.setdiff1d(np.arange(len(J)), self.chosen)
        return True

    def jacobian(
        self, q: FloatArray, samples: Samples, frames: Frames, last: FloatArray | None = None
    ) -> FloatArray:
        """Return the Jacobian (n, rows + size, nv) at q (n, nq); `last` as for `RelativeRows`."""
        J = self.closures.jacobian(q, samples, frames, last)
        constant = self.goals.rows
        if not len(constant):
            return J
        return np.concatenate((J, np.broadcast_to(constant, (len(J), *constant.shape))), axis=1)

    def drift(self, q: FloatArray, samples: Samples, v: FloatArray) -> FloatArray:
        """Return the accelerations (n, rows + size) of closures and target at zero joint acceleration."""
        drift = self.closures.drift(q, samples, self.closures.frames(samples), v)
        return np.concatenate((drift, np.zeros((len(v), len(self.goals.rows)))), axis=1)

    def at(self, q: FloatArray, which: IndexArray, velocities: bool = False) -> Points:
        """Evaluate the samples `which` at configurations q (n, nq).

        With `velocities`, J is not that of the residual, but leads to the velocity of the target; both are
        the same where a target's rotation agrees in all its components.
        """
        samples = self.sweep.at(q)
        frames = self.closures.frames(samples)
        error, last = self.goals.error(q, frames, which)
        J = self.jacobian(q, samples, frames, None if velocities else last)
        r = np.concatenate((self.closures.errors(q, frames), error), axis=1)
        return Points(q, r, J, inverse(J[:, self.chosen]))

    def influence(self, K: FloatArray) -> FloatArray:
        """Return how fast every joint moves per unit speed of the target, (n, nv, size), from `Points.K`.

        A prescribed value whose row is not among the chosen ones follows from those, and has no influence.
        """
        result = np.zeros((*K.shape[:2], self.goals.size))
        of_target = self.chosen >= self.kinematics.size
        result[:, :, self.chosen[of_target] - self.kinematics.size] = K[:, :, of_target]
        return result

    @property
    def plain(self) -> bool:
        """Whether every joint is a plain coordinate."""
        return bool(self.sweep.model.nq == self.sweep.model.nv)

    def empty(self, count: int) -> Points:
        """Return points to be filled in."""
        model, rows = self.sweep.model, self.kinematics.size + self.goals.size
        shapes = (model.nq,), (rows,), (rows, model.nv), (model.nv, model.nv)
        return Points(*(np.full((count, *shape), np.nan) for shape in shapes))

    def moved(self, q: FloatArray, step: FloatArray) -> FloatArray:
        """Return configurations moved by tangent steps (n, nv)."""
        model = self.sweep.model
        if self.plain:
            return q + step
        return np.array([pin.integrate(model, *row) for row in zip(q, step, strict=True)]).reshape(q.shape)

    def step(self, points: Points, goal: FloatArray) -> FloatArray:
        """Return the steps (n, nv) that bring the chosen rows of `r` to `goal` to first order."""
        return apply(points.K, (goal - points.r)[:, self.chosen])

    def yardsticks(self, r0: FloatArray) -> FloatArray:
        """Return what to measure steps (n, nv) by; see `solver.System.yardsticks`."""
        return np.where(self.kinematics.lengths, np.maximum(1.0, largest(r0) / FAR)[:, None], 1.0)

    def same_branch(self, one: Points, other: Points) -> BoolArray:
        """Whether the Jacobian keeps its orientation between neighbouring solutions; see `solver.Point`.

        With J = C B, B the chosen rows and C = (1, D) all rows in terms of them, the determinant of other.J
        in the bases of one.J has the sign of det(B1) det(B2) det(C1ᵀ C2) = det(B1) det(B2) det(1 + D2 D1ᵀ).
        """
        signs = [np.linalg.slogdet(points.J[:, self.chosen])[0] for points in (one, other)]
        D1, D2 = (points.J[:, self.others] @ points.K for points in (one, other))
        shared = np.linalg.det(np.eye(len(self.others)) + D2 @ np.swapaxes(D1, -1, -2))
        return np.asarray(signs[0] * signs[1] * shared > 0)


def settle(system: BatchSystem, start: FloatArray, samples: IndexArray) -> tuple[FloatArray, BoolArray]:
    """Bring samples from one assembled configuration to their targets, without leaving the assembly.

    A few of the samples follow the path from the start. The others begin in between these, as if the samples
    were a motion; where that is far from the solution, they follow the path from the one whose target is
    nearest, else from the start.

    Parameters
    ----------
    system : BatchSystem
        What to solve.
    start : (nq,) array
        Where to start, assembled.
    samples : (n,) array of int
        Which samples.

    Returns
    -------
    q : (n, nq) array
        The last Newton step is taken without another look: the residuals are for the caller to check.
    arrived : (n,) array of bool
        False where a path ended or took too long.
    """
    count = len(samples)
    now = system.empty(count)
    arrived = np.zeros(count, dtype=bool)

    def keep(which: IndexArray, found: Points, good: BoolArray) -> IndexArray:
        now.put(which[good], found.take(good))
        arrived[which[good]] = True
        return which[~good]

    for spacing in _SPACINGS:
        known = np.flatnonzero(arrived)
        rest = np.setdiff1d(np.append(np.arange(0, count, spacing), count - 1), known)
        if len(known) >= 4 and system.plain:
            begin = system.at(_between(known, now.q[known], rest), samples[rest])
            found, good = _correct(system, begin, np.zeros_like(begin.r), samples[rest], near=True)
            post = now.take(known[np.abs(known - rest[:, None]).argmin(axis=1)])
            good &= (largest(found.q - post.q) <= FIRST_STEP) & system.same_branch(post, found)
            rest = keep(rest, found, good)
        if len(known) and len(rest):
            at, of = (system.goals.coordinates(samples[which]) for which in (known, rest))
            nearest = known[np.linalg.norm(at - of[:, None], axis=2).argmin(axis=1)]
            rest = keep(rest, *_follow(system, now.q[nearest], samples[rest]))
        if len(rest):
            begin_q = np.tile(start, (len(rest), 1))
            keep(rest, *_follow(system, begin_q, samples[rest]))
    return now.q, arrived


def _follow(system: BatchSystem, start: FloatArray, samples: IndexArray) -> tuple[Points, BoolArray]:
    """Follow the paths (1 - s) r0 from assembled configurations, never leaving them; see `solver.follow`."""
    count = len(samples)
    now = system.at(start, samples)
    r0 = now.r.copy()
    by = system.yardsticks(r0)
    s, step = np.zeros(count), np.ones(count)
    alive = np.isfinite(now.K).all(axis=(1, 2))
    for _ in range(_ROUNDS):
        active = np.flatnonzero(alive & (s < 1.0))
        if not len(active):
            break
        here, end = now.take(active), np.minimum(s + step, 1.0)[active]
        size = largest(system.step(here, (1.0 - end)[:, None] * r0[active]) / by[active])
        end = np.where(size > FIRST_STEP, s[active] + (end - s[active]) * _CUT / size, end)
        goal = (1.0 - end)[:, None] * r0[active]
        there, good = _correct(system, here, goal, samples[active], end == 1.0, by=by[active])
        good &= system.same_branch(here, there)
        taken, refused = active[good], active[~good]
        step[taken] = 2.0 * (end[good] - s[taken])
        s[taken] = end[good]
        now.put(taken, there.take(good))
        step[refused] = (end[~good] - s[refused]) / 2.0
        alive &= step > _SHORTEST
    return now, s == 1.0


def _correct(
    system: BatchSystem,
    here: Points,
    goal: FloatArray,
    samples: IndexArray,
    last: BoolArray | None = None,
    near: bool = False,
    by: FloatArray | float = 1.0,
) -> tuple[Points, BoolArray]:
    """Newton's method for r = goal; false unless it contracts from the first step on.

    A start that is not assembled must be `near`. All samples are at their `last` goal by default. Steps are
    measured `by` lengths and angles.
    """
    count = len(samples)
    limit = np.full(count, _NEAR if near else FIRST_STEP)
    last = np.ones(count, dtype=bool) if last is None else last
    enough = np.where(last, NEGLIGIBLE, ON_THE_WAY)
    by = np.broadcast_to(by, (count, system.sweep.model.nv))
    there, solved, todo = here.take(np.arange(count)), np.zeros(count, dtype=bool), np.arange(count)
    step = system.step(here, goal)
    for _ in range(10):
        size = largest(step / by[todo])
        good = size <= np.maximum(limit, enough[todo])
        todo, step, size = todo[good], step[good], size[good]
        points = system.at(system.moved(there.q[todo], step), samples[todo])
        step = system.step(points, goal[todo])
        next_size = largest(step / by[todo])
        done = (size <= enough[todo]) | (next_size <= _LAST)
        solved[todo[done]] = (next_size <= enough[todo])[done]
        there.put(todo, points)
        there.q[todo[done]] = system.moved(points.q[done], step[done])
        todo, step, limit = todo[~done], step[~done], CONTRACTION * size[~done]
        if not len(todo):
            break
    return there, solved


def _between(at: IndexArray, values: FloatArray, wanted: IndexArray) -> FloatArray:
    """Interpolate values (m, k) at indices `at` (m,), m >= 4, by the cubics through the four around."""
    first = np.clip(np.searchsorted(at, wanted) - 2, 0, len(at) - 4)
    around = first[:, None] + np.arange(4)
    x = at[around].astype(float)
    result = np.zeros((len(wanted), values.shape[1]))
    for i in range(4):
        others = [j for j in range(4) if j != i]
        weight = np.prod((wanted[:, None] - x[:, others]) / (x[:, [i]] - x[:, others]), axis=1)
        result += weight[:, None] * values[around[:, i]]
    return result
