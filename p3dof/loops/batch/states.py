"""Many samples at once: Pinocchio's kinematics sample by sample, all linear algebra over arrays.

It is meant for mechanisms whose target determines every joint; redundant closures are welcome. Every sample
is checked: closed loops, rank, conditioning, residuals. One that does not pass, and any other mechanism, goes
through the methods for single samples, which decide. `p3dof.loops.batch.dynamics` goes on from here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import AssemblyError, P3dofError
from p3dof.loops.accuracy import ACCURACY, WELL
from p3dof.loops.assembly import TOLERANCE, Assembler
from p3dof.loops.assembly_model import TargetLike
from p3dof.loops.assembly_results import Assembly, State
from p3dof.loops.batch.assembly import BatchSystem, Goals, settle
from p3dof.loops.batch.dynamics import redundant
from p3dof.loops.batch.kinematics import Sweep
from p3dof.loops.batch.linear import FEW, BoolArray, IndexArray, apply, blocks, largest, norms
from p3dof.loops.batch.targets import Targets
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.coordinates import rounding
from p3dof.loops.loop_model import LoopModel
from p3dof.loops.targets import NoTarget


@dataclass(frozen=True, eq=False)
class BatchStates:
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
    """Assembles one model at many samples.

    Parameters
    ----------
    loop : LoopModel
        The model, which decides on what cannot be treated here.
    kinematics : LoopKinematics
        Its closures.
    assembler : Assembler
        Its assembler.
    """

    def __init__(self, loop: LoopModel, kinematics: LoopKinematics, assembler: Assembler) -> None:
        self._loop, self._kinematics, self._assembler = loop, kinematics, assembler
        self._sweep = Sweep(loop.model)

    def complete(
        self,
        target: Targets,
        motion: tuple[FloatArray, FloatArray],
        guess: FloatArray | None,
        near: FloatArray | None,
        stop: bool,
    ) -> BatchStates:
        """Find configurations, velocities and accelerations from the motion of a target.

        Parameters
        ----------
        target : Targets
            The target.
        motion : tuple of (N, size) array
            Its velocity and acceleration, in the order of its components.
        guess, near, stop
            As for `p3dof.ClosedLoopModel.complete_batch`.

        Returns
        -------
        BatchStates
        """
        model, count, goals = self._loop.model, len(motion[0]), target.goals(self._kinematics)
        q, v, a = (np.full((count, size), np.nan) for size in (model.nq, model.nv, model.nv))
        G = np.full((count, model.nv, goals.size), np.nan)
        columns = list(self._loop.actuated_v)
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
                    state = complete_near(self._loop, goal, motion[0][i], motion[1][i], first, guess)
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
            start = self._assembler.assemble(NoTarget(self._loop.model.nv), guess, TOLERANCE)
        except AssemblyError:
            return None
        usable = start.same_assembly and system.choose(start.q, start.rank)
        return (system, start) if usable else None

    def _moving(
        self,
        system: BatchSystem,
        start: Assembly,
        block: IndexArray,
        motion: tuple[FloatArray, FloatArray],
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


def complete_near(
    loop: LoopModel,
    target: TargetLike,
    velocity: FloatArray,
    acceleration: FloatArray,
    near: FloatArray | None,
    guess: FloatArray | None = None,
) -> State:
    """Complete one state from a configuration nearby; where that leaves the assembly, from the guess.

    Parameters
    ----------
    loop : LoopModel
        The model.
    target : FrameTarget, (n_actuated,) array, mapping of str to float, or a list of these
        The target.
    velocity, acceleration : (size,) array
        Its motion.
    near : (nq,) array, optional
        Where to start.
    guess : (nq,) array, optional
        Where to start then; the reference configuration by default.

    Returns
    -------
    State

    Raises
    ------
    AssemblyError
        As `LoopModel.complete` from the guess.
    """
    if near is not None:
        try:
            state = loop.complete(target, velocity, acceleration, guess=near)
            if state.same_assembly:
                return state
        except AssemblyError:
            pass
    return loop.complete(target, velocity, acceleration, guess=guess)


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
