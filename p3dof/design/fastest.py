"""The fastest plan of a task: the machine's forces along every way of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, Progress, shown
from p3dof._base.errors import InputError, TaskError
from p3dof._base.tables import NONE, Table, number, percent, table_of
from p3dof._base.time_series.times import sample_count
from p3dof.closed_form import kinematics
from p3dof.design.forces_of_tasks import TaskForces
from p3dof.design.tasks import Path, Task
from p3dof.design.tasks.fastest import fastest_law
from p3dof.design.tasks.laws import PROFILES, Law, ProfileLaw, SmoothLaw, SpeedLaw
from p3dof.design.tasks.limits import AxisLimits, Demand, Way
from p3dof.design.tasks.plan import Stretch, payloads, planned
from p3dof.design.tasks.smooth import STARTS, FastestPlan, LimitUse, jerk_limited_law, looked_at, uses_of
from p3dof.machine.parameters import LEGS, SLIDES, Friction, Limits
from p3dof.manipulator import Manipulator
from p3dof.methods import InverseDynamics

NODES, SMOOTH_NODES, MOST_NODES = 400, 150, 20_000
_KEPT = 4  # so many rows of places are kept with their poses
_BESIDE, _DIFFERENCE = 1e-7, 1e-3
"""Share of half a step by which third derivatives are taken off its ends, where they may jump; and of a way
over which differences are taken."""


def fastest_plan(
    robot: Manipulator,
    task: Task,
    limits: AxisLimits | None = None,
    *,
    nodes: int | None = None,
    samples: int = 1001,
    progress: Progress | None = None,
) -> FastestPlan:
    """Return the plan of a task in the least time that the actuators allow, friction and payloads counted.

    Between stops the platform moves along the task's path as fast as forces, slider speeds and powers allow:
    mostly one of them is at its limit. Without a limit of jerk the acceleration jumps where another one takes
    over; with one it is continuous, and zero at the stops. Ways whose stops have a duration keep it, with the
    task's profile.

    With more nodes the time comes nearer to the least one, by the square of their distance: within some 1e-4
    of it, with a jerk 5e-4, without `nodes`. The limits hold between the nodes too: they are checked densely,
    and all of a way is slowed down by as much as that asks for, some 1e-4. What a jerk allows is not convex:
    the motion is the fastest one near it, and the best found from several beginnings.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    task : Task
        What it has to do.
    limits : AxisLimits, optional
        Limits of the actuators. Without it those of the task, and force and speed of the
        machine's `p3dof.machine.Limits` where the task gives none.
    nodes : int, optional
        Steps along each way, closer together at its ends; 400, with a jerk 150, without it.
    samples : int
        Least number of samples, as of `Task.plan`; all nodes are samples besides.
    progress : callable, optional
        Called with (done, total) ways.

    Raises
    ------
    InputError
        If `robot`, `task` or `limits` is something else, or `nodes` does not fit.
    TaskError
        If the limits do not let the machine stand somewhere on a way, or move along it.
    ReachError, SingularityError
        If a path leaves what the machine can reach or hold.
    """
    chosen = chosen_limits(robot, task, limits)
    most = isinstance(nodes, int) and not isinstance(nodes, bool) and 10 <= nodes <= MOST_NODES
    if nodes is not None and not most:
        raise InputError(f"nodes: expected a whole number from 10 to {MOST_NODES}, got {shown(nodes)}")
    with_jerk = bool(np.isfinite(chosen.jerk).any())
    steps = (SMOOTH_NODES if with_jerk else NODES) if nodes is None else nodes
    count = sample_count(samples, least=2)
    stretches, looked, time = [], [], task.waypoints[0].dwell
    for done, (path, (first, last)) in enumerate(zip(task.paths, task.stretches, strict=True), 1):
        name = f"{task.names[first]} → {task.names[last]}"
        way = way_of(robot, task, path, (first, last), chosen)
        duration = task.waypoints[last].duration
        law: Law
        try:
            if duration is not None:
                law = ProfileLaw(PROFILES[task.profile], path.end, duration)
            else:
                law = fastest_along(path, way, chosen, steps)
        except TaskError as error:
            raise TaskError(f"{name}: {error}") from error
        stretch = Stretch(path, first, last, law)
        stretches.append(stretch)
        looked.append(looked_at(stretch, way, chosen, time, name))
        time += law.duration + task.waypoints[last].dwell
        if progress is not None:
            progress(done, len(task.paths))
    plan = planned(task.waypoints, task.names, task.carrying, stretches, count, task.name)
    return FastestPlan(
        plan.name, plan.motion, plan.pieces, plan.waypoints, plan.times, chosen, uses_of(looked)
    )


def way_of(
    robot: Manipulator, task: Task, path: Path, stops: tuple[int, int], limits: AxisLimits
) -> WayOfMachine:
    """Return what a path between two stops of a task takes of a machine."""
    first, last = stops
    payload = payloads(task.waypoints, task.carrying)[last]
    machine = robot if payload is None else Manipulator(robot.parameters.carrying(payload))
    wrenches = np.array([point.wrench for point in task.waypoints[first + 1 : last + 1]])
    return WayOfMachine(machine, path, wrenches, limits.reflected_mass, bool(np.isfinite(limits.jerk).any()))


def fastest_along(
    path: Path, way: Way, limits: AxisLimits, nodes: int, starts: int = STARTS
) -> SpeedLaw | SmoothLaw:
    """Return how a path is covered in the least time."""
    breaks = np.union1d(path.breaks, path.at_waypoints)
    if np.isfinite(limits.jerk).any():
        return jerk_limited_law(nodes, path.end, breaks.tolist(), way, limits, starts)
    return fastest_law(_nodes(nodes, breaks), way, limits)


def chosen_limits(robot: Manipulator, task: Task, limits: AxisLimits | None) -> AxisLimits:
    """Return the limits of a plan: those given, or of the task and the machine."""
    for name, value, kind in (("robot", robot, Manipulator), ("task", task, Task)):
        if not isinstance(value, kind):
            raise InputError(f"{name}: expected a {kind.__name__}, got {shown(value)}")
    if limits is None:
        return limits_of(robot, task)
    if not isinstance(limits, AxisLimits):
        raise InputError(f"limits: expected AxisLimits, got {shown(limits)}")
    return limits


def limits_of(robot: Manipulator, task: Task, **others: ArrayLike | None) -> AxisLimits:
    """Return the limits of a task, with force and speed of the machine where it gives none."""
    own = robot.parameters.limits
    found = {"force": own.force, "speed": own.speed, **task.limits}
    given = {name: value for name, value in others.items() if value is not None}
    return AxisLimits(**(found | given))


class WayOfMachine:
    """What a path takes of the actuators of a machine."""

    def __init__(
        self,
        robot: Manipulator,
        path: Path,
        wrenches: FloatArray,
        reflected_mass: FloatArray,
        with_jerk: bool = False,
    ) -> None:
        self._with_jerk = with_jerk
        self._seen: list[tuple[FloatArray, FloatArray, FloatArray]] = []
        bare = replace(robot.parameters, friction=Friction())
        self._lossy, self._bare = robot, Manipulator(bare)
        self._path, self._wrenches, self._mass = path, wrenches, reflected_mass

    @property
    def lossy(self) -> bool:
        """Whether there is friction."""
        return bool(self._lossy.parameters.friction)

    def demand(self, place: FloatArray, middle: FloatArray) -> Demand:
        """Return what is needed at parameters (P,); each is in a step whose middle is given too, (P,)."""
        pose, slope, bend = self._path.at(place)
        none = np.zeros_like(pose)
        piece = np.searchsorted(self._path.at_waypoints, middle, "right") - 1
        load = self._wrenches[np.clip(piece, 0, len(self._wrenches) - 1)]

        def forces(velocity: FloatArray, acceleration: FloatArray) -> FloatArray:
            return np.asarray(self._bare.forces(pose, velocity, acceleration, method="compiled", wrench=load))

        rest = forces(none, none)
        rate, change = self._sliders(pose, slope, bend)
        third = np.full_like(rate, np.nan)
        if self._with_jerk:
            third = self._third(pose, slope, bend, self._path.third(place + _BESIDE * (middle - place)))
        mass = forces(none, slope) - rest + self._mass * rate
        bias = forces(slope, bend) - rest + self._mass * change
        added, geometry = self._bare.parameters.actuators, self._bare.parameters.geometry
        sliders = kinematics.inverse_kinematics(geometry, pose).sliders
        balance = added.balance_at_home(self._bare.parameters.gravity) - added.stiffness * sliders
        return Demand(mass, bias, rest, rate, change, third, self._mass + added.inertia, balance)

    def _at(self, place: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return poses and their derivatives at places, which are asked for again and again."""
        for known, pose, slope in self._seen:
            if known is place or (known.shape == place.shape and (known == place).all()):
                return pose, slope
        pose, slope, _ = self._path.at(place)
        self._seen = [(place.copy(), pose, slope), *self._seen[: _KEPT - 1]]
        return pose, slope

    def _sliders(
        self, pose: FloatArray, velocity: FloatArray, acceleration: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the velocity and acceleration of the sliders, (P, 3) each."""
        geometry = self._bare.parameters.geometry
        moved = kinematics.mechanism_motion(geometry, pose, velocity, acceleration)
        rate = np.column_stack([moved.velocity[name] for name in SLIDES])
        return rate, np.column_stack([moved.acceleration[name] for name in SLIDES])

    def _third(self, pose: FloatArray, slope: FloatArray, bend: FloatArray, third: FloatArray) -> FloatArray:
        """Return the third derivative of the sliders, (P, 3), by differences along a cubic of the pose."""
        step = _DIFFERENCE * self._path.end

        def change(s: float) -> FloatArray:
            place = pose + s * (slope + s * (bend / 2 + s * third / 6))
            return self._sliders(place, slope + s * (bend + s * third / 2), bend + s * third)[1]

        near, far = (change(k * step) - change(-k * step) for k in (1, 2))
        return (8 * near - far) / (12 * step)

    def friction(self, place: FloatArray, speed: FloatArray) -> FloatArray:
        """Return what friction adds to the forces, (P, 3) [N], at parameters and speeds ṡ (P,)."""
        pose, slope = self._at(place)
        velocity, none = slope * speed[:, None], np.zeros_like(pose)
        with_, without = (
            machine.forces(pose, velocity, none, method="compiled") for machine in (self._lossy, self._bare)
        )
        return np.asarray(with_ - without)


def _nodes(count: int, breaks: FloatArray) -> FloatArray:
    """Return parameters that are closer together at both ends, those of breaks (B,) among them."""
    even = np.linspace(0.0, 1.0, count + 1)
    places = np.union1d(breaks[-1] * even**2 * (3 - 2 * even), breaks)
    near = np.isin(places, breaks)
    kept = np.append(True, np.diff(places) > 1e-9 * breaks[-1])
    return np.asarray(places[kept | near])


_UNSEEN = ("jerk", "nut_force")  # limits of tasks that samples are not held against
_FITS = 1 + 1e-9


@dataclass(frozen=True)
class OwnedUse:
    """How much of a limit a task uses, and whose limit it is."""

    of: str  # `"machine"` or `"task"`, that is also what the fastest motion was asked to keep
    quantity: str  # what is limited
    leg: str  # `"A"`, `"B"`, `"C"` or `"platform"`
    value: float  # the largest value, and what is allowed [`unit`]
    limit: float
    unit: str  # of both
    time: float  # when [s]

    @property
    def share(self) -> float:
        """Value by limit: 1 at the limit."""
        return self.value / self.limit


def uses_of_task(
    found: InverseDynamics | TaskForces, limits: AxisLimits | None, machine: Limits
) -> tuple[LimitUse, ...]:
    """Return how much of its limits a task uses, the fastest densely; None without limits or impossible."""
    if isinstance(found, TaskForces) and isinstance(found.plan, FastestPlan):
        return found.plan.uses
    if limits is None or not found.possible:
        return ()
    force = found.forces + limits.reflected_mass * found.slider_accelerations
    columns = {
        "force": (np.abs(force), limits.force),
        "speed": (np.abs(found.slider_velocities), limits.speed),
        "power": (force * found.slider_velocities, limits.power),
    }
    uses = []
    for name, (values, allowed) in columns.items():
        for k, row in enumerate(values.argmax(axis=0)):
            own = getattr(machine, name, np.inf)
            if allowed[k] == own and not (name == "force" and limits.reflected_mass[k]):
                continue
            time, value = float(found.time[row]), max(float(values[row, k]), 0.0)
            place = found.piece_at(time).name if isinstance(found, TaskForces) else ""
            if np.isfinite(allowed[k]):
                uses.append(LimitUse(name, LEGS[k], value, float(allowed[k]), time, place))
    return tuple(uses)


def unseen_limits(limits: AxisLimits | None) -> str:
    """Return a warning of limits of a task that samples are not held against; empty if it has none."""
    names = [] if limits is None else [n for n in _UNSEEN if np.isfinite(getattr(limits, n)).any()]
    words = ", ".join(name.replace("_", " ") for name in names)
    return f"limits of the task that hold for the time-optimal motion only: {words}" if words else ""


def tightest_uses(
    found: TaskForces, machine: Limits, limits: AxisLimits | None = None
) -> tuple[OwnedUse, ...]:
    """Return how much of each limit a task uses, of machine and task the one that is used more."""
    rows = {
        (one.quantity, one.leg): OwnedUse(
            "machine", one.quantity, one.leg, one.value, one.limit, one.unit, one.time
        )
        for one in found.utilisations(machine)
    }
    plan = found.plan
    chosen = plan.limits if isinstance(plan, FastestPlan) else limits
    for use in uses_of_task(found, limits, machine):
        own = rows.get((use.quantity, use.leg))
        turning = chosen is not None and use.quantity == "force" and chosen.reflected_mass.any()
        if own is None or (use.share > own.share and (turning or use.limit != abs(own.limit))):
            rows[use.quantity, use.leg] = OwnedUse(
                "task", use.quantity, use.leg, use.value, use.limit, use.unit, use.time
            )
    return tuple(rows.values())


def within_limits(found: TaskForces, machine: Limits, limits: AxisLimits | None = None) -> bool:
    """Return whether a task is possible and exceeds no limit; arguments are those of `tightest_uses`."""
    return all(one.share <= _FITS for one in tightest_uses(found, machine, limits))


def sizing_table(found: TaskForces, machine: Limits, limits: AxisLimits | None = None) -> Table:
    """Return how much of each limit a task uses, when and where, and whose limit it is."""
    rows = {
        f"{one.quantity} {one.leg} [{one.unit}]": (
            number(one.value),
            number(one.time),
            found.piece_at(one.time).name,
            number(one.limit),
            one.of,
            NONE if np.isnan(one.share) else percent(one.share),
        )
        for one in tightest_uses(found, machine, limits)
    }
    header = ("limit of", "peak", "at t [s]", "segment", "limit", "of", "used")
    return table_of("Utilisation of limits", header, rows, unseen_limits(limits))
