"""The algebra of reactions, over samples: equations (1) and (2) of `p3dof.loops.reactions`.

Wrenches are force, then moment. Those of closures act at the origin and in the axes of their `frame1`,
those of the tree's joints in the joints' own.

Which of all possible reactions is taken: the least squares (2) of `reactions`, or the least energy.

Reactions are stacked, 6 a joint; a change of them that rigid bodies leave open is a column.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.errors import ModelError
from p3dof.loops.closure_joints import ClosureJoint
from p3dof.loops.compliance import JointCompliance, factor
from p3dof.loops.coordinates import skew
from p3dof.loops.linear import RANK_TOLERANCE, apply, blocks, largest

Weighting: TypeAlias = Callable[[FloatArray], FloatArray]
"""Takes wrenches (N, 6 m, k) to rows whose squares are to be small."""


@dataclass(frozen=True, eq=False)
class Measure:
    """What is smallest where rigid bodies leave a choice: (2), or the complementary energy."""

    length: float  # what compares moments with forces in (2) [m]
    compliances: tuple[JointCompliance, ...] | None = None
    """Of all joints and closures: then their energy is smallest."""
    misfit: FloatArray | None = None
    """(n + c, 6): by how much each joint may be out of place when it is assembled [m, rad]."""

    @property
    def links(self) -> tuple[int, ...]:
        """Which joints have a link before them that gives way."""
        each = self.compliances or ()
        return tuple(i for i, one in enumerate(each) if one.before is not None)


def weighting(measure: Measure, turns: Mapping[int, FloatArray]) -> Weighting:
    """Return the weighting of a measure."""
    if measure.compliances is None:
        row = np.array([1.0] * 3 + [1.0 / measure.length] * 3)
        return lambda X: np.tile(row, X.shape[1] // 6)[:, None] * X
    own = np.array([factor(one.own) for one in measure.compliances])
    turned = {i: factor(_before(measure.compliances[i])) @ turn for i, turn in turns.items()}

    def rows(X: FloatArray) -> FloatArray:
        each = X.reshape(len(X), -1, 6, X.shape[-1])
        parts = [(own @ each).reshape(X.shape), *(S @ each[:, i] for i, S in turned.items())]
        return np.concatenate(parts, axis=1)

    return rows


def _before(one: JointCompliance) -> FloatArray:
    return np.zeros((6, 6)) if one.before is None else one.before


def steps_to_least(all_: FloatArray, change: FloatArray, coupled: bool) -> FloatArray:
    """Return how much of each open change (N, m, k) to take away, (N, k), for the least squares."""
    if change.shape[-1] == 0:
        return np.zeros((len(change), 0))
    if coupled:  # changes of couplings alone move nothing here, and stay out
        inverse = np.linalg.pinv(change, rcond=RANK_TOLERANCE)
        return apply(np.asarray(inverse, dtype=np.float64), all_)
    Q, R = _factored(change)
    return np.asarray(np.linalg.solve(R, np.swapaxes(Q, -1, -2) @ all_[..., None])[..., 0])


def _factored(change: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return Q and R of weighted changes, which must all count."""
    Q, R = np.linalg.qr(change)
    diagonal = np.abs(np.diagonal(R, axis1=-2, axis2=-1))
    if (diagonal <= RANK_TOLERANCE * diagonal.max(axis=-1, keepdims=True)).any():
        raise ModelError(
            "compliances: they leave loads open: in some way that loads can change, nothing gives way"
        )
    return Q, R


def fit_of(misfit: FloatArray, change: FloatArray, weighted: FloatArray) -> FloatArray:
    """Return what misfits within their tolerances add at worst, and at random, (2, N, m, 6)."""
    if change.shape[-1] == 0:
        return np.zeros((2, len(change), *misfit.shape))
    _, R = _factored(weighted)
    B = np.swapaxes(np.linalg.solve(np.swapaxes(R, -1, -2), np.swapaxes(change, -1, -2)), -1, -2)
    H = np.abs(B @ np.swapaxes(B, -1, -2))
    tolerance = misfit.ravel()
    both = np.stack([H @ tolerance, np.sqrt(H**2 @ tolerance**2)])
    return both.reshape(2, len(change), *misfit.shape)


IndexArray = NDArray[np.int_]


@dataclass(frozen=True, eq=False)
class Structure:
    """What is the same in all samples, for a robot with n joints, nv freedoms and c closures."""

    joints: tuple[ClosureJoint, ...]  # how each closure is built
    ends: Sequence[tuple[int, pin.SE3, int, pin.SE3]]
    """Joint and placement in its body of `frame1` of each closure, then of `frame2`."""
    signs: FloatArray
    """(c, n + 1): what part of a closure's wrench each joint bears: 1 or -1 on either branch, 0 elsewhere."""
    freedoms: IndexArray  # (nv,): the joint of each freedom
    along: NDArray[np.bool_]  # (k,): which couplings act along lengths
    size: float  # what compares moments with forces in (1) [m]
    parents: IndexArray  # (n + 1,): the parent of each joint
    measure: Measure  # what is smallest in (2)


@dataclass(frozen=True, eq=False)
class Loads:
    """States of motion and what they need, over N samples."""

    missing: FloatArray  # (N, nv): the right-hand side of (1)
    tree: FloatArray  # (N, n, 6): wrenches that the joints of the tree would transmit without the closures
    J: FloatArray  # (N, 6, nv): unit motion of each freedom as a twist at the world's origin
    R: FloatArray  # (N, n + 1, 3, 3): axes and origins of the joints in the world; joint 0 is the world
    p: FloatArray
    coupled: FloatArray  # (N, k, nv): rows of the couplings in the closures' Jacobian
    rank: IndexArray  # (N,): rank of the closures' Jacobian
    tolerance: FloatArray  # (N,): singular values below this share of the largest are zero
    scale: FloatArray  # (N,): largest of the given forces and of the centrifugal terms of bodies
    own: FloatArray
    """(N, c, 6): what the joints of closures exert themselves on their `frame2`, such as friction, at its
    origin in world axes; it is part of the loads already, and counted in the reactions."""

    def __len__(self) -> int:
        return len(self.missing)

    def rows(self, chosen: IndexArray) -> Loads:
        """Return some of the samples."""
        return Loads(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))


@dataclass(frozen=True, eq=False)
class Solved:
    """Wrenches of all joints and closures over N samples."""

    wrenches: FloatArray  # (N, n + c, 6): the reactions
    moves: FloatArray
    """(N, n + c, 2, 3): how much each component takes part in the open changes, which are orthonormal."""
    rotations: FloatArray  # (N, n + c, 3, 3): where they act
    positions: FloatArray
    rank: IndexArray  # (N,): rank of (1), and how many changes it leaves open
    undetermined: IndexArray
    residual: FloatArray  # (N,): error of (1), and the largest force in it
    scale: FloatArray
    fit: FloatArray  # (2, N, n + c, 6): what misfits add, at worst and at random; zero without any


def solve(structure: Structure, loads: Loads) -> Solved:
    """Return the reactions; samples whose equations have the same ranks are solved together."""
    count, bodies, closures = len(loads), loads.tree.shape[1], len(structure.ends)
    result = Solved(
        wrenches=np.empty((count, bodies + closures, 6)),
        moves=np.empty((count, bodies + closures, 2, 3)),
        rotations=np.empty((count, bodies + closures, 3, 3)),
        positions=np.empty((count, bodies + closures, 3)),
        rank=np.empty(count, dtype=int),
        undetermined=np.empty(count, dtype=int),
        residual=np.empty(count),
        scale=np.empty(count),
        fit=np.zeros((2, count, bodies + closures, 6)),
    )
    for block in blocks(count):
        place = _Places(structure, loads.rows(block))
        for alike in _groups(place.free_ranks()):
            _solve_alike(place.rows(alike), block[alike], result)
    return result


class _Places:
    """Closures and joints of some samples."""

    def __init__(self, structure: Structure, loads: Loads) -> None:
        self.structure, self.loads = structure, loads
        self.R1, self.p1 = self._frames(first=True)
        self.R2, self.p2 = self._frames(first=False)

    def _frames(self, first: bool) -> tuple[FloatArray, FloatArray]:
        """Return axes (N, c, 3, 3) and origins (N, c, 3) of one frame of each closure."""
        joints = [end[0] if first else end[2] for end in self.structure.ends]
        placements = [end[1] if first else end[3] for end in self.structure.ends]
        R, p = self.loads.R[:, joints], self.loads.p[:, joints]
        turn = np.array([M.rotation for M in placements]).reshape(-1, 3, 3)
        shift = np.array([M.translation for M in placements]).reshape(-1, 3)
        return R @ turn, p + apply(R, shift)

    def rows(self, chosen: IndexArray) -> _Places:
        """Return some of the samples."""
        return _Places(self.structure, self.loads.rows(chosen))

    def weighted(self, alike: IndexArray) -> Weighting:
        """Return what takes wrenches (N, 6 m, k) of some samples to rows whose squares are to be small."""
        measure = self.structure.measure
        turns = {i: self._to_predecessor(i)[alike] for i in measure.links}
        return weighting(measure, turns)

    def _to_predecessor(self, i: int) -> FloatArray:
        """Return what takes a joint's wrench to the axes of the body before it, (N, 6, 6)."""
        turn = np.zeros((len(self.loads), 6, 6))
        bodies = self.loads.tree.shape[1]
        if i < bodies:
            parent = self.structure.parents[i + 1]
            turn[:, :3, :3] = np.swapaxes(self.loads.R[:, parent], -1, -2) @ self.loads.R[:, i + 1]
        else:
            turn[:, :3, :3] = np.eye(3)
        turn[:, 3:, 3:] = turn[:, :3, :3]
        return turn

    def own(self) -> FloatArray:
        """Return what the joints of closures exert themselves, as their wrenches are given, (N, 6 c)."""
        force, moment = self.loads.own[..., :3], self.loads.own[..., 3:]
        moment = moment + np.cross(self.p2 - self.p1, force)
        turned = [apply(np.swapaxes(self.R1, -1, -2), part) for part in (force, moment)]
        return np.concatenate(turned, axis=-1).reshape(len(self.loads), -1)

    def free(self, c: int) -> tuple[FloatArray, FloatArray]:
        """Return singular values and right singular vectors of a closure's free axes, in those of frame 1."""
        joint, count = self.structure.joints[c], len(self.loads)
        R12 = np.swapaxes(self.R1[:, c], -1, -2) @ self.R2[:, c]
        first = np.broadcast_to(np.array(joint.axes1).reshape(-1, 3), (count, len(joint.axes1), 3))
        second = np.array(joint.axes2).reshape(-1, 3) @ np.swapaxes(R12, -1, -2)
        _, s, Vt = np.linalg.svd(np.concatenate([first, second], axis=1))
        return s, Vt

    def free_ranks(self) -> IndexArray:
        """Return how many independent free axes each closure has, (N, c)."""
        ranks = np.zeros((len(self.loads), len(self.structure.ends)), dtype=int)
        for c in range(ranks.shape[1]):
            s, _ = self.free(c)
            ranks[:, c] = _ranks(s, np.full(len(s), RANK_TOLERANCE))
        return ranks

    def transmitted(self) -> tuple[FloatArray, FloatArray]:
        """Return bases E of what closures and couplings transmit, and which columns are forces."""
        count, closures = len(self.loads), len(self.structure.ends)
        columns: list[FloatArray] = [np.zeros((count, 6 * closures, 0))]
        forces: list[FloatArray] = [np.zeros(0)]
        for c in range(closures):
            s, Vt = self.free(c)
            rank = int(_ranks(s[:1], np.array([RANK_TOLERANCE]))[0])
            moments = np.swapaxes(Vt[:, rank:], -1, -2)
            d = apply(np.swapaxes(self.R1[:, c], -1, -2), self.p2[:, c] - self.p1[:, c])
            along = self.structure.joints[c].forces(d)
            k = along.shape[-1]
            block = np.zeros((count, 6 * closures, k + moments.shape[-1]))
            block[:, 6 * c : 6 * c + 3, :k], block[:, 6 * c + 3 : 6 * c + 6, k:] = along, moments
            columns.append(block)
            forces.append(np.array([1.0] * k + [0.0] * moments.shape[-1]))
        E, coupled = np.concatenate(columns, axis=-1), self.structure.along
        if not len(coupled):
            return E, np.concatenate(forces)
        both = np.zeros((count, E.shape[1] + len(coupled), E.shape[2] + len(coupled)))
        both[:, : E.shape[1], : E.shape[2]] = E
        both[:, E.shape[1] :, E.shape[2] :] = np.eye(len(coupled))
        return both, np.concatenate([*forces, coupled])

    def jacobian_transposed(self) -> FloatArray:
        """Return Jᵀ (N, nv, 6 c + k) of whole wrenches, then of couplings."""
        J, signs = self.loads.J, self.structure.signs[:, self.structure.freedoms]
        parts: list[FloatArray] = [np.zeros((len(J), J.shape[-1], 0))]
        for c in range(len(signs)):
            dual = _dual(self.R1[:, c], self.p1[:, c])
            parts.append(-np.swapaxes(signs[c] * J, -1, -2) @ dual)
        parts.append(np.swapaxes(self.loads.coupled, -1, -2))
        return np.concatenate(parts, axis=-1)

    def to_joints(self) -> FloatArray:
        """Return what unit wrenches of closures add to each joint (N, 6 n, 6 c + k); couplings nothing."""
        bodies, closures = self.loads.tree.shape[1], len(self.structure.ends)
        T = np.zeros((len(self.loads), 6 * bodies, 6 * closures + len(self.structure.along)))
        for c, i in np.argwhere(self.structure.signs[:, 1:]):
            axes = np.swapaxes(self.loads.R[:, i + 1], -1, -2)
            apart = apply(axes, self.p1[:, c] - self.loads.p[:, i + 1])
            block = self.structure.signs[c, i + 1] * _dual(axes @ self.R1[:, c], apart)
            T[:, 6 * i : 6 * i + 6, 6 * c : 6 * c + 6] = block
        return T


def _solve_alike(place: _Places, where: IndexArray, result: Solved) -> None:
    """Solve samples whose closures transmit alike, and enter them into a result."""
    structure, loads = place.structure, place.loads
    wrenched = 6 * len(structure.ends)
    A, T, own = place.jacobian_transposed(), place.to_joints(), place.own()
    E, is_force = place.transmitted()
    E = E * np.where(is_force > 0, 1.0, structure.size)
    turns = np.linalg.norm(loads.J[:, 3:], axis=1) > 0
    row = np.where(turns, 1.0 / structure.size, 1.0)
    U, s, Vt = np.linalg.svd(row[..., None] * (A @ E))
    ranks = _ranks(s, loads.tolerance)
    for alike in _groups(ranks[:, None]):
        r, open_ = int(ranks[alike[0]]), Vt[alike, int(ranks[alike[0]]) :]
        b = apply(np.swapaxes(U[alike, :, :r], -1, -2), row[alike] * loads.missing[alike])
        some = apply(E[alike] @ np.swapaxes(Vt[alike, :r], -1, -2), b / s[alike, :r])
        null = E[alike] @ np.swapaxes(open_, -1, -2)
        tree = loads.tree[alike].reshape(len(alike), -1)
        change = np.concatenate([T[alike] @ null, null[:, :wrenched]], axis=1)
        all_ = np.concatenate([tree + apply(T[alike], some), some[:, :wrenched] + own[alike]], axis=1)
        weighted = place.weighted(alike)
        coupled = wrenched < some.shape[1]
        steps = steps_to_least(weighted(all_[..., None])[..., 0], weighted(change), coupled)
        wrenches = some - apply(null, steps)
        at = where[alike]
        closures = wrenches[:, :wrenched] + own[alike]
        total = np.concatenate([tree + apply(T[alike], wrenches), closures], axis=1)
        if structure.measure.misfit is not None:
            result.fit[:, at] = fit_of(structure.measure.misfit, change, weighted(change))
        result.wrenches[at] = total.reshape(len(alike), -1, 6)
        result.moves[at] = np.linalg.norm(change, axis=-1).reshape(len(alike), -1, 2, 3)
        result.rank[at], result.undetermined[at] = r, null.shape[-1]
        result.residual[at] = largest(loads.missing[alike] - apply(A[alike], wrenches))
        result.scale[at] = np.max([loads.scale[alike], largest(tree), largest(wrenches)], axis=0)
    result.rotations[where] = np.concatenate([loads.R[:, 1:], place.R1], axis=1)
    result.positions[where] = np.concatenate([loads.p[:, 1:], place.p1], axis=1)


def _dual(R: FloatArray, p: FloatArray) -> FloatArray:
    """Return the matrices (N, 6, 6) that take wrenches at p in the axes R to the frame that these are in."""
    result = np.zeros((len(R), 6, 6))
    result[:, :3, :3] = result[:, 3:, 3:] = R
    result[:, 3:, :3] = skew(p) @ R
    return result


def _ranks(s: FloatArray, tolerance: FloatArray) -> IndexArray:
    """Return how many singular values (N, k) are above a share of the largest."""
    reference = s[:, :1] if s.shape[1] else np.zeros((len(s), 1))
    return np.asarray(np.count_nonzero(s > tolerance[:, None] * reference, axis=1))


def _groups(keys: IndexArray) -> Iterator[IndexArray]:
    """Return the rows (N, k) that are equal, together."""
    if not len(keys):
        return
    kinds, of_kind = np.unique(keys, axis=0, return_inverse=True) if keys.shape[1] else (keys[:1], None)
    if of_kind is None or len(kinds) == 1:
        yield np.arange(len(keys))
        return
    for kind in range(len(kinds)):
        yield np.flatnonzero(of_kind.ravel() == kind)
