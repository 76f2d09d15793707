"""`simulate_robot`: any robot with closed loops in time, by the integrator that moves the manipulator."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, Progress, one_line, require
from p3dof._base.errors import LOG, AssemblyError, ControllerError, InputError, ModelError
from p3dof.loops import ClosedLoopModel
from p3dof.loops.compiled import build, runs
from p3dof.loops.compiled.kept import Method
from p3dof.runs import compiled_robot_runs
from p3dof.runs.actuation import Actuation
from p3dof.runs.driver import PYTHON_CONTROLLER, Moving, Run
from p3dof.runs.integration import Recording, Watch
from p3dof.runs.joint_controllers import (
    JointComputedTorque,
    JointPD,
    JointReference,
    RobotMeasurement,
    reference_of,
)
from p3dof.runs.margins import ROBOT_KINDS, Event, RobotMargins, Stop, checked_events
from p3dof.runs.plants import CLOSED, ConstrainedPlant, ExternalOverTime, Loads, states_for
from p3dof.runs.results import RobotRun, left_behind
from p3dof.runs.settings import ControlLoop, InitialState, Integration, Work, require_affordable

RobotController: TypeAlias = Callable[[RobotMeasurement], ArrayLike] | ArrayLike | None
"""A controller, forces (n_actuated,) that stay, or None for none at all."""

ROBOT_PRECISE, ROBOT_CONTINUOUS = Integration(rtol=1e-9, atol=1e-11), ControlLoop()
SHORTEST = 1e-6
"""Steps of a robot that are shorter lead nowhere, if there are very many [s]: it is near a singularity."""
NO_COMPILER = "there is no C compiler"  # why a run is made in Python
_LARGE = 30  # most freedoms of a robot that is compiled without being asked for: a few seconds, once
DOUBTFUL = "the compiled dynamics are not valid somewhere along the run"
"""Why a run that was begun in C was made again."""
_STEPS, _PER_STEP = 50.0, 14
"""Steps a second that are expected of a robot that moves freely, and evaluations in each."""
_NEAR_DEPENDENT = 1e-3  # room to dependent closures below which their margin has to be watched all the way
_CHUNK = 500  # ticks, or steps, between two looks at Ctrl-C


def simulate_robot(
    loop: ClosedLoopModel,
    duration: float,
    q: ArrayLike | InitialState | None = None,
    v: ArrayLike | None = None,
    controller: RobotController = None,
    *,
    control: ControlLoop = ROBOT_CONTINUOUS,
    reference: JointReference | ArrayLike | None = None,
    external: ExternalOverTime | None = None,
    stop_at: Sequence[str] = ROBOT_KINDS,
    events: Sequence[Event] = (),
    samples: int | ArrayLike = 1001,
    integration: Integration = ROBOT_PRECISE,
    progress: Progress | None = None,
    method: Method | None = None,
) -> RobotRun:
    """Follow any robot with closed loops in time.

    It ends early, with its reason in `RobotRun.stop` and all samples so far, where a joint reaches a limit of
    the robot's file, where closures become dependent, or at an event.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    duration : float
        How long [s].
    q : (nq,) array or InitialState, optional
        Where it starts, with closed loops; by default the assembly of the reference configuration. Or an
        `InitialState` with the `joints` (q, v).
    v : (nv,) array, optional
        How fast, not opening the loops; at rest by default.
    controller : callable or (n_actuated,) array, optional
        Takes a `RobotMeasurement`, returns the forces of the actuated joints [N or N m], such as a `JointPD`;
        or forces that stay, none by default.
    control : ControlLoop
        How it acts: how often, how strongly, with which noise; continuously and exactly by default.
    reference : JointReference or (n_actuated,) array, optional
        What the run should follow, for `RobotRun.error`; what the controller follows by default.
    external : mapping of str to array-like (6,) or callable, optional
        Wrenches on frames from outside: force [N] and moment [N m] in world axes at the frame's origin; or
        functions of one time since the start of the run, such as a `p3dof.WrenchHistory`.
    stop_at : sequence of str
        What ends the run, of ``"joint limit"``, ``"singular closures"``. A joint whose lower limit is not
        below its upper one has none.
    events : sequence of Event
        What else ends it, or is noted.
    samples : int or (N,) array
        How many samples to keep, evenly spaced, or their times [s]; the end is always one.
    integration : Integration
        Tolerances, longest step, stabilisation of the closures, and how long it may take.
    progress : callable, optional
        Called with (done, total) samples.
    method : {"general", "compiled"} or CompiledLoop, optional
        What computes accelerations: the robot; C that is compiled for it now, or taken from the cache; or
        what `ClosedLoopModel.compile` returned, for many runs. Where compiled dynamics are not to be trusted
        the robot decides, so that runs end for the same reasons. If all that acts has a
        compiled form the whole run is made in C; with ``scheme="rk4"`` of the integration its closures are
        projected instead of stabilised. Else `RobotRun.note` says what keeps it from that. By default
        ``"compiled"`` where the whole run can be made in C and a compiler is there, for robots of at most 30
        freedoms of their joints, which a compiler takes some seconds for, once; else ``"general"``.

    Raises
    ------
    AssemblyError
        If the loops do not close at the reference configuration.
    ControllerError
        If the controller raises or returns something else than finite forces; with the time, and the run so
        far in ``run``.
    InputError
        If an argument does not fit, the loops are open, the run starts beyond a limit, or it would take too
        long.
    ModelError
        If the robot cannot be compiled.
    """
    given = controller, control, reference, external, stop_at, events, samples, integration, progress, method
    return RunOfRobot(loop, duration, q, v, *given)()


class RunOfRobot(Run[RobotRun]):
    """One run of any robot, checked; arguments as of `simulate_robot`."""

    shortest = SHORTEST

    def __init__(
        self,
        loop: ClosedLoopModel,
        duration: float,
        q: ArrayLike | InitialState | None,
        v: ArrayLike | None,
        controller: RobotController,
        control: ControlLoop,
        reference: JointReference | ArrayLike | None,
        external: ExternalOverTime | None,
        stop_at: Sequence[str],
        events: Sequence[Event],
        samples: int | ArrayLike,
        integration: Integration,
        progress: Progress | None,
        method: Method | None,
    ) -> None:
        require_robot(loop)
        super().__init__(duration, samples, controller, control, integration, progress)
        self.loop, self.loads = loop, Loads(loop, external)
        self.events, beta = checked_events(events), integration.stabilisation
        self.plant = ObservedPlant(loop, beta, self.loads.frames)
        self.state = self.plant.checked_state(*_start(loop, q, v), CLOSED)
        begin = self.plant.split(self.state)[0]
        self.margins = RobotMargins(self.plant, stop_at, [e for e in self.events if e.stops], self.state)
        self.watch = Watch.of(self.events, self.plant.split)
        self.count, self.measure = len(loop.actuated), self.plant.measurement
        self.largest = largest_forces(loop, control)
        self.reference = _followed(loop, reference, controller)
        ends = [] if self.reference is None else [self.reference.duration]
        self.kinks = np.union1d(self.loads.kinks, ends)
        self.longest = self.longest_step(self.loads.watched)
        self._declined = "the method is 'general'; 'compiled' runs in C"
        if method is None:
            self._choose(begin)
        else:
            self._compile(method, begin)

    def _compile(self, method: Method, begin: FloatArray) -> None:
        frames, beta = self.loads.frames, self.integration.stabilisation
        self.plant.compiled = states_for(self.loop, method, "forward_dynamics", frames, beta, begin)

    def _choose(self, begin: FloatArray) -> None:
        """Compile the robot if the whole run can then be made in C, and soon; else say why not."""
        found = next(self._in_python_only(), "")
        if not found and build.compiler() is None:
            found = NO_COMPILER
        if not found and self.loop.model.nv > _LARGE:
            found = f"compilers take long for a robot of {self.loop.model.nv} freedoms; 'compiled' does it"
        if not found:
            try:
                self._compile("compiled", begin)
            except (ModelError, AssemblyError) as error:
                found = one_line(str(error))
        self._declined = found

    def moving(self) -> Moving:
        """Return the robot."""
        self.loop.forward_dynamics(*self.plant.split(self.state), np.zeros(self.count))  # says why not
        self._require_affordable()
        return Moving(self.plant, self.state, self.loads, self.margins, self.watch)

    def obstacles(self) -> Iterator[str]:
        """Yield whatever keeps the run from being made in C, and what to do instead."""
        states = self.plant.compiled
        if states is None:
            yield self._declined
        elif states.loop.level == "numpy":
            yield NO_COMPILER
        yield from self._in_python_only()

    def _in_python_only(self) -> Iterator[str]:
        """Yield what has no compiled form, whatever the method."""
        control = self.control
        if self.events:
            yield "events are functions of Python"
        if not self.loads.stays:
            yield "a wrench changes with time; those that stay act in C"
        if control.delay:
            yield "forces are late (the delay of ControlLoop)"
        if control.drives(self.count) is not None:
            yield "drives lag behind their commands (the bandwidth of ControlLoop)"
        if self.outside and (self.integration.scheme == "rk4" or not _stands(self.controller)):
            yield PYTHON_CONTROLLER

    def in_c(self) -> RobotRun | str:
        """Make the run in C; return why it has to be made again in Python if it cannot be trusted."""
        self.actuation()  # says what does not fit
        in_c = _RobotInC(self)
        if in_c.mover is None:
            return "the model of the controller cannot be compiled here; give the controller a rate"
        with self.telling(in_c.recording):
            made = in_c.run(in_c.mover)
        return self.result(in_c.recording, "") if made else DOUBTFUL

    def decided(self, state: FloatArray, forces: FloatArray) -> FloatArray | None:
        """Return the derivative of a state by the robot itself; None near closures that become dependent."""
        if self.margins.room(self.plant.split(state)[0]) < _NEAR_DEPENDENT:
            return None
        return self.plant.rate(state, forces, self.loads(0.0))

    def looked(self, taken: int) -> None:
        """Tell how many samples a run in C has."""
        if self.progress is not None:
            self.progress(min(taken, len(self.times)), len(self.times))

    def result(self, record: Recording, note: str) -> RobotRun:
        """Return what the run leaves behind."""
        if note:
            LOG.info("a run in Python: %s", note)
        return left_behind(
            self.loop,
            self.plant,
            record,
            self.loads.frames,
            self.reference,
            method="general" if self.plant.compiled is None else "compiled",
            note=note,
            events=() if self.watch is None else self.watch.occurrences,
        )

    def _require_affordable(self) -> None:
        """Raise if a run would take too long, by the time that the equations of motion take here."""
        control, times, began = self.control, self.times, clock.perf_counter()
        for _ in range(3):
            self.plant.rate(self.state, np.zeros(self.count), np.zeros(0))
        seconds = (clock.perf_counter() - began) / 3
        steps = float(times[-1]) * max(_STEPS, 1 / self.longest, control.changes, 1 / control.quickest)
        work = Work(steps, seconds * (_PER_STEP * steps + len(times)))
        require_affordable(work, len(times), self.integration.time_limit, "time_limit")


class _RobotInC:
    """A run of a robot in C."""

    def __init__(self, of: RunOfRobot) -> None:
        assert of.plant.compiled is not None  # noqa: S101 - an obstacle
        compiled, control, integration = of.plant.compiled.loop, of.control, of.integration
        acts = compiled_robot_runs.acting_in_c(of.loop, of.controller, compiled, of.plant.split(of.state)[0])
        own = control.encoders(of.count) is None or not callable(of.controller)
        self._of, self.acting = of, acts if own else None
        self.recording = Recording()
        self.mover: compiled_robot_runs.Mover | None = None
        if self.acting is None and not control.rate:
            return
        shown = self.acting or compiled_robot_runs.Acting(runs.CONSTANT, {})
        ticks = compiled_robot_runs.ticks_of(of.times, control.period, of.kinks)
        given = {"most": of.largest, **shown.given}
        given |= {f"wrench_{name}": rows[0] for name, rows in of.loads.over(np.zeros(1)).items()}
        given["stabilisation"] = np.array([integration.stabilisation])
        course = compiled_robot_runs.Course(
            of.state,
            of.times,
            control.period,
            of.kinks,
            given,
            shown.rows(ticks[0][:-1][ticks[1].astype(bool)], control.period),
            compiled_robot_runs.limited(of.margins),
            shown.control,
            of.decided,
            of.looked,
        )
        if integration.scheme == "rk4":
            self.mover = compiled_robot_runs.EqualSteps(compiled, shown.model, course, integration.step)
        else:
            tolerances = integration.rtol, integration.atol, of.longest, of.shortest
            self.mover = compiled_robot_runs.AdaptiveSteps(compiled, shown.model, course, tolerances)

    def run(self, mover: compiled_robot_runs.Mover) -> bool:
        """Make the run, recorded in `recording`; return whether it can be trusted."""
        begun = clock.perf_counter()
        act = None if self.acting is not None else self._of.actuation()
        try:
            reason = self._go(mover, act)
        except ControllerError as error:
            self._record(mover, Stop("controller", error.time, str(error.__cause__)))
            raise
        finally:
            self.recording.seconds = clock.perf_counter() - begun
        if reason == runs.DOUBTFUL:
            return False
        self._record(mover, self._of.margins.stop(reason - 1, mover.end) if reason else None)
        self.recording.evaluations = mover.evaluations
        return True

    def _go(self, mover: compiled_robot_runs.Mover, act: Actuation | None) -> int:
        """Go from part to part; return why it ended."""
        rows = range(0, len(mover.begins), _CHUNK if act is None else 1)
        begins, reason = mover.begins[rows], 0
        ends = np.append(begins[1:], mover.parts).tolist()
        for row, begin, end in zip(rows, begins.tolist(), ends, strict=True):
            if act is not None:
                self._command(mover, act, mover.when(begin))
            reason = mover.advance(begin, end - begin, end == mover.parts, row)
            if reason:
                return reason
            self._of.looked(mover.taken)
        return reason

    def _command(self, mover: compiled_robot_runs.Mover, act: Actuation, time: float) -> None:
        """Let a controller act at the present state."""
        try:
            _, asked = act(time, *self._of.plant.actuated(mover.state()))
        except Exception as error:
            words = f"the controller failed at t = {time:.6g} s: {error}"
            raise ControllerError(words, time) from error
        mover.hold(asked)  # cut off in C as by the actuation

    def _record(self, mover: compiled_robot_runs.Mover, stop: Stop | None) -> None:
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


class ObservedPlant(ConstrainedPlant):
    """A robot whose whole state controllers may read."""

    def __init__(self, loop: ClosedLoopModel, stabilisation: float, frames: Sequence[str]) -> None:
        super().__init__(loop, stabilisation, frames)
        self._seen: FloatArray = np.zeros(0)

    def actuated(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities of the actuated joints, (n,) each [m or rad, and per second]."""
        self._seen = state
        return super().actuated(state)

    def measurement(
        self, time: float, period: float, positions: FloatArray, velocities: FloatArray, saturated: Any
    ) -> RobotMeasurement:
        """Return what a controller sees, at the state that was asked for last."""
        return RobotMeasurement(time, positions, velocities, period, saturated, *self.split(self._seen))


def require_robot(loop: Any) -> None:
    """Raise `InputError` unless this is a robot with joints."""
    require("loop", loop, ClosedLoopModel)
    if not loop.model.nv:
        raise InputError("loop: expected a robot with joints, this one has none")


def largest_forces(loop: ClosedLoopModel, control: ControlLoop) -> FloatArray:
    """Return where forces are cut off (n,) [N or N m]; an effort of zero in the robot's file is none."""
    effort = np.asarray(loop.model.upperEffortLimit)[loop.actuated_v]
    return control.largest_forces(np.where(effort > 0, effort, np.inf), len(effort))


def _start(
    loop: ClosedLoopModel, q: ArrayLike | InitialState | None, v: ArrayLike | None
) -> tuple[ArrayLike, ArrayLike]:
    if isinstance(q, InitialState):
        if q.joints is None or v is not None:
            raise InputError("q: of any robot an InitialState gives the joints, and v belongs to it")
        return q.joints
    return loop.assemble().q if q is None else q, np.zeros(loop.model.nv) if v is None else v


def _followed(
    loop: ClosedLoopModel, reference: JointReference | ArrayLike | None, controller: RobotController
) -> JointReference | None:
    if reference is not None:
        return reference_of(loop, reference)
    own = getattr(controller, "reference", None)
    return reference_of(loop, own) if isinstance(own, JointReference) else None


def _stands(controller: Any) -> bool:
    """Whether a controller depends on the state only."""
    return type(controller) in (JointPD, JointComputedTorque) and not controller.reference.duration
