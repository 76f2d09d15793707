"""`simulate_many`: many runs of the machine in time, each with its own numbers."""

from __future__ import annotations

import time as clock
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, Progress, positive, shown, whole
from p3dof._base.errors import LOG, InputError
from p3dof._base.time_series.wrenches import WrenchOverTime
from p3dof.closed_form.compiled.kernels import NUMPY, MachineKernels
from p3dof.closed_form.compiled.many import HISTORY_WIDTH, RESULTS
from p3dof.machine.motion import Motion
from p3dof.machine.motion.core import require_motion
from p3dof.machine.parameters import Parameters
from p3dof.runs import (
    AT_HOME,
    CONTINUOUS,
    KINDS,
    PD,
    TIME_LIMIT,
    ControlLoop,
    InitialState,
    Integration,
    Springs,
)
from p3dof.runs.actuation import constant_forces
from p3dof.runs.controllers import ControllerLike
from p3dof.runs.many.columns import GAINS, RunColumns
from p3dof.runs.many.plan import CAREFULLY, SharedTask, why_not
from p3dof.runs.many.results import ManyRuns, RunHistories
from p3dof.runs.many.running import RunWork, run_with
from p3dof.runs.settings import Work, estimate, require_affordable, require_settings

EQUAL_STEPS = Integration(scheme="rk4")

_PER_STEP = 1e-7  # about how long a step of a run takes in lanes [s]

_CAREFUL = 1000  # as how many steps one counts that is gone carefully because of steep friction

_LONGEST = 100_000_000  # most ticks of a run


def simulate_many(
    machine: Parameters,
    duration: float,
    runs: Any,
    *,
    start: ArrayLike | InitialState = AT_HOME,
    controller: ControllerLike = None,
    control: ControlLoop = CONTINUOUS,
    reference: Motion | None = None,
    wrench: WrenchOverTime = None,
    stop_at: Sequence[str] = KINDS,
    integration: Integration = EQUAL_STEPS,
    histories: bool | int | Sequence[int] = False,
    every: int = 1,
    level: str | None = None,
    threads: int | None = None,
    lanes: bool = True,
    client: Any = None,
    progress: Progress | None = None,
) -> ManyRuns:
    """Run many machines in time, each from its own start, with its own gains, noise, payload and wrench.

    The runs go side by side through the compiled extension, by RK4 in equal steps of which one ends at every
    tick of the controller; where a run crosses a limit, or a leg is nearly horizontal, it goes on alone by
    DOP853. Where joints have friction, steps are as short as its time constant asks for. No run depends on
    the others. Without the extension, with a controller written in Python, with a model with friction in
    `ComputedTorque`, or with ``Integration(scheme="dop853")``, runs are made one after the other by
    `Manipulator.simulate`, which takes a thousand times as long; `ManyRuns.note` says so.

    Parameters
    ----------
    machine : Parameters
        What has no column.
    duration : float
        How long each run is [s].
    runs : int, mapping, table or sequence of Parameters
        How many; or columns, one number for each run or one for all: ``start.y``, ``start.z``,
        ``start.theta``, ``start.vy``, ``start.vz``, ``start.vtheta``; ``controller.frequency``,
        ``controller.damping``, ``controller.integral_time`` (``frequency`` will do) of `PD` and its kin,
        ``controller.stiffness`` of `Springs`; ``seed`` of the noise; ``wrench.fy``, ``wrench.fz``,
        ``wrench.my``; and those of `Designs` for the machine (``L``, ``platform.mass``, ``payload.mass``,
        ``limits.force``). In SI units, or with a unit in brackets: ``start.y [mm]``. Or a machine a run.
    start : array-like, shape (3,), or InitialState
        Where runs start that have no columns for it.
    controller : callable or array-like, shape (3,), optional
        As of `Manipulator.simulate`; the model in it is the same for all runs.
    control : ControlLoop
        How it acts. Without a column ``seed`` the noise of a run has the seed of `Noise` plus its number.
    reference : Motion, optional
        What tracking errors are counted from; what the controller follows by default.
    wrench : array-like, shape (6,), or callable, optional
        On the platform of every run; of functions, the values at beginning, middle and end of steps count.
    stop_at : sequence of str
        Which limits end a run.
    integration : Integration
        The longest step; tolerances of runs that go on alone.
    histories : bool, int or sequence of int
        Of which runs to keep the states on the way: all, the first so many, or these.
    every : int
        A sample of a history every so many ticks; the end is always one.
    level, threads
        What to run on, as of `MachineKernels`; one thread for each 1024 runs at most.
    lanes : bool
        Side by side in the lanes of the processor; False is quicker for fewer than five runs, the same but
        for rounding.
    client : distributed.Client or concurrent.futures.Executor, optional
        Who makes the runs, in parts of a quarter of a second or so: a cluster of Dask,
        `p3dof.blocks.Processes`, or any executor; the threads of this process without one. The results
        are the same to the last bit. A controller written in Python must be one that can be pickled (Dask
        takes any), and begins each part as it is now.
    progress : callable, optional
        Called with (done, total) runs.

    Returns
    -------
    ManyRuns
        On an interrupt (Ctrl-C), with the runs that were done.

    Raises
    ------
    InputError
        If an argument or the name or length of a column does not fit, or it would take too long. A run with
        numbers that cannot be has a reason instead.
    SweepError
        If workers of a client die again and again.
    """
    task = _task(duration, start, controller, control, reference, wrench, stop_at, integration)
    columns = RunColumns(runs, machine)
    _check_gains(columns, controller)
    kept, every = _kept(histories, columns.count), whole("every", every, 1)
    if progress is not None and not callable(progress):
        raise InputError(f"progress: expected a function, got {shown(progress)}")
    kernels = MachineKernels(machine, level, threads)
    reason = "the extension is not used" if kernels.level == NUMPY else why_not(task)
    begun = clock.perf_counter()
    work = RunWork(task, columns, machine, kept, every, None if reason else kernels.level, bool(lanes))
    if reason is None:
        _require_time(task, np.ones(1, np.int64), columns.count)  # before any column is filled
        seconds = _require_time(task, work.batch.parts)
        note = f"lanes on {kernels.level}" if lanes else f"in C on {kernels.level}"
    else:
        seconds = _require_time_singly(task, columns.count)
        note = f"one by one: {reason}"
    if client is None:
        found, states, interrupted = work.run(kernels.threads, progress)
    else:
        found, states, interrupted = run_with(client, work, seconds, progress)
    return _results(found, states, kept, columns, clock.perf_counter() - begun, interrupted, note)


def require_runs(
    machine: Parameters,
    duration: float,
    runs: Any,
    *,
    start: ArrayLike | InitialState = AT_HOME,
    controller: ControllerLike = None,
    control: ControlLoop = CONTINUOUS,
    reference: Motion | None = None,
    wrench: WrenchOverTime = None,
    stop_at: Sequence[str] = KINDS,
    integration: Integration = EQUAL_STEPS,
    lanes: bool = True,
) -> None:
    """Raise `InputError` if arguments of `simulate_many` do not fit, before anything is made."""
    del lanes
    _task(duration, start, controller, control, reference, wrench, stop_at, integration)
    _check_gains(RunColumns(runs, machine), controller)


def _task(
    duration: float,
    start: ArrayLike | InitialState,
    controller: Any,
    control: ControlLoop,
    reference: Motion | None,
    wrench: WrenchOverTime,
    stop_at: Sequence[str],
    integration: Integration,
) -> SharedTask:
    begin = start if isinstance(start, InitialState) else InitialState(start)
    if begin.joints is not None:
        raise InputError("start: many runs start at a pose and velocity of the platform, not in joints")
    require_settings(control, integration)
    kinds = [stop_at] if isinstance(stop_at, str) or not isinstance(stop_at, Sequence) else list(stop_at)
    if isinstance(stop_at, str) or any(kind not in KINDS for kind in kinds):
        raise InputError(f"stop_at: expected a list of {', '.join(KINDS)}, got {shown(stop_at)}")
    if reference is not None:
        require_motion(reference, "reference")
    if isinstance(controller, type):
        raise InputError(f"controller: expected an object, got the class {controller.__name__}")
    if controller is not None and not callable(controller):
        controller = constant_forces(controller, 3)
    if isinstance(controller, PD) and control.rate is None:
        raise InputError(
            "control: many runs under this controller need a control rate, ControlLoop(rate=...)"
        )
    followed = controller.motion if reference is None and isinstance(controller, PD) else reference
    state = np.concatenate([np.asarray(begin.pose), np.asarray(begin.velocity)])
    end = positive("duration", duration, InputError)
    task = SharedTask(end, controller, control, followed, wrench, tuple(kinds), integration, state)
    if task.ticks > _LONGEST:
        raise InputError(f"duration: expected at most {_LONGEST:g} ticks or steps, got {task.ticks:g}")
    return task


def _check_gains(columns: RunColumns, controller: Any) -> None:
    """Raise if a column is for another controller."""
    for name in GAINS:
        serves = Springs if name == "controller.stiffness" else PD
        if name in columns.own and not isinstance(controller, serves):
            whose = "Springs" if serves is Springs else "PD, Feedforward or ComputedTorque"
            raise InputError(f"runs: the column {name} is for a controller of the kind {whose}")


def _require_time(task: SharedTask, parts: NDArray[np.int64], times: int = 1) -> float:
    """Raise if the runs would take too long, whose steps are cut into parts; return about how long."""
    each = task.duration * np.maximum(1 / task.tick, parts / task.step)
    each[parts == CAREFULLY] = _CAREFUL * task.duration / task.step
    steps = times * float(each.sum())
    return _require(task, Work(steps, steps * _PER_STEP))


def _require_time_singly(task: SharedTask, count: int) -> float:
    one = estimate("compiled", task.duration, task.ticks, task.control.changes, task.tick)
    return _require(task, Work(count * one.steps, count * one.seconds))


def _require(task: SharedTask, work: Work) -> float:
    require_affordable(work, 1, task.integration.time_limit, "time_limit of Integration")
    return work.seconds


def _kept(histories: bool | int | Sequence[int], count: int) -> NDArray[np.int64]:
    if isinstance(histories, bool):
        return np.arange(count if histories else 0)
    if isinstance(histories, int | np.integer):
        return np.arange(min(whole("histories", histories, 0), count))
    kept = np.unique(np.asarray(histories))
    if len(kept) and (kept.dtype.kind not in "iu" or kept[0] < 0 or kept[-1] >= count):
        raise InputError(f"histories: expected numbers of runs from 0 to {count - 1}")
    return np.asarray(kept, dtype=np.int64)


def _results(
    found: FloatArray,
    states: FloatArray | None,
    kept: NDArray[np.int64],
    columns: RunColumns,
    seconds: float,
    interrupted: bool,
    note: str,
) -> ManyRuns:
    LOG.info("%d runs: %s", len(found), note)
    figures = {name: found[:, place] for name, place in RESULTS.items()}
    figures = {name: array[:, 0] if array.shape[1] == 1 else array for name, array in figures.items()}
    figures.pop("samples")
    return ManyRuns(
        stop=figures.pop("stop").astype(np.int16),
        careful=figures.pop("careful") == 1.0,
        **{name: np.ascontiguousarray(array) for name, array in figures.items()},
        given=columns.columns,
        seconds=seconds,
        interrupted=interrupted,
        note=note,
        histories=None if states is None else _histories(states, kept),
    )


def _histories(states: FloatArray, kept: NDArray[np.int64]) -> RunHistories:
    states = states.reshape(len(kept), -1, HISTORY_WIDTH)
    used = int(np.isfinite(states[..., 0]).sum(axis=1).max(initial=0))
    parts = np.split(states[:, :used], [1, 4, 7, 10], axis=-1)
    return RunHistories(kept, parts[0][..., 0], *parts[1:])


__all__ = ["EQUAL_STEPS", "TIME_LIMIT", "simulate_many"]
