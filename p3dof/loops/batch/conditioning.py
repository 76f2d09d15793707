"""The conditioning of many configurations at once; see `p3dof.loops.linear.actuation_of`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.loops.accuracy import WELL
from p3dof.loops.batch.closures import ClosureRows
from p3dof.loops.batch.kinematics import Sweep
from p3dof.loops.batch.linear import (
    PROBES,
    BoolArray,
    IndexArray,
    blocks,
    independent_rows,
    inverse_norms,
    norms,
    sized,
    solve,
    with_probes,
)
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.linear import RANK_TOLERANCE, Decomposition, actuation_of


@dataclass(frozen=True, eq=False)
class Choice:
    """Independent rows of closures, the others, the joints that follow by these, idle ones, all others."""

    rows: IndexArray
    left: IndexArray
    passive: IndexArray
    idle: IndexArray
    free: IndexArray


def choose(J: FloatArray, actuated_v: IndexArray) -> Choice:
    """Return independent rows, and the joints that follow by these.

    Parameters
    ----------
    J : (rows, nv) array
        The closures' Jacobian.
    actuated_v : (n_actuated,) array of int
        Joints that are to be among the others, first.
    """
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
    """The conditioning of one model at many configurations.

    Parameters
    ----------
    kinematics : LoopKinematics
        The model and its closures.
    sweep : Sweep
        The model.
    closures : ClosureRows
        Its closures.
    actuated_v : (n_actuated,) array of int
        Indices of the actuated joints in v.
    """

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
            # of 1; the inverse of E (NᵀN)⁻¹ Eᵀ is what elimination of the idle joints leaves of NᵀN.
            across = square[:, count:, :count]
            more = np.linalg.solve(square[:, count:, count:], across)
            square = square[:, :count, :count] - np.swapaxes(across, -1, -2) @ more
        return 1.0 / np.sqrt(np.linalg.eigvalsh(square).max(axis=1, initial=1.0)), np.asarray(well)


def follow(others: FloatArray, weights: FloatArray, J: FloatArray, size: FloatArray) -> BoolArray:
    """Whether rows that were left out follow from those that were chosen.

    Parameters
    ----------
    others : (n, left, k) array
        Their entries of the free joints.
    weights : (n, rows, left) array
        What gives their entries of the joints that follow, from those of the chosen rows.
    J : (n, rows, k) array
        The chosen rows' entries of the free joints.
    size : (n,) array
        Norms of all rows.

    Returns
    -------
    (n,) array of bool
    """
    count = J.shape[1] + others.shape[1]
    return follows(others - np.swapaxes(weights, -1, -2) @ J, size, count)


def follows(apart: FloatArray, size: FloatArray, count: int) -> BoolArray:
    """Whether what is left of rows (n, left, k) is nothing beside all rows, of a size (n,) and so many."""
    if not apart.shape[1]:
        return np.ones(len(apart), dtype=bool)
    return np.asarray(norms(apart) <= RANK_TOLERANCE * size / np.sqrt(count))
