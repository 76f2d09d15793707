"""Runs of the machine in time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, Progress, frozen_array, positive, shown
from p3dof._base.errors import ControllerError, DynamicsError, InputError
from p3dof.closed_form.kinematics import reachable_poses
from p3dof.machine.motion import Load, Motion, WrenchHistory, WrenchOverTime
from p3dof.machine.motion.times import evenly, sample_count
from p3dof.machine.parameters import Parameters
from p3dof.methods import DEFAULT_METHOD, Machine, Method, check_method
from p3dof.runs.compiled_machine import pace, simulate_compiled
from p3dof.runs.control import ControllerLike
from p3dof.runs.crossings import CHECKED
from p3dof.runs.drives import DrivenPlant, Lag
from p3dof.runs.equations import CompiledEquations, Equations
from p3dof.runs.integration import Integrator, Recording, Schedule, Tolerances
from p3dof.runs.limits import KINDS, Limiter
from p3dof.runs.machine_plants import MachineJoints, MachineMargins, MachinePlant, MinimalPlant
from p3dof.runs.reference import Reference
from p3dof.runs.run import Simulation
from p3dof.runs.settings import ControlLoop, InitialState, Integration
from p3dof.runs.task import Task
from p3dof.runs.ways import NO_ANSWER, in_python, why_python
from p3dof.runs.work import estimate, require_affordable

AT_HOME, CONTINUOUS, PRECISE = InitialState(), ControlLoop(), Integration()

_Group = TypeVar("_Group")

CLOSED = 1e-9
"""Largest gap of the loops that a run may start with [m]."""


def simulate(
    machine: Machine,
    duration: float,
    *,
    start: ArrayLike | InitialState = AT_HOME,
    controller: ControllerLike = None,
    control: ControlLoop = CONTINUOUS,
    reference: Motion | None = None,
    wrench: WrenchOverTime = None,
    method: Method = DEFAULT_METHOD,
    samples: int | ArrayLike = 1001,
    stop_at: Sequence[str] = KINDS,
    integration: Integration = PRECISE,
    progress: Progress | None = None,
) -> Simulation:
    """Move a machine in time under a controller, constant forces, or none.

    It ends early, with its reason in `Simulation.stop` and all samples so far, at a slider stop or tilt limit
    of `p3dof.Limits`, where a leg becomes horizontal, or where the sliders lose hold of the platform.

    Parameters
    ----------
    machine : Machine
        What is moved: `p3dof.Manipulator`.
    duration : float
        How long [s].
    start : array-like, shape (3,), or InitialState
        Where the platform starts from rest: (y, z, θ) [m, m, rad]; or with a velocity, or in all joints.
    controller : callable or array-like, shape (3,), optional
        Takes a `p3dof.Measurement`, returns the forces of A, B, C [N]; or forces that stay.
    control : ControlLoop
        How it acts: how often, how strongly, with which noise; continuously and exactly by default.
    reference : Motion, optional
        What the run should follow, for `Simulation.error`; what the controller follows by default.
    wrench : array-like, shape (6,), or callable, optional
        External force and moment on the platform at P, in the fixed frame [N, N m]; or a function of one time
        since the start of the run, or of many, such as a `p3dof.WrenchHistory`.
    method : {"pinocchio", "virtual-power", "compiled"}
        Integrate Pinocchio's constrained dynamics of all joints, with stabilised closures; or the minimal
        form in y, z, θ by the paper's formulas or by the kernels.
    samples : int or array-like, shape (N,)
        How many samples to keep, evenly spaced, or their times [s]; the end is always one.
    stop_at : sequence of str
        Which limits end the run, of ``"slider stop"``, ``"tilt limit"``, ``"singular pose"``; the
        ``"reach limit"`` always does.
    integration : Integration
        Tolerances, longest step, stabilisation of the closures, and how long it may take.
    progress : callable, optional
        Called with (done, total) samples.

    Returns
    -------
    Simulation

    Raises
    ------
    ReachError
        If the run starts out of reach.
    ControllerError
        If the controller raises or returns something else than three finite numbers; with the time, and the
        run so far in ``run``.
    InputError
        If an argument does not fit, the run would take too long, or it starts beyond a limit or with open
        loops.
    """
    given = start, controller, control, reference, wrench, method, samples, stop_at, integration, progress
    task = task_of(machine, duration, *given)
    reason = why_python(task)
    found = None if reason else simulate_compiled(task)
    return simulate_in_python(task, in_python(reason or NO_ANSWER)) if found is None else found


def simulate_in_python(task: Task, note: str = "") -> Simulation:
    """Run a machine by the integrator in Python, which serves whatever is asked for.

    Parameters
    ----------
    task : Task
        What is asked for.
    note : str
        Of the result.

    Returns
    -------
    Simulation

    Raises
    ------
    ReachError, InputError, ControllerError, DynamicsError
        As `simulate`.
    """
    machine, control, integration, wrench = task.machine, task.control, task.integration, task.wrench
    acting = _wrench(wrench)
    plant = _PLANTS[task.method](machine, integration)
    state = _state(plant, machine.parameters, task.begin)
    limiter = Limiter(machine.parameters, task.stop_at, plant.pose(state)[0], plant.drops(state))
    margins = MachineMargins(plant, limiter)
    actuation, followed = task.actuation(), task.followed()
    drives = control.drives()
    kinks = wrench.time if isinstance(wrench, WrenchHistory) else np.zeros(0)
    schedule = Schedule(task.times, control.period, kinks, control.lateness)
    tolerances = Tolerances(integration.rtol, integration.atol, task.longest, integration.scheme)
    lag = None if drives is None or not control.period else Lag(drives)
    moved = plant if drives is None or lag is not None else DrivenPlant(plant, drives)
    integrator = Integrator(moved, actuation, acting, margins, schedule, tolerances, task.progress, lag=lag)
    try:
        recording = integrator.run(state)
    except ControllerError as error:
        if integrator.recording.times:
            error.run = _result(task.method, plant, integrator.recording, followed, note)
        raise
    if not recording.times:
        raise DynamicsError(f"the run cannot start: {recording.stop}")
    return _result(task.method, plant, recording, followed, note)


def task_of(
    machine: Machine,
    duration: float,
    start: ArrayLike | InitialState = AT_HOME,
    controller: ControllerLike = None,
    control: ControlLoop = CONTINUOUS,
    reference: Motion | None = None,
    wrench: WrenchOverTime = None,
    method: Method = DEFAULT_METHOD,
    samples: int | ArrayLike = 1001,
    stop_at: Sequence[str] = KINDS,
    integration: Integration = PRECISE,
    progress: Progress | None = None,
) -> Task:
    """Return what is asked for, checked; arguments as of `simulate`."""
    check_method(method)
    begin = start if isinstance(start, InitialState) else InitialState(start)
    control = _group("control", control, ControlLoop)
    integration = _group("integration", integration, Integration)
    times = _times(duration, samples)
    _check_continuous(control, controller)
    longest = integration.longest_step(_careful_step(control, controller, wrench))
    given = controller, control, reference, wrench, stop_at, integration, progress
    task = Task(machine, method, times, longest, begin, *given)
    changes, shortest = control.changes, min(longest, control.quickest)
    work = estimate(pace(task), float(times[-1]), len(times), changes, shortest)
    require_affordable(work, len(times), integration.time_limit, "time_limit")
    if progress is not None and not callable(progress):
        raise InputError(f"progress: expected a function, got {shown(progress)}")
    return task


def _group(name: str, value: Any, kind: type[_Group]) -> _Group:
    if not isinstance(value, kind):
        raise InputError(f"{name}: expected {kind.__name__}(...), got {shown(value)}")
    return value


def _check_continuous(control: ControlLoop, controller: ControllerLike) -> None:
    """Raise if a controller cannot act continuously, and has to."""
    if control.rate is None and getattr(controller, "integral_time", math.inf) != math.inf:
        raise InputError("integral_time: an integral needs a control rate, this run is continuous")


def _careful_step(control: ControlLoop, controller: ControllerLike, wrench: WrenchOverTime) -> float:
    """Return the longest step of the integrator [s]: short where something may change unseen in between."""
    watched = callable(wrench) and not isinstance(wrench, WrenchHistory)
    acting = not control.rate and callable(controller) and not getattr(controller, "autonomous", False)
    return CHECKED if watched or acting else math.inf


def _joints(machine: Machine, integration: Integration) -> MachinePlant:
    return MachineJoints(machine.parameters, machine.loop, integration.stabilisation)


def _minimal(machine: Machine, _: Integration) -> MachinePlant:
    return MinimalPlant(machine.parameters, Equations(machine.parameters))


def _minimal_compiled(machine: Machine, _: Integration) -> MachinePlant:
    return MinimalPlant(machine.parameters, CompiledEquations(machine.kernels))


_PLANTS = {"pinocchio": _joints, "virtual-power": _minimal, "compiled": _minimal_compiled}
"""What is integrated, by method."""


def _state(plant: MachinePlant, parameters: Parameters, start: InitialState) -> FloatArray:
    if start.joints is None:
        pose = reachable_poses(parameters.geometry, np.asarray(start.pose), "raise")
        return plant.state(pose, np.asarray(start.velocity))
    if not isinstance(plant, MachineJoints):
        raise InputError("joints: the minimal coordinates have none; use pose and velocity, or 'pinocchio'")
    return plant.checked_state(*start.joints, CLOSED)


def _result(
    method: str, plant: MachinePlant, record: Recording, reference: Reference | None, note: str
) -> Simulation:
    states, rates, time = np.array(record.states), np.array(record.rates), np.array(record.times)
    poses, velocities = (np.array(rows) for rows in zip(*map(plant.pose, states), strict=True))
    accelerations = np.array([plant.acceleration(*pair) for pair in zip(states, rates, strict=True)])
    sliders, speeds = (np.array(rows) for rows in zip(*map(plant.actuated, states), strict=True))
    joints, gap = plant.joints(states, rates)
    return Simulation(
        method=method,
        motion=Motion(time, poses, velocities, accelerations, check=False),
        forces=np.array(record.forces),
        asked=np.array(record.asked),
        sliders=sliders,
        slider_velocities=speeds,
        joints=joints,
        closure_error=gap,
        wrench=np.array(record.loads),
        reference=None if reference is None else reference.poses(time),
        stop=record.stop,
        evaluations=record.evaluations,
        seconds=record.seconds,
        note=note,
    )


def _times(duration: float, samples: int | ArrayLike) -> FloatArray:
    """Return the sample times, from 0 to the end."""
    end = positive("duration", duration, InputError)
    if np.ndim(samples) == 0:
        return evenly(0.0, end, sample_count(samples, least=2))
    times = frozen_array("samples", samples, ("N",))
    if len(times) == 0 or times[0] < 0 or times[-1] > end or np.any(np.diff(times) <= 0):
        raise InputError(f"samples: expected rising times from 0 to {end:g} s")
    return times if times[-1] == end else np.append(times, end)


def _wrench(wrench: WrenchOverTime) -> Callable[[float], FloatArray]:
    load = Load(wrench)
    if callable(wrench):
        return load.at
    held = load.at(0.0)
    return lambda _: held
