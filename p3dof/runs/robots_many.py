"""`simulate_robot_many`: many runs of any robot, side by side in vector lanes and threads."""

from __future__ import annotations

import copy
import math
import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, Progress, as_floats, frozen_array, positive, shown
from p3dof._base.errors import InputError, P3dofError
from p3dof._base.threads import thread_count
from p3dof._base.time_series.times import evenly, sample_count
from p3dof.loops import ClosedLoopModel
from p3dof.loops.compiled import runs
from p3dof.loops.compiled.kept import Method
from p3dof.loops.compiled.runs import RunsFound
from p3dof.loops.linear import IndexArray
from p3dof.runs.compiled_robot_runs import Acting, acting_in_c, limited, runs_of, step_plan
from p3dof.runs.joint_controllers import JointPD
from p3dof.runs.margins import ROBOT_KINDS, RobotMargins, Stop
from p3dof.runs.plants import CLOSED, ExternalOverTime
from p3dof.runs.robots import ObservedPlant, RobotController, largest_forces, require_robot, simulate_robot
from p3dof.runs.settings import EDGE, ControlLoop, Integration, require_settings

INTERRUPTED = "interrupted"  # why a run was not made


@dataclass(frozen=True, eq=False)
class RobotRuns:
    """Many runs of one robot.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    time : (N,) array
        When each run ended [s].
    q, v : (N, nq) array, (N, nv) array
        Configuration and velocity then; NaN of runs that were not made.
    stop : tuple of N (Stop or None)
        What ended each before its time.
    peak_force, rms_force : (N, n) array
        Largest force of each actuator, and the root of its mean square [N or N m], over the control ticks.
    peak_error, rms_error : (N, n) array
        The same of reference less value of the actuated joints [m or rad]; NaN without a controller.
    gap : (N,) array
        Largest gap of the loops: before they were closed at each step, as the length of the vector of all
        errors [m, rad]; of a run by the robot itself as `RobotRun.gap`.
    margin : (N,) array
        Smallest margin of the compiled partition of speeds; NaN of runs by the robot itself.
    general : (N,) array of bool
        Runs that the robot itself made, as the compiled dynamics was not to be trusted.
    sample_time : (S,) array
        Times of the samples [s], if there are any.
    past : mapping of str to (N, S, size) array
        ``q``, ``v``, ``a``, ``forces`` and ``asked`` at the samples; NaN after the end of a run. A run that
        ended early has no sample at its end.
    seconds : float
        On the clock.
    """

    loop: ClosedLoopModel
    time: FloatArray
    q: FloatArray
    v: FloatArray
    stop: tuple[Stop | None, ...]
    peak_force: FloatArray
    rms_force: FloatArray
    peak_error: FloatArray
    rms_error: FloatArray
    gap: FloatArray
    margin: FloatArray
    general: NDArray[np.bool_]
    sample_time: FloatArray = field(default_factory=lambda: np.zeros(0))
    past: Mapping[str, FloatArray] = field(default_factory=dict)
    seconds: float = 0.0

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        ended = sum(stop is not None for stop in self.stop)
        return f"RobotRuns({self.loop.model.name!r}, {len(self)} runs, {ended} ended early)"

    @property
    def finished(self) -> NDArray[np.bool_]:
        """Which runs went on to their end (N,)."""
        return np.array([stop is None for stop in self.stop], dtype=bool)

    @classmethod
    def empty(cls, loop: ClosedLoopModel, count: int, times: FloatArray) -> RobotRuns:
        """Return runs none of which was made.

        Parameters
        ----------
        loop : ClosedLoopModel
            The robot.
        count : int
            How many.
        times : (S,) array
            Of the samples; none for no histories.
        """
        model, n = loop.model, len(loop.actuated)
        q, v = np.full((count, model.nq), np.nan), np.full((count, model.nv), np.nan)
        force, mean_force, error, mean_error = np.full((4, count, n), np.nan)
        gap, margin = np.full((2, count), np.nan)
        sizes = {"q": model.nq, "v": model.nv, "a": model.nv, "forces": n, "asked": n}
        past = {name: np.full((count, len(times), size), np.nan) for name, size in sizes.items()}
        stop = Stop(INTERRUPTED, 0.0, "the run was not made")
        return cls(
            loop,
            np.zeros(count),
            q,
            v,
            (stop,) * count,
            force,
            mean_force,
            error,
            mean_error,
            gap,
            margin,
            np.zeros(count, dtype=bool),
            times,
            past if len(times) else {},
        )


_BLOCK = 256  # runs between two looks at Ctrl-C, for every thread
_CLOSING = 1e-6  # share of its velocity by which a start may open its loops
EQUAL_STEPS = Integration(scheme="rk4")
AT_1_KHZ = ControlLoop(rate=1000.0)
_PLAIN = ("q", "v", "kp", "kd", "forces", "saturation", "seed")


def simulate_robot_many(
    loop: ClosedLoopModel,
    duration: float,
    columns: Mapping[str, ArrayLike],
    controller: RobotController = None,
    *,
    control: ControlLoop = AT_1_KHZ,
    stop_at: Sequence[str] = ROBOT_KINDS,
    samples: int = 0,
    integration: Integration = EQUAL_STEPS,
    progress: Progress | None = None,
    threads: int | None = None,
) -> RobotRuns:
    """Follow many runs of any robot in time, in C: each in a lane of a vector, whatever its neighbours do.

    Runs whose compiled dynamics is not to be trusted are made again by the robot itself, one after the other.
    All of them are made one after the other, by `simulate_robot`, where there is no C compiler, or what acts
    has no form in lanes: controllers that are called, noise, counts, delays, lags. After Ctrl-C what is done
    is returned.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    duration : float
        How long [s].
    columns : mapping of str to array-like
        What differs between N runs, a row each, or is the same for all: ``q`` (nq,) and ``v`` (nv,), where
        they start; ``kp`` and ``kd`` (n,), gains; ``forces`` (n,), which stay; ``saturation`` (n,);
        ``external.FRAME`` (6,), a wrench on a frame; ``inertia.JOINT`` (10,), inertial parameters of the body
        of a joint, as `pinocchio.Inertia.toDynamicParameters`; ``seed`` (1,), of the noise. At least one has
        N rows.
    controller : JointPD, JointFeedforward, JointComputedTorque or (n_actuated,) array, optional
        As of `simulate_robot`; what is the same for all runs.
    control : ControlLoop
        How it acts, at 1 kHz by default.
    stop_at : sequence of str
        As of `simulate_robot`.
    samples : int
        How many samples of each run to keep, evenly spaced; none by default.
    integration : Integration
        Of scheme ``"rk4"``; its step is 1 ms by default.
    progress : callable, optional
        Called with (done, total) runs.
    threads : int, optional
        Most threads; by default the environment's ``P3DOF_THREADS``, else all processors.

    Raises
    ------
    InputError
        If an argument does not fit, or a run starts with open loops or beyond a limit.
    ModelError
        If the robot cannot be compiled.
    """
    begun = clock.perf_counter()
    require_robot(loop)
    require_settings(control, integration)
    if integration.scheme != "rk4":
        raise InputError(f"integration: expected the scheme 'rk4', got {shown(integration.scheme)}")
    end = positive("duration", duration, InputError)
    times = evenly(0.0, end, sample_count(samples, least=2)) if samples else np.zeros(0)
    many = _Many(loop, _columns(loop, columns), controller, control, integration, stop_at, times, end)
    result = many.result
    try:
        if many.acting is None:
            method: Method = "general" if many.compiled.level == "numpy" else many.compiled
            many.alone(np.arange(many.count), result, progress, method)
        else:
            many.in_c(many.acting, result, progress, thread_count(threads))
    except KeyboardInterrupt:
        pass
    return replace(result, stop=tuple(many.stops), seconds=clock.perf_counter() - begun)


@dataclass(eq=False)
class _Many:
    """Runs that are to be made."""

    loop: ClosedLoopModel
    columns: dict[str, FloatArray]
    controller: RobotController
    control: ControlLoop
    integration: Integration
    stop_at: Sequence[str]
    times: FloatArray
    end: float

    def __post_init__(self) -> None:
        self.count = max(len(array) for array in self.columns.values() if array.ndim == 2)
        model = self.loop.model
        q = self._all(self.columns["q"] if "q" in self.columns else self.loop.assemble().q)
        v = self._all(self.columns.get("v", np.zeros(model.nv)))
        gaps = self.loop.closure_gaps(q).max(axis=1, initial=0.0)
        if gaps.max() > CLOSED:
            worst = int(np.argmax(gaps))
            raise InputError(f"q: the loops of run {worst} are open by {gaps[worst]:.3g} m")
        self.q, self.v = q, v
        self.frames = tuple(n.partition(".")[2] for n in self.columns if n.startswith("external."))
        self.joints = tuple(n.partition(".")[2] for n in self.columns if n.startswith("inertia."))
        plant = ObservedPlant(self.loop, 0.0, ())
        self.margins = RobotMargins(plant, self.stop_at, (), np.concatenate([q[0], v[0]]))
        self.margins.start_at(q)
        at = q[:, self.margins.limited_q]
        beyond = ((at <= self.margins.lower) | (at >= self.margins.upper)).any(axis=1)
        if beyond.any():
            raise InputError(f"q: run {int(np.argmax(beyond))} would start beyond a limit (see stop_at)")
        self.result = RobotRuns.empty(self.loop, self.count, self.times)
        self.stops: list[Stop | None] = list(self.result.stop)
        self.compiled = self.loop.compiled_for(q[0], self.frames, inertias=self.joints)
        self._require_closing()
        self.acting = self._acting()

    def _require_closing(self) -> None:
        """Raise if a velocity opens the loops, where the partition of speeds can tell."""
        free = list(self.compiled.independent_places)
        given = {"q": self.q, "v_independent": self.v[:, free], "a_independent": np.zeros(len(free))}
        found = self.compiled.rows("completion", given)
        off = np.abs(found["v"] - self.v).max(axis=1, initial=0.0)
        open_ = off > _CLOSING * np.maximum(1.0, np.abs(self.v).max(axis=1, initial=0.0))
        open_ &= found["trusted"][:, 0] > 0
        if open_.any():
            worst = int(np.argmax(open_))
            raise InputError(f"v: that of run {worst} opens the loops; complete() gives one that does not")

    def _acting(self) -> Acting | None:
        control, plain = self.control, self.compiled.level != "numpy"
        n = len(self.loop.actuated)
        held = control.encoders(n) is None and control.drives(n) is None and not control.delay
        if not plain or not held or (callable(self.controller) and not control.rate):
            return None
        return acting_in_c(self.loop, self.controller, self.compiled, self.q[0])

    def _all(self, value: ArrayLike) -> FloatArray:
        array = np.asarray(value, dtype=float)
        return np.ascontiguousarray(np.broadcast_to(array, (self.count, array.shape[-1])))

    @cached_property
    def largest(self) -> FloatArray:
        """Where forces are cut off, (n,) or (N, n)."""
        if "saturation" in self.columns:
            return self.columns["saturation"]
        return largest_forces(self.loop, self.control)

    def in_c(self, acting: Acting, result: RobotRuns, progress: Progress | None, threads: int) -> None:
        """Make the runs, and by the robot itself those that are not to be trusted."""
        control, period = self.control, self.control.period
        ends = [] if acting.controller is None else [acting.controller.reference.duration]
        sampled = self.times if len(self.times) else np.array([self.end])
        plan, ticks = step_plan(sampled, period, self.integration.step, np.array(ends))
        given = {"most": self.largest, **acting.given, "q": self.q}
        given["v"] = self.v[:, list(self.compiled.independent_places)]
        given |= {name: self.columns[name] for name in ("kp", "kd", "forces") if name in self.columns}
        given |= {f"wrench_{name}": self.columns[f"external.{name}"] for name in self.frames}
        given |= {f"inertia_{name}": self.columns[f"inertia.{name}"] for name in self.joints}
        made, table = runs_of(self.compiled, acting.model), acting.rows(ticks, control.period)
        limits, room = limited(self.margins), len(self.times)
        size, doubtful = _BLOCK * max(1, threads), []
        for start in range(0, self.count, size):
            block = np.arange(start, min(start + size, self.count))
            parts = {name: a[block] if a.ndim == 2 else a for name, a in given.items()}
            if len(block) == 1:
                parts = {name: a if a.ndim == 1 else a[:1] for name, a in parts.items()}
            prepared = made.prepare(plan, parts, table, limits, acting.control, room)
            found = prepared.run(threads)
            self._enter(found, block, result, ticks, bool(table))
            doubtful += block[found.reason == runs.DOUBTFUL].tolist()
            if progress is not None:
                progress(int(block[-1]) + 1 - len(doubtful), self.count)
        self.alone(np.array(doubtful, dtype=int), result, progress)

    def _enter(
        self, found: RunsFound, block: IndexArray, result: RobotRuns, ticks: FloatArray, errors: bool
    ) -> None:
        good = found.reason != runs.DOUBTFUL
        at = block[good]
        passed = np.maximum(1, np.searchsorted(ticks, found.time[good]))[:, None]
        for name in ("time", "q", "v", "gap", "margin", "peak_force"):
            getattr(result, name)[at] = getattr(found, name)[good]
        result.rms_force[at] = np.sqrt(found.square_force[good] / passed)
        if errors:
            result.peak_error[at] = found.peak_error[good]
            result.rms_error[at] = np.sqrt(found.square_error[good] / passed)
        for name, array in found.past.items():
            kept = array[good]
            early = found.reason[good] != 0
            for i in np.flatnonzero(early):  # the last one is that of the end
                kept[i, found.samples[good][i] - 1 :] = np.nan
            result.past[name][at] = kept
        for i, reason, when in zip(at, found.reason[good].tolist(), found.time[good].tolist(), strict=True):
            self.stops[i] = self.margins.stop(reason - 1, when) if reason else None

    def alone(
        self, which: IndexArray, result: RobotRuns, progress: Progress | None, method: Method = "general"
    ) -> None:
        """Make some of the runs one after the other."""
        for done, i in enumerate(which.tolist(), self.count - len(which) + 1):
            try:
                self._alone(i, result, "general" if self.joints else method)
            except P3dofError as error:
                self.stops[i] = Stop("accuracy", 0.0, str(error))
            result.general[i] = self.joints or method == "general"
            if progress is not None:
                progress(done, self.count)

    def _row(self, name: str, i: int) -> FloatArray:
        array = self.columns[name]
        return array[i] if array.ndim == 2 else array

    def _alone(self, i: int, result: RobotRuns, method: Method) -> None:
        """Make a run: its figures are those of the control ticks, and the end is none."""
        loop, controller, control = self._differing(i)
        external: ExternalOverTime = {name: self._row(f"external.{name}", i) for name in self.frames}
        ticks = math.ceil(self.end * (control.rate or 1 / self.integration.step) - EDGE)
        made = partial(
            simulate_robot,
            loop,
            self.end,
            self.q[i],
            self.v[i],
            controller,
            control=control,
            external=external,
            stop_at=self.stop_at,
            integration=self.integration,
            method=method,
        )
        run = made(samples=ticks + 1)
        self.stops[i], result.time[i] = run.stop, run.time[-1]
        result.q[i], result.v[i], result.gap[i] = run.q[-1], run.v[-1], run.gap.max()
        result.peak_force[i], result.rms_force[i] = _peak_and_rms(run.forces)
        if run.error is not None:
            result.peak_error[i], result.rms_error[i] = _peak_and_rms(run.error)
        if len(self.times):
            stride, rest = divmod(ticks, len(self.times) - 1)
            if rest or not stride:
                run, stride = made(samples=len(self.times)), 1
            rows = np.arange(0, len(run) - (run.stop is not None), stride)
            for name, array in result.past.items():
                array[i, : len(rows)] = getattr(run, name)[rows]

    def _differing(self, i: int) -> tuple[ClosedLoopModel, RobotController, ControlLoop]:
        """Return robot, controller and control of a run."""
        import pinocchio as pin

        loop = self.loop
        if self.joints:
            loop = loop.copy()
            for name in self.joints:
                body = pin.Inertia.FromDynamicParameters(np.array(self._row(f"inertia.{name}", i)))
                loop.model.inertias[loop.model.getJointId(name)] = body
        controller = self.controller
        if isinstance(controller, JointPD):
            controller = copy.copy(controller)
            for name in ("kp", "kd"):
                if name in self.columns:
                    setattr(controller, name, self._row(name, i))
        elif "forces" in self.columns:
            controller = self._row("forces", i)
        control = self.control
        if "saturation" in self.columns:
            control = replace(control, saturation=self._row("saturation", i))
        if "seed" in self.columns and control.noise is not None:
            control = replace(control, noise=replace(control.noise, seed=int(self._row("seed", i)[0])))
        return loop, controller, control


def _peak_and_rms(columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return largest magnitudes and root mean squares of columns (N + 1, n), without the last row."""
    ticks = columns[:-1]
    return np.abs(ticks).max(axis=0), np.sqrt(np.mean(ticks**2, axis=0))


def _columns(loop: ClosedLoopModel, columns: Mapping[str, ArrayLike]) -> dict[str, FloatArray]:
    """Return columns (size,) or (N, size), checked."""
    if not isinstance(columns, Mapping):
        raise InputError(f"columns: expected a mapping of names to arrays, got {shown(columns)}")
    model, n = loop.model, len(loop.actuated)
    sizes = {"q": model.nq, "v": model.nv, "kp": n, "kd": n, "forces": n, "saturation": n, "seed": 1}
    sizes |= {f"external.{frame.name}": 6 for frame in model.frames}
    sizes |= {f"inertia.{name}": 10 for name in list(model.names)[1:]}
    found: dict[str, FloatArray] = {}
    count: int | str = "N"
    for name, value in columns.items():
        if name not in sizes:
            raise InputError(
                f"columns: expected {', '.join(_PLAIN)}, external.FRAME or inertia.JOINT, got {shown(name)}"
            )
        array = as_floats(name, value)
        if array.ndim == 2:
            count = len(array) if count == "N" else count
        shape = (sizes[name],) if array.ndim < 2 else (count, sizes[name])
        found[name] = frozen_array(name, array, shape)
    if count in ("N", 0):
        raise InputError("columns: expected a row for each run in one of them at least")
    for name in ("kp", "kd", "saturation"):
        if name in found and (found[name] < 0).any():
            raise InputError(f"{name}: expected zero or more")
    return found
