"""Many runs one by one, by `p3dof.runs`: what the engine cannot do, and where there is none."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, Progress
from p3dof._base.errors import ControllerError, DynamicsError, InputError, ReachError
from p3dof._base.time_series.wrenches import WRENCH_ROWS
from p3dof.closed_form.compiled import MachineKernels, many
from p3dof.machine.motion import Load
from p3dof.machine.parameters import LEGS, Parameters
from p3dof.runs import PD, InitialState, Noise, Simulation, Springs, simulate
from p3dof.runs.many.columns import NOT_RUN, SEED, STARTS, RunColumns
from p3dof.runs.many.plan import SharedTask


class _Kernels:
    """A machine as far as compiled runs need it."""

    def __init__(self, parameters: Parameters) -> None:
        self.parameters = parameters
        self.kernels = MachineKernels(parameters)


def run_singly(
    task: SharedTask,
    columns: RunColumns,
    machine: Parameters,
    kept: NDArray[np.int64],
    every: int,
    progress: Progress | None,
) -> tuple[FloatArray, FloatArray | None, bool]:
    """Run all, one after the other; as of `p3dof.runs.many.running.Batch.run`."""
    results = np.full((columns.count, many.RESULT_WIDTH), np.nan)
    results[:, 0] = columns.status
    rows = -(-task.ticks // every) + 2
    histories = np.full((len(kept), rows, many.HISTORY_WIDTH), np.nan) if len(kept) else None
    try:
        for run in np.flatnonzero(columns.status == NOT_RUN).tolist():
            results[run], found = _one(task, columns, machine, run)
            if histories is not None and found is not None and run in kept:
                _keep(histories[int(np.searchsorted(kept, run))], found, task, every)
            if progress is not None:
                progress(int((results[:, 0] != NOT_RUN).sum()), columns.count)
    except KeyboardInterrupt:
        return results, histories, True
    return results, histories, False


def _one(
    task: SharedTask, columns: RunColumns, machine: Parameters, run: int
) -> tuple[FloatArray, Simulation | None]:
    own = {name: float(column[run]) for name, column in columns.own.items()}
    x = [own.get(name, known) for name, known in zip(STARTS, task.start, strict=True)]
    control = task.control
    if control.noise is not None:
        seed = int(own.get(SEED, control.noise.seed + columns.first + run))
        control = replace(control, noise=Noise(control.noise.position, control.noise.velocity, seed))
    failed = np.full(many.RESULT_WIDTH, np.nan)
    failed[many.RESULTS["time"]] = 0.0
    try:
        found = simulate(
            _Kernels(columns.machine(run, machine)),  # type: ignore[arg-type]  # all that compiled runs need
            task.duration,
            start=InitialState(x[:3], x[3:]),
            controller=_controller(task.controller, own),
            control=control,
            reference=task.reference,
            wrench=_wrench(task.wrench, own),
            method="compiled",
            samples=np.union1d(task.times, task.boundaries),
            stop_at=task.stop_at,
            integration=task.integration,
        )
    except ControllerError as error:
        if error.run is None:
            failed[0], failed[1] = many.CONTROLLER, error.time
            return failed, None
        return _summary(error.run, task), error.run
    except ReachError:
        failed[0] = many.NOWHERE
    except (InputError, DynamicsError) as error:
        if not isinstance(error, DynamicsError) and "start beyond a limit" not in str(error):
            raise
        failed[0] = many.START
    else:
        return _summary(found, task), found
    return failed, None


def _controller(controller: Any, own: dict[str, float]) -> Any:
    """Return the controller with the gains of a run."""
    if isinstance(controller, PD):
        gains = {
            "frequency": controller.omega / (2 * np.pi),
            "damping": controller.zeta,
            "integral_time": controller.integral_time,
        }
        given = {name: own.get(f"controller.{name}", value) for name, value in gains.items()}
        return type(controller)(controller.model, controller.motion, **given)
    if isinstance(controller, Springs) and "controller.stiffness" in own:
        stiffness = own["controller.stiffness"]
        return Springs(stiffness, controller.rest, controller.damping, controller.preload)
    return controller


def _wrench(wrench: Any, own: dict[str, float]) -> Any:
    """Return the wrench with what a run has besides."""
    more = np.zeros(6)
    for name, row in zip(("wrench.fy", "wrench.fz", "wrench.my"), WRENCH_ROWS, strict=True):
        more[row] = own.get(name, 0.0)
    if not more.any():
        return wrench
    load = Load(wrench)
    return (lambda time: load.at(time) + more) if callable(wrench) else load.at(0.0) + more


def _summary(run: Simulation, task: SharedTask) -> FloatArray:
    """Return the figures of a run; its end counts only if that is one of the ticks."""
    row = np.full(many.RESULT_WIDTH, np.nan)
    counted = _counted(run, task)
    row[many.RESULTS["stop"]] = _stop(run)
    row[many.RESULTS["time"]] = run.time[-1] if run.stop is None else run.stop.time
    row[many.RESULTS["pose"]], row[many.RESULTS["velocity"]] = run.pose[-1], run.velocity[-1]
    if run.reference is not None:
        row[many.RESULTS["peak_error"]] = np.abs(run.error[counted]).max(axis=0)
        row[many.RESULTS["rms_error"]] = np.sqrt((run.error[counted] ** 2).mean(axis=0))
    row[many.RESULTS["peak_force"]] = np.abs(run.forces[counted]).max(axis=0)
    row[many.RESULTS["rms_force"]] = np.sqrt((run.forces[counted] ** 2).mean(axis=0))
    drives = task.control.drives()
    held = np.full(3, task.control.rate is not None) & (True if drives is None else np.isinf(drives))
    acting = np.where(held, run.forces[:-1], (run.forces[:-1] + run.forces[1:]) / 2)
    done = acting * np.diff(run.sliders, axis=0)
    row[many.RESULTS["work"]], row[many.RESULTS["energy"]] = done.sum(), np.abs(done).sum()
    row[many.RESULTS["careful"]], row[many.RESULTS["samples"]] = 1.0, len(run.time[counted])
    return row


def _counted(run: Simulation, task: SharedTask) -> NDArray[np.intp]:
    """Return the samples that are ticks, or the end of a whole run; at least the first."""
    ticks = np.isin(run.time, task.times)
    ticks[0] = True
    if not run.finished:
        ticks[1:][run.time[1:] >= run.time[-1]] = False
    return np.flatnonzero(ticks)


def _stop(run: Simulation) -> int:
    """Return the number of what ended a run."""
    if run.stop is None:
        return many.FINISHED
    alone = {"accuracy": many.ACCURACY, "controller": many.CONTROLLER, "singular pose": 11}
    if run.stop.kind in alone:
        return alone[run.stop.kind]
    if run.stop.kind == "tilt limit":
        return 6 if run.pose[-1, 2] < 0 else 7
    leg = next(k for k, name in enumerate(LEGS) if f" {name} " in run.stop.reason)
    kinds = {"reach limit": 8, "slider stop": 0 if "lower" in run.stop.reason else 3}
    return kinds[run.stop.kind] + leg


def _keep(history: FloatArray, run: Simulation, task: SharedTask, every: int) -> None:
    """Write the samples of a run into its history."""
    ticks = _counted(run, task).tolist()
    places = [k for tick, k in enumerate(ticks) if tick % every == 0 or tick == task.ticks]
    if not run.finished:
        places.append(len(run) - 1)
    for row, k in enumerate(places):
        history[row] = [run.time[k], *run.pose[k], *run.velocity[k], *run.forces[k], *run.asked[k]]
