"""Inverse dynamics of many samples at once; see `p3dof.loops.batch.assembly`.

With no more actuators than freedoms a square system replaces the singular value decompositions of
`p3dof.loops.inverse`: J = [Ja Jp] being the closures' Jacobian by actuated and passive joints, as many
independent rows as there are passive joints give

    Jpᵀ λ = fp,    τ = fa - Jaᵀ λ,    f = rnea(q, v, a) - Σ Jeᵀ w        (1)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, Readable
from p3dof._base.errors import InputError, P3dofError
from p3dof._base.threads import Workspace
from p3dof.loops.batch.kinematics import (
    BatchConditioning,
    Choice,
    ClosureRows,
    Samples,
    Sweep,
    choose,
    follow,
)
from p3dof.loops.closed_tree import ClosedTree
from p3dof.loops.closures import TIGHT, LoopKinematics
from p3dof.loops.coordinates import ACCURACY, SURELY, WELL, cross, rounding
from p3dof.loops.linear import (
    FEW,
    PROBES,
    RANK_TOLERANCE,
    BoolArray,
    IndexArray,
    apply,
    blocks,
    inverse_norms,
    largest,
    norms,
    sized,
    solve,
    with_probes,
)
from p3dof.loops.results import HybridDynamics


class BatchEvidence:
    """What is found out about many samples when it is asked for, and once."""

    def __init__(self, known: FloatArray, find: Callable[[IndexArray], FloatArray] | None = None) -> None:
        self._known, self.find = known, find
        self._open: list[IndexArray] = []

    def leave_open(self, which: IndexArray) -> None:
        """Note that the conditioning of some samples has to be found."""
        self._open.append(which)

    def know(self, i: int, conditioning: float) -> None:
        """Enter the conditioning of one sample."""
        self._known[i] = conditioning

    @cached_property
    def conditioning(self) -> FloatArray:
        """The conditioning (N,) of all samples."""
        if self._open and self.find is not None:
            which = np.concatenate(self._open)
            self._known[which] = self.find(which)
        return self._known

    def __reduce__(self) -> tuple[type[BatchEvidence], tuple[FloatArray]]:
        return BatchEvidence, (self.conditioning,)  # for other processes


@dataclass(frozen=True, eq=False)
class BatchInverseDynamics(Readable):
    """Actuator forces that produce motions, and the evidence for them; see `InverseDynamics`.

    Parameters
    ----------
    tau : (N, n_actuated) array
        Forces of the actuated joints [N or N m]; NaN in the rows of samples that failed.
    residual : (N,) array
        Largest error of the full equation of motion [N or N m].
    closure_error : (N, rows) array
        How far each closure is open [m or rad].
    errors : dict of int to P3dofError
        What went wrong, by sample.
    evidence : BatchEvidence
        What `conditioning` asks: it is found out when it is asked for, in the workspace of the model.
    """

    tau: FloatArray
    residual: FloatArray
    closure_error: FloatArray
    errors: dict[int, P3dofError]
    evidence: BatchEvidence

    @property
    def conditioning(self) -> FloatArray:
        """Smallest singular value of Nᵀ B (N,), as in `InverseDynamics`."""
        return self.evidence.conditioning

    def put(
        self, i: IndexArray | int, tau: FloatArray, residual: FloatArray | float, closure_error: FloatArray
    ) -> None:
        """Enter what was found of some samples."""
        self.tau[i], self.residual[i], self.closure_error[i] = tau, residual, closure_error


@dataclass(frozen=True, eq=False)
class BatchHybridDynamics(Readable):
    """Actuator forces that produce prescribed accelerations, and the motions with them; see `HybridDynamics`.

    Parameters
    ----------
    tau : (N, n_actuated) array
        Forces of the actuated joints [N or N m]; NaN in the rows of samples that failed.
    a : (N, nv) array
        Accelerations of the whole tree.
    residual, closure_error, errors, evidence
        As of `BatchInverseDynamics`.
    """

    tau: FloatArray
    a: FloatArray
    residual: FloatArray
    closure_error: FloatArray
    errors: dict[int, P3dofError]
    evidence: BatchEvidence

    @property
    def conditioning(self) -> FloatArray:
        """Smallest singular value of Nᵀ B (N,), as in `InverseDynamics`."""
        return self.evidence.conditioning

    def put(self, i: int, one: HybridDynamics, gaps: FloatArray) -> None:
        """Enter what was found of one sample alone, `gaps` (rows,) being how far its closures are open."""
        self.tau[i], self.a[i], self.residual[i] = one.tau, one.a, one.residual
        self.closure_error[i] = gaps
        self.evidence.know(i, one.conditioning)

    def put_all(
        self, which: IndexArray, tau: FloatArray, a: FloatArray, residual: FloatArray, gaps: FloatArray
    ) -> None:
        """Enter what was found of many samples together."""
        self.tau[which], self.a[which], self.residual[which] = tau, a, residual
        self.closure_error[which] = gaps
        self.evidence.leave_open(which)

    @classmethod
    def empty(cls, count: int, actuated: int, nv: int, rows: int) -> BatchHybridDynamics:
        """Return results of samples of which nothing is known."""
        tau, a, gaps = (np.full((count, size), np.nan) for size in (actuated, nv, rows))
        residual, known = np.full((2, count), np.nan)
        return cls(tau, a, residual, gaps, {}, BatchEvidence(known))


@dataclass(frozen=True, eq=False)
class BatchForwardDynamics(Readable):
    """Accelerations that actuator forces produce, and the evidence for them; see `ForwardDynamics`.

    Parameters
    ----------
    a : (N, nv) array
        Accelerations of the whole tree; NaN in the rows of samples that failed.
    residual : (N,) array
        Largest error of the full equation of motion [N or N m].
    closure_residual : (N,) array
        Largest relative acceleration that is left at a closure [m/s² or rad/s²].
    closure_error, errors
        As of `BatchInverseDynamics`.
    """

    a: FloatArray
    residual: FloatArray
    closure_residual: FloatArray
    closure_error: FloatArray
    errors: dict[int, P3dofError]


@dataclass(frozen=True, eq=False)
class Prescribed:
    """Prescribed accelerations of many samples."""

    at: IndexArray  # (n,): indices in v of joints
    values: FloatArray  # (N, n): their accelerations
    frames: tuple[tuple[str, BoolArray], ...]
    """(6,): frames, and which components of their accelerations are prescribed."""
    of_frames: FloatArray  # (N, m): these components, one frame after the other

    @property
    def size(self) -> int:
        """How many accelerations are prescribed."""
        return self.values.shape[1] + self.of_frames.shape[1]

    @property
    def kind(self) -> tuple[object, ...]:
        """What is prescribed, without the values."""
        return (self.at.tobytes(), *((name, mask.tobytes()) for name, mask in self.frames))

    def of(self, block: IndexArray) -> Prescribed:
        """Return those of some samples."""
        return Prescribed(self.at, self.values[block], self.frames, self.of_frames[block])


_CHOICES = 3  # how many times the independent rows are chosen before the rest is left to the single samples


class BatchDynamics(Workspace):
    """Inverse dynamics of one model at many samples."""

    def __init__(self, tree: ClosedTree) -> None:
        kinematics = tree.kinematics
        self._tree, self._kinematics = tree, kinematics
        self._sweep = Sweep(tree.model)
        self._closures = ClosureRows(kinematics, self._sweep)
        self._passive = np.setdiff1d(np.arange(tree.model.nv), tree.actuated_v)
        self._chosen: Choice | None = None
        self.conditioning = BatchConditioning(kinematics, self._sweep, self._closures, tree.actuated_v)
        """Returns that of `InverseDynamics` (N,) at configurations (N, nq)."""

    def inverse_dynamics(
        self,
        q: FloatArray,
        v: FloatArray,
        a: FloatArray,
        external: Mapping[str, FloatArray],
        joint_forces: FloatArray,
        stop: bool,
    ) -> BatchInverseDynamics:
        """Return the actuator forces of motions."""
        count, tree = len(q), self._tree
        tau = np.full((count, len(tree.actuated)), np.nan)
        residual, known = np.full((2, count), np.nan)
        gaps = np.full((count, self._kinematics.size), np.nan)
        evidence = BatchEvidence(known, lambda which: self.conditioning(q[which]))
        result = BatchInverseDynamics(tau, residual, gaps, {}, evidence)
        self._pool = pin.ModelPool(tree.model, 1)  # with a copy of the model as it is now
        for block in blocks(count, sized(self._kinematics.size, tree.model.nv)):
            left = block
            if count >= FEW:
                loads = {name: wrench[block] for name, wrench in external.items()}
                good, *found = self._forces(q[block], v[block], a[block], loads, joint_forces[block])
                result.put(block[good], *(values[good] for values in found))
                evidence.leave_open(block[good])
                left = block[~good]
            for i in left:
                loads = {name: wrench[i] for name, wrench in external.items()}
                try:
                    one = tree.inverse_dynamics(q[i], v[i], a[i], (loads, joint_forces[i]))
                except P3dofError as error:
                    result.errors[int(i)] = error
                    if stop:
                        return result
                else:
                    result.put(i, one.tau, one.residual, tree.closure_error(q[i]))
                    evidence.know(int(i), one.conditioning)
        return result

    def errors(self, q: FloatArray) -> FloatArray:
        """Return how far the closures are open (N, rows) at configurations (N, nq)."""
        return self._closures.errors(q, self._closures.frames(self._sweep.at(q)))

    def power(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return the rate of change of the mechanical energy (N,) [W]; see `energy.energy_rate`."""
        model, rates = self._tree.model, np.empty(len(q))
        if len(q) < FEW:
            return np.array([self._tree.power(*row) for row in zip(q, v, a, strict=True)])
        bodies = list(model.inertias)[1:]
        m, c = np.array([b.mass for b in bodies]), np.array([b.lever for b in bodies]).reshape(-1, 3)
        inertia = np.array([b.inertia for b in bodies]).reshape(-1, 3, 3)
        for block in blocks(len(q)):
            samples = self._sweep.moving(q[block], v[block])
            moved = slice(1, None)  # all but the world
            V = self._sweep.twists(samples.J, v[block], moved)
            A = self._sweep.twists(samples.J, a[block], moved)
            A += self._sweep.twists(samples.J_dot, v[block], moved)
            R, omega, alpha = samples.R[:, 1:], V[..., 3:], A[..., 3:]
            centre = samples.p[:, 1:] + apply(R, c)
            vc = V[..., :3] + cross(omega, centre)
            ac = A[..., :3] + cross(alpha, centre)  # less ω × vc, which has no power: it is across vc
            turned = R @ inertia @ np.swapaxes(R, -1, -2)
            torque = apply(turned, alpha) + cross(omega, apply(turned, omega))
            each = m[:, None] * vc * (ac - model.gravity.linear) + omega * torque
            rates[block] = each.sum(axis=(1, 2)) + (v[block] * a[block]) @ np.asarray(model.armature)
        return rates + self._tree.passive.power(q, v)

    def _forces(
        self,
        q: FloatArray,
        v: FloatArray,
        a: FloatArray,
        external: Mapping[str, FloatArray],
        joint_forces: FloatArray,
    ) -> tuple[BoolArray, FloatArray, FloatArray, FloatArray]:
        """Return where the forces are good; forces, residual and closure errors."""
        samples = self._sweep.moving(q, v)
        J, errors, fits = self._closed(samples, q, v, a)
        f = np.array(pin.rneaInParallel(1, self._pool, q.T, v.T, a.T)).T.reshape(v.shape)  # one comes flat
        f -= joint_forces + generalised(self._kinematics, self._sweep, samples, external)
        if self._tree.passive:
            f -= self._tree.passive.forces(q, v)
        tau, residual, good = self._project(J, f, fits)
        return good, tau, residual, errors

    def _closed(
        self, samples: Samples, q: FloatArray, v: FloatArray, a: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return the closures' Jacobian, their errors, and whether the motion keeps them closed."""
        frames = self._closures.frames(samples)
        J, errors = self._closures.jacobian(q, samples, frames), self._closures.errors(q, frames)
        opening = apply(J, v)
        faster = apply(J, a) + self._closures.drift(q, samples, frames, v)
        size = largest(v)
        fits = largest(errors) <= np.maximum(TIGHT, rounding(q))
        fits &= largest(opening) <= ACCURACY * np.maximum(1.0, size)
        fits &= largest(faster) <= ACCURACY * np.maximum(np.maximum(1.0, largest(a)), size**2)
        return J, errors, fits

    def _project(
        self, J: FloatArray, f: FloatArray, fits: BoolArray
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return forces and residual by (1), and where they are good."""
        tau, good = np.empty((len(f), len(self._tree.actuated_v))), np.zeros(len(f), dtype=bool)
        residual: FloatArray = np.empty(len(f))
        for _ in range(_CHOICES):
            todo = np.flatnonzero(fits & ~good)
            if not len(todo):
                break
            if self._chosen is None:
                self._chosen = choose(J[todo[0]], self._tree.actuated_v)
            choice, every = self._chosen, slice(None) if len(todo) == len(J) else todo
            if len(choice.passive) + len(choice.idle) == len(self._passive):
                tau[todo], residual[todo], good[todo] = self._by(choice, J[every], f[every])
            if not good[todo].all():
                self._chosen = None
        return tau, residual, good

    def _by(self, choice: Choice, J: FloatArray, f: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return forces and residual of samples by a choice, and where they are good."""
        passive, free, count = choice.passive, choice.free, len(self._tree.actuated_v)
        JR = J[:, choice.rows] if len(choice.left) else J
        Jp, Jf, others = JR[:, :, passive], JR[:, :, free], J[:, choice.left]
        asked = np.concatenate((f[:, passive, None], np.swapaxes(others[:, :, passive], -1, -2)), axis=2)
        with np.errstate(all="ignore"):  # what is not a number passes no test
            x = solve(np.swapaxes(Jp, -1, -2), with_probes(asked))
            inverse, lambda_, weights = inverse_norms(x), x[:, :, PROBES], x[:, :, PROBES + 1 :]
            well = (norms(Jp) * inverse <= 1.0 / WELL) & (norms(Jf) * inverse <= 1.0 / WELL)
            well &= follow(others[:, :, free], weights, Jf, norms(J))
            left = f[:, passive] - apply(np.swapaxes(Jp, -1, -2), lambda_)
            rest = f[:, free] - apply(np.swapaxes(Jf, -1, -2), lambda_)
            missing = rest[:, count:]
            well &= largest(missing) <= SURELY * largest(f)  # passive freedoms move freely
        return rest[:, :count], np.maximum(largest(left), largest(missing)), well


def generalised(
    kinematics: LoopKinematics, sweep: Sweep, samples: Samples, external: Mapping[str, FloatArray]
) -> FloatArray:
    """Return the generalised forces of wrenches on frames; (n, nv)."""
    force = np.zeros((len(samples.p), kinematics.model.nv))
    for name, wrench in external.items():
        frame = kinematics.frame(name, "external", InputError)
        joint = frame.parentJoint
        place = samples.p[:, joint] + samples.R[:, joint] @ frame.placement.translation
        moment = wrench[:, 3:] + cross(place, wrench[:, :3])
        at_origin = np.concatenate((wrench[:, :3], moment), axis=1)
        force += apply(np.swapaxes(samples.J, -1, -2), at_origin) * sweep.behind[joint]
    return force


def redundant(J: FloatArray, N: FloatArray, scale: FloatArray | float = 1.0) -> BoolArray:
    """Whether the rows of closures J (n, rows, nv) do not resist motions N (n, nv, k); (n,) array of bool.

    The closures then have no more than nv - k independent rows.
    """
    tolerance = RANK_TOLERANCE * norms(J) / np.sqrt(max(1, J.shape[2]))
    return np.asarray(norms(np.matmul(J, N)) * scale <= tolerance)
