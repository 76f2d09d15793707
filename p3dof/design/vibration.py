"""Motions that leave no vibration: shaped laws, motor references of elastic drives, and what is left.

Shaping: N. C. Singer, W. P. Seering, "Preshaping command inputs to reduce system vibration", ASME J. Dyn.
Syst. Meas. Control 112 (1990) 76. The parameter of each way is shaped, not the pose, so that the path stays.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import (
    FloatArray,
    Progress,
    Readable,
    as_floats,
    not_negative,
    positive,
    require,
    shown,
)
from p3dof._base.errors import InputError, SampleError
from p3dof._base.tables import NONE, Numeral, Table, Tabular, columns_by, formatted, number
from p3dof._base.time_series.smoothing import breaks
from p3dof._base.time_series.times import sample_count
from p3dof.design.forces_of_tasks import TaskForces, machines_of
from p3dof.design.tasks import Piece, Plan
from p3dof.design.tasks.laws import Law
from p3dof.design.tasks.paths import LengthPath, SampledPath
from p3dof.design.tasks.plan import JUMP, Stretch, planned
from p3dof.machine.parameters import LEGS
from p3dof.manipulator import Manipulator

Kind = Literal["zv", "zvd"]
KINDS = {"zv": (1.0, 1.0), "zvd": (1.0, 2.0, 1.0)}
"""How many times each power of K an impulse has: a binomial."""

_PRECISE = {"rtol": 1e-10, "atol": 1e-13}
_NEWTON, _SETTLED = 50, 1e-13
_DEGREE = 5
_BEFORE = 4  # least number of samples from which a spline goes on to a jump


@dataclass(frozen=True, eq=False)
class Shaper(Readable):
    """Impulses that a law of motion is convolved with.

    Parameters
    ----------
    times : ndarray, shape (K,)
        When each comes [s]; the first at 0.
    shares : ndarray, shape (K,)
        How much of the motion each is; together 1.
    """

    times: FloatArray
    shares: FloatArray

    @property
    def duration(self) -> float:
        """By how much a motion takes longer [s]."""
        return float(self.times[-1])


def shaper(kind: Kind, frequency: ArrayLike, damping: float = 0.0) -> Shaper:
    """Return the impulses of a zero-vibration (ZV) or zero-vibration-and-derivative (ZVD) shaper.

    Parameters
    ----------
    kind : {"zv", "zvd"}
        Two impulses, or three: ZVD bears errors of the frequency.
    frequency : float or array-like, shape (M,)
        Undamped natural frequencies of modes [Hz]; their shapers are convolved.
    damping : float
        Damping ratio of the modes, below 1.

    Raises
    ------
    InputError
        If an argument does not fit.
    """
    if kind not in KINDS:
        raise InputError(f"kind: expected one of {', '.join(KINDS)}, got {shown(kind)}")
    ratio = _ratio(damping)
    modes = np.atleast_1d(np.asarray(frequency, dtype=object))
    if modes.ndim != 1 or not len(modes):
        raise InputError(f"frequency: expected a number or a row of them, got {shown(frequency)}")
    root = np.sqrt(1 - ratio**2)
    powers = np.arange(len(KINDS[kind]))
    shares = np.array(KINDS[kind]) * np.exp(-np.pi * ratio / root * powers)
    found = [
        Shaper(powers / (2 * positive("frequency", mode, InputError) * root), shares / shares.sum())
        for mode in modes.tolist()
    ]
    return reduce(_convolved, found)


def _convolved(one: Shaper, other: Shaper) -> Shaper:
    times = np.add.outer(one.times, other.times).ravel()
    order = np.argsort(times, kind="stable")
    return Shaper(times[order], np.multiply.outer(one.shares, other.shares).ravel()[order])


def _ratio(damping: float) -> float:
    ratio = not_negative("damping", damping, InputError)
    if ratio >= 1:
        raise InputError(f"damping: expected a damping ratio below 1, got {ratio:g}")
    return ratio


def residual_vibration(shaping: Shaper, frequency: float, damping: float = 0.0) -> float:
    """Return the vibration of a linear mode after any shaped motion, as a share of that after the plain one.

    Both at their own ends: V of Singer and Seering.

    Parameters
    ----------
    shaping : Shaper
        What the motion was shaped with.
    frequency : float
        Undamped natural frequency that the mode has in truth [Hz].
    damping : float
        Its damping ratio, below 1.

    Raises
    ------
    InputError
        If an argument does not fit.
    """
    require("shaping", shaping, Shaper)
    ratio = _ratio(damping)
    rate = 2 * np.pi * positive("frequency", frequency, InputError)
    turns = (1j * np.sqrt(1 - ratio**2) + ratio) * rate * (shaping.times - shaping.duration)
    return float(abs(shaping.shares @ np.exp(turns)))


class ShapedLaw:
    """A law of motion convolved with impulses."""

    def __init__(self, law: Law, shaping: Shaper) -> None:
        self._law, self._shaping = law, shaping
        self.duration = law.duration + shaping.duration
        self._end = float(law.at(np.array([law.duration]))[0][0])
        ends = np.union1d(law.kinks, [0.0, law.duration])
        self.kinks: FloatArray = np.unique(np.add.outer(shaping.times, ends))
        self.jumps: FloatArray = np.unique(np.add.outer(shaping.times, law.jumps))

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the parameter and its first two derivatives by time, at times (N,) [s]."""
        total = np.zeros((3, len(time)))
        period, last = self._law.duration, time >= self.duration
        for start, share in zip(self._shaping.times, self._shaping.shares, strict=True):
            own = time - start
            moves = (own >= 0) & (own < period)
            if start == self._shaping.duration:
                moves |= last
            total[0, (own >= period) & ~moves] += share * self._end
            total[:, moves] += share * np.array(self._law.at(np.minimum(own[moves], period)))
        return total[0], total[1], total[2]

    def when(self, parameter: FloatArray) -> FloatArray:
        """Return when parameters (K,) are reached [s]."""
        from scipy.optimize import brentq

        def ahead(time: float, place: float) -> float:
            return float(self.at(np.array([time]))[0][0]) - place

        inside = (parameter > 0) & (parameter < self._end * (1 - 1e-15))
        found = np.where(parameter > 0, self.duration, 0.0)
        for k in np.flatnonzero(inside):
            found[k] = brentq(ahead, 0.0, self.duration, args=(parameter[k],), xtol=1e-15)
        return found


def shaped(plan: Plan, shapers: Shaper | Sequence[Shaper], samples: int = 1001) -> Plan:
    """Return a plan on the same path, each way of which is shaped, and takes so much longer.

    Parameters
    ----------
    plan : Plan
        Of `Task.plan` or `fastest_plan`. The shaped one may exceed limits that a time-optimal one keeps.
    shapers : Shaper or sequence of Shaper
        For all ways from stop to stop, or one for each.
    samples : int
        As of `Task.plan`.

    Raises
    ------
    InputError
        If an argument does not fit.
    """
    require("plan", plan, Plan)
    source = plan.source
    if source is None:
        raise InputError("plan: expected what Task.plan or fastest_plan returns")
    ways = source.stretches
    each = [shapers] * len(ways) if isinstance(shapers, Shaper) else list(shapers)
    if len(each) != len(ways) or not all(isinstance(one, Shaper) for one in each):
        raise InputError(f"shapers: expected one, or one for each of {len(ways)} ways, got {shown(shapers)}")
    along = [_by_length(way) for way in ways]
    own = [replace(way, law=ShapedLaw(way.law, one)) for way, one in zip(along, each, strict=True)]
    count = sample_count(samples, least=2)
    return planned(source.waypoints, plan.waypoints, source.carrying, own, count, plan.name)


class _LengthLaw:
    """A law along a path by its length, of one by its parameter."""

    def __init__(self, law: Law, path: LengthPath) -> None:
        self._law, self._path = law, path
        self.duration, self.kinks, self.jumps = law.duration, law.kinks, law.jumps

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the length and its first two derivatives by time, at times (N,) [s]."""
        place, speed, change = self._law.at(time)
        length, rate, bend = self._path.lengths(place)
        return length, rate * speed, bend * speed**2 + rate * change

    def when(self, parameter: FloatArray) -> FloatArray:
        """Return when lengths (K,), those of the ends, are reached [s]."""
        return np.where(parameter > 0, self.duration, 0.0)


def _by_length(way: Stretch) -> Stretch:
    """Return a way by its length: impulses of the time of a motion would not add up to rest."""
    if not isinstance(way.path, SampledPath):
        return way
    path = LengthPath(way.path)
    return replace(way, path=path, law=_LengthLaw(way.law, path))


def shapers_of(
    robot: Manipulator, plan: Plan, drive_stiffness: ArrayLike, kind: Kind = "zvd"
) -> tuple[Shaper, ...]:
    """Return a shaper for each way of a plan, by the natural frequencies of the machine on elastic drives.

    For two modes, convolved: the lowest, and the mean of the two others; of each the mean over the way, with
    what the platform carries.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    plan : Plan
        Of `Task.plan` or `fastest_plan`.
    drive_stiffness : float or array-like, shape (3,)
        Of each drive, from the motor to the slider [N/m].
    kind : {"zv", "zvd"}
        As of `shaper`.

    Raises
    ------
    InputError
        If an argument does not fit, or the machine is not stable on such drives.
    """
    modes = modes_of(robot, plan, drive_stiffness)
    return tuple(shaper(kind, frequencies) for frequencies in _shaped_at(modes).tolist())


def modes_of(robot: Manipulator, plan: Plan, drive_stiffness: ArrayLike) -> FloatArray:
    """Return natural frequencies of the machine on elastic drives, their mean over each way, (W, 3) [Hz]."""
    require("plan", plan, Plan)
    k = _stiffness(drive_stiffness)
    machines, found = machines_of(robot, plan), []
    for way in _ways(plan):
        poses = np.concatenate([piece.motion.pose for piece in plan.pieces[way]])
        own = _on_springs(machines[way.start])
        found.append(own.indices(poses, drive_stiffness=k, rods=None).frequency.mean(axis=0))
        if not np.isfinite(found[-1]).all():
            raise InputError("drive_stiffness: expected drives on which the machine is stable")
    return np.array(found)


def _shaped_at(modes: FloatArray) -> FloatArray:
    """Return the frequencies of shapers for modes (W, 3), (W, 2): the lowest, the mean of the others [Hz]."""
    return np.column_stack([modes[:, 0], modes[:, 1:].mean(axis=1)])


@dataclass(frozen=True, eq=False)
class MotorReferences(Tabular):
    """Where the motors of elastic drives have to be, so that the platform follows a plan.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Of the samples, as those of `TaskForces` [s].
    positions : ndarray, shape (N, 3)
        Of the motors of A, B, C, as positions of sliders [m].
    velocities : ndarray, shape (N, 3)
        [m/s].
    """

    time: FloatArray
    positions: FloatArray
    velocities: FloatArray

    def to_columns(self) -> dict[str, FloatArray]:
        """Return times, positions and velocities, (N,) each, by name and unit."""
        places = columns_by("motor {} [m]", LEGS, self.positions)
        return {"t [s]": self.time} | places | columns_by("rate {} [m/s]", LEGS, self.velocities)


def motor_references(found: TaskForces, drive_stiffness: ArrayLike) -> MotorReferences:
    """Return motor references by elastic inverse dynamics: the slider's position, and force by stiffness.

    The force is that between nut and slider. Where it jumps, such as where a payload is picked up or an
    acceleration changes at once, the reference does, too.

    Parameters
    ----------
    found : TaskForces
        Of `forces_of_task`.
    drive_stiffness : float or array-like, shape (3,)
        Of each drive, from the motor to the slider [N/m]; infinite for rigid drives.

    Raises
    ------
    InputError
        If an argument does not fit, or the machine cannot be at every sample of the task.
    """
    require("found", found, TaskForces)
    k = _stiffness(drive_stiffness, rigid=True)
    if not found.possible:
        raise InputError("found: expected forces at every sample of the task")
    curves = _references(found, k)
    positions = [result.sliders + result.nut_forces / k for result in found.results]
    velocities = [curve.rates(result.time) for curve, result in zip(curves, found.results, strict=True)]
    return MotorReferences(found.time, np.concatenate(positions), np.concatenate(velocities))


def residual_energies(
    robot: Manipulator,
    found: TaskForces,
    drive_stiffness: ArrayLike,
    assumed: ArrayLike | None = None,
    progress: Progress | None = None,
) -> FloatArray:
    """Return the energy of the vibration that is left at the end of each way [J]; ndarray, shape (W,).

    The whole nonlinear machine hangs on a spring between each motor and slider, begins at rest, and is
    integrated in time by `scipy.integrate.solve_ivp` (DOP853) while the motors follow their references,
    jumps included; at rest they hold the machine. The energy is kinetic and potential, to second order about
    where the machine comes to rest. With the true stiffness assumed it is that of the splines between the
    samples, which begin anew wherever a force may bend: next to nothing unless the acceleration jumps.

    Parameters
    ----------
    robot : Manipulator
        The machine; inertias of motors and screws are on the other side of the springs.
    found : TaskForces
        Of `forces_of_task`.
    drive_stiffness : float or array-like, shape (3,)
        Of each drive in truth [N/m].
    assumed : float or array-like, shape (3,), optional
        With which the `motor_references` are made; those of rigid drives without it [N/m].
    progress : callable, optional
        Called with (done, total) ways.

    Raises
    ------
    InputError
        If an argument does not fit.
    SampleError
        If the machine leaves what it can reach.
    """
    require("found", found, TaskForces)
    k = _stiffness(drive_stiffness)
    if not found.possible:
        raise InputError("found: expected forces at every sample of the task")
    believed = _stiffness(np.inf if assumed is None else assumed, rigid=True)
    curves = _references(found, believed)
    machines = [_on_springs(machine) for machine in machines_of(robot, found.plan)]
    ways, energies = _ways(found.plan), []
    for done, way in enumerate(ways, 1):
        parts = [
            _ElasticPiece(machine, piece, k, believed)
            for machine, piece in zip(machines[way], found.plan.pieces[way], strict=True)
        ]
        state = np.append(parts[0].rest(0), np.zeros(3))
        for part, curve in zip(parts, curves[way], strict=True):
            state = part.after(state, curve)
        energies.append(parts[-1].energy(state))
        if progress is not None:
            progress(done, len(ways))
    return np.array(energies)


@dataclass(frozen=True)
class Swing:
    """The vibration that a motion leaves at the worst of its stops."""

    motion: str  # "plain", or its shape
    motors: str  # what they follow
    stiffness: str  # of the drives in truth
    duration: float  # of the motion [s]
    energy: float  # that is left [J]
    stop: str  # where


_ERROR = 0.2  # of the stiffness


def swings_of(
    robot: Manipulator,
    plain: TaskForces,
    found: TaskForces,
    drive_stiffness: ArrayLike,
    shape: Kind | None = None,
    progress: Progress | None = None,
) -> tuple[Swing, ...]:
    """Return what motions leave: the plain one, a shaped one, and that with motor references, k wrong too."""
    k = _stiffness(drive_stiffness)
    name = "plain" if shape is None else shape.upper()
    cases: list[tuple[str, TaskForces, float, FloatArray | None]] = [("plain", plain, 1.0, None)]
    cases += [] if shape is None else [(name, found, 1.0, None)]
    cases += [(name, found, true, k) for true in (1.0, 1 - _ERROR, 1 + _ERROR)]
    words = {1.0: "as given", 1 - _ERROR: f"{_ERROR:.0%} less", 1 + _ERROR: f"{_ERROR:.0%} more"}
    swings = []
    for done, (motion, forces, true, assumed) in enumerate(cases, 1):
        left = residual_energies(robot, forces, true * k, assumed)
        worst = int(left.argmax())
        stop = forces.plan.pieces[_ways(forces.plan)[worst].stop - 1].last
        motors = "sliders" if assumed is None else "references"
        swings.append(Swing(motion, motors, words[true], forces.plan.duration, float(left[worst]), stop))
        if progress is not None:
            progress(done, len(cases))
    return tuple(swings)


def swings_table(swings: Sequence[Swing], plan: Plan) -> Table:
    """Return the vibration that motions leave, the first one's being the whole."""
    header = ("motion", "motors follow", "stiffness", "duration [s]", "energy left [J]", "swing", "at")
    rows = []
    for one in swings:
        share = math.sqrt(one.energy / swings[0].energy) if swings[0].energy else math.nan
        energy = Numeral(f"{one.energy:.3g}" if one.energy >= _LEAST else f"< {_LEAST:g}", one.energy)
        swing = Numeral(f"< {_SEEN:.1%}", share) if share < _SEEN else formatted(share, ".1%")
        rows.append((one.motion, one.motors, one.stiffness, number(one.duration), energy, swing, one.stop))
    note = "Swing: by the amplitude of the first row, the root of the energies; at the worst stop."
    if plan.source is not None and len(plan.source.bends()[0]):
        note += " Motor references jump where accelerations do, as no drive can: limit the jerk."
    return Table("Vibration left at the stops", header, tuple(rows), note)


_SEEN, _LEAST = 0.001, 1e-12  # share of a swing, and its energy [J], below which it is none


def modes_table(robot: Manipulator, plain: Plan, plan: Plan, drive_stiffness: ArrayLike) -> Table:
    """Return the natural frequencies of each way, at which a shaped plan was shaped, and the durations."""
    modes = modes_of(robot, plain, drive_stiffness)
    rows = []
    for own, used, one, other in zip(modes, _shaped_at(modes), _ways(plain), _ways(plan), strict=True):
        former, latter = plain.pieces[one], plan.pieces[other]
        before, after = (
            float(each[-1].motion.time[-1] - each[0].motion.time[0]) for each in (former, latter)
        )
        new = (NONE, NONE) if plan is plain else (", ".join(f"{f:.4g}" for f in used), number(after))
        frequencies = (formatted(frequency, ".4g") for frequency in own)
        rows.append((f"{former[0].first} → {former[-1].last}", *frequencies, number(before), *new))
    header = ("way", *(f"mode {k} [Hz]" for k in (1, 2, 3)), "duration [s]", "shaped at [Hz]", "takes [s]")
    return Table("Natural frequencies on elastic drives", header, tuple(rows))


class _ElasticPiece:
    """A piece of a plan, done by the machine on springs."""

    def __init__(self, machine: Manipulator, piece: Piece, k: FloatArray, believed: FloatArray) -> None:
        self._machine, self._piece, self._wrench = machine, piece, piece.wrench
        self._k, self._believed = k, believed

    def after(self, state: FloatArray, motors: _Reference) -> FloatArray:
        """Return pose and velocity at the end of the piece."""
        from scipy.integrate import solve_ivp

        def rate(time: float, now: FloatArray, spline: Any) -> FloatArray:
            pose, velocity = now[:3], now[3:]
            forces = self._k * (spline(time) - self._machine.sliders(pose))
            change = self._machine.forward_dynamics(
                pose, velocity, forces, wrench=self._wrench, method="compiled"
            )
            return np.append(velocity, change)

        for ends, spline in zip(pairwise(motors.ends), motors.splines, strict=True):
            run = solve_ivp(rate, ends, state, method="DOP853", args=(spline,), **_PRECISE)
            state = np.asarray(run.y[:, -1])
        return state

    def rest(self, end: int) -> FloatArray:
        """Return where the machine is at rest while its motors hold it at the beginning (0) or end (-1)."""
        none = np.zeros(3)
        pose: FloatArray = self._piece.motion.pose[end]
        held = self._machine.forces(pose, none, none, wrench=self._wrench, method="compiled")
        if np.abs(held / self._k).max() > self._machine.parameters.geometry.L:
            raise InputError(f"drive_stiffness: expected drives that hold the machine, got {self._k} N/m")
        motors = self._machine.sliders(pose) + held / self._believed
        for _ in range(_NEWTON):
            found = self._machine.force_derivatives(pose, none, none, wrench=self._wrench)
            error = found.forces - self._k * (motors - self._machine.sliders(pose))
            move = np.linalg.solve(self._slope(pose), error)
            pose = pose - move
            if np.abs(move).max() < _SETTLED:
                return pose
        raise SampleError("the machine on elastic drives has no place of rest near the plan")

    def energy(self, state: FloatArray) -> float:
        """Return the energy above that at rest [J]."""
        pose, velocity = state[:3], state[3:]
        rest = self.rest(-1)
        off = pose - rest
        stiffness = self._machine.jacobian(rest, method="compiled").T @ self._slope(rest)
        mass = self._machine.mass_matrix(rest, method="compiled")
        return float(off @ stiffness @ off + velocity @ mass @ velocity) / 2

    def _slope(self, pose: FloatArray) -> FloatArray:
        """Return the derivative of holding forces less those of the springs by the pose, (3, 3)."""
        none = np.zeros(3)
        holding = self._machine.force_derivatives(pose, none, none, wrench=self._wrench)
        return holding.by_pose + self._k[:, None] * self._machine.jacobian(pose, method="compiled")


@dataclass(frozen=True, eq=False)
class _Reference:
    """Where the motors have to be over a piece: splines that meet where a force or its rate may jump."""

    ends: FloatArray  # (S + 1,): when each begins, and the last ends [s]
    splines: list[Any]

    def rates(self, time: FloatArray) -> FloatArray:
        """Return velocities at times (N,), of what begins where two splines meet; ndarray, (N, 3) [m/s]."""
        part = np.clip(np.searchsorted(self.ends, time, "right") - 1, 0, len(self.splines) - 1)
        found = np.empty((len(time), len(LEGS)))
        for one in np.unique(part):
            found[part == one] = self.splines[one](time[part == one], 1)
        return found


def _references(found: TaskForces, k: FloatArray) -> list[_Reference]:
    """Return where the motors have to be over each piece, by the samples.

    Across a bend a spline would be wrong by the cube of the distance of samples, so none goes across. Where
    the acceleration jumps, a sample has what begins there: the spline before goes on to it from the others.
    After a dwell, it is the sample that has what ended, and the spline after it goes back to it.
    """
    from scipy.interpolate import make_interp_spline

    jumps, bends = (np.zeros(0),) * 2 if found.plan.source is None else found.plan.source.bends()
    references = []
    for one in found.results:
        time, where = one.time, one.sliders + one.nut_forces / k
        ends = np.union1d([0, len(time) - 1], _rows(time, bends))
        sudden, short, splines = _rows(time, jumps), breaks(time), []
        for first, last in pairwise(ends.tolist()):
            alone = short[last - 1] or (last in sudden and last - first > _BEFORE)
            rows = slice(first + int(short[first]), last if alone else last + 1)
            degree = min(_DEGREE, rows.stop - rows.start - 1)
            splines.append(make_interp_spline(time[rows], where[rows], degree))
        references.append(_Reference(time[ends], splines))
    return references


def _rows(time: FloatArray, instants: FloatArray) -> NDArray[np.intp]:
    """Return which of the samples at times (N,) are those at instants (K,) that they comprise."""
    close = JUMP * (time[-1] - time[0])
    within = instants[(instants > time[0] - close) & (instants < time[-1] + close)]
    return np.asarray(np.searchsorted((time[1:] + time[:-1]) / 2, within))


def _ways(plan: Plan) -> list[slice]:
    """Return which pieces each way from stop to stop has."""
    moving = [k for k, piece in enumerate(plan.pieces) if not piece.dwells]
    ends = [k + 1 for k in moving if not plan.pieces[k].motion.velocity[-1].any()]
    starts = [moving[0]] + [next(k for k in moving if k >= end) for end in ends[:-1]]
    return [slice(start, end) for start, end in zip(starts, ends, strict=True)]


def _on_springs(robot: Manipulator) -> Manipulator:
    """Return the machine that the springs move: without the inertia of motors and screws."""
    parameters = robot.parameters
    return Manipulator(replace(parameters, actuators=replace(parameters.actuators, armature={})))


def _stiffness(value: ArrayLike, rigid: bool = False) -> FloatArray:
    """Return the stiffness of three drives; infinite ones where rigid drives make sense."""
    rows = as_floats("drive_stiffness", value)
    if rows.shape not in ((), (3,)) or not (rows > 0).all():
        raise InputError(f"drive_stiffness: expected a positive number, or three, got {shown(value)}")
    if not rigid and not np.isfinite(rows).all():
        raise InputError(f"drive_stiffness: expected a finite stiffness, got {shown(value)}")
    return np.broadcast_to(rows, (3,))
