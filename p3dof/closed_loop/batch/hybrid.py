"""Hybrid dynamics of many samples at once; see `p3dof.closed_loop.hybrid`.

As many independent rows of the closures' Jacobian J as there are joints that are neither prescribed nor idle
give the rates of these d from those of the others f, so that all is algebra of stacked arrays:

    a_d = -Jd⁻¹ (J̇ v + Jf a_f),    N = [1; -Jd⁻¹ Jf]

The columns of N of the prescribed joints and of the idle ones are P and Z there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from p3dof.checks import FloatArray
from p3dof.closed_loop.batch.closures import ClosureRows
from p3dof.closed_loop.batch.dynamics import CONSISTENT, TIGHT, WELL, generalised, redundant
from p3dof.closed_loop.batch.kinematics import Sweep
from p3dof.closed_loop.batch.linear import (
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
from p3dof.closed_loop.closures import LoopKinematics
from p3dof.closed_loop.coordinates import rounding
from p3dof.closed_loop.hybrid_results import HybridDynamics
from p3dof.closed_loop.linear import Decomposition
from p3dof.closed_loop.loop_model import LoopModel
from p3dof.errors import P3dofError

_BLOCK = 512
"""Samples that are treated together: matrices as large as the mass matrix shall fit into the cache."""
_SEEN = 1e-5
"""Least conditioning of the prescribed accelerations in a batch."""
_ACCURACY = 1e-10
"""Largest residual in a batch, relative to the forces in it."""
_ENOUGH = 1e-13
"""The same, from which on nothing is refined."""
_SOLUTIONS = 2
"""Solutions of the linear equations at most; the second one refines the first."""


@dataclass(frozen=True, eq=False)
class BatchHybridDynamics:
    """Actuator forces that produce prescribed accelerations, and the motions with them; see `HybridDynamics`.

    Parameters
    ----------
    tau : (N, n_actuated) array
        Forces of the actuated joints [N or N m]; NaN in the rows of samples that failed.
    a : (N, nv) array
        Accelerations of the whole tree.
    conditioning : (N,) array
        Smallest singular value of S N, as in `HybridDynamics`.
    residual : (N,) array
        Largest error of the full equation of motion [N or N m].
    closure_error : (N, rows) array
        How far each closure is open [m or rad].
    errors : dict of int to P3dofError
        What went wrong, by sample.
    """

    tau: FloatArray
    a: FloatArray
    conditioning: FloatArray
    residual: FloatArray
    closure_error: FloatArray
    errors: dict[int, P3dofError]

    def put(self, i: int, one: HybridDynamics, gaps: FloatArray) -> None:
        """Enter what was found of one sample alone, `gaps` (rows,) being how far its closures are open."""
        self.tau[i], self.a[i] = one.tau, one.a
        self.conditioning[i], self.residual[i] = one.conditioning, one.residual
        self.closure_error[i] = gaps

    @classmethod
    def empty(cls, count: int, actuated: int, nv: int, rows: int) -> BatchHybridDynamics:
        """Return results of samples of which nothing is known."""
        tau, a, gaps = (np.full((count, size), np.nan) for size in (actuated, nv, rows))
        conditioning, residual = np.full((2, count), np.nan)
        return cls(tau, a, conditioning, residual, gaps, {})


@dataclass(frozen=True, eq=False)
class _Motions:
    """The free motions of n samples that have the same independent rows and joints."""

    N: FloatArray
    T: FloatArray
    Z: FloatArray
    H: FloatArray
    G: FloatArray
    """Inverses of Zᵀ M Z, and of Tᵀ B."""


class BatchHybrid:
    """Hybrid dynamics of one model at many samples; it owns workspaces.

    Parameters
    ----------
    loop : LoopModel
        The model.
    kinematics : LoopKinematics
        Its closures.
    """

    def __init__(self, loop: LoopModel, kinematics: LoopKinematics) -> None:
        self._model, self._kinematics, self._actuated = loop.model, kinematics, loop.actuated_v
        self._sweep, self._data = Sweep(loop.model), loop.model.createData()
        self._closures = ClosureRows(kinematics, self._sweep)
        self._upper = np.triu(np.ones((loop.model.nv, loop.model.nv))) - np.eye(loop.model.nv) / 2

    def solve(
        self,
        q: FloatArray,
        v: FloatArray,
        prescribed: tuple[IndexArray, FloatArray],
        external: Mapping[str, FloatArray],
        joint_forces: FloatArray,
    ) -> tuple[BatchHybridDynamics, BoolArray]:
        """Return what was found, and for which samples; the others are for the method for single ones.

        Parameters
        ----------
        q : (N, nq) array
            Configurations.
        v : (N, nv) array
            Velocities.
        prescribed : tuple of (n,) and (N, n) array
            Indices in v, and accelerations.
        external : mapping of str to (N, 6) array
            Wrenches on frames.
        joint_forces : (N, nv) array
            What acts in the joints besides the actuators.

        Returns
        -------
        result : BatchHybridDynamics
        good : (N,) array of bool
        """
        count = len(q)
        sizes = len(self._actuated), self._model.nv, self._kinematics.size
        result = BatchHybridDynamics.empty(count, *sizes)
        done = np.zeros(count, dtype=bool)
        at, values = prescribed
        if count >= FEW and len(at) == len(self._actuated):
            for block in blocks(count, _BLOCK):
                loads = {name: wrench[block] for name, wrench in external.items()}
                given = at, values[block]
                with np.errstate(all="ignore"):  # what is not a number passes no test
                    good, *found = self._block(q[block], v[block], given, loads, joint_forces[block])
                which = block[good]
                done[which] = True
                for all_, some in zip(vars(result).values(), found, strict=False):
                    all_[which] = some[good]
        return result, done

    def _block(
        self,
        q: FloatArray,
        v: FloatArray,
        prescribed: tuple[IndexArray, FloatArray],
        external: Mapping[str, FloatArray],
        joint_forces: FloatArray,
    ) -> tuple[BoolArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return where it is good; forces, accelerations, conditioning, residual, closure errors."""
        samples = self._sweep.moving(q, v)
        frames = self._closures.frames(samples)
        J, errors = self._closures.jacobian(q, samples, frames), self._closures.errors(q, frames)
        drift = self._closures.drift(q, samples, frames, v)
        fits = largest(errors) <= np.maximum(TIGHT, rounding(q))
        fits &= largest(apply(J, v)) <= CONSISTENT * np.maximum(1.0, largest(v))
        acting = joint_forces + generalised(self._kinematics, self._sweep, samples, external)
        tau: FloatArray = np.empty((len(q), len(self._actuated)))
        a: FloatArray = np.zeros(v.shape)
        conditioning, residual = np.zeros((2, len(q)))
        at, a[:, at] = prescribed
        chosen = self._choice(J[fits][0], at) if fits.any() else None
        if chosen is None:
            return np.zeros(len(q), dtype=bool), tau, a, conditioning, residual, errors
        rows, dependent, idle = chosen
        Jr = J[:, rows]
        Jd = Jr[:, :, dependent]
        K = inverse(Jd)
        a[:, dependent] = -apply(K, drift[:, rows] + apply(Jr, a))
        motions, conditioning = self._motions(Jr, K, self._inertia(q), (at, dependent, idle))
        fits &= norms(Jd) * norms(K) <= WELL
        fits &= redundant(J, motions.N) & (conditioning >= _SEEN)
        tau, a, force, size = self._solution(motions, q, v, a, acting)
        lambda_ = apply(np.swapaxes(K, -1, -2), force[:, dependent])
        residual = largest(force - apply(np.swapaxes(Jr, -1, -2), lambda_))
        opening = largest(apply(J, a) + drift)
        fits &= residual <= _ACCURACY * size
        fits &= opening <= CONSISTENT * np.maximum(1.0, largest(a))
        return fits, tau, a, conditioning, residual, errors

    def _choice(self, J: FloatArray, at: IndexArray) -> tuple[IndexArray, IndexArray, IndexArray] | None:
        """Return independent rows, joints that follow by these, and idle ones; None if there are none."""
        rank = Decomposition.of(J).rank
        rows, rest = independent_rows(J, rank), np.setdiff1d(np.arange(J.shape[1]), at)
        dependent = rest[independent_rows(J[rows][:, rest].T, rank)]
        if len(rows) < rank or len(dependent) < rank:
            return None
        return rows, dependent, np.setdiff1d(rest, dependent)

    def _inertia(self, q: FloatArray) -> FloatArray:
        """Return the mass matrices (n, nv, nv) of the tree: the upper triangles, with half the diagonals."""
        M = np.empty((len(q), self._model.nv, self._model.nv))
        for q_i, M_i in zip(q, M, strict=True):
            np.multiply(pin.crba(self._model, self._data, q_i), self._upper, out=M_i)
        return M

    def _motions(
        self,
        J: FloatArray,
        K: FloatArray,
        M: FloatArray,
        parts: tuple[IndexArray, IndexArray, IndexArray],
    ) -> tuple[_Motions, FloatArray]:
        """Return the free motions, and the conditioning (n,) of the prescribed ones."""
        at, dependent, idle = parts
        free = np.concatenate((at, idle))
        N = np.zeros((len(J), J.shape[2], len(free)))
        N[:, free] = np.eye(len(free))
        N[:, dependent] = -K @ J[:, :, free]
        P, Z = N[:, :, : len(at)], N[:, :, len(at) :]
        MZ = M @ Z + np.swapaxes(M, -1, -2) @ Z
        H = inverse(np.swapaxes(Z, -1, -2) @ MZ)
        T = P - Z @ (H @ (np.swapaxes(MZ, -1, -2) @ P))
        # The rows of the prescribed joints in N are those of 1, so that those of orthonormal motions are the
        # first ones of (NᵀN)^(-1/2).
        square = inverse(np.swapaxes(N, -1, -2) @ N)[:, : len(at), : len(at)]
        seen = np.linalg.eigvalsh(np.where(np.isfinite(square), square, 0.0)).min(axis=1, initial=1.0)
        G = inverse(np.swapaxes(T[:, self._actuated], -1, -2))
        return _Motions(N, T, Z, H, G), np.sqrt(np.maximum(seen, 0.0))

    def _solution(
        self, motions: _Motions, q: FloatArray, v: FloatArray, a: FloatArray, acting: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return forces, accelerations, what closures have to bear, and how large the forces in it are."""
        tau: FloatArray = np.zeros((len(q), len(self._actuated)))
        a = np.where(np.isfinite(a), a, 0.0)
        pool = pin.ModelPool(self._model, 1)  # with a copy of the model as it is now

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
            if np.all(largest(apply(transposed[2], f)) <= _ENOUGH * np.maximum(largest(f), largest(tau))):
                break
        return tau, a, f, np.maximum(largest(f), largest(tau))
