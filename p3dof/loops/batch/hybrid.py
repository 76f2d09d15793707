"""Hybrid dynamics of many samples at once; see `p3dof.loops.hybrid`.

As many independent rows of the closures' Jacobian J and of prescribed frames F as there are joints that are
neither prescribed nor idle give the rates of these d from those of the others f, so that all is algebra of
stacked arrays. With R the chosen rows of [J; F] and c their accelerations less J̇ v and Ḟ v,

    a_d = Rd⁻¹ (c - Rf a_f),    N = [1; -Rd⁻¹ Rf]

The columns of N of the prescribed joints, and Rd⁻¹ for those rows of frames, are P there; those of idle
joints are Z.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof._base.errors import InputError
from p3dof._base.threads import Workspace
from p3dof.loops.batch.dynamics import BatchHybridDynamics, Prescribed, generalised
from p3dof.loops.batch.kinematics import BatchConditioning, ClosureRows, Pair, Sweep
from p3dof.loops.closed_tree import ClosedTree
from p3dof.loops.closures import TIGHT
from p3dof.loops.coordinates import ACCURACY, NO_CHANGE, SURELY, WELL, rounding
from p3dof.loops.hybrid import KINDS
from p3dof.loops.linear import (
    FEW,
    PROBES,
    RANK_TOLERANCE,
    BoolArray,
    Decomposition,
    IndexArray,
    apply,
    blocks,
    independent_rows,
    inverse,
    inverse_norms,
    largest,
    norms,
    sized,
    solve,
    with_probes,
)

_CHOICES = 2  # how many times rows and joints are chosen before all is left to the single samples
_SOLUTIONS = 2  # solutions of the linear equations at most; for more, single samples get one


@dataclass(frozen=True, eq=False)
class _Choice:
    """Independent rows of closures and frames, the others, joints that follow by these, idle ones."""

    rows: IndexArray
    left: IndexArray
    dependent: IndexArray
    idle: IndexArray


@dataclass(frozen=True, eq=False)
class _Motions:
    """The free motions of n samples by one choice: N = [P Z], T, Z, the inverses of Zᵀ M Z and of Tᵀ B."""

    N: FloatArray
    T: FloatArray
    Z: FloatArray
    H: FloatArray
    G: FloatArray


class BatchHybrid(Workspace):
    """Hybrid dynamics of one model at many samples."""

    def __init__(self, tree: ClosedTree) -> None:
        kinematics = tree.kinematics
        self._model, self._kinematics, self._actuated = tree.model, kinematics, tree.actuated_v
        self._sweep, self._data = Sweep(tree.model), tree.model.createData()
        self._upper = np.triu(np.ones((tree.model.nv, tree.model.nv))) - np.eye(tree.model.nv) / 2
        self._known: dict[object, tuple[ClosureRows, list[_Choice]]] = {}
        closures = ClosureRows(kinematics, self._sweep)
        self._conditioning = BatchConditioning(kinematics, self._sweep, closures, tree.actuated_v)

    def solve(
        self,
        q: FloatArray,
        v: FloatArray,
        prescribed: Prescribed,
        external: Mapping[str, FloatArray],
        joint_forces: FloatArray,
    ) -> tuple[BatchHybridDynamics, BoolArray]:
        """Return what was found, and for which samples; the others are for the method for single ones."""
        count, rows, nv = len(q), self._kinematics.size, self._model.nv
        result = BatchHybridDynamics.empty(count, len(self._actuated), nv, rows)
        result.evidence.find = lambda which: self._conditioning(q[which])
        done = np.zeros(count, dtype=bool)
        self._pool = pin.ModelPool(self._model, 1)  # with a copy of the model as it is now
        if count >= FEW and prescribed.size == len(self._actuated):
            for block in blocks(count, sized(max(rows, nv), nv)):
                loads = {name: wrench[block] for name, wrench in external.items()}
                with np.errstate(all="ignore"):  # what is not a number passes no test
                    good, *found = self._block(
                        q[block], v[block], prescribed.of(block), loads, joint_forces[block]
                    )
                which = block[good]
                done[which] = True
                result.put_all(which, *(some[good] for some in found))
        return result, done

    def _rows(self, prescribed: Prescribed) -> tuple[ClosureRows, list[_Choice]]:
        """Return the rows of closures and prescribed frames, and the choice that was good last, if any."""
        if prescribed.kind not in self._known:
            if len(self._known) >= KINDS:
                self._known.clear()
            pairs = [self._pair(name, mask) for name, mask in prescribed.frames]
            self._known[prescribed.kind] = ClosureRows(self._kinematics, self._sweep, pairs), []
        return self._known[prescribed.kind]

    def _pair(self, name: str, mask: BoolArray) -> Pair:
        frame = self._kinematics.frame(name, "frames", InputError)
        ends = (0, pin.SE3.Identity(), frame.parentJoint, frame.placement.copy())
        return Pair(ends, tuple(int(i) for i in np.flatnonzero(mask)), at_first=False)

    def _block(
        self,
        q: FloatArray,
        v: FloatArray,
        prescribed: Prescribed,
        external: Mapping[str, FloatArray],
        joint_forces: FloatArray,
    ) -> tuple[BoolArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return where it is good; forces, accelerations, residual, closure errors."""
        closures, known = self._rows(prescribed)
        samples, size = self._sweep.moving(q, v), self._kinematics.size
        frames = closures.frames(samples)
        rows, errors = closures.jacobian(q, samples, frames), closures.errors(q, frames)
        J, wanted = rows[:, :size], -closures.drift(q, samples, frames, v)
        wanted[:, size:] += prescribed.of_frames
        fits = largest(errors) <= np.maximum(TIGHT, rounding(q))
        fits &= largest(apply(J, v)) <= ACCURACY * np.maximum(1.0, largest(v))
        acting = joint_forces + generalised(self._kinematics, self._sweep, samples, external)
        tau: FloatArray = np.zeros((len(q), len(self._actuated)))
        a: FloatArray = np.zeros(v.shape)
        nothing = np.zeros(len(q), dtype=bool), tau, a, np.zeros(len(q)), errors
        if not fits.any():
            return nothing
        first = int(np.argmax(fits))
        for _ in range(_CHOICES):
            fresh = not known
            if fresh:
                chosen = self._choice(rows[first], size, prescribed.at)
                if chosen is None:
                    break
                known.append(chosen)
            a[:, prescribed.at] = prescribed.values
            motions, well = self._motions(known[0], rows, wanted, a, prescribed.at, self._inertia(q))
            if (fits & well).any() or fresh:
                break
            known.clear()  # it does not fit here any more
        else:
            return nothing
        if not known:
            return nothing
        tau, a, force, scale = self._solution(motions, q, v, a, acting)
        residual = largest(apply(np.swapaxes(motions.N, -1, -2), force))
        opening = largest(apply(rows, a) - wanted)
        fits &= well & (residual <= SURELY * scale)
        fits &= opening <= ACCURACY * np.maximum(1.0, largest(a))
        if not fits[first]:
            known.clear()
        return fits, tau, a, residual, errors

    def _choice(self, rows: FloatArray, size: int, at: IndexArray) -> _Choice | None:
        """Return independent rows, joints that follow by these, and idle ones; None if there are none."""
        rank = Decomposition.of(rows[:size]).rank
        closures, of_frames = independent_rows(rows[:size], rank), np.arange(size, len(rows))
        chosen, rest = np.concatenate((closures, of_frames)), np.setdiff1d(np.arange(rows.shape[1]), at)
        dependent = rest[independent_rows(rows[chosen][:, rest].T, len(chosen))]
        if len(closures) < rank or len(dependent) < len(chosen):
            return None
        left = np.setdiff1d(np.arange(size), closures)
        return _Choice(chosen, left, dependent, np.setdiff1d(rest, dependent))

    def _inertia(self, q: FloatArray) -> FloatArray:
        """Return the mass matrices (n, nv, nv) of the tree: the upper triangles, with half the diagonals."""
        M = np.empty((len(q), self._model.nv, self._model.nv))
        for q_i, M_i in zip(q, M, strict=True):
            np.multiply(pin.crba(self._model, self._data, q_i), self._upper, out=M_i)
        return M

    def _motions(
        self,
        choice: _Choice,
        rows: FloatArray,
        wanted: FloatArray,
        a: FloatArray,
        at: IndexArray,
        M: FloatArray,
    ) -> tuple[_Motions, BoolArray]:
        """Return the free motions, and where they are good; enter the joints that follow into a (n, nv)."""
        chosen, dependent, free = rows[:, choice.rows], choice.dependent, np.concatenate((at, choice.idle))
        count, of_frames = len(rows), rows.shape[1] - self._kinematics.size
        unit = np.zeros((count, len(choice.rows), of_frames))
        unit[:, len(choice.rows) - of_frames :] = np.eye(of_frames)
        target = wanted[:, choice.rows] - apply(chosen[:, :, at], a[:, at])
        Rd, Rf = chosen[:, :, dependent], chosen[:, :, free]
        x = solve(Rd, with_probes(np.concatenate((target[..., None], unit, -Rf), axis=2)))
        a[:, dependent] = x[:, :, PROBES]
        N = np.zeros((count, rows.shape[2], of_frames + len(free)))
        N[:, free, of_frames + np.arange(len(free))] = 1.0
        N[:, dependent] = x[:, :, PROBES + 1 :]
        well = (norms(Rd) * inverse_norms(x) <= 1.0 / WELL) & (norms(N) <= 1.0 / WELL)
        if len(choice.left):
            tolerance = RANK_TOLERANCE * norms(rows) / np.sqrt(rows.shape[2])
            well &= norms(rows[:, choice.left] @ N) <= tolerance
        driven = of_frames + len(at)
        P, Z = N[:, :, :driven], N[:, :, driven:]
        T: FloatArray = P
        H: FloatArray = np.zeros((count, 0, 0))
        if Z.shape[2]:
            MZ = M @ Z + np.swapaxes(M, -1, -2) @ Z
            H = inverse(np.swapaxes(Z, -1, -2) @ MZ)
            T = P - Z @ (H @ (np.swapaxes(MZ, -1, -2) @ P))
        G = inverse(np.swapaxes(T[:, self._actuated], -1, -2))
        return _Motions(N, T, Z, H, G), well

    def _solution(
        self, motions: _Motions, q: FloatArray, v: FloatArray, a: FloatArray, acting: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return forces, accelerations, what closures have to bear, and how large the forces in it are."""
        tau: FloatArray = np.zeros((len(q), len(self._actuated)))
        a = np.where(np.isfinite(a), a, 0.0)
        pool = self._pool

        def force() -> FloatArray:
            f = np.array(pin.rneaInParallel(1, pool, q.T, v.T, a.T)).T - acting
            f[:, self._actuated] -= tau
            return f

        transposed = [np.swapaxes(free, -1, -2) for free in (motions.T, motions.Z, motions.N)]
        f = force()
        for _ in range(_SOLUTIONS):
            more = apply(motions.G, apply(transposed[0], f))
            tau = tau + more
            f[:, self._actuated] -= more
            a = a - apply(motions.Z, apply(motions.H, apply(transposed[1], f)))
            a = np.where(np.isfinite(a), a, 0.0)
            f = force()
            if np.all(largest(apply(transposed[2], f)) <= NO_CHANGE * np.maximum(largest(f), largest(tau))):
                break
        return tau, a, f, np.maximum(largest(f), largest(tau))
