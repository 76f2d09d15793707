"""Closures and couplings of many configurations at once; see `p3dof.loops.closures`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.loops.batch.kinematics import Frames, Pair, RelativeRows, Samples, Sweep
from p3dof.loops.batch.linear import apply
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.rotations import rotation_vector, turned_rates


class ClosureRows:
    """Rows of closures and couplings, then of further pairs of frames, over samples.

    Parameters
    ----------
    kinematics : LoopKinematics
        The closures and couplings.
    sweep : Sweep
        The model.
    pairs : sequence of Pair
        Further pairs of frames.
    """

    def __init__(self, kinematics: LoopKinematics, sweep: Sweep, pairs: Sequence[Pair] = ()) -> None:
        self._kinematics = kinematics
        closures = _closure_pairs(kinematics)
        self._relative = RelativeRows(sweep, [*closures, *pairs])
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

    def frames(self, samples: Samples) -> Frames:
        """Return both frames of every closure, then of every further pair."""
        return self._relative.frames(samples)

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


def _closure_pairs(kinematics: LoopKinematics) -> list[Pair]:
    """Return the closures of a model as pairs: all but a ``6d`` follow the point at frame 2."""
    return [
        Pair(ends, tuple(range(3 if closure.kind == "3d" else 6)), closure.kind == "6d")
        for closure, ends in zip(kinematics.closures, kinematics.ends, strict=True)
    ]
