"""The velocity and the acceleration of a whole tree that move a target as asked, its loops staying closed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import AssemblyError
from p3dof._base.threads import Workspace
from p3dof.loops.accuracy import ACCURACY
from p3dof.loops.assembly_results import Assembly, State
from p3dof.loops.closures import ClosurePoint, LoopKinematics, max_abs
from p3dof.loops.linear import Decomposition
from p3dof.loops.partitions import Memory, Split
from p3dof.loops.targets import Target

_FOLLOWS = 1e-9
"""Share of a target's row in one of a closure from which on that follows from the target, too."""


class TargetMotions(Workspace):
    """Completes the motions of one model.

    Parameters
    ----------
    kinematics : LoopKinematics
        The model and its closures.
    """

    def __init__(self, kinematics: LoopKinematics) -> None:
        self.kinematics, self.model = kinematics, kinematics.model
        self._memories: dict[tuple[type, int], Memory] = {}

    def complete(
        self, target: Target, assembly: Assembly, velocity: FloatArray, acceleration: FloatArray
    ) -> State:
        """Find the velocity and the acceleration of the whole tree that move the target as asked.

        Parameters
        ----------
        target : Target
            The target.
        assembly : Assembly
            Its solution.
        velocity, acceleration : (size,) array
            Velocity and acceleration of the target.

        Returns
        -------
        State

        Raises
        ------
        AssemblyError
            If the closed mechanism cannot move the target so.
        """
        k, q = self.kinematics, assembly.q
        closures = k.at(q)
        A = np.concatenate((closures.J, target.jacobian(q)))
        solve, influence, determined = self._solution(closures, A, target)
        b = np.concatenate((np.zeros(k.size), velocity))
        v = solve(b)
        self._check("velocity", A.dot(v) - b, b, v)
        k.move(q, v)
        b = np.concatenate((-k.acceleration(), acceleration - target.drift()))
        a = solve(b)
        self._check("acceleration", A.dot(a) - b, b, a)
        for array in (v, a, influence):
            array.setflags(write=False)
        return State(**vars(assembly), v=v, a=a, determined=determined, influence=influence)

    def _solution(
        self, closures: ClosurePoint, A: FloatArray, target: Target
    ) -> tuple[Callable[[FloatArray], FloatArray], FloatArray, bool]:
        """Return how to solve A x = b, what a unit rate of the target does, and whether that is all.

        A are the rows of the closures, then of the target.
        """
        count, size, nv = len(closures.J), target.size, self.model.nv
        if len(A) >= nv:  # else there is more than one solution
            memory = self._memories.setdefault((type(target), size), Memory(np.arange(nv)))
            split = memory.at(ClosurePoint(closures.q, closures.error, A))
            if split is not None and self._squarely(split, count, nv):
                rows, unit = split.partition.rows, np.zeros((nv, size), order="F")
                unit[nv - size :] = np.eye(size)  # the target's rows are the last ones
                return lambda b: split.solve(b.take(rows)), split.solve(unit), True
        stacked = Decomposition.of(A, closures.rank_tolerance)
        return stacked.solve, stacked.pseudo_inverse[:, count:], stacked.rank == nv

    def _squarely(self, split: Split, count: int, nv: int) -> bool:
        """Whether chosen rows determine every joint, and those left out are of closures and follow from such.

        What the target does is then the same by all of them.
        """
        partition = split.partition
        if len(partition.rows) < nv or not len(partition.left):
            return len(partition.rows) == nv
        of_target = split.weights[np.count_nonzero(partition.rows < count) :]
        return bool(partition.left[-1] < count and np.abs(of_target).max(initial=0.0) <= _FOLLOWS)

    def _check(self, what: str, error: FloatArray, b: FloatArray, x: FloatArray) -> None:
        if error.dot(error) <= ACCURACY**2:
            return  # less than what is always allowed
        worst = max_abs(error)
        if not worst <= ACCURACY * max(1.0, max_abs(b), max_abs(x)):
            raise AssemblyError(
                f"the closed mechanism cannot have this {what}: {worst:.3g} is left over", worst
            )
