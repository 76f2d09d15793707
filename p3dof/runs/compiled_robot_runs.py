"""Runs of any robot in C: what of a run has a compiled form, and the run by it.

Compiled are both schemes under forces that are held or stay, constant wrenches, limits of joints. `JointPD`,
`JointFeedforward` and `JointComputedTorque` act in C; other controllers, and encoders with errors, are called
at their rate. The steps of rk4 project the closures, so that no stabilisation is needed; those of DOP853 are
SciPy's on the same stabilised equations. Where the compiled dynamics is not to be trusted, the robot itself
is asked for the rates of adaptive steps; else there is no run, and the robot's own way has to make it.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from p3dof._base.checks import FloatArray, Progress
from p3dof._base.errors import ControllerError, P3dofError
from p3dof.loops import ClosedLoopModel, CompiledLoop
from p3dof.loops.compiled import runs
from p3dof.loops.compiled.runs import Limited
from p3dof.loops.compiling_model import ENOUGH
from p3dof.runs.actuation import Actuation
from p3dof.runs.integration import Recording
from p3dof.runs.joint_controllers import JointComputedTorque, JointFeedforward, JointPD
from p3dof.runs.margins import Stop
from p3dof.runs.plants import ConstrainedPlant
from p3dof.runs.robot_loads import Loads
from p3dof.runs.robot_margins import RobotMargins
from p3dof.runs.robot_movers import AdaptiveSteps, Course, EqualSteps, Mover
from p3dof.runs.settings import ControlLoop, Integration
from p3dof.runs.step_plans import ticks_of

_NEAR_DEPENDENT = 1e-3
"""Room to dependent closures below which their margin has to be watched all the way."""
_CHUNK = 500
"""Ticks, or steps, between two looks at Ctrl-C."""


class Acting(NamedTuple):
    """What acts in C.

    Parameters
    ----------
    control : int
        One of `p3dof.loops.compiled.runs`.
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
    longest: float
    shortest: float
    progress: Progress | None

    @property
    def compiled(self) -> CompiledLoop | None:
        """What is compiled of the robot; None if the run has no compiled form."""
        states, control = self.plant.compiled, self.control
        works = states is not None and states.loop.level != "numpy"
        works = works and not self.margins.events
        works = works and self.loads.stays and not control.delay
        works = works and control.drives(len(self.largest)) is None
        if callable(self.controller) and not control.rate:
            works = works and self.integration.scheme != "rk4" and _stands(self.controller)
        if not works:
            return None
        return states.loop if states is not None else None

    def decided(self, state: FloatArray, forces: FloatArray) -> FloatArray | None:
        """Return the derivative of a state by the robot itself; None near closures that become dependent."""
        if self.margins.room(self.plant.split(state)[0]) < _NEAR_DEPENDENT:
            return None
        return self.plant.rate(state, forces, self.loads(0.0))


class RobotRunInC:
    """A run of a robot in C.

    Parameters
    ----------
    setting : Setting
        The run, of which `compiled` says what is compiled.
    compiled : CompiledLoop
        That.
    state : (nq + nv,) array
        Where it starts.
    """

    def __init__(self, setting: Setting, compiled: CompiledLoop, state: FloatArray) -> None:
        self._of, control = setting, setting.control
        acts = acting_in_c(setting.loop, setting.controller, compiled, setting.plant.split(state)[0])
        own = control.encoders(len(setting.largest)) is None or not callable(setting.controller)
        self.acting = acts if own else None
        self.recording = Recording()
        self._mover: Mover | None = None
        if self.acting is None and not control.rate:
            return
        shown, integration = self.acting or Acting(runs.CONSTANT, {}), setting.integration
        ticks = ticks_of(setting.times, control.period, setting.kinks)
        given = {"most": setting.largest, **shown.given}
        given |= {f"wrench_{name}": rows[0] for name, rows in setting.loads.over(np.zeros(1)).items()}
        given["stabilisation"] = np.array([integration.stabilisation])
        course = Course(
            state,
            setting.times,
            control.period,
            setting.kinks,
            given,
            shown.rows(ticks[0][:-1][ticks[1].astype(bool)], control.period),
            limited(setting.margins),
            shown.control,
            setting.decided,
        )
        if integration.scheme == "rk4":
            self._mover = EqualSteps(compiled, shown.model, course, integration.step)
        else:
            tolerances = integration.rtol, integration.atol, setting.longest, setting.shortest
            self._mover = AdaptiveSteps(compiled, shown.model, course, tolerances)

    def __call__(self, actuation: Callable[[], Actuation]) -> Recording | None:
        """Make the run; return None if it cannot be trusted.

        Raises
        ------
        ControllerError
            If a controller fails; `recording` holds the samples so far.
        """
        if self._mover is None:
            return None
        mover, begun = self._mover, clock.perf_counter()
        act = None if self.acting is not None else actuation()
        try:
            reason = self._go(mover, act)
        except ControllerError as error:
            self._record(mover, Stop("controller", error.time, str(error.__cause__)))
            raise
        finally:
            self.recording.seconds = clock.perf_counter() - begun
        if reason == runs.DOUBTFUL:
            return None
        self._record(mover, self._of.margins.stop(reason - 1, mover.end) if reason else None)
        self.recording.evaluations = mover.evaluations
        return self.recording

    def _go(self, mover: Mover, act: Actuation | None) -> int:
        """Go from part to part; return why it ended."""
        rows = range(0, len(mover.begins), _CHUNK if act is None else 1)
        begins, reason = mover.begins[rows], 0
        ends, total = np.append(begins[1:], mover.parts).tolist(), len(self._of.times)
        for row, begin, end in zip(rows, begins.tolist(), ends, strict=True):
            if act is not None:
                self._command(mover, act, mover.when(begin))
            reason = mover.advance(begin, end - begin, end == mover.parts, row)
            if reason:
                return reason
            if self._of.progress is not None:
                self._of.progress(min(mover.taken, total), total)
        return reason

    def _command(self, mover: Mover, act: Actuation, time: float) -> None:
        """Let a controller act at the present state."""
        try:
            _, asked = act(time, *self._of.plant.actuated(mover.state()))
        except Exception as error:
            words = f"the controller failed at t = {time:.6g} s: {error}"
            raise ControllerError(words, time) from error
        mover.hold(asked)  # cut off in C as by the actuation

    def _record(self, mover: Mover, stop: Stop | None) -> None:
        record, times, count = self.recording, self._of.times, mover.taken
        q, v, a, forces, asked = (array[:count] for array in mover.past)
        when = times[: min(count, len(times))].tolist()
        if stop is not None and stop.kind != "controller":
            when = [*times[: count - 1].tolist(), stop.time]
        record.times, record.stop = when, stop
        record.states = list(np.hstack([q, v]))
        record.rates = list(np.hstack([np.full(q.shape, np.nan), a]))  # nobody asks for those of q
        record.forces, record.asked = list(forces), list(asked)
        record.loads = [self._of.loads(time) for time in when]


def _stands(controller: Any) -> bool:
    """Whether a controller depends on the state only."""
    return type(controller) in (JointPD, JointComputedTorque) and not controller.reference.duration


def limited(margins: RobotMargins) -> Limited:
    """Return the limits that end a run."""
    return Limited(margins.limited_q.astype(np.int32), margins.lower, margins.upper)
