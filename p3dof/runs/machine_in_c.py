"""Runs of the machine in C: what is the same for all of them is made once, each begins where it is told."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, Progress
from p3dof._base.errors import ControllerError, DynamicsError
from p3dof._base.time_series.wrenches import Load, WrenchHistory, WrenchOverTime
from p3dof.closed_form.compiled import runs
from p3dof.closed_form.compiled.runs import NO_CONTROLLER, CompiledRun, Forces, Samples, Timing, Watched
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import Parameters
from p3dof.methods import Machine
from p3dof.runs import compiled_controllers as controllers
from p3dof.runs.actuation import Actuation, Measure, constant_forces
from p3dof.runs.controllers import Reference, Springs
from p3dof.runs.integration import BEYOND, FAILED, NEAR
from p3dof.runs.machine_plants import Limiter
from p3dof.runs.margins import Stop
from p3dof.runs.settings import ControlLoop, InitialState, Integration, require_room
from p3dof.runs.simulation import LaterSimulation, Simulation

_IDLE = 2  # most runs that wait to be made again: those of so many threads

_SHOWN = 1001  # samples that are kept of a run that goes to a file

_USUAL = 1e9
"""Where no number of a run that went on is larger, no acceleration is beyond what a motion may have [SI]."""


class RunTask(Protocol):
    """What a run of the machine is given, checked: `p3dof.runs.machine.RunOfMachine`."""

    machine: Machine
    parameters: Parameters
    count: int
    times: FloatArray
    controller: Any
    control: ControlLoop
    integration: Integration
    wrench: WrenchOverTime
    reference: Motion | None
    stop_at: Any
    measure: Measure
    largest: FloatArray
    longest: float
    in_c_too: bool

    @property
    def called(self) -> bool:
        """Whether a controller in Python acts at every tick."""

    @property
    def springs(self) -> bool:
        """Whether springs act continuously, instead of drives."""

    def actuation(self) -> Actuation:
        """Return what asks the controller; it is reset."""

    def followed(self) -> Reference | None:
        """Return what the run should follow."""


class MachineInC:
    """The tables of a run, and how it is made."""

    def __init__(self, task: RunTask) -> None:
        self._task = task
        self._limiter = Limiter(task.parameters, task.stop_at)
        self._largest, self._idle = task.largest, list[CompiledRun]()
        constant = task.controller if not callable(task.controller) else None
        self._held = self.held(constant)
        self._reset = getattr(task.controller, "reset", None)
        self._followed = task.followed() if task.reference is not None else None
        task.control.encoders(task.count)  # say what does not fit

    def held(self, forces: ArrayLike | None) -> FloatArray:
        """Return constant forces as they act, and as they were asked for, (6,)."""
        found = np.zeros(6)
        if forces is not None:
            found[3:] = constant_forces(forces, 3)
            np.clip(found[3:], -self._largest, self._largest, out=found[:3])
        return found

    def __call__(
        self,
        begin: InitialState,
        forces: ArrayLike | None = None,
        progress: Progress | None = None,
        begun: float | None = None,
        sink: Callable[[Simulation], object] | None = None,
    ) -> Simulation | None:
        """Make a run; return None if it cannot be in C.

        `forces` stay instead of those of the task; `begun` is when the call began on the clock [s]. A `sink`
        is given the samples part by part: the run that is returned has about a thousand of them.
        """
        if sink is None:
            require_room(len(self._task.times))
        run = _OneRun(self, begin, progress, clock.perf_counter() if begun is None else begun, sink)
        return run.made(self._held if forces is None else self.held(forces))

    def taken(self) -> CompiledRun:
        """Return a run that nobody makes now."""
        try:
            return self._idle.pop()
        except IndexError:
            pass
        task, largest = self._task, self._largest
        given = task.controller, task.control, float(task.times[-1]), task.parameters.geometry, largest
        known = task.in_c_too and not task.springs
        return CompiledRun(
            task.machine.kernels,
            self._forces(),
            _load(task),
            Watched(*self._limiter.watched),
            _timing(task),
            controllers.in_c(*given) if known else NO_CONTROLLER,
        )

    def given_back(self, run: CompiledRun) -> None:
        """Keep a run for another one."""
        if run.again and len(self._idle) < _IDLE:
            self._idle.append(run)

    def started(self, begin: InitialState) -> tuple[Limiter, FloatArray]:
        """Return the limits of a run, and where it begins, (7,)."""
        start, pose = np.empty(7), np.asarray(begin.pose)
        limiter, start[6] = self._limiter.started(pose)
        start[:3], start[3:6] = pose, begin.velocity
        return limiter, start

    def acting(self) -> Actuation | None:
        """Return what asks a controller of Python; a controller is reset in any case."""
        task = self._task
        if task.called or isinstance(task.controller, type):
            return task.actuation()
        if callable(self._reset):
            Actuation(task.measure, task.controller, task.control.period, self._largest)
        return None

    def _forces(self) -> Forces:
        """Return what drives the run; a controller from Python acts at its rate."""
        task, controller = self._task, self._task.controller
        springs: FloatArray = np.zeros(0)
        if task.springs and isinstance(controller, Springs):
            springs = np.concatenate(
                [controller.stiffness, controller.rest, controller.damping, controller.preload]
            )
        drives = task.control.drives()
        lag = np.full(3, np.inf) if drives is None else 2 * np.pi * drives
        return Forces(springs, self._largest, task.called, lag)

    def left(
        self,
        rows: FloatArray,
        followed: Reference | None,
        stop: Stop | None,
        evaluations: int,
        went_on: bool,
        part: bool = False,
    ) -> Simulation | None:
        """Return samples with all that belongs to them; None if there are none."""
        task, samples = self._task, Samples.of(rows)
        if not len(rows):
            return None
        if not (went_on and np.abs(rows).max() < _USUAL):  # no samples where no integrator could go on
            acceleration = runs.accelerations(task.machine.kernels, samples, wrenches(task, samples.time))
            parts = samples.pose, samples.velocity, acceleration
            good = np.all([(np.abs(part) <= BEYOND).all(axis=1) for part in parts], axis=0)
            samples = samples if good.all() else Samples(*(part[good] for part in samples))
            if not good.any():
                return None
        return LaterSimulation.of(
            task.machine.kernels,
            samples,
            followed,
            lambda times: wrenches(task, times),
            part,
            method="compiled",
            forces=samples.forces,
            asked=samples.asked,
            stop=stop,
            evaluations=evaluations,
            seconds=0.0,
            note="",
            events=(),
            parameters=task.parameters,
        )

    @property
    def task(self) -> RunTask:
        """What is made."""
        return self._task

    def following(self) -> Reference | None:
        """Return what the run should follow."""
        return self._followed or self._task.followed()


class _OneRun:
    """A run that is being made."""

    def __init__(
        self,
        of: MachineInC,
        begin: InitialState,
        progress: Progress | None,
        begun: float,
        sink: Callable[[Simulation], object] | None = None,
    ) -> None:
        self._of, self._progress, self._begun, self._sink = of, progress, begun, sink
        self._taken, self._every = 0, -(-len(of.task.times) // _SHOWN)
        self._limiter, self._start = of.started(begin)
        self._act = of.acting()
        self._followed = of.following()
        self._parts: list[FloatArray] = []

    def made(self, held: FloatArray) -> Simulation | None:
        """Integrate, and return what the run left; None if it cannot be in C."""
        of, run = self._of, self._of.taken()
        self._run = run
        try:
            run.begin(self._start)
            run.hold(held)
            status = self._integrate(run)
            if status == runs.BEYOND:
                return None
            stop = self._reason(status)
            found = self._left(stop, status != runs.FAILED)
        except ControllerError as error:
            error.run = self._left(Stop("controller", error.time, str(error.__cause__)), False)
            raise
        finally:
            of.given_back(run)
        if found is None:
            raise DynamicsError(f"the run cannot start: {stop}")
        return found

    def _left(self, stop: Stop | None, went_on: bool) -> Simulation | None:
        rows = self._run.rows()
        if self._sink is not None:
            rows = self._sunk(rows, went_on, last=True)
        if self._parts:
            rows = np.concatenate([*self._parts, rows])
        found = self._of.left(rows, self._followed, stop, self._run.evaluations, went_on)
        if found is not None:
            found.__dict__["seconds"] = clock.perf_counter() - self._begun
        return found

    def _drained(self, _: int) -> None:
        rows = self._run.rows()
        self._parts.append(rows if self._sink is None else self._sunk(rows, True))

    def _sunk(self, rows: FloatArray, went_on: bool, last: bool = False) -> FloatArray:
        """Give rows away; return those that are kept."""
        part = self._of.left(rows, self._followed, None, 0, went_on, part=True)
        if part is None or self._sink is None:
            return rows[:0]
        self._sink(part)
        rows = rows[: len(part)]
        kept = (np.arange(self._taken, self._taken + len(rows)) % self._every) == 0
        kept[-1] |= last
        self._taken += len(rows)
        return np.asarray(rows[kept])

    def _integrate(self, run: CompiledRun) -> int:
        """Go on to the end of the run; return why it ended."""
        progress, act, total = self._progress, self._act, len(self._of.task.times)
        told = None if progress is None else lambda done: progress(done, total)
        while True:
            status = run.advance(told, self._drained)
            if status != runs.TICK or act is None:
                break
            time, positions, velocities = run.actuated()
            try:
                forces, asked = act(time, positions, velocities)
            except Exception as error:
                failed = f"the controller failed at t = {time:.6g} s: {error}"
                raise ControllerError(failed, time) from error
            run.command(forces, asked)
        if progress is not None:
            taken = self._taken if self._sink else sum(map(len, self._parts))
            progress(min(run.count + taken, total), total)
        return status

    def _reason(self, status: int) -> Stop | None:
        """Return why the run ended before its time; None if it did not."""
        if status == runs.FINISHED:
            return None
        run, time = self._run, self._run.time
        if status == runs.CROSSED:
            return self._limiter.stop(run.index, time)
        margins = self._limiter(run.state()[:3], None)
        near = int(np.argmin(margins))
        if margins[near] < NEAR:  # what keeps it from going on is a limit, beyond which nothing is defined
            return self._limiter.stop(near, time)
        return Stop("accuracy", time, FAILED)


def _timing(task: RunTask) -> Timing:
    """Return when something happens in a run."""
    control, integration = task.control, task.integration
    tolerances = integration.rtol, integration.atol, task.longest
    return Timing(task.times, control.period, *tolerances, integration.scheme == "rk4", control.lateness)


def _load(task: RunTask) -> runs.Load:
    """Return what pushes the platform, as a table."""
    wrench, end = task.wrench, task.times[-1]
    if isinstance(wrench, WrenchHistory):
        kinks = wrench.time[(wrench.time > 0) & (wrench.time < end)]
        return runs.Load(wrench.time, wrench.wrench, kinks)
    return runs.Load(np.zeros(1), wrenches(task, np.zeros(1)), np.zeros(0))


def wrenches(task: RunTask, times: FloatArray) -> FloatArray:
    """Return the wrenches at times (N,), shape (N, 6)."""
    if isinstance(task.wrench, WrenchHistory):
        return task.wrench(times)
    return np.repeat(Load(task.wrench).at(0.0)[None], len(times), axis=0)
