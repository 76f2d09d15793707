"""`FollowingLoop`: the motion of a whole tree along one of its actuated joints, compiled."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, frozen_array, shown
from p3dof._base.errors import InputError, ModelError
from p3dof.loops.compiled import build
from p3dof.loops.compiled.compiled_functions import CompiledFunctions
from p3dof.loops.compiled.printing import sweep_source
from p3dof.loops.compiled.results import CompiledDynamics, with_general
from p3dof.loops.compiled.sweep import Sweep
from p3dof.loops.loop_model import External

_JUMP = 0.5
"""What part of a step between two samples may be unforeseen."""
_STRIDE, _MOST = 0.2, 200
"""Longest way of a joint between two assemblies, towards where a lane starts [m or rad]; how many."""
_SWEEP = ("integrate", "step", "motion")


class FollowingLoop(CompiledFunctions):
    """A compiled robot that follows motions of its actuated joints."""

    _sweep: Sweep | None = None

    def complete(
        self,
        time: ArrayLike,
        target: ArrayLike,
        velocity: ArrayLike,
        acceleration: ArrayLike,
        external: External | None = None,
        joint_forces: ArrayLike | None = None,
        inertias: Mapping[str, ArrayLike] | None = None,
        guess: ArrayLike | None = None,
        steps: int = 2,
    ) -> CompiledDynamics:
        """Return the motion of the whole tree along a motion of the actuated joints, and its forces.

        Every sample starts where velocity and acceleration of the one before lead, and takes a fixed number
        of steps of Newton's method.

        Parameters
        ----------
        time : (N,) array
            Times of the samples, rising [s].
        target, velocity, acceleration : (N, n_actuated) array
            Values of the actuated joints [m or rad] and their rates.
        external, joint_forces, inertias
            As in `inverse_dynamics`.
        guess : (nq,) array, optional
            Where the first sample starts; by default the reference configuration.
        steps : int
            Of Newton's method.

        Returns
        -------
        CompiledDynamics
            With ``q``, ``v``, ``a``, ``tau`` and ``lambda_``.

        Raises
        ------
        ModelError
            If the actuated joints do not determine the motion.
        InputError
            If an argument has the wrong shape or is not finite, or times do not rise.
        AssemblyError
            If the loops cannot be closed at the first sample, or at one where a part of the motion begins.
        """
        time = frozen_array("time", time, ("N",))
        if np.any(np.diff(time) <= 0):
            raise InputError("time: expected rising times")
        count = len(self._robot.motors)
        motion = [
            frozen_array(name, value, (len(time), count))
            for name, value in (
                ("target", target),
                ("velocity", velocity),
                ("acceleration", acceleration),
            )
        ]
        if isinstance(steps, bool) or not isinstance(steps, int) or not 1 <= steps <= 100:
            raise InputError(f"steps: expected a whole number from 1 to 100, got {shown(steps)}")
        sweep = self._sweeper()
        load = self._load(len(time), external, joint_forces, inertias)
        order = [motor for *_, motor in self.follow_places()]
        starts = self._starts(sweep, motion[0], guess)
        found = sweep(time, [part[:, order] for part in motion], load, starts, steps, self._threads)
        self._doubt_jumps(found, time, starts)
        near = dict(enumerate(found["q"]))

        def alone(i: int) -> dict[str, ArrayLike]:
            loop, (forces, joints) = self._alone(i, load)
            good = near[i - 1] if i and i - 1 in near else guess
            state = loop.complete(motion[0][i], motion[1][i], motion[2][i], guess=good)
            near[i] = np.array(state.q)
            done = loop.inverse_dynamics(state.q, state.v, state.a, forces, joints)
            return {"q": state.q, "v": state.v, "a": state.a, "tau": done.tau, "lambda_": done.lambda_}

        return with_general(found, alone, ("q", "v", "a", "tau", "lambda_"), single=False)

    def _sweeper(self) -> Sweep:
        if not self.determined:
            raise ModelError(
                "the actuated joints do not determine the motion: complete_batch or hybrid_dynamics do it"
            )
        if self.level == "numpy":
            raise ModelError("following a motion needs a C compiler; complete_batch does it without one")
        with self._making:
            if self._sweep is None:
                functions = [self.function(name) for name in _SWEEP]
                (library,) = build.libraries([sweep_source(self._robot, functions)], self.level)
                self._sweep = Sweep(functions[-1], library)
            return self._sweep

    def _doubt_jumps(
        self,
        found: Mapping[str, FloatArray],
        time: FloatArray,
        starts: Mapping[int, FloatArray],
    ) -> None:
        """Doubt the samples of lanes that do not go on where the lane before ends: on another assembly."""
        model, edges = self._loop.model, [*sorted(starts), len(time)]
        for first, stop in pairwise(edges):
            if first == 0:
                continue
            dt, before = time[first] - time[first - 1], first - 1
            rate = (found["v"][before] + found["v"][first]) / 2
            there = pin.integrate(model, found["q"][before], dt * rate)
            off = np.abs(pin.difference(model, there, found["q"][first])).max()
            # The trapezoidal rule is off by dt³/12 of the jerk; a jump is off by the size of the mechanism.
            change = dt * np.abs(found["v"][first] - found["v"][before]).max()
            if not off <= _JUMP * (self._robot.length * 1e-3 + change + dt * np.abs(rate).max()):
                found["trusted"][first:stop] = -1.0

    def _starts(self, sweep: Sweep, target: FloatArray, guess: ArrayLike | None) -> dict[int, FloatArray]:
        """Return closed configurations where lanes start, each from the one before."""
        wanted = sorted({i for *_, lanes in sweep.parts(len(target), self._threads) for i in lanes})
        found: dict[int, FloatArray] = {}
        at, place = self._loop.assemble(target[0], guess=guess).q, 0
        for i in wanted:
            # By the straight way; where that leads to another assembly, the lane before does not end there.
            way = target[i] - target[place]
            ways = max(1, int(np.ceil(np.abs(way).max(initial=0.0) / _STRIDE)))
            for k in range(1, min(ways, _MOST) + 1):
                at = self._loop.assemble(target[place] + way * (k / min(ways, _MOST)), guess=at).q
            found[i], place = np.array(at), i
        return found
