"""Runs of the manipulator by RK4 in equal steps, in C: one run of the engine of many runs, in one lane.

What it leaves is what `p3dof.simulation.fixed_steps` in Python would have left, but for rounding. A run that
comes near a limit, or whose controller has no answer, is made there: it says where and why the run ended.
"""

from __future__ import annotations

import math
import time as clock

import numpy as np

from p3dof.checks import FloatArray
from p3dof.compiled import runs
from p3dof.compiled.lanes import lane_kernel
from p3dof.compiled.many import (
    FEEDBACK,
    FINISHED,
    HISTORY_WIDTH,
    INPUTS,
    MOST_STEPS,
    RESULT_WIDTH,
    RESULTS,
    TORQUE,
    Engine,
    empty_inputs,
)
from p3dof.compiled.runs import Controller, Samples
from p3dof.kinematics import reachable_poses
from p3dof.motion import Load, Motion
from p3dof.motion.wrenches import WRENCH_ROWS
from p3dof.simulation.compiled_controllers import MOST_LATE, controller_of, has_table
from p3dof.simulation.compiled_machine import IN_C, LaterSimulation
from p3dof.simulation.controllers import ComputedTorque, Springs
from p3dof.simulation.crossings import CHECKED
from p3dof.simulation.integration import BEYOND
from p3dof.simulation.limits import HORIZONTAL, Limiter
from p3dof.simulation.run import Simulation
from p3dof.simulation.task import Task

LONGEST = 500_000
"""Runs of more steps would take too much memory, and nobody could interrupt them for about a second."""

_EDGE = 1e-9
"""Share of a step below which a rest of it is rounding."""


def serves_equal_steps(task: Task) -> bool:
    """Return whether a run in equal steps can be in C, if no limit comes in between.

    Parameters
    ----------
    task : Task
        What is asked for.

    Returns
    -------
    bool
    """
    integration, kernels = task.integration, task.machine.kernels
    if task.method not in IN_C or integration.scheme != "rk4" or not runs.available(kernels):
        return False
    controlled = not callable(task.controller) or has_table(task) or _continuous(task)
    return (
        task.begin.joints is None
        and not kernels.has_friction
        and not callable(task.wrench)
        and integration.step <= CHECKED
        and controlled
        and task.control.drives() is None
        and _in_time(task)
        and _steps_fit(task)
    )


def _continuous(task: Task) -> bool:
    """Return whether feedback acts at every time."""
    return task.control.rate is None and type(task.controller) is Springs


def _in_time(task: Task) -> bool:
    """Return whether forces are late by what the engine knows, and are looked at before a run ends."""
    whole, rest = task.control.lateness
    return rest == 0 and whole <= (0 if isinstance(task.controller, ComputedTorque) else MOST_LATE)


def _steps_fit(task: Task) -> bool:
    """Return whether all ticks have the same steps, and are not too many."""
    tick, steps = _tick(task)
    ticks = float(task.times[-1]) / tick
    whole = abs(ticks - round(ticks)) <= _EDGE and ticks > _EDGE
    return ticks * steps <= LONGEST and steps <= MOST_STEPS - 2 and (steps == 1 or whole)


def _tick(task: Task) -> tuple[float, int]:
    """Return how long forces are held, or a step is where they are not [s]; how many steps that has."""
    end, step, period = float(task.times[-1]), task.integration.step, task.control.period
    if period:
        return period, max(1, math.ceil(period / step - _EDGE))
    return end / max(1, math.ceil(end / step - _EDGE)), 1


def simulate_equal_steps(task: Task) -> Simulation | None:
    """Run a machine in C, in equal steps.

    Parameters
    ----------
    task : Task
        What is asked for; `serves_equal_steps` holds.

    Returns
    -------
    Simulation, or None
        None if a limit may have been reached or a controller has no answer: the integrator in Python says
        what comes of it.

    Raises
    ------
    ReachError, InputError, ControllerError
        As `p3dof.simulation.simulate`.
    """
    return _EqualSteps(task).result()


class _EqualSteps:
    """One run in equal steps, and what it leaves."""

    def __init__(self, task: Task) -> None:
        self._task, parameters, begin = task, task.machine.parameters, task.begin
        self._pose = reachable_poses(parameters.geometry, np.asarray(begin.pose), "raise")
        self._side = Limiter(parameters, task.stop_at, self._pose, None).watched[1][-1]
        self._largest = task.actuation().limits
        self._followed, self._load = task.followed(), Load(task.wrench).at(0.0)
        self._end = float(task.times[-1])
        self._tick, self._steps = _tick(task)
        self._given = (
            controller_of(task, self._largest) if has_table(task) else _standing(task, self._largest)
        )
        self._engine = self._engine_of()

    def _engine_of(self) -> Engine:
        """Return the engine, which never goes on by itself but beyond a limit."""
        given, steps = self._given, self._steps
        names = ("noisy", "counting", "differencing", "integrating", "model_symmetric")
        flags = dict(zip(names, given.settings[1:6] != 0, strict=True))
        torque = bool(given.settings[0])
        changes = np.zeros(steps, np.int64)
        changes[0] = 1
        return Engine(
            tick=self._tick,
            end=self._end,
            lengths=np.full(steps, self._tick / steps),
            changes=changes,
            near=0.0,
            rtol=self._task.integration.rtol,
            atol=self._task.integration.atol,
            kind=TORQUE if torque else FEEDBACK,
            flags=flags | {"continuous": _continuous(self._task)},
            whole=int(given.settings[7]),
            table=given.table.reshape(-1, 9) if given.table.size else None,
            model=given.model if torque else (),
        )

    def result(self) -> Simulation | None:
        """Integrate, and return what the run left; None if it cannot be in C."""
        begun = clock.perf_counter()
        rows = self._integrated() if self._answers() else None
        if rows is None:
            return None
        seconds, task, machine = clock.perf_counter() - begun, self._task, self._task.machine
        samples = self._sampled(rows)
        wrench = np.repeat(self._load[None], len(task.times), axis=0)
        acceleration = runs.accelerations(machine.kernels, samples, wrench)
        sliders, speeds = runs.sliders(machine.kernels, samples)
        if not all((np.abs(part) <= BEYOND).all() for part in (samples.velocity, acceleration)):
            return None
        if task.progress is not None:
            task.progress(len(task.times), len(task.times))
        return LaterSimulation.of(
            machine.parameters.geometry,
            method=task.method,
            motion=Motion(samples.time, samples.pose, samples.velocity, acceleration, check=False),
            forces=samples.forces,
            asked=samples.asked,
            sliders=sliders,
            slider_velocities=speeds,
            wrench=wrench,
            reference=None if self._followed is None else self._followed.poses(samples.time),
            stop=None,
            evaluations=4 * self._steps * self._engine.ticks,
            seconds=seconds,
            note="",
        )

    def _answers(self) -> bool:
        """Return whether a controller knows what to do at every tick, also where its forces come too late."""
        table = self._given.table.reshape(-1, 9)
        huge = math.inf if self._given.settings[0] else self._given.settings[6]
        return bool(np.isfinite(table).all() and (np.abs(table[:, :3]) < huge).all())

    def _integrated(self) -> FloatArray | None:
        """Return the states at all ticks and at the end, (N + 1, 13); None if something ended the run."""
        task, engine, given = self._task, self._engine, self._given
        symmetric, inputs = task.machine.kernels.symmetric, self._inputs()
        results = np.full((1, RESULT_WIDTH), np.nan)
        history = np.full((1, engine.rows, HISTORY_WIDTH), np.nan)
        noise = given.noise.reshape(1, -1, 6) if given.noise.size else None
        cancel, level = np.zeros(1, np.int64), task.machine.kernels.level
        engine.run(level, symmetric, inputs, results, cancel, noise, history, wide=False)
        rows = history[0, : engine.ticks + 1]
        ended = results[0, 0] != FINISHED or results[0, RESULTS["careful"]] != 0
        huge = given.settings[6]
        if ended or not np.isfinite(rows).all() or (np.abs(rows[:, 10:]) > huge).any() or self._turned(rows):
            return None
        return rows

    def _inputs(self) -> FloatArray:
        """Return the row of inputs of the run."""
        task, limits, kernels = self._task, self._task.machine.parameters.limits, self._task.machine.kernels
        row = empty_inputs(1)
        for name in ("place", "limits", "motion"):
            constants = lane_kernel(name, kernels.symmetric and name == "motion").of(kernels.model)
            row[0, INPUTS[name].start : INPUTS[name].start + len(constants)] = constants
        row[0, INPUTS["x"]] = np.concatenate([self._pose, np.asarray(task.begin.velocity)])
        if "singular pose" in task.stop_at:
            row[0, INPUTS["side"]] = self._side
        bounds = [*limits.travel, *limits.tilt]
        counted = np.repeat([kind in task.stop_at for kind in ("slider stop", "tilt limit")], 2)
        row[0, INPUTS["bound"]] = np.where(counted, bounds, row[0, INPUTS["bound"]])
        row[0, INPUTS["gain"].start : INPUTS["lag"].stop] = self._given.given
        row[0, INPUTS["load"]] = self._load[list(WRENCH_ROWS)]
        return row

    def _turned(self, rows: FloatArray) -> bool:
        """Return whether a leg's drop or det J may have been beyond its limit within a step."""
        watched = np.empty((len(rows), 14))
        self._task.machine.kernels.run("limits", [*rows[:, 1:7].T], [*watched.T, None])
        margins, rates = watched[:, 3:7].copy(), watched[:, 10:14].copy()
        margins[:, :3] -= HORIZONTAL
        sign = np.sign(margins[0, 3]) or 1.0
        count = 4 if "singular pose" in self._task.stop_at else 3
        margins[:, 3] *= sign
        rates[:, 3] *= sign
        steps = np.diff(rows[:, 0])[:, None]
        falling, rising = rates[:-1] * steps, rates[1:] * steps
        deep = np.minimum(margins[:-1] + falling, margins[1:] - rising)
        return bool(((falling < 0) & (rising > 0) & (deep <= 0))[:, :count].any())

    def _sampled(self, rows: FloatArray) -> Samples:
        """Return the samples: of the steps where they are, cubic in time within."""
        times, step = self._task.times, self._tick / self._steps
        ticks = np.minimum((times / self._tick + _EDGE).astype(np.int64), len(rows) - 2)
        last = times >= self._end - _EDGE * self._tick
        ticks[last] = len(rows) - 1
        found = rows[ticks]
        after = times - ticks * self._tick
        inside = np.flatnonzero((after > max(1e-15, _EDGE * self._task.control.period)) & ~last)
        if len(inside):
            chosen, places = np.unique(ticks[inside], return_inverse=True)
            after = after[inside]
            passed = np.minimum((after / step).astype(np.int64), self._steps - 1)
            lengths = np.minimum(step, self._end - chosen * self._tick)[:, None]
            state, held = rows[chosen, 1:7], rows[chosen, 7:13]
            for k in range(int(passed.max()) + 1):
                first, rate, begun = state, self._rate(state, held), k * step
                state = self._stepped(state, rate, held, lengths)
                now = passed == k
                where = places[now]
                parts = first[where], rate[where], state[where], self._rate(state, held)[where]
                found[inside[now], 1:7] = _cubic(*parts, after[now, None] - begun, lengths[where])
            if _continuous(self._task):
                found[:, 7:13] = self._forces(found[:, 1:7], found[:, 7:13])
        columns = np.split(found[:, 1:], [3, 6, 9], axis=1)
        return Samples(times, *map(np.ascontiguousarray, columns))

    def _stepped(self, state: FloatArray, k1: FloatArray, held: FloatArray, h: FloatArray) -> FloatArray:
        """Return states (N, 6) a step later, as `p3dof.simulation.fixed_steps`."""
        k2 = self._rate(state + h / 2 * k1, held)
        k3 = self._rate(state + h / 2 * k2, held)
        k4 = self._rate(state + h * k3, held)
        return np.asarray(state + h / 6 * (k1 + 2 * (k2 + k3) + k4))

    def _rate(self, state: FloatArray, held: FloatArray) -> FloatArray:
        """Return the derivatives of states (N, 6)."""
        forces = self._forces(state, held)
        samples = Samples(np.zeros(len(state)), state[:, :3], state[:, 3:], forces[:, :3], forces[:, 3:])
        wrench = np.repeat(self._load[None], len(state), axis=0)
        return np.hstack([state[:, 3:], runs.accelerations(self._task.machine.kernels, samples, wrench)])

    def _forces(self, state: FloatArray, held: FloatArray) -> FloatArray:
        """Return forces and those asked for at states, (N, 6): those held, or of springs."""
        springs = self._task.controller
        if not _continuous(self._task) or not isinstance(springs, Springs):
            return held
        samples = Samples(np.zeros(len(state)), state[:, :3], state[:, 3:], held[:, :3], held[:, 3:])
        positions, velocities = runs.sliders(self._task.machine.kernels, samples)
        asked = (
            springs.preload + springs.stiffness * (springs.rest - positions) - springs.damping * velocities
        )
        return np.hstack([np.clip(asked, -self._largest, self._largest), asked])


def _cubic(
    y0: FloatArray, f0: FloatArray, y1: FloatArray, f1: FloatArray, after: FloatArray, h: FloatArray
) -> FloatArray:
    """Return states a time after the beginning of steps, as `p3dof.simulation.fixed_steps`."""
    s = after / h
    inner = (1 - 2 * s) * (y1 - y0) + h * ((s - 1) * f0 + s * f1)
    return np.asarray((1 - s) * y0 + s * y1 - s * (1 - s) * inner)


def _standing(task: Task, largest: FloatArray) -> Controller:
    """Return what needs no table: forces that stay, or springs that act at every time."""
    controller = task.controller
    none: FloatArray = np.zeros(3)
    parts: list[FloatArray] = [none, none, none, none, none, none]
    if isinstance(controller, Springs):
        parts = [controller.stiffness, controller.damping, none, controller.preload, controller.rest, none]
    elif controller is not None:
        parts[3] = np.asarray(controller, dtype=float)
    endless = np.full(3, math.inf)
    given = np.concatenate([*parts, largest, none, none[:2], endless])
    settings = np.array([0, 0, 0, 0, 0, 0, math.inf, task.control.lateness[0]])
    return Controller(settings, given, np.zeros(0), np.zeros(0), ())
