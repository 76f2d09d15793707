"""Emergency stops at any instant of a motion: by the drives with limited jerk, or by the brakes alone.

A controlled stop leads each slider to rest on a ramp of its own; an uncontrolled one takes the torque of all
motors away, and brakes close after their delay. Then with M of the machine and the turning parts, and forces
b of the brakes, M ẍ + c = Jᵀ b, |b_k| <= F_k, and b_k against λ̇_k while slider k moves: the least of a
quadratic form in the impulses of each step. Sliders are coupled: where one brake is open, the platform falls
by it. Friction and losses, which would help, are left out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from p3dof._base.checks import FloatArray, FrozenArrays, Readable, not_negative
from p3dof._base.errors import DriveError
from p3dof._base.tables import NONE, Table, number, table_of
from p3dof.design.drives.motor import above_zero
from p3dof.design.drives.sizing import Rating
from p3dof.design.drives.transmission import Drive, Screw
from p3dof.machine.parameters import LEGS, SLIDES, Actuators, Friction, Parameters
from p3dof.manipulator import Manipulator
from p3dof.methods import Method

_WAY: Method = "compiled"
_SAMPLES = 33  # of a controlled stop
_STEP, _LONGEST = 5e-4, 2.0  # of an uncontrolled stop, and how long it is followed [s]
_SWEEPS, _CLOSE = 200, 1e-13


@dataclass(frozen=True)
class StopRamp:
    """How the drives stop in an emergency: each slider by itself."""

    deceleration: float  # largest, of each slider [m/s²]
    jerk: float  # largest, of each slider [m/s³]
    delay: float = 0.0  # until the ramp begins, with the acceleration of the motion [s]

    def __post_init__(self) -> None:
        for name in ("deceleration", "jerk"):
            object.__setattr__(self, name, above_zero(f"stop: {name}", getattr(self, name)))
        object.__setattr__(self, "delay", not_negative("stop: delay", self.delay, DriveError))

    def way(self, speed: FloatArray) -> FloatArray:
        """Return the way of sliders that have speeds (...) [m/s] and no acceleration, in (...) [m]."""
        size = np.abs(np.asarray(speed, dtype=float))
        a, j = self.deceleration, self.jerk
        ramp = np.where(size > a * a / j, size**2 / (2 * a) + size * a / (2 * j), size * np.sqrt(size / j))
        return np.asarray(size * self.delay + ramp)

    def phases(self, speed: FloatArray, acceleration: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return durations [s] and jerks [m/s³] of the four phases, (4, ...): delay, and ramp to rest."""
        a, v = acceleration, speed + acceleration * self.delay
        side = np.where(v + a * np.abs(a) / (2 * self.jerk) >= 0, 1.0, -1.0)  # of what is to be slowed down
        a, v = side * a, side * v
        peak = np.minimum(np.sqrt(np.maximum(self.jerk * v + a * a / 2, 0.0)), self.deceleration)
        first = np.abs(a + peak) / self.jerk
        left = v + (a - peak) / 2 * first - peak**2 / (2 * self.jerk)
        hold = np.where(peak >= self.deceleration, np.maximum(left, 0.0) / self.deceleration, 0.0)
        times = np.stack([np.full_like(v, self.delay), first, hold, peak / self.jerk])
        zero = np.zeros_like(v)
        return times, np.stack([zero, -side * np.sign(a + peak) * self.jerk, zero, side * self.jerk])


def brake_fall(
    mass: float, reflected: float, brake: float, speed: float, delay: float, gravity: float = 9.81
) -> tuple[float, float]:
    """Return way [m] and force at the nut [N] of one vertical slider whose power fails, in closed form.

    `mass` at the nut and `reflected` mass of the turning parts [kg], `brake`: what the brake holds at the
    slider [N]; `speed`: downwards [m/s]; `delay`: until the brake bears [s]; `gravity` [m/s²].
    """
    total, weight = mass + reflected, mass * gravity
    falling, slowing = weight / total, (brake - weight) / total
    if slowing <= 0:
        return math.inf, weight + mass * slowing
    faster = speed + falling * delay
    return speed * delay + falling * delay**2 / 2 + faster**2 / (2 * slowing), mass * (gravity + slowing)


@dataclass(frozen=True, eq=False)
class StopLoads(FrozenArrays):
    """What the worst emergency stops of a motion take, by slider A, B, C; each with the instant it begins."""

    kind: str  # `"by the drives"` or `"by the brakes"`
    way: FloatArray  # (3,): longest way [m], infinite where the machine does not come to rest, and when [s]
    way_time: FloatArray
    nut_force: FloatArray  # (3,): largest force at the nut [N], and when [s]
    nut_time: FloatArray
    brake_energy: (
        FloatArray  # (3,): largest that a brake takes in one stop [J], and when [s]; 0 by the drives
    )
    energy_time: FloatArray
    platform_way: float  # longest way of P [m], and when [s]
    platform_time: float
    duration: float  # of the longest stop [s]
    ratings: tuple[tuple[str, Rating], ...]  # how much of each rating is used, by axis


@dataclass(frozen=True, eq=False)
class Instants(Readable):
    """Instants of a motion with one payload."""

    parameters: Parameters  # with what the machine carries
    time: FloatArray  # (N,) [s]
    pose: FloatArray  # (N, 3), and its velocity and acceleration [m, m, rad; per second, per second²]
    velocity: FloatArray
    acceleration: FloatArray
    wrench: FloatArray  # (N, 6): external, on the platform [N, N m]


def controlled_stops(pieces: Sequence[Instants], drives: Sequence[Drive], ramp: StopRamp) -> StopLoads:
    """Return the worst of the stops by the drives, from each of the instants."""
    return _worst("by the drives", [_controlled(piece, drives, ramp) for piece in pieces], pieces, drives)


def uncontrolled_stops(pieces: Sequence[Instants], drives: Sequence[Drive], step: float = _STEP) -> StopLoads:
    """Return the worst of the stops by brakes alone, from each of the instants, followed in steps [s]."""
    found = [_uncontrolled(piece, drives, above_zero("step", step)) for piece in pieces]
    return _worst("by the brakes", found, pieces, drives)


@dataclass(frozen=True)
class _Stops:
    """Of each instant (N,) and slider (N, 3)."""

    low: FloatArray  # how far it goes down and up [m]
    high: FloatArray
    nut: FloatArray  # largest size of the force [N]
    energy: FloatArray
    platform: FloatArray  # (N,)
    duration: FloatArray  # (N,)
    torque: FloatArray  # of the motor, and what it has, where their ratio is largest [N m]
    available: FloatArray


def _machine(parameters: Parameters, armature: FloatArray | None, friction: bool) -> Manipulator:
    """Return a machine with other rotors, perhaps without friction."""
    rotors = {} if armature is None else dict(zip(SLIDES, armature.tolist(), strict=True))
    own: Actuators = replace(parameters.actuators, armature=rotors)
    kept = parameters.friction if friction else Friction()
    return Manipulator(replace(parameters, actuators=own, friction=kept))


def _controlled(piece: Instants, drives: Sequence[Drive], ramp: StopRamp) -> _Stops:
    robot = _machine(piece.parameters, None, friction=True)
    start = robot.inverse_kinematics(piece.pose).sliders
    jacobian = robot.jacobian(piece.pose, method=_WAY)
    speed = np.einsum("nij,nj->ni", jacobian, piece.velocity)
    bend = _bend(robot, piece.pose, piece.velocity)
    acceleration = np.einsum("nij,nj->ni", jacobian, piece.acceleration) + bend
    times, jerks = ramp.phases(speed, acceleration)
    longest = times.sum(axis=0).max(axis=1)
    moments = np.linspace(0, 1, _SAMPLES)[:, None] * longest
    way, v, a = (np.zeros((_SAMPLES, *speed.shape)) for _ in range(3))
    v += speed
    a += acceleration
    left = np.broadcast_to(moments[:, :, None], way.shape).copy()
    for duration, jerk in zip(times, jerks, strict=True):  # one phase after the other, as long as it lasts
        passed = np.clip(left, 0.0, duration)
        way += v * passed + a * passed**2 / 2 + jerk * passed**3 / 6
        v += a * passed + jerk * passed**2 / 2
        a += jerk * passed
        left -= passed
    over = left > 0
    v[over] = a[over] = 0.0
    poses = robot.forward_kinematics(start + way, on_invalid="nan")
    back = np.linalg.inv(robot.jacobian(poses, on_invalid="nan", method=_WAY))
    rate = np.einsum("knij,knj->kni", back, v)
    bend = _bend(robot, poses, rate)
    change = np.einsum("knij,knj->kni", back, a - bend)
    wrench = np.broadcast_to(piece.wrench, (_SAMPLES, *piece.wrench.shape))
    force = robot.forces(poses, rate, change, wrench=wrench, on_invalid="nan", method=_WAY)
    torque, available = np.zeros_like(way), np.ones_like(way)
    for leg, drive in enumerate(drives):
        torque[..., leg] = np.abs(drive.torque(force[..., leg], v[..., leg], a[..., leg]))
        available[..., leg] = drive.motor.peak(drive.ratio * v[..., leg])
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(torque == 0, 0.0, torque / available)
    row = np.expand_dims(np.argmax(share, axis=0), 0)
    lost = np.asarray(~np.isfinite(force).all(axis=(0, 2)), dtype=bool).reshape(-1)
    path = np.linalg.norm((poses - piece.pose)[..., :2], axis=2).max(axis=0)
    return _Stops(
        np.where(lost[:, None], -np.inf, way.min(axis=0)),
        np.where(lost[:, None], np.inf, way.max(axis=0)),
        np.where(lost[:, None], np.inf, np.abs(force).max(axis=0)),
        np.zeros_like(speed),
        np.where(lost, np.inf, path),
        longest,
        np.take_along_axis(torque, row, 0)[0],
        np.take_along_axis(available, row, 0)[0],
    )


def _bend(robot: Manipulator, pose: FloatArray, velocity: FloatArray) -> FloatArray:
    """Return J̇ẋ, the acceleration of the sliders where the platform has none, by central differences."""
    ahead, behind = (
        robot.jacobian(pose + s * _TINY * velocity, on_invalid="nan", method=_WAY) for s in (1, -1)
    )
    return np.asarray(np.einsum("...ij,...j->...i", ahead - behind, velocity) / (2 * _TINY))


_TINY = 1e-5  # step of these differences [s]


def _uncontrolled(piece: Instants, drives: Sequence[Drive], step: float) -> _Stops:
    """Follow all instants at once; each step by the state at its middle."""
    rotors = np.array([drive.reflected_mass for drive in drives])
    robot = _machine(piece.parameters, rotors, friction=False)
    count, limits = len(piece.time), piece.parameters.limits.travel
    start = robot.inverse_kinematics(piece.pose).sliders
    pose, sliders = piece.pose.copy(), start.copy()
    speed = np.einsum("nij,nj->ni", robot.jacobian(pose, method=_WAY), piece.velocity)
    delays = np.array([drive.motor.brake_time for drive in drives])
    holds = np.array([drive.motor.brake_torque * drive.ratio for drive in drives])
    low, high, nut, energy = (np.zeros((count, 3)) for _ in range(4))
    path, lasted = np.zeros(count), np.zeros(count)
    active = np.arange(count)
    for now, dt in _steps(delays, step):
        bound = np.broadcast_to(np.where(now + 1e-12 >= delays, holds, 0.0) * dt, (len(active), 3))
        here = pose[active], speed[active], piece.wrench[active]
        moved, after, force, slope = _brake_step(robot, *here, bound, dt)
        sliders[active] += moved
        nut[active] = np.maximum(nut[active], np.abs(force - rotors * slope))
        energy[active] += np.abs(force * moved)
        speed[active] = after
        placed = robot.forward_kinematics(sliders[active], on_invalid="nan")
        lost = ~np.isfinite(placed).all(axis=1) | ~np.isfinite(slope).all(axis=1)
        pose[active] = placed
        way = sliders[active] - start[active]
        beyond = ((sliders[active] < limits[0]) | (sliders[active] > limits[1])) & (speed[active] != 0)
        lost |= beyond.any(axis=1)
        low[active], high[active] = np.minimum(low[active], way), np.maximum(high[active], way)
        path[active] = np.fmax(path[active], np.linalg.norm((placed - piece.pose[active])[:, :2], axis=1))
        lasted[active] = now + dt
        low[active[lost]], high[active[lost]] = -np.inf, np.inf
        path[active[lost]] = lasted[active[lost]] = np.inf
        resting = (speed[active] == 0).all(axis=1) & (now + dt + 1e-12 >= delays.max())
        active = active[~(lost | resting)]
        if not len(active):
            break
    low[active], high[active], path[active], lasted[active] = -np.inf, np.inf, np.inf, np.inf
    blank: FloatArray = np.zeros((count, 3))
    return _Stops(low, high, nut, energy, path, lasted, blank, blank)


def _brake_step(
    robot: Manipulator, pose: FloatArray, speed: FloatArray, wrench: FloatArray, bound: FloatArray, dt: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return ways of sliders in a step, their speeds after it, forces of brakes, and accelerations.

    Forces and accelerations are those until the first slider comes to rest in the step.
    """
    middle = pose + _rate(robot.jacobian(pose, method=_WAY), speed) * dt / 2
    jacobian = robot.jacobian(middle, on_invalid="nan", method=_WAY)
    rate = _rate(jacobian, speed)
    none = np.zeros_like(rate)
    bias = robot.forces(middle, rate, none, wrench=wrench, on_invalid="nan", method=_WAY)
    mass = robot.mass_matrix(middle, on_invalid="nan", method=_WAY)
    give = jacobian @ np.linalg.solve(mass, np.swapaxes(jacobian, 1, 2))  # the inverse mass of the sliders
    own = _bend(robot, middle, rate) - np.einsum("nij,nj->ni", give, bias)
    impulse, after = _braked(give, speed + own * dt, bound)
    after[np.abs(after) <= _CLOSE * (1 + np.abs(speed))] = 0.0
    ends = (speed * after <= 0) & (speed != 0) & (np.abs(impulse) < bound)
    sliding = np.where(ends, -np.sign(speed) * bound, impulse)
    slope = own + np.einsum("nij,nj->ni", give, sliding) / dt
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = np.where(ends, -(speed**2) / (2 * slope), (speed + after) / 2 * dt)
    return moved, after, sliding / dt, slope


def _rate(jacobian: FloatArray, speed: FloatArray) -> FloatArray:
    """Return the velocity of the platform by those of the sliders."""
    return np.asarray(np.linalg.solve(jacobian, speed[..., None])[..., 0], dtype=np.float64)


def _steps(delays: FloatArray, step: float) -> list[tuple[float, float]]:
    """Return times and lengths of steps that meet the instants at which brakes close."""
    marks = [0.0, *sorted({float(delay) for delay in delays} - {0.0}), _LONGEST]
    found = []
    for a, b in pairwise(marks):
        count = max(math.ceil((b - a) / step - 1e-9), 1) if b > a else 0
        found += [(a + (b - a) * k / count, (b - a) / count) for k in range(count)]
    return found


def _braked(give: FloatArray, free: FloatArray, bound: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return impulses (N, 3) within bounds that take the speeds `free` to their least, and these speeds.

    By projected Gauss-Seidel: each slider in turn comes to rest, or as near to it as its bound lets it.
    """
    impulse: FloatArray = np.zeros_like(free)
    after = free.copy()
    for _ in range(_SWEEPS):
        change = 0.0
        for k in range(3):
            wanted = np.clip(impulse[:, k] - after[:, k] / give[:, k, k], -bound[:, k], bound[:, k])
            added = wanted - impulse[:, k]
            impulse[:, k] = wanted
            after += give[:, :, k] * added[:, None]
            change = max(change, float(np.nanmax(np.abs(give[:, k, k] * added), initial=0.0)))
        if change <= 1e-2 * _CLOSE:
            break
    return impulse, after


def _worst(kind: str, found: list[_Stops], pieces: Sequence[Instants], drives: Sequence[Drive]) -> StopLoads:
    """Return the worst of all instants, and the ratings that are known."""
    times = np.concatenate([piece.time for piece in pieces])
    low, high, nut, energy, platform, lasted, torque, available = (
        np.concatenate([getattr(one, name) for one in found]) for name in _Stops.__dataclass_fields__
    )
    sliders = np.concatenate(
        [Manipulator(piece.parameters).inverse_kinematics(piece.pose).sliders for piece in pieces]
    )
    way = np.maximum(high, -low)
    travel = pieces[0].parameters.limits.travel
    ratings: list[tuple[str, Rating]] = []
    for leg, (name, drive) in enumerate(zip(LEGS, drives, strict=True)):
        sides = [(high[:, leg], travel[1] - sliders[:, leg]), (-low[:, leg], sliders[:, leg] - travel[0])]
        needed, left = (np.concatenate(part) for part in zip(*sides, strict=True))
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(needed <= 0, 0.0, needed / np.maximum(left, 0.0))
        row = int(np.argmax(share))
        values = float(needed[row]), float(max(left[row], 0.0))
        which = f"stop {kind}"
        ratings.append((name, Rating(f"way of a {which}", *values, "m", float(np.tile(times, 2)[row]))))
        if isinstance(drive.transmission, Screw) and drive.transmission.static_limit < math.inf:
            row = int(np.argmax(nut[:, leg]))
            values = float(nut[row, leg]), drive.transmission.static_limit
            ratings.append((name, Rating(f"nut force of a {which}", *values, "N", float(times[row]))))
        if kind == "by the drives":
            with np.errstate(divide="ignore", invalid="ignore"):
                share = np.where(torque[:, leg] == 0, 0.0, torque[:, leg] / available[:, leg])
            row = int(np.argmax(share))
            values = float(torque[row, leg]), float(available[row, leg])
            ratings.append((name, Rating(f"torque of a {which}", *values, "N m", float(times[row]))))
        elif drive.motor.brake_energy < math.inf:
            row = int(np.argmax(energy[:, leg]))
            values = float(energy[row, leg]), drive.motor.brake_energy
            ratings.append((name, Rating("brake energy of a stop", *values, "J", float(times[row]))))
    rows = [part.argmax(axis=0) for part in (way, nut, energy)]
    row = int(platform.argmax())
    return StopLoads(
        kind=kind,
        way=way.max(axis=0),
        way_time=times[rows[0]],
        nut_force=nut.max(axis=0),
        nut_time=times[rows[1]],
        brake_energy=energy.max(axis=0),
        energy_time=times[rows[2]],
        platform_way=float(platform[row]),
        platform_time=float(times[row]),
        duration=float(lasted.max()),
        ratings=tuple(ratings),
    )


def stops_table(found: Sequence[StopLoads]) -> Table:
    """Return what the worst emergency stops take, by slider."""
    rows: dict[str, list[str]] = {}
    for one in found:
        rows[f"{one.kind}: way [mm]"] = [_shown(1e3 * value) for value in one.way]
        rows[f"{one.kind}: from t [s]"] = [number(value) for value in one.way_time]
        rows[f"{one.kind}: force at the nut [N]"] = [_shown(value) for value in one.nut_force]
        if one.brake_energy.any():
            rows[f"{one.kind}: energy of the brake [J]"] = [_shown(value) for value in one.brake_energy]
    told = [
        f"{one.kind}: P moves {number(1e3 * one.platform_way)} mm at most, in {number(one.duration)} s."
        if math.isfinite(one.platform_way + one.duration)
        else f"{one.kind}: no brake stops an axis within its travel (see brake_torque): it falls or runs on."
        for one in found
    ]
    return table_of("Emergency stops", ("worst", *LEGS), rows, " ".join(told))


def _shown(value: float) -> str:
    return number(value) if math.isfinite(value) else f"{NONE} (no end)"
