"""What all runs share, for the engine: steps, tables, loads; steps that friction shortens; what it cannot."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.time_series.wrenches import WRENCH_ROWS, WrenchOverTime
from p3dof.closed_form.compiled import reduced
from p3dof.closed_form.compiled.formulas import MODEL, is_symmetric
from p3dof.closed_form.compiled.lanes import lane_kernel
from p3dof.closed_form.compiled.many import FEEDBACK, INPUTS, MOST_LATE, MOST_STEPS, TORQUE, Engine
from p3dof.closed_form.compiled.reduced import Model, model_of
from p3dof.closed_form.compiled.reduced.dynamics import TOGETHER, gradients
from p3dof.machine.motion import Load, Motion
from p3dof.runs import PD, ComputedTorque, ControlLoop, Feedforward, Integration, Reference, Springs
from p3dof.runs.compiled_controllers import table_of
from p3dof.runs.settings import EDGE

NEAR = 0.2  # below which share of its length that a leg hangs down a run goes on carefully

_OF_LAG = 0.5  # longest step in time constants of the drives


@dataclass(frozen=True, eq=False)
class SharedTask:
    """What is asked of every run."""

    duration: float  # how long [s]
    controller: Any  # as of `p3dof.runs.machine`
    control: ControlLoop  # how it acts
    reference: Motion | None  # what errors are counted from
    wrench: WrenchOverTime  # on the platform
    stop_at: tuple[str, ...]  # which limits count
    integration: Integration  # steps and tolerances
    start: FloatArray  # (6,): pose and velocity of runs without columns for these
    parts: int = 1  # into how many each step is cut

    @property
    def continuous(self) -> bool:
        """Whether feedback acts at every time."""
        return isinstance(self.controller, Springs) and self.control.rate is None

    @property
    def tick(self) -> float:
        """The period of the controller, or of equal steps where there is none [s]."""
        if self.control.rate is not None:
            return self.control.period
        return self.duration / max(1, math.ceil(self.duration / self.integration.step - EDGE))

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
        return np.append(inside[inside < self.duration - EDGE * self.tick], self.duration)

    @property
    def ticks(self) -> int:
        """How many there are in a run."""
        return max(1, math.ceil(self.duration / self.tick - EDGE))

    @property
    def times(self) -> FloatArray:
        """The ticks and the end (N + 1,) [s]."""
        return np.append(np.arange(self.ticks) * self.tick, self.duration)


def why_not(task: SharedTask) -> str | None:
    """Return why the engine cannot do a task, None if it can."""
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
        "adaptive steps were requested": task.integration.scheme != "rk4",
    }
    return next((reason for reason, holds in reasons.items() if holds), None)


def engine_of(task: SharedTask, every: int, near: float = NEAR) -> Engine:
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


def fill(rows: FloatArray, task: SharedTask, columns: dict[str, FloatArray], cut: Any) -> None:
    """Write the controllers of runs into rows of inputs."""
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


def _steps(task: SharedTask) -> tuple[FloatArray, Any]:
    """Return the lengths of the steps of a tick [s], and where forces change."""
    rest = task.control.lateness[1]
    parts = [rest, 1 - rest] if rest else [1.0]
    longest = task.step
    counts = [max(1, math.ceil(part * task.tick / longest - EDGE)) for part in parts]
    lengths = np.concatenate(
        [np.full(count, part * task.tick / count) for part, count in zip(parts, counts, strict=True)]
    )
    changes = np.zeros(len(lengths), np.int64)
    changes[0] = 2 if rest else 1
    if rest:
        changes[counts[0]] = 1
    return lengths, changes


def _table(task: SharedTask) -> FloatArray | None:
    """Return what the controller follows, a row a tick."""
    if not isinstance(task.controller, PD):
        return None
    return table_of(task.controller, task.times[:-1], task.tick / 2, "raise")


def _loads(task: SharedTask, lengths: FloatArray) -> FloatArray | None:
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


CAREFULLY = 0  # instead of a number of parts: by DOP853 from the beginning

_OF_DECAY = 0.5  # longest step in time constants of friction

_MOST_PARTS = 64


def have_friction(model: tuple[Any, ...], count: int) -> NDArray[np.bool_]:
    """Return which machines have friction; ndarray of bool, shape (R,)."""
    found = np.zeros(count, dtype=bool)
    for number in model[len(MODEL) : -1]:
        found |= np.broadcast_to(np.asarray(number) != 0, count)
    return found


def parts_of_steps(
    task: SharedTask, model: tuple[Any, ...], y: Any, theta: Any, count: int
) -> NDArray[np.int64]:
    """Return into how many parts the steps of each run are cut, or `CAREFULLY`.

    A run's own friction and start count only, so that it does not depend on the others.

    Powers of two.
    """
    parts = np.ones(count, np.int64)
    if len(model) == len(MODEL):
        return parts
    most = min(float(_MOST_PARTS), (MOST_STEPS - 2) * task.step / task.tick)
    wanted = np.broadcast_to(decay_rates(model, y, theta), count) * task.step / _OF_DECAY
    parts[wanted > 1] = CAREFULLY
    part = 1
    while part <= most:
        parts[(parts == CAREFULLY) & (wanted <= part)] = part
        part *= 2
    return parts


def decay_rates(model: tuple[Any, ...], y: Any, theta: Any) -> FloatArray:
    """Return the sum of friction's three decay rates of machines that hardly move [1/s]; NaN out of reach."""
    numbers, friction = Model.of_numbers(model[: len(MODEL)]), model[len(MODEL) :]
    size = len(TOGETHER)
    with np.errstate(all="ignore"):
        x = reduced.shape(numbers, y, theta, np)
        (yy, yz, yt), (_, zz, zt), (_, _, tt) = reduced.mass_matrix(numbers, x, y, np)
        inverse = (  # times the determinant
            (zz * tt - zt * zt, yt * zt - yz * tt, yz * zt - yt * zz),
            (yt * zt - yz * tt, yy * tt - yt * yt, yz * yt - yy * zt),
            (yz * zt - yt * zz, yz * yt - yy * zt, yy * zz - yz * yz),
        )
        determinant = yy * inverse[0][0] + yz * inverse[0][1] + yt * inverse[0][2]
        total = 0.0 * (np.asarray(y) + theta)
        for k, gradient in enumerate(gradients(x, y, np)):
            slope = friction[k] + friction[size + k] * friction[-1]
            products = (
                g * entry * h
                for g, row in zip(gradient, inverse, strict=True)
                for h, entry in zip(gradient, row, strict=True)
            )
            total = total + slope * sum(products)
        return np.asarray(total / determinant, dtype=float)
