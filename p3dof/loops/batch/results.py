"""What the dynamics of many samples takes and returns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import P3dofError
from p3dof.loops.batch.linear import BoolArray, IndexArray
from p3dof.loops.hybrid_results import HybridDynamics


class BatchEvidence:
    """What is found out about many samples when it is asked for, and once.

    Parameters
    ----------
    known : (N,) array
        The conditioning of each sample, where it is known.
    find : callable
        Finds that of samples, by their numbers.
    """

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
class BatchInverseDynamics:
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
class BatchHybridDynamics:
    """Actuator forces that produce prescribed accelerations, and the motions with them; see `HybridDynamics`.

    Parameters
    ----------
    tau : (N, n_actuated) array
        Forces of the actuated joints [N or N m]; NaN in the rows of samples that failed.
    a : (N, nv) array
        Accelerations of the whole tree.
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
class BatchForwardDynamics:
    """Accelerations that actuator forces produce, and the evidence for them; see `ForwardDynamics`.

    Parameters
    ----------
    a : (N, nv) array
        Accelerations of the whole tree; NaN in the rows of samples that failed.
    residual : (N,) array
        Largest error of the full equation of motion [N or N m].
    closure_residual : (N,) array
        Largest relative acceleration that is left at a closure [m/s² or rad/s²].
    closure_error : (N, rows) array
        How far each closure is open [m or rad].
    errors : dict of int to P3dofError
        What went wrong, by sample.
    """

    a: FloatArray
    residual: FloatArray
    closure_residual: FloatArray
    closure_error: FloatArray
    errors: dict[int, P3dofError]


@dataclass(frozen=True, eq=False)
class Prescribed:
    """Prescribed accelerations of many samples.

    Parameters
    ----------
    at : (n,) array of int
        Indices in v of joints.
    values : (N, n) array
        Their accelerations.
    frames : tuple of (str, (6,) array of bool)
        Frames, and which components of their accelerations are prescribed.
    of_frames : (N, m) array
        These components, one frame after the other.
    """

    at: IndexArray
    values: FloatArray
    frames: tuple[tuple[str, BoolArray], ...]
    of_frames: FloatArray

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
