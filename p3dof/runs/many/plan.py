"""What all runs share, for the engine: steps, the controller's tables, the loads; and what it cannot do."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.closed_form import kinematics
from p3dof.closed_form.compiled.formulas import is_symmetric
from p3dof.closed_form.compiled.lanes import lane_kernel
from p3dof.closed_form.compiled.many import (
    FEEDBACK,
    INPUTS,
    MOST_LATE,
    MOST_STEPS,
    TORQUE,
    Engine,
)
from p3dof.closed_form.compiled.reduced import model_of
from p3dof.machine.motion import Load, Motion, states_of
from p3dof.machine.motion.wrenches import WRENCH_ROWS, WrenchOverTime
from p3dof.methods.virtual_power import VirtualPowerMethod
from p3dof.runs import PD, ComputedTorque, ControlLoop, Feedforward, Integration, Reference, Springs

NEAR = 0.2
"""Below which share of its length that a leg hangs down a run goes on carefully."""

_OF_LAG = 0.5
"""Longest step in time constants of the drives."""

_EDGE = 1e-9


@dataclass(frozen=True, eq=False)
class Task:
    """What is asked of every run.

    Parameters
    ----------
    duration : float
        How long [s].
    controller : object
        As of `p3dof.runs.simulate`.
    control : ControlLoop
        How it acts.
    reference : Motion or None
        What errors are counted from.
    wrench : array-like, callable or None
        On the platform.
    stop_at : tuple of str
        Which limits count.
    integration : Integration
        Steps and tolerances.
    start : ndarray, shape (6,)
        Pose and velocity of runs without columns for these.
    parts : int
        Into how many each step is cut.
    """

    duration: float
    controller: Any
    control: ControlLoop
    reference: Motion | None
    wrench: WrenchOverTime
    stop_at: tuple[str, ...]
    integration: Integration
    start: FloatArray
    parts: int = 1

    @property
    def continuous(self) -> bool:
        """Whether feedback acts at every time."""
        return isinstance(self.controller, Springs) and self.control.rate is None

    @property
    def tick(self) -> float:
        """The period of the controller, or of equal steps where there is none [s]."""
        if self.control.rate is not None:
            return self.control.period
        return self.duration / max(1, math.ceil(self.duration / self.integration.step - _EDGE))

    @property
    def step(self) -> float:
        """The longest step [s]."""
        drives = self.control.drives()
        quick = math.inf if drives is None else _OF_LAG / (2 * math.pi * float(drives[drives < np.inf].max()))
        return min(self.integration.step, quick) / self.parts

    @property
    def boundaries(self) -> FloatArray:
        """The ends of all steps (K,), from 0 to the end [s]."""
        begin = np.concatenate([[0.0], np.cumsum(_steps(self)[0])])[:-1]
        inside = (self.times[:-1, None] + begin).ravel()
        return np.append(inside[inside < self.duration - _EDGE * self.tick], self.duration)

    @property
    def ticks(self) -> int:
        """How many there are in a run."""
        return max(1, math.ceil(self.duration / self.tick - _EDGE))

    @property
    def times(self) -> FloatArray:
        """The ticks and the end (N + 1,) [s]."""
        return np.append(np.arange(self.ticks) * self.tick, self.duration)


def why_not(task: Task) -> str | None:
    """Return why the engine cannot do a task, None if it can.

    Parameters
    ----------
    task : Task
        What is asked.
    """
    controller, control = task.controller, task.control
    known = type(controller) in (PD, Feedforward, ComputedTorque, Springs)
    reasons = {
        "the controller is Python": callable(controller) and not known,
        "a model with friction in computed torque": type(controller) is ComputedTorque
        and bool(controller.model.friction),
        "drives that lag behind a continuous controller": control.rate is None
        and control.drives() is not None,
        f"forces later than {MOST_LATE} periods": control.lateness[0] > MOST_LATE,
        f"more than {MOST_STEPS - 2} steps in a period": task.tick / task.step > MOST_STEPS - 2,
        "adaptive steps were asked for": task.integration.scheme != "rk4",
    }
    return next((reason for reason, holds in reasons.items() if holds), None)


def engine_of(task: Task, every: int, near: float = NEAR) -> Engine:
    """Return the engine of a task, in which runs go on carefully that hang down less than this share."""
    lengths, changes = _steps(task)
    control, controller = task.control, task.controller
    model: tuple[FloatArray, ...] = ()
    if isinstance(controller, ComputedTorque):
        numbers = model_of(controller.model)
        symmetric = is_symmetric(numbers)
        model = tuple(lane_kernel(name, symmetric).of(numbers) for name in ("assembly", "torque", "inverse"))
    integrating = isinstance(controller, PD)
    flags = {
        "noisy": control.noise is not None,
        "counting": bool(np.any(control.resolution)),
        "differencing": control.differencing,
        "lagging": control.drives() is not None,
        "integrating": integrating,
        "model_symmetric": bool(model) and symmetric,
        "continuous": task.continuous,
    }
    return Engine(
        tick=task.tick,
        end=task.duration,
        lengths=lengths,
        changes=changes,
        near=near,
        rtol=task.integration.rtol,
        atol=task.integration.atol,
        kind=TORQUE if model else FEEDBACK,
        flags=flags,
        whole=control.lateness[0],
        every=every,
        table=_table(task),
        model=model,
        reference=None if task.reference is None else Reference(task.reference).poses(task.times),
        loads=_loads(task, lengths),
    )


def fill(rows: FloatArray, task: Task, columns: dict[str, FloatArray], cut: Any) -> None:
    """Write the controllers of runs into rows of inputs.

    Parameters
    ----------
    rows : ndarray, shape (R, INPUT_WIDTH)
        Where to write.
    task : Task
        What is asked of every run.
    columns : dict of str to ndarray, shape (R,)
        Gains and wrenches.
    cut : ndarray, shape (3,) or (R, 3)
        Where forces are cut off [N].
    """
    control, controller = task.control, task.controller
    rows[:, INPUTS["cut"]] = cut
    rows[:, INPUTS["count"]] = control.resolution
    if control.noise is not None:
        rows[:, INPUTS["sigma"]] = control.noise.position, control.noise.velocity
    drives = control.drives()
    if drives is not None:
        rows[:, INPUTS["lag"]] = 2 * np.pi * drives
    _fill_gains(rows, controller, columns, control.period)
    held = np.zeros(6) if callable(task.wrench) else Load(task.wrench).at(0.0)
    for k, (name, row) in enumerate(zip(("wrench.fy", "wrench.fz", "wrench.my"), WRENCH_ROWS, strict=True)):
        rows[:, INPUTS["load"].start + k] = held[row] + columns.get(name, 0.0)


def _fill_gains(rows: FloatArray, controller: Any, columns: dict[str, FloatArray], period: float) -> None:
    def given(name: str, otherwise: float) -> Any:
        return np.asarray(columns.get(f"controller.{name}", otherwise))[..., None]

    if isinstance(controller, PD):
        omega = 2 * np.pi * given("frequency", controller.omega / (2 * np.pi))
        zeta = given("damping", controller.zeta)
        moved = 1.0 if isinstance(controller, ComputedTorque) else controller.moved
        rows[:, INPUTS["gain"]] = omega**2 * moved
        rows[:, INPUTS["damping"]] = 2 * zeta * omega * moved
        rows[:, INPUTS["share"]] = period / given("integral_time", controller.integral_time)
    elif isinstance(controller, Springs):
        own = "controller.stiffness" in columns
        rows[:, INPUTS["gain"]] = given("stiffness", 0.0) if own else controller.stiffness
        rows[:, INPUTS["damping"]] = controller.damping
        rows[:, INPUTS["base"]] = controller.preload
        rows[:, INPUTS["wanted"]] = controller.rest
    elif controller is not None:
        rows[:, INPUTS["base"]] = controller


def _steps(task: Task) -> tuple[FloatArray, Any]:
    """Return the lengths of the steps of a tick [s], and where forces change."""
    rest = task.control.lateness[1]
    parts = [rest, 1 - rest] if rest else [1.0]
    longest = task.step
    counts = [max(1, math.ceil(part * task.tick / longest - _EDGE)) for part in parts]
    lengths = np.concatenate(
        [np.full(count, part * task.tick / count) for part, count in zip(parts, counts, strict=True)]
    )
    changes = np.zeros(len(lengths), np.int64)
    changes[0] = 2 if rest else 1
    if rest:
        changes[counts[0]] = 1
    return lengths, changes


def _table(task: Task) -> FloatArray | None:
    """Return what the controller follows, a row a tick."""
    controller, times = task.controller, task.times[:-1]
    if not isinstance(controller, PD):
        return None
    model, half = controller.model, task.tick / 2
    pose, velocity, _ = controller.reference.over(times)
    ahead = controller.reference.over(times + half)
    if isinstance(controller, ComputedTorque):
        return np.hstack([pose, velocity, ahead[2]])
    sliders = kinematics.inverse_kinematics(model.geometry, pose).sliders
    rates = np.einsum("nij,nj->ni", kinematics.inverse_jacobian(model.geometry, pose), velocity)
    base = np.broadcast_to(controller.holding, pose.shape)
    if isinstance(controller, Feedforward):
        base = VirtualPowerMethod(model).forces(states_of(*ahead))
    return np.hstack([base, sliders, rates])


def _loads(task: Task, lengths: FloatArray) -> FloatArray | None:
    """Return F_y, F_z, M_y at beginning, middle and end of each step of each tick."""
    if not callable(task.wrench):
        return None
    begin = np.concatenate([[0.0], np.cumsum(lengths)])[:-1]
    within = begin[:, None] + lengths[:, None] * np.array([0.0, 0.5, 1.0])
    times = (task.times[:-1, None, None] + within).clip(max=task.duration)
    found = Load(task.wrench).over(times.ravel())[:, list(WRENCH_ROWS)]
    if not np.isfinite(found).all():
        Load(task.wrench).at(float(times.ravel()[~np.isfinite(found).all(axis=1)][0]))  # raises
    return np.ascontiguousarray(found.reshape(*times.shape, 3))
