"""Runs of the manipulator in C, where everything that is asked for has a compiled form.

`p3dof.runs.ways` says what has none: `p3dof.runs.integration` serves it, and is what the runs in
C are compared with.
"""

from __future__ import annotations

import time as clock
from dataclasses import fields
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import ControllerError, DynamicsError
from p3dof.closed_form import kinematics
from p3dof.closed_form.compiled import runs
from p3dof.closed_form.compiled.kernels import MachineKernels
from p3dof.closed_form.compiled.runs import NO_CONTROLLER, CompiledRun, Forces, Samples, Timing, Watched
from p3dof.closed_form.kinematics import reachable_poses
from p3dof.machine.motion import Load, Motion, WrenchHistory
from p3dof.methods import JointStates
from p3dof.runs.compiled_controllers import controller_of, follows, has_table
from p3dof.runs.controllers import Springs
from p3dof.runs.integration import BEYOND, FAILED, NEAR
from p3dof.runs.limits import Limiter
from p3dof.runs.margins import Stop
from p3dof.runs.reference import Reference
from p3dof.runs.run import Simulation
from p3dof.runs.task import Task
from p3dof.runs.ways import why_python


def _from_python(task: Task) -> bool:
    """Return whether a controller in Python acts at every tick."""
    known = (
        has_table(task) or follows(task) or (task.control.rate is None and type(task.controller) is Springs)
    )
    return callable(task.controller) and not known


def pace(task: Task) -> str:
    """Return by what a run is integrated, as `p3dof.runs.work.estimate` takes it.

    Parameters
    ----------
    task : Task
        What is asked for.

    Returns
    -------
    str
    """
    if why_python(task):
        return task.method
    return "C and Python" if _from_python(task) else "C"


def simulate_compiled(task: Task) -> Simulation | None:
    """Run a machine in C.

    Parameters
    ----------
    task : Task
        What is asked for; nothing keeps it from C: `p3dof.runs.ways.why_python`.

    Returns
    -------
    Simulation, or None
        None if a controller's model has no answer somewhere: the integrator in Python says what is wrong.

    Raises
    ------
    ReachError, InputError, ControllerError, DynamicsError
        As `p3dof.runs.simulate`.
    """
    return _Runner(task).result()


class LaterSimulation(Simulation):
    """A run whose joints, closure errors, sliders and reference are computed when they are first asked for.

    They take longer than a short run itself.
    """

    @classmethod
    def of(
        cls, kernels: MachineKernels, samples: Samples, followed: Reference | None, **known: Any
    ) -> Simulation:
        """Return a run from its machine, samples, what it followed, and all else that is known of it."""
        run = object.__new__(cls)
        later = {"_kernels": kernels, "_samples": samples, "_followed": followed}
        for name, value in {**known, **later}.items():
            object.__setattr__(run, name, value)
        return run

    def __reduce__(self) -> tuple[type[Simulation], tuple[Any, ...]]:
        return Simulation, tuple(getattr(self, field.name) for field in fields(Simulation))

    def __getattr__(self, name: str) -> Any:
        made = _LATER.get(name)
        if made is None:
            raise AttributeError(f"{type(self).__name__!r} has no attribute {name!r}")
        for each, value in made(self).items():
            object.__setattr__(self, each, value)
        return self.__dict__[name]


def _joints(run: Any) -> dict[str, Any]:
    motion, geometry = run.motion, run._kernels.parameters.geometry
    found = kinematics.mechanism_motion(geometry, motion.pose, motion.velocity, motion.acceleration, "nan")
    parts = found.position, found.velocity, found.acceleration
    joints = JointStates.from_mappings(tuple(found.position), *parts)
    return {"joints": joints, "closure_error": kinematics.closure_error(geometry, found)}


def _sliders(run: Any) -> dict[str, Any]:
    positions, velocities = runs.sliders(run._kernels, run._samples)
    return {"sliders": positions, "slider_velocities": velocities}


def _reference(run: Any) -> dict[str, Any]:
    return {"reference": None if run._followed is None else run._followed.poses(run._samples.time)}


_LATER = {
    "joints": _joints,
    "closure_error": _joints,
    "sliders": _sliders,
    "slider_velocities": _sliders,
    "reference": _reference,
}


class _Runner:
    """One run in C, and what it leaves."""

    def __init__(self, task: Task) -> None:
        self._task = task
        parameters, begin = task.machine.parameters, task.begin
        pose = reachable_poses(parameters.geometry, np.asarray(begin.pose), "raise")
        self._limiter = Limiter(parameters, task.stop_at, pose, None)
        self._actuation = task.actuation()
        self._followed = task.followed()
        known = has_table(task) or follows(task)
        self._run = CompiledRun(
            task.machine.kernels,
            np.concatenate([pose, np.asarray(begin.velocity)]),
            self._forces(),
            _load(task),
            Watched(*self._limiter.watched),
            _timing(task),
            controller_of(task, self._actuation.limits) if known else NO_CONTROLLER,
        )
        self._stop: Stop | None = None
        self._seconds = 0.0

    def _forces(self) -> Forces:
        """Return what drives the run; a controller from Python acts at its rate."""
        task, largest = self._task, self._actuation.limits
        controller, held = task.controller, np.zeros(6)
        springs: FloatArray = np.zeros(0)
        outside = _from_python(task)
        if type(controller) is Springs and task.control.rate is None:
            parts = controller.stiffness, controller.rest, controller.damping, controller.preload
            springs = np.concatenate(parts)
        elif controller is not None and not callable(controller):
            asked = np.asarray(controller, dtype=float)
            held = np.concatenate([np.clip(asked, -largest, largest), asked])
        drives = task.control.drives()
        lag = np.full(3, np.inf) if drives is None else 2 * np.pi * drives
        return Forces(held, springs, largest, outside, lag)

    def result(self) -> Simulation | None:
        """Integrate, and return what the run left; None if it cannot be in C."""
        begun = clock.perf_counter()
        try:
            status = self._integrate()
        except ControllerError as error:
            self._stop = Stop("controller", error.time, str(error.__cause__))
            error.run = self._simulation()
            raise
        finally:
            self._seconds = clock.perf_counter() - begun
        if status == runs.BEYOND:
            return None
        self._stop = self._reason(status)
        found = self._simulation()
        if found is None:
            raise DynamicsError(f"the run cannot start: {self._stop}")
        return found

    def _integrate(self) -> int:
        """Go on to the end of the run; return why it ended."""
        progress, total = self._task.progress, len(self._task.times)
        told = None if progress is None else lambda done: progress(done, total)
        advance, hold, actuated = self._run.advance, self._run.hold, self._run.actuated
        while True:
            status = advance(told)
            if status != runs.TICK:
                break
            time, positions, velocities = actuated()
            try:
                forces, asked = self._actuation(time, positions, velocities)
            except Exception as error:
                failed = f"the controller failed at t = {time:.6g} s: {error}"
                raise ControllerError(failed, time) from error
            hold(forces, asked)
        if progress is not None:
            progress(min(self._run.count, total), total)
        return status

    def _reason(self, status: int) -> Stop | None:
        """Return why the run ended before its time; None if it did not."""
        time = self._run.time
        if status == runs.CROSSED:
            return self._limiter.stop(self._run.index, time)
        if status != runs.FAILED:
            return None
        margins = self._limiter(self._run.state()[:3], None)
        near = int(np.argmin(margins))
        if margins[near] < NEAR:  # what keeps it from going on is a limit, beyond which nothing is defined
            return self._limiter.stop(near, time)
        return Stop("accuracy", time, FAILED)

    def _simulation(self) -> Simulation | None:
        """Return the samples so far with all that belongs to them; None if there are none."""
        machine = self._task.machine
        samples, wrench, acceleration = self._recorded()
        if not len(samples.time):
            return None
        return LaterSimulation.of(
            machine.kernels,
            samples,
            self._followed,
            method="compiled",
            motion=Motion(samples.time, samples.pose, samples.velocity, acceleration, check=False),
            forces=samples.forces,
            asked=samples.asked,
            wrench=wrench,
            stop=self._stop,
            evaluations=self._run.evaluations,
            seconds=self._seconds,
            note="",
        )

    def _recorded(self) -> tuple[Samples, FloatArray, FloatArray]:
        """Return samples, wrenches and accelerations; without samples where no integrator could go on."""
        machine = self._task.machine
        samples = self._run.samples()
        wrench = _wrenches(self._task, samples.time)
        acceleration = runs.accelerations(machine.kernels, samples, wrench)
        parts = samples.pose, samples.velocity, acceleration
        good = np.all([(np.abs(part) <= BEYOND).all(axis=1) for part in parts], axis=0)
        if good.all():
            return samples, wrench, acceleration
        return Samples(*(part[good] for part in samples)), wrench[good], acceleration[good]


def _timing(task: Task) -> Timing:
    """Return when something happens in a run."""
    control, integration = task.control, task.integration
    tolerances = integration.rtol, integration.atol, task.longest
    return Timing(task.times, control.period, *tolerances, integration.scheme == "rk4", control.lateness)


def _load(task: Task) -> runs.Load:
    """Return what pushes the platform, as a table."""
    wrench, end = task.wrench, task.times[-1]
    if isinstance(wrench, WrenchHistory):
        kinks = wrench.time[(wrench.time > 0) & (wrench.time < end)]
        return runs.Load(wrench.time, wrench.wrench, kinks)
    return runs.Load(np.zeros(1), _wrenches(task, np.zeros(1)), np.zeros(0))


def _wrenches(task: Task, times: FloatArray) -> FloatArray:
    """Return the wrenches at times (N,), shape (N, 6)."""
    if isinstance(task.wrench, WrenchHistory):
        return task.wrench(times)
    return np.repeat(Load(task.wrench).at(0.0)[None], len(times), axis=0)
