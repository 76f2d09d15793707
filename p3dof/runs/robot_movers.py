"""What moves one robot in C from tick to tick: by equal steps with projected loops, or by adaptive ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.loops import CompiledLoop
from p3dof.loops.batch.linear import IndexArray
from p3dof.loops.compiled.adaptive import Adaptation, AdaptiveRun, CompiledAdaptation, Other
from p3dof.loops.compiled.runs import CompiledRuns, Limited
from p3dof.runs.step_plans import step_plan, ticks_of

_EVALUATIONS = 4
"""Of an equal step."""


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
    """A run for a mover.

    Parameters
    ----------
    state : (nq + nv,) array
        Where it starts.
    times : (S,) array
        Of the samples [s].
    period : float
        How long forces are held [s]; zero for not at all.
    kinks : (K,) array
        Other times at which a step must end [s].
    given : mapping of str to array
        Gains, largest forces, and what else acts.
    rows : sequence of (T, n) array
        What the controller knows of each tick.
    limited : Limited
        Where it ends.
    control : int
        What gives the forces.
    other : callable
        What decides where the compiled dynamics is not to be trusted, of adaptive steps.
    """

    state: FloatArray
    times: FloatArray
    period: float
    kinks: FloatArray
    given: Mapping[str, FloatArray]
    rows: Sequence[FloatArray]
    limited: Limited
    control: int
    other: Other


class EqualSteps:
    """A run by equal steps.

    Parameters
    ----------
    compiled, model : CompiledLoop
        The robot, and the model of its controller.
    course : Course
        The run.
    step : float
        Longest step [s].
    """

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
    """A run by adaptive steps.

    Parameters
    ----------
    compiled, model : CompiledLoop
        The robot, and the model of its controller.
    course : Course
        The run.
    steps : (rtol, atol, longest, shortest)
        Tolerances, longest step, and one that leads nowhere.
    """

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
