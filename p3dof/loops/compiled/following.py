"""`FollowingLoop`: the motion of a whole tree along one of its actuated joints, compiled."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, frozen_array, shown
from p3dof._base.errors import InputError, ModelError
from p3dof._base.threads import in_threads, shares
from p3dof.loops.closed_tree import External
from p3dof.loops.compiled import build
from p3dof.loops.compiled.compiled_functions import CompiledFunctions
from p3dof.loops.compiled.function import SHARE, Function, pointers, sizes
from p3dof.loops.compiled.printing import sweep_source
from p3dof.loops.compiled.results import CompiledDynamics, with_general


class _Way(ctypes.Structure):
    _fields_ = (
        ("count", ctypes.c_ssize_t),
        ("part", ctypes.c_ssize_t),
        ("steps", ctypes.c_int),
        ("time", ctypes.c_void_p),
        ("start", ctypes.c_void_p),
        ("target", ctypes.c_void_p),
        ("velocity", ctypes.c_void_p),
        ("acceleration", ctypes.c_void_p),
        ("load", ctypes.c_void_p),
        ("strides", ctypes.c_void_p),
        ("q", ctypes.c_void_p),
        ("v", ctypes.c_void_p),
        ("a", ctypes.c_void_p),
        ("out", ctypes.c_void_p),
    )


class LaneSweep:
    """What follows a motion: every lane a part of it."""

    def __init__(self, motion: Function, library: ctypes.CDLL) -> None:
        self._motion, self._sweep = motion, library.sweep
        self._sweep.argtypes, self._sweep.restype = [ctypes.c_void_p], None
        library.width.restype = ctypes.c_int
        self.width: int = library.width()  # lanes

    def parts(self, count: int, threads: int) -> list[tuple[int, int, list[int]]]:
        """Return how samples are shared: first, behind the last, and where lanes start, for every thread."""
        found = []
        for start, stop in shares(count, threads, SHARE):
            part = -(-(stop - start) // self.width)
            found.append((start, stop, [min(start + k * part, stop - 1) for k in range(self.width)]))
        return found

    def __call__(
        self,
        time: FloatArray,
        motion: Sequence[FloatArray],
        load: Mapping[str, FloatArray],
        starts: Mapping[int, FloatArray],
        steps: int,
        threads: int,
    ) -> dict[str, FloatArray]:
        """Return the motion of the tree, and what belongs to it; dict of str to (N, size) array."""
        count, outputs = len(time), dict(self._motion.outputs)
        nq = len(next(iter(starts.values())))
        found: dict[str, FloatArray] = {}
        for name, size in {"q": nq, **outputs}.items():
            found[name] = np.empty((count, size))
        groups = [np.ascontiguousarray(array) for array in load.values()]
        strides = [array.shape[1] if array.ndim == 2 else 0 for array in groups]
        arrays = [np.ascontiguousarray(array) for array in (time, *motion)]

        def run(part: tuple[int, int, list[int]]) -> None:
            first, stop, lanes = part
            start = np.ascontiguousarray([starts[i] for i in lanes])
            at = [array.ctypes.data + array.strides[0] * first for array in arrays]
            loads = pointers([g.ctypes.data + 8 * s * first for g, s in zip(groups, strides, strict=True)])
            steps_of = sizes(strides)
            places = {name: array.ctypes.data + array.strides[0] * first for name, array in found.items()}
            rest = pointers([places[name] for name in outputs if name not in ("v", "a")])
            way = _Way(
                stop - first,
                -(-(stop - first) // self.width),
                steps,
                at[0],
                start.ctypes.data,
                *at[1:],
                ctypes.addressof(loads),
                ctypes.addressof(steps_of),
                *(places[name] for name in ("q", "v", "a")),
                ctypes.addressof(rest),
            )
            self._sweep(ctypes.addressof(way))

        in_threads(run, self.parts(count, threads))
        return found


_JUMP = 0.5  # what part of a step between two samples may be unforeseen
_STRIDE, _MOST = 0.2, 200
"""Longest way of a joint between two assemblies, towards where a lane starts [m or rad]; how many."""
_SWEEP = ("integrate", "step", "motion")


class FollowingLoop(CompiledFunctions):
    """A compiled robot that follows motions of its actuated joints."""

    _sweep: LaneSweep | None = None

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
        """Return ``q``, ``v``, ``a``, ``tau`` and ``lambda_`` along a motion of the actuated joints.

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
            for name, value in (("target", target), ("velocity", velocity), ("acceleration", acceleration))
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

    def _sweeper(self) -> LaneSweep:
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
                self._sweep = LaneSweep(functions[-1], library)
            return self._sweep

    def _doubt_jumps(
        self, found: Mapping[str, FloatArray], time: FloatArray, starts: Mapping[int, FloatArray]
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

    def _starts(self, sweep: LaneSweep, target: FloatArray, guess: ArrayLike | None) -> dict[int, FloatArray]:
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
