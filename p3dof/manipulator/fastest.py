"""The fastest plan of a task: the machine's forces along every way of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from p3dof import kinematics
from p3dof.checks import FloatArray, Progress, shown
from p3dof.errors import InputError, TaskError
from p3dof.manipulator.facade import Manipulator
from p3dof.motion.times import sample_count
from p3dof.parameters import SLIDES, Friction
from p3dof.tasks import Path, Plan, Task
from p3dof.tasks.fastest import AxisLimits, Demand, fastest_law
from p3dof.tasks.laws import Law, ProfileLaw
from p3dof.tasks.plan import Stretch, payloads, planned
from p3dof.tasks.profiles import PROFILES

NODES, _MOST_NODES = 400, 20_000


def fastest_plan(
    robot: Manipulator,
    task: Task,
    limits: AxisLimits | None = None,
    *,
    nodes: int = NODES,
    samples: int = 1001,
    progress: Progress | None = None,
) -> Plan:
    """Return the plan of a task in the least time that the actuators allow, friction and payloads counted.

    Between stops the platform moves along the task's path as fast as forces, slider speeds and powers allow:
    mostly one of them is at its limit. The acceleration jumps where another one takes over. Ways whose stops
    have a duration keep it, with the task's profile.

    With more nodes the time comes nearer to the least one, by the square of their distance: with 400 within
    some 1e-4 of it. The limits hold between the nodes too: they are checked densely, and all of a way is
    slowed down by as much as that asks for, some 1e-4.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    task : Task
        What it has to do.
    limits : AxisLimits, optional
        What the actuators may be asked for; force and speed of the machine's `p3dof.Limits` without it.
    nodes : int
        Steps along each way, closer together at its ends.
    samples : int
        Least number of samples, as of `Task.plan`; all nodes are samples besides.
    progress : callable, optional
        Called with (done, total) ways.

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        If `robot`, `task` or `limits` is something else, or `nodes` does not fit.
    TaskError
        If the limits do not let the machine stand somewhere on a way, or move along it.
    ReachError, SingularityError
        If a path leaves what the machine can reach or hold.
    """
    for name, value, kind in (("robot", robot, Manipulator), ("task", task, Task)):
        if not isinstance(value, kind):
            raise InputError(f"{name}: expected a {kind.__name__}, got {shown(value)}")
    own = robot.parameters.limits
    chosen = AxisLimits(own.force, own.speed) if limits is None else limits
    if not isinstance(chosen, AxisLimits):
        raise InputError(f"limits: expected AxisLimits, got {shown(limits)}")
    if isinstance(nodes, bool) or not isinstance(nodes, int) or not 10 <= nodes <= _MOST_NODES:
        raise InputError(f"nodes: expected a whole number from 10 to {_MOST_NODES}, got {shown(nodes)}")
    count, carried, stretches = sample_count(samples, least=2), payloads(task.waypoints, task.carrying), []
    for done, (path, (first, last)) in enumerate(zip(task.paths, task.stretches, strict=True), 1):
        law: Law
        duration = task.waypoints[last].duration
        if duration is not None:
            law = ProfileLaw(PROFILES[task.profile], path.end, duration)
        else:
            payload = carried[last]
            machine = robot
            if payload is not None:
                machine = Manipulator(robot.parameters.carrying(payload))
            wrenches = np.array([point.wrench for point in task.waypoints[first + 1 : last + 1]])
            way = WayOfMachine(machine, path, wrenches, chosen.reflected_mass)
            places = np.union1d(path.end * _graded(nodes), path.at_waypoints)
            places = places[np.append(True, np.diff(places) > 1e-9 * path.end)]
            try:
                law = fastest_law(places, way, chosen)
            except TaskError as error:
                raise TaskError(f"{task.names[first]} to {task.names[last]}: {error}") from error
        stretches.append(Stretch(path, first, last, law))
        if progress is not None:
            progress(done, len(task.paths))
    return planned(task.waypoints, task.names, task.carrying, stretches, count, task.name)


class WayOfMachine:
    """What a path takes of the actuators of a machine.

    Parameters
    ----------
    robot : Manipulator
        The machine, with what it carries.
    path : Path
        Where the platform goes.
    wrenches : ndarray, shape (K - 1, 6)
        The external wrench from waypoint to waypoint [N, N m].
    reflected_mass : ndarray, shape (3,)
        What the drives add to each slider [kg].
    """

    def __init__(
        self, robot: Manipulator, path: Path, wrenches: FloatArray, reflected_mass: FloatArray
    ) -> None:
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
        moved = kinematics.mechanism_motion(self._bare.parameters.geometry, pose, slope, bend)
        rate = np.column_stack([moved.velocity[name] for name in SLIDES])
        change = np.column_stack([moved.acceleration[name] for name in SLIDES])
        mass = forces(none, slope) - rest + self._mass * rate
        return Demand(mass, forces(slope, bend) - rest + self._mass * change, rest, rate)

    def friction(self, place: FloatArray, speed: FloatArray) -> FloatArray:
        """Return what friction adds to the forces, (P, 3) [N], at parameters and speeds ṡ (P,)."""
        pose, slope, _ = self._path.at(place)
        velocity, none = slope * speed[:, None], np.zeros_like(pose)
        with_, without = (
            machine.forces(pose, velocity, none, method="compiled") for machine in (self._lossy, self._bare)
        )
        return np.asarray(with_ - without)


def _graded(count: int) -> FloatArray:
    """Return shares from 0 to 1 that are closer together at both ends, (count + 1,)."""
    even = np.linspace(0.0, 1.0, count + 1)
    return even**2 * (3 - 2 * even)
