"""What of a run of any robot has a form in C: controllers, steps and what moves a robot by them.

`JointPD`, `JointFeedforward` and `JointComputedTorque` act in C; other controllers, and encoders with errors,
are called at their rate. The steps of rk4 project the closures, so that no stabilisation is needed; those of
DOP853 are SciPy's on the same stabilised equations. Where the compiled dynamics is not to be trusted, the
robot itself is asked for the rates of adaptive steps; else the run has to be made in Python.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.errors import P3dofError
from p3dof.loops import ClosedLoopModel, CompiledLoop
from p3dof.loops.compiled import runs
from p3dof.loops.compiled.adaptive import Adaptation, AdaptiveRun, CompiledAdaptation, Other
from p3dof.loops.compiled.kept import ENOUGH
from p3dof.loops.compiled.runs import CompiledRuns, Limited, StepPlan
from p3dof.loops.linear import IndexArray
from p3dof.runs.joint_controllers import JointComputedTorque, JointFeedforward, JointPD
from p3dof.runs.margins import RobotMargins
from p3dof.runs.settings import EDGE


def step_plan(
    times: FloatArray, period: float, step: float, kinks: FloatArray
) -> tuple[StepPlan, FloatArray]:
    """Return the steps of a run, those of `p3dof.runs.integration`, and the times of the ticks."""
    edges, tick_edges = ticks_of(times, period, kinks)
    slack = _slack(times, period)
    ticks = edges[:-1][tick_edges.astype(bool)]
    end = float(times[-1])
    lengths = np.diff(edges)
    counts = np.maximum(1, np.ceil(lengths / step - EDGE)).astype(int)
    begins = np.repeat(edges[:-1], counts)
    within = np.arange(len(begins)) - np.repeat(np.cumsum(counts) - counts, counts)
    time = np.append(begins + within * np.repeat(lengths / counts, counts), end)
    tick = np.zeros(len(begins), dtype=np.uint8)
    tick[(np.cumsum(counts) - counts)[tick_edges.astype(bool)]] = 1
    place = np.clip(np.searchsorted(time, times + slack, side="right") - 1, 0, len(time) - 1)
    share = times - time[place]
    inside = (share > slack) & (place < len(begins))
    lengths_at = np.diff(np.append(time, np.inf))[place]
    share = np.where(inside, share / lengths_at, 0.0)
    return StepPlan(time, tick, place.astype(np.intp), share), ticks


def ticks_of(times: FloatArray, period: float, kinks: FloatArray) -> tuple[FloatArray, NDArray[np.uint8]]:
    """Return when steps must end (K + 1,), the beginning first, and at which of them are ticks (K,)."""
    end, slack = float(times[-1]), _slack(times, period)
    ticks: FloatArray = np.zeros(1)
    if period:
        ticks = np.asarray(period * np.arange(math.ceil(end / period - EDGE)), dtype=float)
    inner = kinks[(kinks > 0) & (kinks < end)]
    edges = np.unique(np.concatenate([ticks, inner, [end]]))
    edges = edges[np.append(True, np.diff(edges) > slack)]
    edges[-1] = end
    tick = np.zeros(len(edges) - 1, dtype=np.uint8)
    tick[np.searchsorted(edges[:-1], ticks - slack)] = 1
    return edges, tick


def _slack(times: FloatArray, period: float) -> float:
    return max(1e-15 * float(times[-1]), EDGE * period)


_EVALUATIONS = 4  # of an equal step


class Mover(Protocol):
    """A run in C that goes on from tick to tick."""

    @property
    def begins(self) -> IndexArray:
        """The parts of the run that begin with a tick."""

    @property
    def parts(self) -> int:
        """How many parts there are."""

    def when(self, part: int) -> float:
        """Return when a part begins [s]."""

    def state(self) -> FloatArray:
        """Return q and v now, (nq + nv,)."""

    def hold(self, forces: FloatArray) -> None:
        """Ask for forces (n,) from the next tick on."""

    def advance(self, begin: int, count: int, closing: bool, row: int) -> int:
        """Go on; see `p3dof.loops.compiled.runs.PreparedRuns.advance`."""

    @property
    def end(self) -> float:
        """Where it got to [s]."""

    @property
    def taken(self) -> int:
        """How many samples there are."""

    @property
    def past(self) -> Sequence[FloatArray]:
        """Samples: q, v, a, forces, asked, a row each."""

    @property
    def evaluations(self) -> int:
        """Of the equations of motion."""


class Course(NamedTuple):
    """A run for a mover."""

    state: FloatArray  # (nq + nv,): where it starts
    times: FloatArray  # (S,): of the samples [s]
    period: float  # how long forces are held [s]; zero for not at all
    kinks: FloatArray  # (K,): other times at which a step must end [s]
    given: Mapping[str, FloatArray]  # gains, largest forces, and what else acts
    rows: Sequence[FloatArray]  # (T, n): what the controller knows of each tick
    limited: Limited  # where it ends
    control: int  # what gives the forces
    other: Other  # what decides where the compiled dynamics is not to be trusted, of adaptive steps
    look: Callable[[int], object] | None  # called now and then with the number of samples, of adaptive steps


class EqualSteps:
    """A run by equal steps."""

    def __init__(
        self, compiled: CompiledLoop, model: CompiledLoop | None, course: Course, step: float
    ) -> None:
        self._free = list(compiled.independent_places)
        nq = len(course.state) - compiled.robot.tree.nv
        self._v = np.array(course.state[nq:])
        plan, _ = step_plan(course.times, course.period, step, course.kinks)
        if not course.period:
            plan.tick[:] = 1  # so that it may go on from anywhere
        self._plan, self._done = plan, 0
        given = {**course.given, "q": course.state[None, :nq].copy(), "v": self._v[self._free]}
        self._runs = runs_of(compiled, model).prepare(
            plan, given, course.rows, course.limited, course.control, len(course.times) + 1
        )
        self.begins: IndexArray = np.flatnonzero(plan.tick)
        self.parts = len(plan.tick)

    def when(self, part: int) -> float:
        """Return when a step begins [s]."""
        return float(self._plan.time[part])

    def state(self) -> FloatArray:
        """Return q and v now."""
        return np.concatenate([self._runs.parts[0][0], self._v])

    def hold(self, forces: FloatArray) -> None:
        """Ask for forces from the next tick on."""
        self._runs.parts[5][:] = forces

    def advance(self, begin: int, count: int, closing: bool, row: int) -> int:
        """Take some steps."""
        runs = self._runs
        reason = runs.advance(begin, count, closing, row)
        self._done += count
        runs.parts[0][0], self._v = runs.out[1][0], runs.out[2][0]
        runs.parts[1][:] = self._v[self._free]
        return reason

    @property
    def end(self) -> float:
        """Where it got to [s]."""
        return float(self._runs.out[0][0])

    @property
    def taken(self) -> int:
        """How many samples there are."""
        return int(self._runs.taken[0])

    @property
    def past(self) -> list[FloatArray]:
        """Samples."""
        return [array[0] for array in self._runs.past]

    @property
    def evaluations(self) -> int:
        """Of the equations of motion."""
        return _EVALUATIONS * self._done


class AdaptiveSteps:
    """A run by adaptive steps."""

    def __init__(
        self,
        compiled: CompiledLoop,
        model: CompiledLoop | None,
        course: Course,
        steps: tuple[float, float, float, float],
    ) -> None:
        edges, tick = ticks_of(course.times, course.period, course.kinks)
        how = Adaptation(edges, tick, course.times, course.period, *steps)
        continuous = course.control > 0 and not course.period
        self._edges = edges
        self._run = AdaptiveRun(
            adaptation_of(compiled, model),
            how,
            course.state.copy(),
            course.given,
            course.rows,
            course.limited,
            course.control,
            continuous,
            course.other,
            course.look,
        )
        self.begins: IndexArray = np.flatnonzero(tick)
        self.parts = len(tick)

    def when(self, part: int) -> float:
        """Return when a part begins [s]."""
        return float(self._edges[part])

    def state(self) -> FloatArray:
        """Return q and v now."""
        return self._run.state.copy()

    def hold(self, forces: FloatArray) -> None:
        """Ask for forces from the next tick on."""
        self._run.parts[3][:] = forces

    def advance(self, begin: int, count: int, closing: bool, row: int) -> int:
        """Go on by some parts."""
        return self._run.advance(begin, count, closing, row)

    @property
    def end(self) -> float:
        """Where it got to [s]."""
        return self._run.end

    @property
    def taken(self) -> int:
        """How many samples there are."""
        return self._run.taken

    @property
    def past(self) -> list[FloatArray]:
        """Samples."""
        return self._run.past

    @property
    def evaluations(self) -> int:
        """Of the equations of motion."""
        return self._run.evaluations


def runs_of(compiled: CompiledLoop, model: CompiledLoop | None = None) -> CompiledRuns:
    """Return the runs by equal steps of what is compiled, made once."""
    key = "runs", id(model)
    found = compiled.kept.get(key)
    if not isinstance(found, CompiledRuns):
        found = compiled.kept[key] = CompiledRuns(compiled, model)
    return found


def adaptation_of(compiled: CompiledLoop, model: CompiledLoop | None = None) -> CompiledAdaptation:
    """Return the runs by adaptive steps of what is compiled, made once."""
    key = "adaptation", id(model)
    found = compiled.kept.get(key)
    if not isinstance(found, CompiledAdaptation):
        found = compiled.kept[key] = CompiledAdaptation(compiled, model)
    return found


class Acting(NamedTuple):
    """What acts in C."""

    control: int  # one of `p3dof.loops.compiled.runs`
    given: dict[str, FloatArray]  # (n,): gains, and forces that stay
    controller: JointPD | None = None  # what the rows of ticks are made from
    model: CompiledLoop | None = None  # its model

    def rows(self, ticks: FloatArray, period: float) -> list[FloatArray]:
        """Return targets, speeds, and what is known before, at all ticks (T, n); one row if it stays."""
        one = self.controller
        if one is None:
            return []
        reference, middle = one.reference, ticks + period / 2
        if not reference.duration and not isinstance(one, JointFeedforward):
            ticks = middle = ticks[:1]
        values, speeds, _ = reference.over(ticks)
        more = np.zeros_like(values)
        if isinstance(one, JointComputedTorque):
            more = reference.over(middle)[2]
        elif isinstance(one, JointFeedforward):
            more = np.stack([np.interp(middle, one.time, column) for column in one.forces.T], axis=1)
        return [values, speeds, more]


def acting_in_c(
    loop: ClosedLoopModel, controller: Any, compiled: CompiledLoop, q: FloatArray
) -> Acting | None:
    """Return what a controller is in C; None if it has to be called."""
    if not callable(controller):
        forces = np.zeros(len(loop.actuated)) if controller is None else np.asarray(controller, dtype=float)
        return Acting(runs.CONSTANT, {"forces": forces})
    if type(controller) not in (JointPD, JointFeedforward, JointComputedTorque) or not compiled.hybrid:
        return None
    gains = {"kp": controller.kp, "kd": controller.kd}
    computed = isinstance(controller, JointComputedTorque)
    if not computed and (isinstance(controller, JointFeedforward) or not controller.gravity):
        return Acting(runs.PD, gains, controller)
    model = compiled if compiled.is_of(controller.loop) else None
    if model is None:
        try:
            model = controller.loop.compiled_for(q)
        except P3dofError:
            return None
        if model.independent != compiled.independent or not model.margin(q) > ENOUGH:
            return None
    kind = runs.COMPUTED_TORQUE if computed else runs.PD_WITH_GRAVITY
    return Acting(kind, gains, controller, model)


def limited(margins: RobotMargins) -> Limited:
    """Return the limits that end a run."""
    return Limited(margins.limited_q.astype(np.int32), margins.lower, margins.upper)
