"""Kinematics of many configurations at once: bodies, closures, couplings, energies, conditioning.

Pinocchio goes sample by sample, everything after it is in arrays.

Spatial vectors are in world axes at the world's origin, linear part first: (v_O, ω).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, Readable
from p3dof._base.errors import ModelError
from p3dof._base.threads import Workspace
from p3dof.loops.closed_tree import ClosedTree
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.coordinates import WELL, cross, rotation_vector, turned_rates
from p3dof.loops.linear import (
    PROBES,
    RANK_TOLERANCE,
    BoolArray,
    Decomposition,
    IndexArray,
    actuation_of,
    apply,
    blocks,
    independent_rows,
    inverse_norms,
    norms,
    sized,
    solve,
    with_probes,
)

_LAYOUT = 12  # numbers in a `pin.SE3`: the rotation by columns, then the translation
_STEADY = ("FreeFlyer", "Planar", "Spherical", "Translation")
"""Joints of several freedoms whose axes do not turn within the joint, after `JointModel`."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Bodies and joints at N configurations."""

    J: FloatArray
    """(N, 6, nv): column k: the spatial velocity that a unit rate of freedom k gives the bodies behind it."""
    J_dot: FloatArray
    """(N, 6, nv): the time derivative of `J`; empty without velocities. Where a joint's own axes turn with
    it, as those of a universal joint, only its product with the velocity is right."""
    R: FloatArray
    """(N, njoints, 3, 3): axes of the bodies, as columns, in the world; joint 0 is the world itself."""
    p: FloatArray  # (N, njoints, 3): their origins [m]


class Sweep(Workspace):
    """Takes Pinocchio through many configurations.

    One call of Pinocchio a sample, and its results are copied straight from the memory of `pin.Data`.
    """

    def __init__(self, model: pin.Model) -> None:
        self.model = model
        self._data = model.createData()
        self._J, self._J_dot = self._data.J.T, self._data.dJ.T
        self._placements = shared_placements(self._data)
        shapes = (model.nv, 6), (model.nv, 6), (model.njoints * _LAYOUT,)
        self._room = [np.empty((0, *shape)) for shape in shapes]
        names = [model.joints[i].shortname().removeprefix("JointModel") for i in range(1, model.njoints)]
        self._unsteady = [i for i, n in enumerate(names, 1) if model.nvs[i] > 1 and n not in _STEADY]
        self.behind = np.zeros((model.njoints, model.nv))
        """Entry (i, k): 1 if freedom k moves body i, else 0."""
        for i in range(model.njoints):
            for j in list(model.supports[i])[1:]:
                self.behind[i, model.idx_vs[j] : model.idx_vs[j] + model.nvs[j]] = 1.0

    def at(self, q: FloatArray) -> Samples:
        """Return the samples at configurations q (N, nq), without `J_dot`; they hold until the next call."""
        J, _, placements = self._buffers(len(q))
        compute, model, data = pin.computeJointJacobians, self.model, self._data
        for q_i, J_i, placements_i in zip(q, J, placements, strict=True):
            compute(model, data, q_i)
            J_i[:] = self._J
            placements_i[:] = self._placements
        return Samples(np.swapaxes(J, -1, -2), np.swapaxes(J[:, :0], -1, -2), *placed(placements))

    def moving(self, q: FloatArray, v: FloatArray) -> Samples:
        """Return the samples at configurations q (N, nq), velocities v (N, nv), until the next call."""
        J, J_dot, placements = self._buffers(len(q))
        compute, model, data = pin.computeJointJacobiansTimeVariation, self.model, self._data
        for q_i, v_i, J_i, J_dot_i, placements_i in zip(q, v, J, J_dot, placements, strict=True):
            compute(model, data, q_i, v_i)
            J_i[:] = self._J
            J_dot_i[:] = self._J_dot
            for i in self._unsteady:
                self._turn_axes(i, v_i, J_dot_i)
            placements_i[:] = self._placements
        return Samples(np.swapaxes(J, -1, -2), np.swapaxes(J_dot, -1, -2), *placed(placements))

    def _turn_axes(self, joint: int, v: FloatArray, J_dot: FloatArray) -> None:
        """Add to J_dot (nv, 6) what Pinocchio leaves out of it: that a joint's own axes turn, Ṡ v."""
        freedoms = slice(self.model.idx_vs[joint], self.model.idx_vs[joint] + self.model.nvs[joint])
        rate, square = v[freedoms], v[freedoms] @ v[freedoms]
        if square > 0:
            bias = self._data.oMi[joint].act(self._data.joints[joint].c).vector
            J_dot[freedoms] += np.outer(rate / square, bias)

    def twists(self, J: FloatArray, v: FloatArray, joints: Sequence[int] | slice = slice(None)) -> FloatArray:
        """Return Σ J_k v_k over the freedoms behind some joints' bodies; (N, joints, 6)."""
        rates = np.swapaxes(J * v[:, None, :], -1, -2)
        return np.asarray(np.matmul(self.behind[joints], rates))

    def _buffers(self, count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return room for samples; fresh memory at every call would cost as much as the kinematics."""
        if len(self._room[0]) < count:
            shapes = (self.model.nv, 6), (self.model.nv, 6), (self.model.njoints * _LAYOUT,)
            self._room = [np.empty((count, *shape)) for shape in shapes]
        J, J_dot, placements = (array[:count] for array in self._room)
        return J, J_dot, placements


@dataclass(frozen=True, eq=False)
class Pair:
    """Two frames whose relative motion is prescribed."""

    ends: tuple[int, pin.SE3, int, pin.SE3]  # joint and placement in its body of frame 1, then of frame 2
    components: tuple[int, ...]
    """Which of (vx, vy, vz, ωx, ωy, ωz) count: velocity of body 2 relative to body 1 in the axes of frame
    1."""
    at_first: bool  # whether the velocity is that of the point at the origin of frame 1, else of frame 2


@dataclass(frozen=True, eq=False)
class Frames:
    """Both frames of k pairs at N samples: axes (N, k, 3, 3), origins (N, k, 3) and the common point."""

    R1: FloatArray
    R2: FloatArray
    p1: FloatArray
    p2: FloatArray
    point: FloatArray


class RelativeRows:
    """Relative velocities of pairs of frames, and their rates, over samples."""

    def __init__(self, sweep: Sweep, pairs: Sequence[Pair]) -> None:
        self._sweep = sweep
        self._joints1 = [pair.ends[0] for pair in pairs]
        self._joints2 = [pair.ends[2] for pair in pairs]
        placements1, placements2 = [pair.ends[1] for pair in pairs], [pair.ends[3] for pair in pairs]
        self._R1, self._R2 = (_stack([M.rotation for M in Ms], (3, 3)) for Ms in (placements1, placements2))
        self._t1, self._t2 = (_stack([M.translation for M in Ms], (3,)) for Ms in (placements1, placements2))
        self._at_first = np.array([pair.at_first for pair in pairs], dtype=bool)[:, None]
        self._rows = np.array([6 * i + c for i, pair in enumerate(pairs) for c in pair.components], dtype=int)
        sign = sweep.behind[self._joints2] - sweep.behind[self._joints1]
        self._sign = sign[self._rows // 6]

    def frames(self, samples: Samples) -> Frames:
        """Return both frames of every pair."""
        R1, R2 = samples.R[:, self._joints1], samples.R[:, self._joints2]
        p1 = samples.p[:, self._joints1] + apply(R1, self._t1)
        p2 = samples.p[:, self._joints2] + apply(R2, self._t2)
        point = np.where(self._at_first, p1, p2)
        return Frames(_turned(R1, self._R1), _turned(R2, self._R2), p1, p2, point)

    def jacobian(self, samples: Samples, frames: Frames, last: FloatArray | None = None) -> FloatArray:
        """Return the matrices (N, rows, nv) from v to the relative velocities."""
        J: FloatArray = np.matmul(self._projection(frames, last), samples.J)
        J *= self._sign
        return J

    def drift(self, samples: Samples, frames: Frames, v: FloatArray) -> FloatArray:
        """Return the relative accelerations (N, rows) at zero joint acceleration, for v (N, nv)."""
        (V1, V2), (A1, A2) = self._ends_of(samples.J, v), self._ends_of(samples.J_dot, v)
        carrying = np.where(self._at_first, V1, V2)
        point_dot = carrying[..., :3] + cross(carrying[..., 3:], frames.point)
        omega1, omega, alpha = V1[..., 3:], V2[..., 3:] - V1[..., 3:], A2[..., 3:] - A1[..., 3:]
        u = V2[..., :3] - V1[..., :3] + cross(omega, frames.point)
        linear = A2[..., :3] - A1[..., :3] + cross(alpha, frames.point)
        turning = linear + cross(omega, point_dot) - cross(omega1, u), alpha - cross(omega1, omega)
        rates = np.matmul(np.stack(turning, axis=-2), frames.R1)  # R1ᵀ x = (xᵀ R1)ᵀ
        return np.asarray(rates.reshape(len(v), 6 * len(self._joints1))[:, self._rows])

    def _ends_of(self, J: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return `Sweep.twists` of the bodies of frames 1, and of frames 2."""
        both = self._sweep.twists(J, v, self._joints1 + self._joints2)
        count = len(self._joints1)
        return both[:, :count], both[:, count:]

    def _projection(self, frames: Frames, last: FloatArray | None) -> FloatArray:
        """Return the matrices (N, rows, 6) from a relative twist at the world's origin to the rows."""
        count, pairs = frames.p1.shape[:2]
        axes = np.swapaxes(frames.R1, -1, -2)
        X = np.zeros((count, pairs, 6, 6))
        X[..., :3, :3] = axes
        X[..., :3, 3:] = cross(frames.point[..., None, :], axes)  # rows a of R1ᵀ: a · (ω × c) = (c × a) · ω
        X[..., 3:, 3:] = axes
        if last is not None:
            X[:, -last.shape[1] :, 3:, 3:] = last
        return np.asarray(X.reshape(count, 6 * pairs, 6)[:, self._rows])


def _stack(arrays: Sequence[FloatArray], shape: tuple[int, ...]) -> FloatArray:
    return np.array(arrays, dtype=np.float64).reshape(-1, *shape)


def _turned(R: FloatArray, placements: FloatArray) -> FloatArray:
    """Return R (N, k, 3, 3) times constant rotations (k, 3, 3), which are mostly none."""
    return R if (placements == np.eye(3)).all() else R @ placements


def shared_placements(data: Any) -> FloatArray:
    """Return all joint placements of a `pin.Data` as one array (njoints * 12,) in its own memory."""
    first = data.oMi[0].rotation.T  # by columns, as Pinocchio stores it
    numbers = len(data.oMi) * _LAYOUT
    parts = [(M.rotation.T, M.translation) for M in data.oMi]
    start, size = _address(first), first.itemsize
    expected = [(start + (_LAYOUT * i) * size, start + (_LAYOUT * i + 9) * size) for i in range(len(parts))]
    if first.flags.owndata or [(_address(R), _address(t)) for R, t in parts] != expected:
        raise ModelError("this version of Pinocchio stores its placements in a way that is not known here")
    return np.lib.stride_tricks.as_strided(first[0], (numbers,), (size,), writeable=False)


def placed(placements: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return axes (N, njoints, 3, 3) and origins (N, njoints, 3) of copies of shared placements."""
    each = placements.reshape(len(placements), placements.shape[1] // _LAYOUT, _LAYOUT)
    return np.swapaxes(each[..., :9].reshape(*each.shape[:2], 3, 3), -1, -2), each[..., 9:]


def _address(array: NDArray[np.float64]) -> int:
    return int(array.__array_interface__["data"][0])


@dataclass(frozen=True, eq=False)
class BodyEnergies(Readable):
    """Energy and momentum of the bodies of a robot, at one state or at N of them.

    Parameters
    ----------
    names : tuple of str
        The n joints that carry the bodies, in Pinocchio's order. Links that are fixed to each other are one
        body.
    kinetic : ndarray, shape (n,) or (N, n)
        Of each body, and of the rotor of its joint (`model.armature`) [J].
    potential : ndarray, shape (n,) or (N, n)
        Of each body, zero where its mass centre is at the world's origin [J].
    momentum, angular_momentum : ndarray, shape (3,) or (N, 3)
        Of all bodies together, without rotors, the angular one about the world's origin [N s, N m s].
    springs : ndarray, shape () or (N,)
        Energy in the springs of the joints [J].
    """

    names: tuple[str, ...]
    kinetic: FloatArray
    potential: FloatArray
    momentum: FloatArray
    angular_momentum: FloatArray
    springs: FloatArray = field(default_factory=lambda: np.zeros(()))

    @property
    def total(self) -> FloatArray:
        """Kinetic and potential energy of all bodies and springs together, shape () or (N,) [J]."""
        return np.asarray(np.sum(self.kinetic + self.potential, axis=-1) + self.springs)


def energies_of(tree: ClosedTree, q: ArrayLike, v: ArrayLike) -> BodyEnergies:
    """Return energies and momenta at one state or at many; see `ClosedLoopModel.body_energies`."""
    if np.ndim(q) != 1:
        q, v = tree.states(q, v)
        return replace(_body_energies(tree.model, q, v), springs=tree.passive.energy(q))
    q, v = tree.state(q, v)
    many = vars(_body_energies(tree.model, q[None], v[None]))
    one = {name: value[0] for name, value in many.items() if name not in ("names", "springs")}
    return BodyEnergies(many["names"], **one, springs=tree.passive.energy(q))


def _body_energies(model: pin.Model, q: FloatArray, v: FloatArray) -> BodyEnergies:
    """Return energies and momenta of the bodies of a tree."""
    bodies = range(1, model.njoints)
    m = np.array([model.inertias[i].mass for i in bodies])
    lever = np.array([model.inertias[i].lever for i in bodies]).reshape(-1, 3)
    inertia = np.array([model.inertias[i].inertia for i in bodies]).reshape(-1, 3, 3)
    sweep = Sweep(model)
    samples = sweep.at(q)
    twists = sweep.twists(samples.J, v)[:, 1:]
    R = samples.R[:, 1:]
    c, omega = samples.p[:, 1:] + apply(R, lever), twists[..., 3:]
    vc = twists[..., :3] + cross(omega, c)
    turning = np.einsum("...ji,...j->...i", R, omega)  # in the axes of the body
    spin = apply(inertia, turning)
    rotors = np.asarray(model.armature) * v**2
    each = [rotors[:, model.idx_vs[i] : model.idx_vs[i] + model.nvs[i]].sum(axis=-1) for i in bodies]
    kinetic = m * np.sum(vc * vc, axis=-1) + np.sum(turning * spin, axis=-1)
    kinetic += np.array(each).reshape(len(m), len(q)).T
    return BodyEnergies(
        tuple(str(name) for name in model.names[1:]),
        kinetic / 2,
        -m * (c @ model.gravity.linear),
        np.sum(m[:, None] * vc, axis=1),
        np.sum(m[:, None] * cross(c, vc) + apply(R, spin), axis=1),
    )


class ClosureRows:
    """Rows of closures and couplings, then of further pairs of frames, over samples."""

    def __init__(self, kinematics: LoopKinematics, sweep: Sweep, pairs: Sequence[Pair] = ()) -> None:
        self._kinematics = kinematics
        closures = [  # all but a ``6d`` follow the point at frame 2
            Pair(ends, tuple(range(3 if closure.kind == "3d" else 6)), closure.kind == "6d")
            for closure, ends in zip(kinematics.closures, kinematics.ends, strict=True)
        ]
        self._relative = RelativeRows(sweep, [*closures, *pairs])
        self.frames = self._relative.frames
        """Returns both frames of every closure, then of every further pair."""
        sizes = [len(pair.components) for pair in (*closures, *pairs)]
        self._size = kinematics.size + sum(sizes[len(closures) :])
        # Where the rows of a pair come from and go to; those of other closures become less by their matrices.
        stops = np.cumsum([0, *sizes])
        own = {int(i) for i in kinematics.own}
        kept = [i for i in range(len(sizes)) if i not in own]
        starts = [rows.start for rows in kinematics.rows[: len(closures)]]
        starts += (kinematics.size + stops[len(closures) :] - stops[len(closures)]).tolist()
        self._from = np.array([stops[i] + k for i in kept for k in range(sizes[i])], dtype=int)
        self._to = np.array([starts[i] + k for i in kept for k in range(sizes[i])], dtype=int)
        self._of_own = stops[kinematics.own][:, None] + np.arange(6)

    def errors(self, q: FloatArray, frames: Frames) -> FloatArray:
        """Return how far closures and couplings are open, (N, rows) at configurations q (N, nq)."""
        k = self._kinematics
        errors = np.zeros((len(frames.p1), k.size))
        for kind in ("3d", "6d"):
            which = [i for i, closure in enumerate(k.closures) if closure.kind == kind]
            if not which:
                continue
            axes = np.swapaxes(frames.R1[:, which], -1, -2)
            found = apply(axes, frames.p2[:, which] - frames.p1[:, which])
            if kind == "6d":
                turn = rotation_vector(axes @ frames.R2[:, which])
                found = np.concatenate((apply(turned_rates(turn), found), turn), axis=-1)
            rows = np.concatenate([np.arange(k.size)[k.rows[i]] for i in which])
            errors[:, rows] = found.reshape(len(errors), len(rows))
        if len(k.own):
            for group in k.kinds.at(*self._places(frames)):
                group.errors(errors)
        if k.couplings.size:
            errors[:, k.coupled] = k.couplings.errors(q)
        return errors

    def jacobian(
        self, q: FloatArray, samples: Samples, frames: Frames, last: FloatArray | None = None
    ) -> FloatArray:
        """Return the Jacobian (N, rows, nv); `last` as for `RelativeRows.jacobian`."""
        k, each = self._kinematics, self._relative.jacobian(samples, frames, last)
        if k.plain:
            return each
        J = np.empty((len(each), self._size, each.shape[-1]))
        J[:, self._to] = each[:, self._from]
        if len(k.own):
            for group in k.kinds.at(*self._places(frames)):
                group.jacobian(each[:, self._of_own], J)
        if k.couplings.size:
            J[:, k.coupled] = k.couplings.jacobian(q)
        return J

    def drift(self, q: FloatArray, samples: Samples, frames: Frames, v: FloatArray) -> FloatArray:
        """Return the relative accelerations (N, rows) at zero joint acceleration, for v (N, nv)."""
        k, each = self._kinematics, self._relative.drift(samples, frames, v)
        if k.plain:
            return each
        drift = np.empty((len(each), self._size))
        drift[:, self._to] = each[:, self._from]
        if len(k.own):
            rates = apply(self._relative.jacobian(samples, frames), v)
            for group in k.kinds.at(*self._places(frames)):
                group.drift(rates[:, self._of_own], each[:, self._of_own], drift)
        if k.couplings.size:
            drift[:, k.coupled] = k.couplings.drift(q, v)
        return drift

    def _places(self, frames: Frames) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return d, E and turn of `closure_kinds.Relative` for the other closures."""
        own, turning = self._kinematics.own, self._kinematics.kinds.turning
        axes = np.swapaxes(frames.R1[:, own], -1, -2)
        d, E = apply(axes, frames.p2[:, own] - frames.p1[:, own]), axes @ frames.R2[:, own]
        turn = np.zeros(d.shape)
        if len(turning):
            turn[:, turning] = rotation_vector(E[:, turning])
        return d, E, turn


@dataclass(frozen=True, eq=False)
class Choice:
    """Independent rows of closures, the others, the joints that follow by these, idle ones, all others."""

    rows: IndexArray
    left: IndexArray
    passive: IndexArray
    idle: IndexArray
    free: IndexArray


def choose(J: FloatArray, actuated_v: IndexArray) -> Choice:
    """Return independent rows, and the joints that follow by these."""
    passive = np.setdiff1d(np.arange(J.shape[1]), actuated_v)
    rank = len(passive)
    rows, chosen = independent_rows(J[:, passive], rank), passive
    if len(rows) < rank:
        rank = Decomposition.of(J).rank
        rows = independent_rows(J, rank)
        chosen = passive[independent_rows(J[rows][:, passive].T, rank)]
        if len(chosen) < len(rows):
            chosen = passive[:0]  # joints that are actuated follow from others, too
    idle = np.setdiff1d(passive, chosen) if len(chosen) else passive[:0]
    left = np.setdiff1d(np.arange(len(J)), rows)
    return Choice(rows, left, chosen, idle, np.concatenate((actuated_v, idle)))


class BatchConditioning:
    """The conditioning of one model at many configurations."""

    def __init__(
        self, kinematics: LoopKinematics, sweep: Sweep, closures: ClosureRows, actuated_v: IndexArray
    ) -> None:
        self._kinematics, self._sweep, self._closures = kinematics, sweep, closures
        self._actuated = actuated_v

    def __call__(self, q: FloatArray) -> FloatArray:
        """Return the conditioning (N,) at configurations (N, nq)."""
        found = np.zeros(len(q))
        for block in blocks(len(q), sized(self._kinematics.size, self._kinematics.model.nv)):
            samples = self._sweep.at(q[block])
            J = self._closures.jacobian(q[block], samples, self._closures.frames(samples))
            choice = choose(J[0], self._actuated)
            well: BoolArray = np.zeros(len(block), dtype=bool)
            if len(choice.rows) == len(choice.passive):
                found[block], well = self._chosen(J, choice)
            alone = block[~well]
            found[alone] = [self._alone(row) for row in q[alone]]
        return found

    def _alone(self, q: FloatArray) -> float:
        return actuation_of(self._kinematics.at(q).svd, self._actuated).least

    def _chosen(self, J: FloatArray, choice: Choice) -> tuple[FloatArray, BoolArray]:
        """Return the conditioning by a choice, and where it is good."""
        JR, others, count = J[:, choice.rows], J[:, choice.left], len(self._actuated)
        Jp, Jf = JR[:, :, choice.passive], JR[:, :, choice.free]
        with np.errstate(all="ignore"):
            x = solve(Jp, with_probes(Jf))
            well = norms(Jp) * inverse_norms(x) <= 1.0 / WELL
            N = x[:, :, PROBES:]  # of the joints that follow, but for the sign; that of the others is 1
            well &= follows(others[:, :, choice.free] - others[:, :, choice.passive] @ N, norms(J), len(J[0]))
        N = np.where(well[:, None, None], N, 0.0)
        square = np.eye(N.shape[2]) + np.swapaxes(N, -1, -2) @ N
        if len(choice.idle):
            # Orthonormal motions have the rows E (NᵀN)^(-1/2) of the actuated joints, E being the first ones
            # of 1; the inverse of E (NᵀN)⁻¹ Eᵀ is what elimination of the passive joints leaves of NᵀN.
            across = square[:, count:, :count]
            more = np.linalg.solve(square[:, count:, count:], across)
            square = square[:, :count, :count] - np.swapaxes(across, -1, -2) @ more
        return 1.0 / np.sqrt(np.linalg.eigvalsh(square).max(axis=1, initial=1.0)), np.asarray(well)


def follow(others: FloatArray, weights: FloatArray, J: FloatArray, size: FloatArray) -> BoolArray:
    """Whether rows that were left out follow from those that were chosen; (n,) array of bool."""
    count = J.shape[1] + others.shape[1]
    return follows(others - np.swapaxes(weights, -1, -2) @ J, size, count)


def follows(apart: FloatArray, size: FloatArray, count: int) -> BoolArray:
    """Whether what is left of rows (n, left, k) is nothing beside all rows, of a size (n,) and so many."""
    if not apart.shape[1]:
        return np.ones(len(apart), dtype=bool)
    return np.asarray(norms(apart) <= RANK_TOLERANCE * size / np.sqrt(count))
