"""`simulate_robot`: any robot with closed loops in time, by the integrator that moves the manipulator."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, Progress, positive, shown
from p3dof._base.errors import ControllerError, DynamicsError, InputError
from p3dof.loops import ClosedLoopModel
from p3dof.loops.compiling_model import Method
from p3dof.machine.motion.times import evenly, sample_count
from p3dof.runs.actuation import Actuation
from p3dof.runs.compiled_robot_runs import RobotRunInC, Setting
from p3dof.runs.compiled_robots import states_for
from p3dof.runs.crossings import CHECKED, Watch
from p3dof.runs.drives import DrivenPlant, Lag
from p3dof.runs.events import Event, Occurrence, checked_events
from p3dof.runs.integration import Integrator, Recording, Schedule, Tolerances
from p3dof.runs.joint_controllers import RobotMeasurement
from p3dof.runs.joint_reference import JointReference, reference_of
from p3dof.runs.plants import ConstrainedPlant
from p3dof.runs.robot_loads import ExternalOverTime, Loads
from p3dof.runs.robot_margins import ROBOT_KINDS, RobotMargins
from p3dof.runs.robot_run import RobotRun, explained
from p3dof.runs.settings import ControlLoop, InitialState, Integration
from p3dof.runs.work import Work, require_affordable

RobotController: TypeAlias = Callable[[RobotMeasurement], ArrayLike] | ArrayLike | None
"""A controller, forces (n_actuated,) that stay, or None for none at all."""

CLOSED = 1e-9
"""Largest gap of a start, and share of its velocity that may open the loops."""
ROBOT_PRECISE, ROBOT_CONTINUOUS = Integration(rtol=1e-9, atol=1e-11), ControlLoop()
SHORTEST = 1e-6
"""Steps of a robot that are shorter lead nowhere, if there are very many [s]: it is near a singularity."""
_STEPS, _PER_STEP = 50.0, 14
"""Steps a second that are expected of a robot that moves freely, and evaluations in each."""


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
    samples: int = 1001,
    integration: Integration = ROBOT_PRECISE,
    progress: Progress | None = None,
    method: Method = "general",
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
    samples : int
        How many samples to keep, evenly spaced.
    integration : Integration
        Tolerances, longest step, stabilisation of the closures, and how long it may take.
    progress : callable, optional
        Called with (done, total) samples.
    method : {"general", "compiled"} or CompiledLoop
        What computes accelerations: the robot; C that is compiled for it now, or taken from the cache; or
        what `ClosedLoopModel.compile` returned, for many runs. Where compiled dynamics are not to be trusted
        the robot decides, so that runs end for the same reasons. If all that acts has a
        compiled form the whole run is made in C; with ``scheme="rk4"`` of the integration its closures are
        projected instead of stabilised. See `p3dof.runs.compiled_robot_runs`.

    Returns
    -------
    RobotRun

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
    check_robot(loop, control, integration)
    times = evenly(0.0, positive("duration", duration, InputError), sample_count(samples, least=2))
    loads, chosen = Loads(loop, external), checked_events(events)
    beta = integration.stabilisation
    plant = ObservedPlant(loop, beta, loads.frames)
    state = plant.checked_state(*_start(loop, q, v), CLOSED)
    plant.compiled = states_for(loop, method, "forward_dynamics", loads.frames, beta, plant.split(state)[0])
    margins = RobotMargins(plant, stop_at, [event for event in chosen if event.stops], state)
    count = len(loop.actuated)
    effort = np.asarray(loop.model.upperEffortLimit)[loop.actuated_v]
    limits = control.largest_forces(np.where(effort > 0, effort, np.inf), count)
    followed = _followed(loop, reference, controller)
    ends = [] if followed is None else [followed.duration]
    kinks = np.union1d(loads.kinks, ends)
    noted = [event for event in chosen if not event.stops]

    def actuation() -> Actuation:
        return Actuation(plant.measurement, controller, control.period, limits, control.encoders(count))

    longest = integration.longest_step(_careful_step(control, controller, loads))
    setting = Setting(
        loop,
        plant,
        controller,
        control,
        integration,
        loads,
        margins,
        limits,
        times,
        kinks,
        longest,
        SHORTEST,
        progress,
    )
    compiled = None if noted else setting.compiled
    if compiled is not None:
        actuation()  # says what does not fit
        in_c = RobotRunInC(setting, compiled, state)
        finish = _Finish(loop, plant, loads, followed, (), None)
        try:
            made = in_c(actuation)
        except ControllerError as error:
            if in_c.recording.times:
                error.run = finish(in_c.recording)
            raise
        if made is not None:
            return finish(made)
    drives = control.drives(count)
    _require_affordable(plant, state, count, times, longest, control, integration.time_limit)
    schedule = Schedule(times, control.period, kinks, control.lateness)
    tolerances = Tolerances(integration.rtol, integration.atol, longest, integration.scheme)
    watch = _watch(plant, noted) if noted else None
    lag = None if drives is None or not control.period else Lag(drives)
    moved = plant if drives is None or lag is not None else DrivenPlant(plant, drives)
    integrator = Integrator(
        moved, actuation(), loads, margins, schedule, tolerances, progress, watch, SHORTEST, lag
    )
    finish = _Finish(loop, plant, loads, followed, noted, watch)
    try:
        record = integrator.run(state)
    except ControllerError as error:
        if integrator.recording.times:
            error.run = finish(integrator.recording)
        raise
    if not record.times:
        raise DynamicsError(f"the run cannot start: {record.stop}")
    return finish(record)


class ObservedPlant(ConstrainedPlant):
    """A robot whose whole state controllers may read.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    stabilisation : float
        β of Baumgarte's stabilisation [1/s].
    frames : sequence of str
        Where wrenches act.
    """

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


class _Finish:
    """Makes a `RobotRun` of what was recorded."""

    def __init__(
        self,
        loop: ClosedLoopModel,
        plant: ConstrainedPlant,
        loads: Loads,
        reference: JointReference | None,
        noted: Sequence[Event],
        watch: Watch | None,
    ) -> None:
        self._loop, self._plant, self._loads = loop, plant, loads
        self._reference, self._noted, self._watch = reference, noted, watch

    def __call__(self, record: Recording) -> RobotRun:
        q, v, a, gap = self._plant.motion(np.array(record.states), np.array(record.rates))
        time = np.array(record.times)
        loads = np.array(record.loads).reshape(len(time), -1, 6)
        changes = () if self._watch is None else self._watch.changes
        return RobotRun(
            self._loop,
            time,
            q,
            v,
            a,
            np.array(record.forces).reshape(len(time), -1),
            np.array(record.asked).reshape(len(time), -1),
            gap,
            self._loop.body_energies(q, v).total,
            explained(record.stop, self._loop, v[-1]),
            record.evaluations,
            record.seconds,
            {name: loads[:, i] for i, name in enumerate(self._loads.frames)},
            None if self._reference is None else self._reference.over(time)[0],
            tuple(Occurrence(self._noted[i].name, when, rose) for when, i, rose in changes),
        )


def check_robot(loop: Any, control: Any, integration: Any) -> None:
    """Raise unless these are a robot with joints, and settings.

    Raises
    ------
    InputError
        With the name of the one that is not.
    """
    if not isinstance(loop, ClosedLoopModel):
        raise InputError(f"loop: expected a ClosedLoopModel, got {shown(loop)}")
    if not loop.model.nv:
        raise InputError("loop: expected a robot with joints, this one has none")
    for name, value, kind in (("control", control, ControlLoop), ("integration", integration, Integration)):
        if not isinstance(value, kind):
            raise InputError(f"{name}: expected {kind.__name__}(...), got {shown(value)}")


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


def _careful_step(control: ControlLoop, controller: RobotController, loads: Loads) -> float:
    """Return the longest step [s]: short where a function acts that could change unseen in between."""
    known = np.inf if getattr(controller, "autonomous", False) else CHECKED
    acting = not control.rate and callable(controller)
    own = float(getattr(controller, "longest_step", known)) if acting else np.inf
    return min(own, CHECKED if loads.watched else np.inf)


def _watch(plant: ConstrainedPlant, events: Sequence[Event]) -> Watch:
    def values(time: float, state: FloatArray) -> FloatArray:
        q, v = plant.split(state)
        return np.array([event.at(time, q, v) for event in events])

    return Watch(values)


def _require_affordable(
    plant: ConstrainedPlant,
    state: FloatArray,
    count: int,
    times: FloatArray,
    longest: float,
    control: ControlLoop,
    limit: float,
) -> None:
    """Raise if a run would take too long, by the time that the equations of motion take here."""
    began = clock.perf_counter()
    for _ in range(3):
        plant.rate(state, np.zeros(count), np.zeros(0))
    seconds = (clock.perf_counter() - began) / 3
    steps = float(times[-1]) * max(_STEPS, 1 / longest, control.changes, 1 / control.quickest)
    require_affordable(
        Work(steps, seconds * (_PER_STEP * steps + len(times))), len(times), limit, "time_limit"
    )
