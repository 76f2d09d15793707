"""A motion of the actuated joints of any robot: read, completed to all joints, and the forces for it."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, Watch
from p3dof._base.errors import AssemblyError, DynamicsError, InputError, P3dofError, SingularityError
from p3dof._base.files import Source, called, read_text
from p3dof._base.tables import Tabular
from p3dof._base.time_series.joint_files import JointCurve, read_joints
from p3dof._base.time_series.smoothing import Smooth
from p3dof._base.time_series.wrenches import WrenchHistory
from p3dof.loops import BatchInverseDynamics, BatchStates, ClosedLoopModel
from p3dof.loops.compiled.kept import Method
from p3dof.loops.linear import RANK_TOLERANCE, orientation
from p3dof.loops.tables import closure_conditioning, is_slide, joint_values, overview, units_of_actuated
from p3dof.runs.following import follow_motion
from p3dof.runs.joint_controllers import JointReference
from p3dof.runs.margins import DEPENDENT, GROWING, SINGULAR, Stop
from p3dof.runs.plants import ExternalOverTime, Limited, Loads

_FEWEST, _MOST = 200, 4000  # steps of a curve that its forces begin with, and beyond which they do not go
_SETTLED = 3e-4  # share by which twice as many samples may change peaks, RMS and power
_SHOWN, _FRAMES = 4.0, 201  # how long a motion through the ranges is [s], and how many samples it has
_SHARE, _SHRINKINGS = 0.6, 14  # how much of each range it begins with, and how often it becomes smaller
_MOST_TURN = 1.2  # how far a motor turns to either side at most [rad]
_NEAR_SINGULAR = 3.0  # how many times faster than at home joints may move with the motors
_STARTS_SINGULAR = (
    "the motion starts at a singular configuration, whose forces are not determined; p3dof loop info and "
    "regular_configuration give a regular one near the reference"
)
_AT_REST = 1e-2  # share of its largest speed below which a joint is at rest


@dataclass(frozen=True, eq=False)
class RobotForces(Limited, Tabular):
    """Forces along a motion, with the motion of all joints."""

    loop: ClosedLoopModel  # what moves
    time: FloatArray  # (N,): times [s]
    q: FloatArray  # (N, nq): configurations
    v: FloatArray  # (N, nv): velocities and accelerations
    a: FloatArray
    forces: FloatArray  # (N, n_actuated): forces of the actuated joints [N or N m]
    gap: float  # largest gap of a loop [m or rad], and largest error of the equation of motion [N or N m]
    residual: float
    remarks: tuple[str, ...] = ()  # what there is to know about the motion, one sentence each

    def crossing(self) -> Stop | None:
        """Return where closures first become dependent, also between samples."""
        steps, rank = pairwise(zip(self.time, self.q, strict=True)), _regular_rank(self.loop)
        return next(filter(None, (_dependent(self.loop, rank, *step) for step in steps)), None)

    def to_columns(self) -> dict[str, FloatArray]:
        """Return times, forces of the actuated joints, and all joints, (N,) each, by name and unit."""
        loop, found = self.loop, {"t [s]": self.time}
        for name, (_, unit), forces in zip(
            loop.actuated, units_of_actuated(loop), self.forces.T, strict=True
        ):
            found[f"force {name} [{unit}]"] = forces
        for joint, name in enumerate(map(str, loop.model.names)):
            if loop.model.nvs[joint] != 1:
                found |= {f"{name}.{i}": column for i, column in enumerate(self.values(name).T)}
            elif is_slide(loop, joint):
                found[f"{name} [m]"] = self.values(name)
            else:
                found[f"{name} [rad]"] = np.asarray(np.unwrap(self.values(name)))
        return found


def forces_along(
    robot: ClosedLoopModel,
    motion: Source,
    samples: int | None = None,
    external: ExternalOverTime | None = None,
    equilibrium: bool = False,
    method: Method = "general",
    smooth: Smooth = None,
    watch: Watch = lambda *_: nullcontext(),
) -> RobotForces:
    """Return the forces of the actuated joints along a motion of them, passive freedoms moving freely."""
    if not robot.actuated:
        raise InputError("the robot has no actuated joints")
    joints = [robot.model.getJointId(name) for name in robot.actuated]
    text, name = read_text(motion), called(motion)
    sliding = [is_slide(robot, joint) for joint in joints]
    curve = read_joints(text, name, robot.actuated, sliding, smooth, list(robot.model.names))
    known = [f"{words[0].upper()}{words[1:]}." for words in curve.remarks(robot.actuated, sliding)]
    external = {
        frame: wrench.since(curve.start) if isinstance(wrench, WrenchHistory) else wrench
        for frame, wrench in (external or {}).items()
    }
    told, loads = (*known, *_ends(robot, curve)), (Loads(robot, external), method)
    seen = overview(robot, robot.assemble(curve.values[0]).q)
    idle = seen.idle
    if idle and robot.generic_rank is not None:
        regular = overview(robot, robot.regular_configuration)
        if (seen.rank, seen.held) < (regular.rank, regular.held):
            raise DynamicsError(_STARTS_SINGULAR)
    if equilibrium and not idle:
        raise InputError("--equilibrium: the robot has no passive degrees of freedom")
    if idle and len(curve.time) > 1:
        options = external, equilibrium, method, watch
        return _with_idle(robot, curve, samples, options, (*told, _idle_words(idle)))
    if len(curve.time) == 1:
        return _forces_at(robot, curve, curve.time, told, loads)
    if samples is not None:
        return _forces_at(robot, curve, np.linspace(curve.time[0], curve.time[-1], samples), told, loads)
    steps, parts = len(curve.time) - 1, 1
    while parts * steps < _FEWEST:
        parts *= 2
    found = _forces_at(robot, curve, curve.divided(parts), told, loads)
    while 2 * parts * steps <= max(_MOST, 2 * steps):
        finer = _forces_at(robot, curve, curve.divided(2 * parts), told, loads)
        if _settled(_sizes(found), _sizes(finer)):
            return found
        found, parts = finer, 2 * parts
    return found


def through_ranges(
    robot: ClosedLoopModel, q: FloatArray, ranges: Sequence[tuple[float, float]], method: Method = "general"
) -> RobotForces | None:
    """Return a motion that shows what all motors move, as far through their ranges as the loops stay closed.

    About a configuration (nq,) one motor swings once in four seconds, the next one twice, and so on in turn.
    Where a loop opens, another branch of the assembly begins, a joint passes a limit, a singular pose is near
    or a force is not determined, all swing less. None where motors alone do not determine the motion.
    """
    if not robot.actuated or robot.mobility(q) != len(robot.actuated) or overview(robot, q).idle:
        return None
    time = np.linspace(0.0, _SHOWN, _FRAMES, dtype=np.float64)
    turns = 2 * np.pi / _SHOWN * (1 + np.arange(len(ranges)) % 2)
    values = joint_values(robot, q)
    home = np.array([values[name][0] for name in robot.actuated])
    low, high = np.array(ranges).T
    most = np.minimum(high - home, home - low)
    most = _SHARE * np.where(most > 0.05 * (high - low), most, 0.0)  # where it is at a limit, it stays
    turning = [not is_slide(robot, robot.model.getJointId(name)) for name in robot.actuated]
    most = np.where(turning, np.minimum(most, _MOST_TURN), most)
    angles, count = time[:, None] * turns, len(robot.actuated)
    for amplitude in most * 0.75 ** np.arange(_SHRINKINGS)[:, None]:
        target = home + amplitude * np.sin(angles)
        rates = amplitude * turns * np.cos(angles), -amplitude * turns**2 * np.sin(angles)
        states = robot.complete_batch(target, *rates, guess=q, method=method)
        if states.errors or not states.same_assembly.all():
            continue
        sizes = np.linalg.norm(states.influence, axis=(1, 2))
        if sizes.max() > _NEAR_SINGULAR * sizes[0]:
            continue
        found = robot.inverse_dynamics_batch(states.q, states.v, states.a, method=method)
        if not found.errors and np.isfinite(found.tau).all() and found.tau.shape[1] == count:
            told = ("A motion through the ranges of the motors, to show what they move.",)
            shown = _found(robot, time, states, found, told)
            if all(one.quantity != "position" for one in shown.exceedances()):
                return shown
    return None


def _regular_rank(robot: ClosedLoopModel) -> int:
    """Return the rank of the closures where they are not singular."""
    return robot.rank(robot.regular_configuration)


def _dependent(
    robot: ClosedLoopModel,
    rank: int,
    one: tuple[float, FloatArray],
    other: tuple[float, FloatArray],
    left: int = 40,
) -> Stop | None:
    """Return where closures become dependent: their Jacobian changes its orientation, however near."""
    (start, low), (end, high) = one, other
    if closure_conditioning(robot, high, rank) < DEPENDENT:
        return Stop(SINGULAR, float(end), GROWING)
    if not left or orientation(robot.closure_jacobian(low), robot.closure_jacobian(high), RANK_TOLERANCE) > 0:
        return None
    try:
        middle = (start + end) / 2, robot.assemble(guess=pin.interpolate(robot.model, low, high, 0.5)).q
    except AssemblyError:
        return None  # samples too far apart to tell
    halves = (one, middle), (middle, other)
    return next(filter(None, (_dependent(robot, rank, *half, left - 1) for half in halves)), None)


def _settled(before: FloatArray, after: FloatArray) -> bool:
    """Return whether twice as many samples change peaks, RMS and power by nothing that counts."""
    size = np.maximum(after, 1e-2 * after.max(axis=1, keepdims=True))  # small ones may be as far off as large
    return bool(np.all(np.abs(after - before) <= _SETTLED * size))


def _idle_words(idle: tuple[str, ...]) -> str:
    """Say which joints no motor holds."""
    named = ", ".join(idle[:4]) + (f" and {len(idle) - 4} more" if len(idle) > 4 else "")
    return f"Joints that no actuator holds move freely, from rest: {named}."


def _with_idle(
    robot: ClosedLoopModel,
    curve: JointCurve,
    samples: int | None,
    options: tuple[ExternalOverTime | None, bool, Method, Watch],
    told: tuple[str, ...],
) -> RobotForces:
    """Return the forces of a robot with passive freedoms, whose motion is integrated in time."""
    motion = JointReference(curve.time, curve.values, curve.smooth)
    count = 2 * _FEWEST * 4 + 1 if samples is None else samples
    external, equilibrium, method, watch = options
    with watch("motion", count) as progress:
        run = follow_motion(
            robot,
            motion,
            external=external,
            equilibrium=equilibrium,
            samples=count,
            progress=progress,
            method=method,
        )
    if run.stop is not None:
        raise DynamicsError(f"the passive degrees of freedom cannot be integrated: ended by {run.stop}")

    def thinned(stride: int) -> RobotForces:
        rows = slice(None, None, stride)
        q, v, a, tau = run.q[rows], run.v[rows], run.a[rows], run.forces[rows]
        acting = {name: wrench[rows] for name, wrench in run.external.items()}
        wanted = a[:, robot.actuated_v]
        found = robot.hybrid_dynamics_batch(q, v, wanted, external=acting, method=method)
        residual = float(np.abs(found.residual).max(initial=0.0))
        return RobotForces(
            robot, curve.time[0] + run.time[rows], q, v, a, tau, float(run.gap.max()), residual, told
        )

    if samples is not None:
        return thinned(1)
    for stride in (8, 4, 2):
        found = thinned(stride)
        if _settled(_sizes(found), _sizes(thinned(stride // 2))):
            return found
    return thinned(1)


def _forces_at(
    robot: ClosedLoopModel,
    curve: JointCurve,
    time: FloatArray,
    told: tuple[str, ...],
    by: tuple[Loads, Method],
) -> RobotForces:
    loads, method = by
    values, velocities, accelerations = curve.at(time)
    start = robot.assemble(values[0]).q
    states = robot.complete_batch(values, velocities, accelerations, start, stop=True, method=method)
    for k in filter(None, states.errors):  # at most one: it stopped there
        with suppress(AssemblyError):
            there = time[k], robot.assemble(values[k], states.q[k - 1]).q
            if (stop := _dependent(robot, _regular_rank(robot), there, there)) is not None:
                raise DynamicsError(str(stop)) from states.errors[k]
    _require(states.errors, time)
    motion, acting = (states.q, states.v, states.a), loads.over(time - curve.time[0])
    found = robot.inverse_dynamics_batch(*motion, external=acting, stop=True, method=method)
    _require(found.errors, time)
    return _found(robot, time, states, found, told)


def _found(
    robot: ClosedLoopModel, time: FloatArray, at: BatchStates, by: BatchInverseDynamics, told: tuple[str, ...]
) -> RobotForces:
    gap, residual = (float(np.abs(array).max(initial=0.0)) for array in (by.closure_error, by.residual))
    return RobotForces(robot, time, at.q, at.v, at.a, by.tau, gap, residual, told)


def _sizes(found: RobotForces) -> FloatArray:
    """Return peak, RMS and largest power of every actuator, (3, n_actuated)."""
    power = found.forces * found.v[:, found.loop.actuated_v]
    mean = np.trapezoid(found.forces**2, found.time, axis=0) / (found.time[-1] - found.time[0])
    return np.array([np.abs(found.forces).max(axis=0), np.sqrt(mean), np.abs(power).max(axis=0)])


def _ends(robot: ClosedLoopModel, curve: JointCurve) -> tuple[str, ...]:
    """Say with what velocities a motion starts and ends, where it does not so at rest."""
    _, velocities, _ = curve.at(curve.time)
    least, told = _AT_REST * np.abs(velocities).max(axis=0), []
    for when, row in (("starts", velocities[0]), ("ends", velocities[-1])):
        each = zip(robot.actuated, row, units_of_actuated(robot), abs(row) > least, strict=True)
        moving = [f"{name} at {speed:.4g} {unit}/s" for name, speed, (unit, _), moves in each if moves]
        if moving:
            told.append(f"The curve through the {len(curve.time)} values {when} with {', '.join(moving)}.")
    return tuple(told)


def _require(errors: dict[int, P3dofError], time: FloatArray) -> None:
    """Raise the first error with its time."""
    for index, error in sorted(errors.items()):
        words = f"at t = {time[index]:.6g} s: {error}"
        if isinstance(error, AssemblyError):
            raise AssemblyError(words, error.gap) from error
        known = isinstance(error, DynamicsError | SingularityError | InputError)
        raise (type(error) if known else DynamicsError)(words) from error
