"""Assembling many samples at once: the homotopy of `p3dof.loops.assembly`, in lock-step over arrays.

Every sample passes the same tests on its way: a bounded first Newton step, contraction of each further one,
and a Jacobian that keeps its orientation. Where closures and target determine every joint, as many rows of
their Jacobian as there are joints do for all, so that a Newton step is the solution of a square system; the
remaining rows follow, which is checked. A sample that fails a test is left out: it is for
`p3dof.loops.assembly` to decide.

`BatchAssembler` adds the motion of the whole tree: Pinocchio's kinematics sample by sample, all linear
algebra over arrays. It is meant for mechanisms whose target determines every joint; redundant closures are
welcome. Every sample is checked: closed loops, rank, conditioning, residuals. One that does not pass, and any
other mechanism, goes through the methods for single samples, which decide.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias, cast

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, Readable, as_floats, frozen_array
from p3dof._base.errors import AssemblyError, InputError, P3dofError
from p3dof.loops.assembly import (
    CONTRACTION,
    FAR,
    FIRST_STEP,
    NEGLIGIBLE,
    ON_THE_WAY,
    TOLERANCE,
    Assembly,
    FrameTarget,
    NoTarget,
    State,
    TargetLike,
    named_joints,
)
from p3dof.loops.batch.dynamics import redundant
from p3dof.loops.batch.kinematics import ClosureRows, Frames, Pair, Samples, Sweep
from p3dof.loops.closed_tree import ClosedTree
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.coordinates import ACCURACY, WELL, rotation_vector, rounding, turned_rates
from p3dof.loops.linear import (
    FEW,
    BoolArray,
    IndexArray,
    apply,
    blocks,
    independent_rows,
    inverse,
    largest,
    norms,
)

_NEAR = 1e-2  # largest first Newton step from a configuration that is not assembled [m or rad]
_CUT = 0.25  # length to which a longer one is cut [m or rad]
_LAST = 1e-10  # a Newton step behind which there is nothing to look at [m or rad]
_SPACINGS = (64, 8, 1)  # every how many samples are solved first, and then in between those
_SHORTEST = 2.0**-8  # smallest fraction of a path that is tried
_ROUNDS = 40  # steps along the path after which a sample is given up


@dataclass(frozen=True, eq=False)
class Points:
    """Residual and Jacobian of closures and target at n configurations."""

    q: FloatArray  # (n, nq): the configurations
    r: FloatArray  # (n, rows + size): closure errors, then target errors [m, rad]
    J: FloatArray  # (n, rows + size, nv): Jacobian of `r`
    K: FloatArray  # (n, nv, nv): inverse of its chosen rows; NaN where it is singular

    def take(self, which: IndexArray | BoolArray) -> Points:
        """Return a copy of some points."""
        return Points(self.q[which], self.r[which], self.J[which], self.K[which])

    def put(self, which: IndexArray, points: Points) -> None:
        """Put others in the place of some points."""
        for mine, theirs in zip(vars(self).values(), vars(points).values(), strict=True):
            mine[which] = theirs


class BatchSystem:
    """Closures and targets of many samples as square systems of equations."""

    def __init__(self, kinematics: LoopKinematics, sweep: Sweep, goals: Goals) -> None:
        self.kinematics, self.sweep, self.goals = kinematics, sweep, goals
        self.closures = ClosureRows(kinematics, sweep, goals.pairs)
        self.plain = bool(sweep.model.nq == sweep.model.nv)  # whether every joint is a plain coordinate
        self.chosen: IndexArray = np.arange(0)
        self.others: IndexArray = np.arange(0)

    def choose(self, q: FloatArray, rank: int) -> bool:
        """Choose rows for a square system where the closures have `rank`; false if joints stay open."""
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


@dataclass(frozen=True, eq=False)
class FrameTargets(Readable):
    """Chosen components of the placement of a frame, at N samples; see `FrameTarget`.

    Parameters
    ----------
    frame : str
        Name of the frame.
    positions : (N, 3) array
        Where its origin shall be, in the world [m].
    rotations : (N, 3, 3) array
        Its axes, as columns.
    mask : (6,) array of bool
        Which of x, y, z, rx, ry, rz are prescribed, the same at all samples.

    Raises
    ------
    InputError
        If the arrays do not fit, hold something that is not finite or no rotation, or the mask is not six
        bools with at least one true.
    """

    frame: str
    positions: FloatArray
    rotations: FloatArray
    mask: Sequence[bool] | NDArray[np.bool_] = (True,) * 6

    def __post_init__(self) -> None:
        positions = frozen_array("positions", self.positions, ("N", 3))
        rotations = frozen_array("rotations", self.rotations, (len(positions), 3, 3))
        wrong = np.abs(np.swapaxes(rotations, -1, -2) @ rotations - np.eye(3)).max(axis=(1, 2)) > 1e-9
        wrong |= np.linalg.det(rotations) < 0
        if wrong.any():
            raise InputError(f"rotations: number {int(np.argmax(wrong))} is not a rotation matrix")
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "rotations", rotations)
        object.__setattr__(self, "mask", FrameTarget(self.frame, pin.SE3.Identity(), self.mask).mask)

    def __len__(self) -> int:
        return len(self.positions)

    def __getitem__(self, i: int) -> FrameTarget:
        """Return the target of one sample."""
        return FrameTarget(self.frame, pin.SE3(self.rotations[i], self.positions[i]), self.mask)


BatchTarget: TypeAlias = FrameTargets | ArrayLike | Mapping[str, ArrayLike]
"""Placements of a frame, values of the actuated joints, or values of joints by name, at many samples."""


class FrameGoals:
    """`FrameTargets` in a model."""

    def __init__(self, kinematics: LoopKinematics, targets: FrameTargets) -> None:
        frame = kinematics.frame(targets.frame, "target", InputError)
        self._targets = targets
        self._mask = np.asarray(targets.mask)
        self._turns = bool(self._mask[3:].any())
        components = tuple(int(i) for i in np.flatnonzero(self._mask))
        ends = (0, pin.SE3.Identity(), frame.parentJoint, frame.placement.copy())
        self.pair = Pair(ends, components, at_first=False)

    def error_at(self, frames: Frames, which: IndexArray, pair: int) -> tuple[FloatArray, FloatArray]:
        """Return the errors (n, size), and the matrices (n, 1, 3, 3) from ω to the rate of the rotation's."""
        error = np.zeros((len(which), 6))
        error[:, :3] = frames.p2[:, pair] - self._targets.positions[which]
        rates: FloatArray = np.broadcast_to(np.eye(3), (len(which), 1, 3, 3))
        if self._turns:
            goal = np.swapaxes(self._targets.rotations[which], -1, -2)
            error[:, 3:] = rotation_vector(frames.R2[:, pair] @ goal)
            rates = turned_rates(error[:, 3:])[:, None]
        return error[:, self._mask], rates

    def coordinates(self, which: IndexArray) -> FloatArray:
        """Return the prescribed positions, and the axes if a rotation is prescribed, of some samples."""
        positions = self._targets.positions[which][:, self._mask[:3]]
        if not self._turns:
            return positions
        return np.concatenate((positions, self._targets.rotations[which].reshape(-1, 9)), axis=1)


@dataclass(frozen=True, eq=False)
class Targets:
    """What many samples are driven to, checked against a model: frames first, then joints."""

    frames: tuple[FrameTargets, ...]  # placements of frames
    joints: tuple[int, ...]  # ids of joints
    values: FloatArray  # (N, n): values of these joints [m or rad]; an angle for a continuous joint
    order: IndexArray  # (size,): of which prescribed value, as they were given, each component is

    def __len__(self) -> int:
        return len(self.values)

    def of_sample(self, i: int, model: pin.Model) -> list[FrameTarget | dict[str, float]]:
        """Return the targets of one sample, as `ClosedLoopModel.complete` takes them."""
        names = [str(model.names[joint]) for joint in self.joints]
        values = dict(zip(names, self.values[i].tolist(), strict=True))
        return [*(target[i] for target in self.frames), *([values] if values else [])]

    def given(self, components: FloatArray) -> FloatArray:
        """Return arrays (..., size) of components in the order in which these were given."""
        if np.array_equal(self.order, np.arange(len(self.order))):
            return components
        found = np.empty_like(components)
        found[..., self.order] = components
        return found


class Goals:
    """`Targets` in a model: placements of frames, then values of joints."""

    def __init__(self, kinematics: LoopKinematics, targets: Targets) -> None:
        model, joints = kinematics.model, targets.joints
        self._frames = [FrameGoals(kinematics, target) for target in targets.frames]
        self._values = targets.values
        self._q = np.array([model.idx_qs[j] for j in joints], dtype=int)
        self._circles = np.array([model.nqs[j] == 2 for j in joints], dtype=bool)
        self.pairs = [part.pair for part in self._frames]
        self.rows = np.eye(model.nv)[[model.idx_vs[j] for j in joints]]
        """Of the Jacobian, those of the joints."""
        self.size = sum(len(pair.components) for pair in self.pairs) + len(joints)

    def error(self, q: FloatArray, frames: Frames, which: IndexArray) -> tuple[FloatArray, FloatArray | None]:
        """Return the errors (n, size) of some samples, and `last` of `RelativeRows.jacobian` for them.

        That of a continuous joint, which is given an angle, is the shorter way round.
        """
        found = [part.error_at(frames, which, i - len(self._frames)) for i, part in enumerate(self._frames)]
        last = np.concatenate([rates for _, rates in found], axis=1) if found else None
        of_joints = q[:, self._q] - self._values[which]
        cosine, sine = self._q[self._circles], self._q[self._circles] + 1
        goal = self._values[which][:, self._circles]
        c, s = np.cos(goal), np.sin(goal)
        of_joints[:, self._circles] = np.arctan2(
            q[:, sine] * c - q[:, cosine] * s, q[:, cosine] * c + q[:, sine] * s
        )
        return np.concatenate([*(error for error, _ in found), of_joints], axis=1), last

    def coordinates(self, which: IndexArray) -> FloatArray:
        """Return points (n, k) whose distances say how far the goals of some samples are apart."""
        return np.concatenate(
            [*(part.coordinates(which) for part in self._frames), self._values[which]], axis=1
        )


def targets_of(
    target: BatchTarget | Sequence[BatchTarget],
    kinematics: LoopKinematics,
    actuated: Sequence[int],
    count: int,
) -> Targets:
    """Return targets of `count` samples, frames first; the number counts where none is given."""
    several = isinstance(target, list | tuple) and any(
        isinstance(part, FrameTargets | Mapping) for part in target
    )
    frames: list[FrameTargets] = []
    joints: list[int] = []
    columns: list[FloatArray] = []
    places: list[IndexArray] = []
    of_joints: list[IndexArray] = []
    size = 0
    for part in cast("Sequence[BatchTarget]", target if several else [target]):
        if isinstance(part, FrameTargets):
            kinematics.frame(part.frame, "target", InputError)
            frames.append(part)
            places.append(size + np.arange(np.count_nonzero(part.mask)))
            size += len(places[-1])
            continue
        ids, values = _joint_values(kinematics, actuated, part, count)
        joints += ids
        columns.append(values)
        of_joints.append(size + np.arange(len(ids)))
        size += len(ids)
    lengths = {len(part) for part in frames} | {len(part) for part in columns}
    if len(lengths) != 1:
        raise InputError(f"target: expected as many samples in all parts, got {sorted(lengths)}")
    values = np.concatenate([np.zeros((lengths.pop(), 0)), *columns], axis=1)
    order = np.concatenate([np.arange(0), *places, *of_joints])
    return Targets(tuple(frames), tuple(joints), values, order)


def _joint_values(
    kinematics: LoopKinematics,
    actuated: Sequence[int],
    target: ArrayLike | Mapping[str, ArrayLike],
    count: int,
) -> tuple[Sequence[int], FloatArray]:
    """Return ids of joints, and their values (N, n)."""
    if not isinstance(target, Mapping):
        return actuated, frozen_array("target", target, ("N", len(actuated)))
    ids, columns = named_joints(kinematics.model, target), []
    for name, value in target.items():
        array = as_floats(f"target {name}", value)
        array = np.broadcast_to(array, (count,)) if array.ndim == 0 else array
        columns.append(frozen_array(f"target {name}", array, ("N",)))
    if len({len(column) for column in columns}) > 1:
        raise InputError("target: expected as many samples of all joints")
    return ids, np.stack(columns, axis=1) if columns else np.zeros((count, 0))


@dataclass(frozen=True, eq=False)
class BatchStates(Readable):
    """Configurations that close the loops at their targets, moving; see `State`.

    Parameters
    ----------
    q : (N, nq) array
        Configurations; NaN in the rows of samples that failed.
    v, a : (N, nv) array
        Velocities and accelerations.
    influence : (N, nv, size) array
        How fast every joint moves per unit speed of the target: v = influence @ velocity; NaN where a sample
        failed.
    actuated_v : list of int
        Rows of `influence` of the actuated joints.
    same_assembly : (N,) array of bool
        As in `Assembly`.
    errors : dict of int to P3dofError
        What went wrong, by sample.
    """

    q: FloatArray
    v: FloatArray
    a: FloatArray
    influence: FloatArray
    actuated_v: list[int]
    same_assembly: BoolArray
    errors: dict[int, P3dofError]

    @property
    def inverse_jacobian(self) -> FloatArray:
        """How fast the actuated joints move per unit speed of the target, (N, n_actuated, size)."""
        return self.influence[:, self.actuated_v]

    def put(
        self, i: IndexArray | int, q: FloatArray, v: FloatArray, a: FloatArray, G: FloatArray, same: bool
    ) -> None:
        """Enter what was found of some samples, G being the influence."""
        self.q[i], self.v[i], self.a[i] = q, v, a
        self.influence[i], self.same_assembly[i] = G, same


class BatchAssembler:
    """Assembles one model at many samples."""

    def __init__(self, tree: ClosedTree) -> None:
        self._tree, self._kinematics, self._assembler = tree, tree.kinematics, tree.assembler
        self._sweep = Sweep(tree.model)

    def complete(
        self,
        target: Targets,
        motion: tuple[FloatArray, FloatArray],
        guess: FloatArray | None,
        near: FloatArray | None,
        stop: bool,
    ) -> BatchStates:
        """Find configurations, velocities and accelerations from the motion of a target."""
        model, count, goals = self._tree.model, len(motion[0]), Goals(self._kinematics, target)
        q, v, a = (np.full((count, size), np.nan) for size in (model.nq, model.nv, model.nv))
        G = np.full((count, model.nv, goals.size), np.nan)
        columns = list(self._tree.actuated_v)
        result = BatchStates(q, v, a, G, columns, np.zeros(count, dtype=bool), {})
        begin = self._start(goals, guess) if count >= FEW else None
        for block in blocks(count):
            if begin is not None:
                result.put(*self._moving(*begin, block, motion), same=True)
            for i in block[~result.same_assembly[block]]:
                known = _nearest(result.same_assembly, i)
                first = near if known is None else result.q[known]
                try:
                    goal = target.of_sample(int(i), model)
                    state = complete_near(self._tree, goal, motion[0][i], motion[1][i], first, guess)
                except P3dofError as error:
                    result.errors[int(i)] = error
                    if stop:
                        return result
                else:
                    result.put(i, state.q, state.v, state.a, state.influence, state.same_assembly)
        return result

    def _start(self, goals: Goals, guess: FloatArray | None) -> tuple[BatchSystem, Assembly] | None:
        """Return the square system and where all samples start; None if there is none."""
        system = BatchSystem(self._kinematics, self._sweep, goals)
        try:
            start = self._assembler.assemble(NoTarget(self._tree.model.nv), guess, TOLERANCE)
        except AssemblyError:
            return None
        usable = start.same_assembly and system.choose(start.q, start.rank)
        return (system, start) if usable else None

    def _moving(
        self, system: BatchSystem, start: Assembly, block: IndexArray, motion: tuple[FloatArray, FloatArray]
    ) -> tuple[IndexArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return the samples of a block that pass every test, their motions and influences."""
        velocity, acceleration = (values[block] for values in motion)
        with np.errstate(all="ignore"):  # what is not a number passes no test
            q, good = settle(system, start.q, block)
            points = system.at(q, block, velocities=True)
            good &= largest(points.r) <= np.maximum(TOLERANCE, rounding(q))
            J, K = points.J, points.K
            B = J[:, system.chosen]
            good &= norms(B) * norms(K) <= 1.0 / WELL
            good &= redundant(J[:, : self._kinematics.size], K[:, :, start.rank :], norms(B[:, start.rank :]))
            v, fits = _solution(system, J, K, np.zeros((len(q), self._kinematics.size)), velocity)
            good &= fits
            drift = system.drift(q, self._sweep.moving(q, v), v)
            closures, target = np.split(-drift, [self._kinematics.size], axis=1)
            a, fits = _solution(system, J, K, closures, acceleration + target)
            good &= fits
        return block[good], q[good], v[good], a[good], system.influence(K)[good]


class Completes(Protocol):
    """A robot that completes motions of a target."""

    def complete(
        self, target: TargetLike, velocity: ArrayLike, acceleration: ArrayLike, guess: ArrayLike | None = None
    ) -> State:
        """Return configuration, velocity and acceleration of the whole tree."""


def complete_near(
    robot: Completes,
    target: TargetLike,
    velocity: FloatArray,
    acceleration: FloatArray,
    near: FloatArray | None,
    guess: FloatArray | None = None,
) -> State:
    """Complete one state from a configuration nearby; where that leaves the assembly, from the guess."""
    if near is not None:
        try:
            state = robot.complete(target, velocity, acceleration, guess=near)
            if state.same_assembly:
                return state
        except AssemblyError:
            pass
    return robot.complete(target, velocity, acceleration, guess=guess)


def _solution(
    system: BatchSystem, J: FloatArray, K: FloatArray, closures: FloatArray, target: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Solve J x = b by the chosen rows; the flag says whether all others agree."""
    b = np.concatenate((closures, target), axis=1)
    x = apply(K, b[:, system.chosen])
    scale = np.maximum(np.maximum(1.0, largest(b)), largest(x))
    return x, largest(apply(J, x) - b) <= ACCURACY * scale


def _nearest(known: BoolArray, i: int) -> int | None:
    """Return the index nearest to i that is true, if there is one."""
    indices = np.flatnonzero(known)
    return int(indices[np.argmin(np.abs(indices - i))]) if len(indices) else None
