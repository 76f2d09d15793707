"""Configurations and motions of a whole tree along those of its actuated joints, compiled."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, frozen_array, shown
from p3dof._base.errors import InputError, ModelError
from p3dof._base.threads import in_threads, shares
from p3dof.loops.assembly import CONTRACTION
from p3dof.loops.closed_tree import External
from p3dof.loops.compiled import build
from p3dof.loops.compiled.compiled_functions import CompiledFunctions
from p3dof.loops.compiled.formulas import MARGIN
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


_PIECE = 0.2  # longest way of a joint in one piece [rad, or share of the robot's unit of length]
_PIECES = 64  # most pieces, as long as none is too long
_SHORTEST = 1 / 64  # least part of a piece
LARGEST_CORRECTION = 0.1  # largest first correction [m or rad]
CONVERGING = 1e-8  # correction behind which the next one is rounding [m or rad]
CONVERGED = 1e-13  # one that is
_STEPS = 6  # most corrections of a piece
_SPACINGS = (64, 8, 1)  # every how many samples are found first, and then in between those

_Flags = NDArray[np.bool_]


class Settled(NamedTuple):
    """Configurations (N, nq), and which of them close the loops at their values (N,)."""

    q: FloatArray
    good: _Flags


class Settler:
    """Finds configurations at values of independent coordinates, the actuated joints or others.

    A few of the samples go straight from where the assembly is known, in short pieces; the others from the
    nearest one that is there already. Every piece must contract as Newton's method does near its solution,
    and must not change the sign of the pivots: so that no sample leaves the assembly unnoticed.
    """

    def __init__(self, compiled: CompiledFunctions) -> None:
        self._compiled = compiled
        places = compiled.follow_places()
        self._at = np.array([at for at, *_ in places], dtype=int)
        self._circle = np.array([circle for _, circle, _ in places], dtype=bool)
        self._longest = np.array(
            [_PIECE * (compiled.length if slides else 1.0) for slides in compiled.slides]
        )
        independent = compiled.independent_places
        self._columns = [independent.index(place) for place in compiled.followed]
        self.order = np.array([motor for *_, motor in places], dtype=int)
        """Motors in the order of the independent coordinates."""

    def __call__(self, start: FloatArray, values: FloatArray) -> Settled:
        """Return configurations at values (N, n_actuated), from one that is closed."""
        wanted, count = values[:, self.order], len(values)
        q, good = np.tile(start, (count, 1)), np.zeros(count, dtype=bool)
        for spacing in _SPACINGS:
            known = np.flatnonzero(good)
            rest = np.setdiff1d(np.append(np.arange(0, count, spacing), count - 1), known)
            if not len(rest):
                continue
            if len(known):
                right = np.clip(np.searchsorted(known, rest), 1, max(len(known) - 1, 1))
                near = known[np.minimum(right, len(known) - 1)]
                left = known[right - 1]
                near = np.where(np.abs(left - rest) <= np.abs(near - rest), left, near)
                q[rest], good[rest] = self._follow(q[near], wanted[rest])
                rest = rest[~good[rest]]
            if len(rest):
                q[rest], good[rest] = self._follow(np.tile(start, (len(rest), 1)), wanted[rest])
        return Settled(q, good)

    def _follow(self, q: FloatArray, wanted: FloatArray) -> Settled:
        """Go straight to the values that are wanted, in pieces, halved where one is too long."""
        begin, q = self.values(q), np.array(q)
        way = wanted - begin
        way = np.where(self._circle, np.arctan2(np.sin(way), np.cos(way)), way)
        with np.errstate(invalid="ignore"):
            pieces = np.ceil(np.abs(way / self._longest).max(axis=1, initial=1.0))
        longest = np.where(pieces <= _PIECES, 1.0 / pieces, 0.0)  # shares of the way
        piece, done = longest.copy(), np.zeros(len(q))
        for _ in range(2 * _PIECES):
            at = np.flatnonzero((done < 1.0) & (piece >= _SHORTEST * longest) & (longest > 0.0))
            if not len(at):
                break
            end = np.where(done[at] + 1.5 * piece[at] < 1.0, done[at] + piece[at], 1.0)
            there = self._compiled.rows(
                "completion", {"q": q[at], **self._rates(way[at] * (end - done[at])[:, None])}
            )
            moved = self._compiled.rows("integrate", {"q": q[at], "dq": there["v"]})["q"]
            self.enter(moved, begin[at] + way[at] * end[:, None])
            new, fits = self._corrected(moved)
            fits &= there["orientation"][:, 0] * self._orientation(new) > 0
            q[at[fits]], done[at[fits]] = new[fits], end[fits]
            piece[at] = np.where(fits, np.minimum(2.0 * piece[at], longest[at]), piece[at] / 2.0)
        return Settled(q, done >= 1.0)

    def _corrected(self, q: FloatArray) -> Settled:
        good, limit = np.ones(len(q), dtype=bool), np.full(len(q), LARGEST_CORRECTION)
        for _ in range(_STEPS):
            found = self._compiled.rows("step", {"q": q})
            size = np.abs(found["q"] - q).max(axis=1, initial=0.0)
            good &= (size <= np.maximum(limit, CONVERGING)) & (found["margin"][:, 0] > MARGIN)
            q, limit = found["q"], CONTRACTION * size
            if not good.any() or size[good].max() <= CONVERGED:
                break
        return Settled(q, good & (size <= CONVERGING))

    def _orientation(self, q: FloatArray) -> FloatArray:
        given = {"q": q, **self._rates(np.zeros((len(q), len(self.order))))}
        return self._compiled.rows("completion", given)["orientation"][:, 0]

    def _rates(self, speeds: FloatArray) -> dict[str, FloatArray]:
        """Return speeds of the coordinates as those of all independent ones."""
        rates = np.zeros((len(speeds), len(self._compiled.independent)))
        rates[:, self._columns] = speeds
        return {"v_independent": rates, "a_independent": np.zeros_like(rates)}

    def values(self, q: FloatArray) -> FloatArray:
        """Return the values of the coordinates in configurations (N, nq)."""
        values: Any = q[:, self._at]
        turned = np.arctan2(q[:, np.minimum(self._at + 1, q.shape[1] - 1)], values)
        return np.asarray(np.where(self._circle, turned, values))

    def enter(self, q: FloatArray, values: FloatArray) -> None:
        """Enter values of the coordinates, in the order of the independent ones, into configurations."""
        q[:, self._at] = np.where(self._circle, np.cos(values), values)
        circles = self._circle
        q[:, self._at[circles] + 1] = np.sin(values[:, circles])
