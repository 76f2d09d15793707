"""Runs of any robot in C: what of a run has a compiled form, and the run by it.

Compiled are steps of rk4 under forces that are held or stay, constant wrenches, limits of joints. `JointPD`,
`JointFeedforward` and `JointComputedTorque` act in C; other controllers, and encoders with errors, are called
at their rate. Closures are projected after every step, so that no stabilisation is needed. Where the compiled
dynamics is not to be trusted there is no run: the robot's own way has to make it.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from p3dof.checks import FloatArray, Progress
from p3dof.closed_loop import ClosedLoopModel, CompiledLoop
from p3dof.closed_loop.compiled import runs
from p3dof.closed_loop.compiled.runs import CompiledRuns, Limited, PreparedRuns
from p3dof.closed_loop.compiling_model import ENOUGH
from p3dof.errors import ControllerError, P3dofError
from p3dof.simulation.actuation import Actuation
from p3dof.simulation.integration import Recording
from p3dof.simulation.joint_controllers import JointComputedTorque, JointFeedforward, JointPD
from p3dof.simulation.margins import Stop
from p3dof.simulation.plants import ConstrainedPlant
from p3dof.simulation.robot_loads import Loads
from p3dof.simulation.robot_margins import RobotMargins
from p3dof.simulation.settings import ControlLoop, Integration
from p3dof.simulation.step_plans import step_plan

_CHUNK = 500
"""Ticks, or steps, between two looks at Ctrl-C."""
_EVALUATIONS = 4
"""Of a step."""


class Acting(NamedTuple):
    """What acts in C.

    Parameters
    ----------
    control : int
        One of `p3dof.closed_loop.compiled.runs`.
    given : dict of str to (n,) array
        Gains, and forces that stay.
    controller : JointPD, optional
        What the rows of ticks are made from.
    model : CompiledLoop, optional
        Its model.
    """

    control: int
    given: dict[str, FloatArray]
    controller: JointPD | None = None
    model: CompiledLoop | None = None

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
    """Return what a controller is in C; None if it has to be called.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    controller : callable or (n,) array, optional
        As of `simulate_robot`.
    compiled : CompiledLoop
        The robot, compiled.
    q : (nq,) array
        Where the run starts.
    """
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


class Setting(NamedTuple):
    """A run of a robot, as `simulate_robot` has it."""

    loop: ClosedLoopModel
    plant: ConstrainedPlant
    controller: Any
    control: ControlLoop
    integration: Integration
    loads: Loads
    margins: RobotMargins
    largest: FloatArray
    times: FloatArray
    kinks: FloatArray
    progress: Progress | None

    @property
    def compiled(self) -> CompiledLoop | None:
        """What is compiled of the robot; None if the run has no compiled form."""
        states, control = self.plant.compiled, self.control
        works = states is not None and states.loop.level != "numpy"
        works = works and self.integration.scheme == "rk4" and not self.margins.events
        works = works and self.loads.stays and not control.delay
        works = works and control.drives(len(self.largest)) is None
        if not works or (callable(self.controller) and not control.rate):
            return None
        return states.loop if states is not None else None


class RobotRunInC:
    """A run of a robot in C.

    Parameters
    ----------
    setting : Setting
        The run, of which `compiled` says what is compiled.
    state : (nq + nv,) array
        Where it starts.
    """

    def __init__(self, setting: Setting, compiled: CompiledLoop, state: FloatArray) -> None:
        self._of, self._compiled = setting, compiled
        nq = setting.loop.model.nq
        q, v = setting.plant.split(state)
        self._free = list(compiled.independent_places)
        control = setting.control
        acts = acting_in_c(setting.loop, setting.controller, compiled, q)
        own = control.encoders(len(setting.largest)) is None
        self.acting = acts if own or (acts is not None and not callable(setting.controller)) else None
        shown = self.acting or Acting(runs.CONSTANT, {})
        plan, ticks = step_plan(setting.times, control.period, setting.integration.step, setting.kinks)
        if not control.period:
            plan.tick[:] = 1  # so that it may go on from anywhere
        self._plan, self._ticks = plan, ticks
        given = {"q": q[None].copy(), "v": v[self._free], "most": setting.largest, **shown.given}
        given |= {f"wrench_{name}": rows[0] for name, rows in setting.loads.over(np.zeros(1)).items()}
        made = runs_of(compiled, shown.model)
        self._runs: PreparedRuns = made.prepare(
            plan,
            given,
            shown.rows(ticks, control.period),
            limited(setting.margins),
            shown.control,
            len(setting.times) + 1,
        )
        self._nq = nq
        self.recording = Recording()

    def __call__(self, actuation: Callable[[], Actuation]) -> Recording | None:
        """Make the run; return None if it cannot be trusted.

        Raises
        ------
        ControllerError
            If a controller fails; `recording` holds the samples so far.
        """
        begun = clock.perf_counter()
        act = None if self.acting is not None else actuation()
        try:
            reason, steps = self._go(act)
        except ControllerError as error:
            self._record(Stop("controller", error.time, str(error.__cause__)))
            raise
        finally:
            self.recording.seconds = clock.perf_counter() - begun
        if reason == runs.DOUBTFUL:
            return None
        time = float(self._runs.out[0][0])
        self._record(self._of.margins.stop(reason - 1, time) if reason else None)
        self.recording.evaluations = _EVALUATIONS * steps
        return self.recording

    def _go(self, act: Actuation | None) -> tuple[int, int]:
        """Go from part to part; return why it ended, and the steps that were taken."""
        prepared, plan = self._runs, self._plan
        rows = range(0, np.count_nonzero(plan.tick), _CHUNK if act is None else 1)
        begins = np.flatnonzero(plan.tick)[rows]
        ends, reason = np.append(begins[1:], len(plan.tick)).tolist(), 0
        for row, begin, end in zip(rows, begins.tolist(), ends, strict=True):
            if act is not None:
                self._command(act, float(plan.time[begin]))
            reason = prepared.advance(begin, end - begin, end == len(plan.tick), row)
            if reason:
                return reason, end
            prepared.parts[0][0] = prepared.out[1][0]
            prepared.parts[1][:] = prepared.out[2][0, self._free]
            if self._of.progress is not None:
                self._of.progress(min(int(prepared.taken[0]), len(self._of.times)), len(self._of.times))
        return reason, len(plan.tick)

    def _command(self, act: Actuation, time: float) -> None:
        """Let a controller act at the present state."""
        prepared, plant = self._runs, self._of.plant
        v = prepared.out[2][0] if time > 0 else self._start_speeds()
        state = np.concatenate([prepared.parts[0][0], v])
        try:
            forces, asked = act(time, *plant.actuated(state))
        except Exception as error:
            words = f"the controller failed at t = {time:.6g} s: {error}"
            raise ControllerError(words, time) from error
        prepared.parts[5][:] = asked
        del forces  # they are cut off in C likewise

    def _start_speeds(self) -> FloatArray:
        found = self._compiled.rows(
            "completion",
            {
                "q": self._runs.parts[0],
                "v_independent": self._runs.parts[1][None],
                "a_independent": np.zeros((1, len(self._free))),
            },
        )
        return np.array(found["v"][0])

    def _record(self, stop: Stop | None) -> None:
        prepared, record, times = self._runs, self.recording, self._of.times
        count = int(prepared.taken[0])
        q, v, a, forces, asked = (array[0, :count] for array in prepared.past)
        when = times[: min(count, len(times))].tolist()
        if stop is not None and stop.kind != "controller":
            when = [*times[: count - 1].tolist(), stop.time]
        record.times, record.stop = when, stop
        record.states = list(np.hstack([q, v]))
        record.rates = list(np.hstack([np.full(q.shape, np.nan), a]))  # nobody asks for those of q
        record.forces, record.asked = list(forces), list(asked)
        record.loads = [self._of.loads(time) for time in when]


def runs_of(compiled: CompiledLoop, model: CompiledLoop | None = None) -> CompiledRuns:
    """Return the runs of what is compiled, made once."""
    key = "runs", id(model)
    found = compiled.kept.get(key)
    if not isinstance(found, CompiledRuns):
        found = compiled.kept[key] = CompiledRuns(compiled, model)
    return found


def limited(margins: RobotMargins) -> Limited:
    """Return the limits that end a run."""
    return Limited(margins.limited_q.astype(np.int32), margins.lower, margins.upper)
