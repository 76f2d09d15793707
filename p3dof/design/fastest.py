"""The fastest plan of a task: the machine's forces along every way of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, Progress, require, shown
from p3dof._base.errors import DriveError, InputError, SampleError, TaskError
from p3dof._base.tables import NONE, ShownInNotebook, Table, html_of, notebook_html, number, percent, table_of
from p3dof._base.time_series.times import sample_count
from p3dof.closed_form.kinematics.bodies import slider_motion
from p3dof.design.drives import Drive, Margins
from p3dof.design.drives.sizing import RPM, Rating, force_ratings, speed_ratings
from p3dof.design.forces_of_tasks import TaskForces
from p3dof.design.tasks import AxisLimits, FastestPlan, Path, Task, Waypoint
from p3dof.design.tasks.fastest import fastest_law
from p3dof.design.tasks.laws import PROFILES, Law, ProfileLaw, SmoothLaw, SpeedLaw
from p3dof.design.tasks.limits import Demand, Used, Way
from p3dof.design.tasks.paths import third_by_differences
from p3dof.design.tasks.plan import Stretch, payloads, planned
from p3dof.design.tasks.smooth import STARTS, LimitUse, jerk_limited_law, looked_at, uses_of
from p3dof.design.tasks.task import MotionTask
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import LEGS, Friction, Limits
from p3dof.manipulator import Manipulator
from p3dof.methods import InverseDynamics

NODES, SMOOTH_NODES, MOST_NODES = 400, 150, 20_000
_WOUND = 33  # speeds at which what a winding gives is looked at
_KEPT = 4  # so many rows of places are kept with their poses
_BESIDE = 1e-7
"""Share of half a step by which third derivatives are taken off its ends, where they may jump."""


def fastest_plan(
    robot: Manipulator,
    task: Task | Motion,
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
    task : Task or Motion
        What it has to do, or a motion whose path it has to take.
    limits : AxisLimits, optional
        Limits of the actuators. Without it those of the task, and force and speed of the
        machine's `p3dof.machine.Limits`, the tighter.
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
        If the limits do not let the machine stand somewhere on a way, or move along it; or samples of a
        motion are too far from each other to tell the path between them.
    ReachError, SingularityError
        If a path leaves what the machine can reach or hold.
    """
    task = MotionTask(task) if isinstance(task, Motion) else task
    chosen = chosen_limits(robot, task, limits)
    task = task.on(robot.parameters.geometry)
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
    parts = plan.name, plan.motion, plan.pieces, plan.waypoints, plan.times
    return FastestPlan(*parts, chosen, uses_of(looked), source=plan.source)


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
    """Return the limits of a task; of its force and speed and the machine's, the tighter."""
    own, found = robot.parameters.limits, dict(task.limits)
    for name, most in (("force", own.force), ("speed", own.speed)):
        if most is not None:
            found[name] = np.minimum(most, found.get(name, np.inf))
    given = {name: value for name, value in others.items() if value is not None}
    return AxisLimits(**(found | given))


def drive_limits(
    robot: Manipulator, drives: Drive | Sequence[Drive], margins: Margins | None = None
) -> AxisLimits:
    """Return the limits that drives set a plan, with their margins: those of `Sizing` that samples tell.

    Peak torque over speed, as a curve of forces; the speeds of motor, gear, and screw or belt; the power of
    the motor; and what nut, screw, belt or rack bear. Losses count with what passes through the drive, but
    for what a gear loses of the screw's own acceleration; drag always against the motor. What belongs to the
    whole cycle, as rms torque and heat, and braking power, is left to `p3dof.design.sizing.size_drives`.

    Parameters
    ----------
    robot : Manipulator
        The machine; where it has armatures, they are taken as those of the drives, which have their own.
    drives : Drive or sequence of Drive
        Of all axes, or of A, B and C.
    margins : Margins, optional
        What must stay free of each rating; as usual without it.

    Raises
    ------
    InputError, DriveError
        If an argument does not fit, or a drive has no torque left to move.
    """
    require("robot", robot, Manipulator)
    each = [drives] * 3 if isinstance(drives, Drive) else list(drives)
    if len(each) != 3 or not all(isinstance(drive, Drive) for drive in each):
        raise InputError(f"drives: expected a Drive, or three of them, got {shown(drives)}")
    free = Margins() if margins is None else margins
    require("margins", free, Margins)
    rotors = robot.parameters.actuators.rotors
    speed = np.array([_most(drive, speed_ratings, free) / (RPM * drive.ratio) for drive in each])
    nut_force = [_most(drive, force_ratings, free) for drive in each]
    power = [(1 - free.power) * drive.motor.max_power for drive in each]
    grid = np.unique(np.concatenate([_speeds(drive) for drive in each]))
    curve = np.array([np.column_stack([grid, _forces(drive, grid, free)]) for drive in each])
    heavier = [drive.reflected_mass - own for drive, own in zip(each, rotors, strict=True)]
    return AxisLimits(
        curve[:, 0, 1],
        speed,
        power,
        np.maximum(heavier, 0.0),
        nut_force=nut_force,
        curve=curve,
        efficiency=[drive.gear.efficiency * drive.transmission.efficiency for drive in each],
        efficiency_back=[
            float(drive.gear.efficiency_back or 0.0) * float(drive.transmission.efficiency_back or 0.0)
            for drive in each
        ],
        drag=[_drag(drive) * drive.ratio for drive in each],
    )


def _most(drive: Drive, ratings: Callable[[Drive, float], list[Rating]], margins: Margins) -> float:
    """Return the largest speed or force of which all ratings keep their margins; they are straight in it."""
    pairs = zip(ratings(drive, 0.0), ratings(drive, 1.0), strict=True)
    return min(
        (
            (one.allowed * (1 - margins.of(one.name)) - none.required) / (one.required - none.required)
            for none, one in pairs
        ),
        default=math.inf,
    )


def _speeds(drive: Drive) -> FloatArray:
    """Return slider speeds between which the peak torque is straight, or so near that it does not matter."""
    points = np.asarray(drive.motor.curve)[:, 0]
    if drive.motor.winding is not None:
        points = np.union1d(points, np.linspace(0.0, drive.motor.max_speed, _WOUND))
    return np.asarray(points[points <= drive.motor.max_speed] / drive.ratio)


def _drag(drive: Drive) -> float:
    """Return what the friction of motor and nut, or belt, takes of the motor's torque [N m]."""
    return drive.motor.drag + drive.transmission.drag / (drive.gear.ratio * drive.gear.efficiency)


def _forces(drive: Drive, speed: FloatArray, margins: Margins) -> FloatArray:
    """Return what a motor gives at slider speeds, less margin and drag; it does not rise [N]."""
    gear, drag = drive.gear, _drag(drive)
    turning = np.minimum(speed * drive.ratio, drive.motor.max_speed)
    torque = (1 - margins.peak_torque) * drive.motor.peak(turning) - drag
    most = (1 - margins.gear_torque) * gear.max_torque / (gear.ratio * gear.efficiency)
    found = np.minimum.accumulate(np.minimum(torque, most - drag) * drive.ratio)
    if found[0] <= 0:
        raise DriveError(f"{drive.name}: its peak torque, less margin and drag, moves nothing")
    return np.asarray(np.maximum(found, 0.0))


def tighter(one: AxisLimits, other: AxisLimits) -> AxisLimits:
    """Return limits that keep both; the larger of the reflected masses, and of the drags, counts."""
    least = {
        name: np.minimum(getattr(one, name), getattr(other, name))
        for name in ("force", "speed", "power", "jerk", "nut_force")
    }
    curves = [limits.curve for limits in (one, other) if limits.curve is not None]
    if curves:
        # Where two curves cross, the straight line between points of both is below them.
        grid = np.unique(np.concatenate([rows[..., 0].ravel() for rows in curves]))
        forces = [[np.interp(grid, *rows.T) for rows in axes] for axes in curves]
        least["curve"] = np.stack([np.broadcast_to(grid, (3, len(grid))), np.min(forces, axis=0)], axis=-1)
    for name in ("efficiency", "efficiency_back"):
        least[name] = np.minimum(getattr(one, name), getattr(other, name))
    most = {name: np.maximum(getattr(one, name), getattr(other, name)) for name in ("reflected_mass", "drag")}
    return AxisLimits(**most, **least)


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
        self._looked: list[tuple[FloatArray, FloatArray, Demand]] = []
        bare = replace(robot.parameters, friction=Friction())
        self._lossy, self._bare = robot, Manipulator(bare)
        self._path, self._wrenches, self._mass = path, wrenches, reflected_mass

    @property
    def lossy(self) -> bool:
        """Whether there is friction."""
        return bool(self._lossy.parameters.friction)

    def demand(self, place: FloatArray, middle: FloatArray) -> Demand:
        """Return what is needed at parameters (P,); each is in a step whose middle is given too, (P,)."""
        for *known, demand in self._looked:
            if all(map(np.array_equal, known, (place, middle))):
                return demand
        self._looked = [(place.copy(), middle.copy(), self._demand(place, middle)), *self._looked[:1]]
        return self._looked[0][-1]

    def _demand(self, place: FloatArray, middle: FloatArray) -> Demand:
        pose, slope, bend = self._path.at(place)
        none = np.zeros_like(pose)
        piece = np.searchsorted(self._path.at_waypoints, middle, "right") - 1
        load = self._wrenches[np.clip(piece, 0, len(self._wrenches) - 1)]

        def forces(velocity: FloatArray, acceleration: FloatArray) -> FloatArray:
            return np.asarray(self._bare.forces(pose, velocity, acceleration, method="compiled", wrench=load))

        rest = forces(none, none)
        geometry = self._bare.parameters.geometry
        sliders, rate, change = slider_motion(geometry, pose, slope, bend)
        third = np.full_like(rate, np.nan)
        if self._with_jerk:
            beside = self._path.third(place + _BESIDE * (middle - place))
            along = partial(slider_motion, geometry)
            third = third_by_differences(along, pose, slope, bend, beside, self._path.end)
        mass = forces(none, slope) - rest + self._mass * rate
        bias = forces(slope, bend) - rest + self._mass * change
        added = self._bare.parameters.actuators
        balance = added.balance_at_home(self._bare.parameters.gravity) - added.stiffness * sliders
        own, turning = self._mass + added.inertia, self._mass + added.rotors
        return Demand(mass, bias, rest, rate, change, third, own, balance, turning)

    def _at(self, place: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return poses and their derivatives at places, which are asked for again and again."""
        for known, pose, slope in self._seen:
            if known is place or (known.shape == place.shape and (known == place).all()):
                return pose, slope
        pose, slope, _ = self._path.at(place)
        self._seen = [(place.copy(), pose, slope), *self._seen[: _KEPT - 1]]
        return pose, slope

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
        "force": (np.abs(force), limits.force_at(found.slider_velocities)),
        "speed": (np.abs(found.slider_velocities), limits.speed),
        "power": (force * found.slider_velocities, limits.power),
    }
    uses = []
    for name, (values, limit) in columns.items():
        used, allowed = Used(name, values, limit).share, np.broadcast_to(limit, values.shape)
        for k, row in enumerate(used.argmax(axis=0)):
            own, most = getattr(machine, name, np.inf), float(allowed[row, k])
            if most == own and not (name == "force" and limits.reflected_mass[k]):
                continue
            time, value = float(found.time[row]), max(float(values[row, k]), 0.0)
            place = found.piece_at(time).name if isinstance(found, TaskForces) else ""
            if np.isfinite(most):
                uses.append(LimitUse(name, LEGS[k], value, most, time, place))
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


_FEW, _FEW_SMOOTH = 60, 40  # steps along a way while paths are compared
_STEP, _LEAST = 0.25, 0.01  # shares of what a freedom allows by which the search goes first, and at last
_EVALUATIONS, _EVALUATIONS_SMOOTH = 150, 60  # most paths that are tried on a way, without and with a jerk
_GAIN = 1e-5  # least share of the time that is a gain while paths are compared


@dataclass(frozen=True, eq=False)
class BestPath(ShownInNotebook):
    """What `best_path` found.

    Parameters
    ----------
    task : Task
        With the blends and poses found.
    plan : FastestPlan
        Its fastest plan.
    given : Task
        What was asked for.
    given_plan : FastestPlan
        The fastest plan of that.
    """

    task: Task
    plan: FastestPlan
    given: Task
    given_plan: FastestPlan

    @property
    def decided(self) -> Task:
        """`task` without blend_range and tolerance, which are those about the given path and are used up."""
        points = (replace(point, blend_range=None, tolerance=None) for point in self.task.waypoints)
        return replace(self.task, waypoints=tuple(points))

    def __repr__(self) -> str:
        return f"BestPath({self.given_plan.duration:.6g} s → {self.plan.duration:.6g} s)"


def best_path(
    robot: Manipulator,
    task: Task,
    limits: AxisLimits | None = None,
    *,
    nodes: int | None = None,
    samples: int = 1001,
    progress: Progress | None = None,
) -> BestPath:
    """Return the path of a task that takes the least time, with blends and waypoints where they may be.

    A waypoint that is passed may say between which sizes its blend may be (`Waypoint.blend_range`), and how
    far its pose may be from the one given (`Waypoint.tolerance`). Way by way a compass search goes from the
    given path, and from those of the smallest and the largest blends, to faster ones, with few steps;
    the best is planned with as many as the given one. What is found is never slower than the given path, and
    the same every time; it is the best near it, not surely of all.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    task : Task
        What it has to do.
    limits : AxisLimits, optional
        As of `fastest_plan`.
    nodes : int, optional
        As of `fastest_plan`.
    samples : int
        As of `fastest_plan`.
    progress : callable, optional
        Called with (done, total) paths; most of the total may not be needed.

    Raises
    ------
    InputError, TaskError, ReachError, SingularityError
        As `fastest_plan`; also if no waypoint says what may be changed.
    """
    chosen = chosen_limits(robot, task, limits)
    task = task.on(robot.parameters.geometry)
    free = [k for k, (a, b) in enumerate(task.stretches) if _freedoms(task, a, b)]
    if not free:
        raise TaskError(
            "no waypoint on a segment of free duration has a blend_range or a tolerance: nothing can be "
            "optimised"
        )
    given = fastest_plan(robot, task, limits, nodes=nodes, samples=samples)
    points = list(task.waypoints)
    most = _EVALUATIONS_SMOOTH if np.isfinite(chosen.jerk).any() else _EVALUATIONS
    total = most * len(free)
    for done, way in enumerate(free):
        first, last = task.stretches[way]
        search = _PathSearch(robot, task, chosen, (first, last), most)
        points[first : last + 1] = search.best(_counted(progress, done * most, total))
    if progress is not None:
        progress(total, total)
    found = replace(task, waypoints=tuple(points)).on(robot.parameters.geometry)
    plan = fastest_plan(robot, found, limits, nodes=nodes, samples=samples)
    if plan.duration >= given.duration:
        found, plan = task, given
    return BestPath(found, plan, task, given)


def _counted(progress: Progress | None, done: int, total: int) -> Callable[[int], None]:
    def told(more: int) -> None:
        if progress is not None:
            progress(done + more, total)

    return told


class _PathSearch:
    """The search for the best path from one stop to the next."""

    def __init__(
        self, robot: Manipulator, task: Task, limits: AxisLimits, stops: tuple[int, int], most: int
    ) -> None:
        self._robot, self._task, self._limits = robot, task, limits
        self._first, self._last = stops
        self._free, self._most = _freedoms(task, *stops), most
        self._steps = _FEW_SMOOTH if np.isfinite(limits.jerk).any() else _FEW
        self._known: dict[tuple[float, ...], float] = {}

    def best(self, told: Callable[[int], None]) -> Sequence[Waypoint]:
        """Return the waypoints of the way, its stops among them."""
        given = tuple(start for _, _, low, high, start in self._free)
        low, high = (tuple(one[k] for one in self._free) for k in (2, 3))
        blends = [one[1] < 0 for one in self._free]
        starts = [given]
        if any(blends):
            starts += [tuple(np.where(blends, end, given).tolist()) for end in (low, high)]
        place = min(starts, key=self._time)
        step = _STEP
        while step >= _LEAST and len(self._known) < self._most:
            best = min(self._around(place, step, told), key=self._time)
            if self._time(best) < self._time(place) * (1 - _GAIN):
                place = best
            else:
                step /= 2
        return self._points(place)

    def _around(
        self, place: tuple[float, ...], step: float, told: Callable[[int], None]
    ) -> list[tuple[float, ...]]:
        """Return the neighbours of a place, and where two good steps together lead."""
        found, downhill = [], np.zeros(len(place))
        for k, (_, _, low, high, _) in enumerate(self._free):
            for sign in (1, -1):
                moved = min(max(place[k] + sign * step * (high - low), low), high)
                other = (*place[:k], moved, *place[k + 1 :])
                if moved == place[k] or len(self._known) >= self._most:
                    continue
                found.append(other)
                if self._time(other) < self._time(place):
                    downhill[k] = moved - place[k]
                told(len(self._known))
        if np.count_nonzero(downhill) > 1:
            found.append(tuple((np.array(place) + downhill).tolist()))
        return found or [place]

    def _points(self, place: tuple[float, ...]) -> list[Waypoint]:
        points = list(self._task.waypoints[self._first : self._last + 1])
        for (k, what, *_), value in zip(self._free, place, strict=True):
            point = points[k]
            if what < 0:
                points[k] = replace(point, blend=value)
            else:
                pose = point.pose.copy()
                pose[what] = value
                points[k] = replace(point, pose=pose)
        return self._fitted(points)

    def _fitted(self, points: list[Waypoint]) -> list[Waypoint]:
        """Return the points, with blends that may be smaller made so small that they do not overlap."""
        least = {k: low for k, what, low, _, _ in self._free if what < 0}
        size = min(len(point.pose) for point in points)
        metric = np.array([1.0, 1.0, self._task.turning_length])[:size]
        for k in range(len(points) - 1):
            one, other = points[k : k + 2]
            leg = float(np.linalg.norm((other.pose[:size] - one.pose[:size]) * metric))
            free = [j for j in (k, k + 1) if j in least]
            over = one.blend + other.blend - leg
            room = sum(points[j].blend - least[j] for j in free)
            if over <= 0 or over > room:
                continue
            share = over / room
            for j in free:
                points[j] = replace(points[j], blend=points[j].blend - share * (points[j].blend - least[j]))
        return points

    def _time(self, place: tuple[float, ...]) -> float:
        """Return how long the way takes; infinite where it is not possible."""
        if place not in self._known:
            self._known[place] = self._found(place)
        return self._known[place]

    def _found(self, place: tuple[float, ...]) -> float:
        task, first, last = self._task, self._first, self._last
        try:
            points = self._points(place)
            path = task.path_through(points, (first, last))
            way = way_of(self._robot, task, path, (first, last), self._limits)
            return fastest_along(path, way, self._limits, self._steps, starts=1).duration
        except (TaskError, SampleError):
            return math.inf


def _freedoms(task: Task, first: int, last: int) -> list[tuple[int, int, float, float, float]]:
    """Return what may be changed: waypoint of the way, -1 for the blend or a coordinate, low, high, given."""
    found: list[tuple[int, int, float, float, float]] = []
    if task.waypoints[last].duration is not None:
        return found
    for k, point in enumerate(task.waypoints[first : last + 1]):
        if point.blend_range is not None and task.path != "spline":
            found.append((k, -1, *point.blend_range, point.blend))
        if point.tolerance is not None:
            for what, half in enumerate(point.tolerance.tolist()):
                if half > 0:
                    middle = float(point.pose[what])
                    found.append((k, what, middle - half, middle + half, middle))
    return found


def best_path_table(found: BestPath) -> Table:
    """Return what was changed of a path."""
    rows: dict[str, tuple[str, ...]] = {
        "whole task: time [s]": (number(found.given_plan.duration), number(found.plan.duration), "")
    }
    points = zip(found.given.names, found.given.waypoints, found.task.waypoints, strict=True)
    for name, old, new in points:
        if old.blend_range is not None and found.given.path != "spline":
            bounds = " to ".join(f"{1e3 * end:g}" for end in old.blend_range)
            rows[f"{name}: blend [mm]"] = (number(1e3 * old.blend), number(1e3 * new.blend), bounds)
        if old.tolerance is None:
            continue
        units = (("y [mm]", 1e3), ("z [mm]", 1e3), ("θ [deg]", 180 / math.pi))
        for k, (what, unit) in enumerate(units[: len(old.tolerance)]):
            middle, half = unit * old.pose[k], unit * old.tolerance[k]
            if half > 0:
                bounds = f"{middle - half:g} to {middle + half:g}"
                rows[f"{name}: {what}"] = (number(middle), number(unit * new.pose[k]), bounds)
    return table_of("Optimised path", ("", "given", "best", "allowed"), rows)


@html_of.register(BestPath)
def best_path_html(found: BestPath) -> str:
    """Return how a notebook shows the best path, as HTML."""
    facts = f"{number(found.given_plan.duration)} s → {number(found.plan.duration)} s"
    return notebook_html("Best path", facts, [best_path_table(found)])
