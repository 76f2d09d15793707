"""What designs are measured by, by name.

Over the motion: forces, powers, what is left to limits. Over a box of poses, in closed forms: reach,
singularity, height, transmission, stiffness. Of legs and rods by the forces in them over the motion: buckling
and stress. These forces are the reactions with elastic joints and rods (`p3dof.analysis.reactions`): the two
rods of the parallelogram bear different ones, which no model of rigid bodies tells. They are found machine by
machine.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from p3dof._base.algebra import Namespace
from p3dof._base.checks import FloatArray, meant, shown
from p3dof._base.errors import InputError, P3dofError, TaskError
from p3dof._base.time_series.wrenches import WRENCH_ROWS
from p3dof.analysis.designs.columns import OFFSETS
from p3dof.analysis.designs.figures import outputs
from p3dof.analysis.reactions import Reactions
from p3dof.analysis.reactions.stiffness import RodSection, Stiffness
from p3dof.analysis.workspace.closed_forms import Sizes, drops, extents
from p3dof.analysis.workspace.margins import box_margins
from p3dof.closed_form.compiled import reduced
from p3dof.closed_form.compiled.formulas import MODEL
from p3dof.design.bearings.evaluation import RodCheck, rod_check
from p3dof.design.clearance import CollisionModel
from p3dof.design.optimisation.population import (
    STEP,
    Box,
    ClosedForm,
    Measure,
    Numbers,
    OfDesigns,
    Pieces,
    Population,
    Setting,
    worst_of,
)
from p3dof.design.optimisation.task_measures import OF_TASKS, duties_of
from p3dof.design.tasks.fastest import fastest_law
from p3dof.design.tasks.limits import AxisLimits, Demand
from p3dof.loops import ClosedLoopModel
from p3dof.machine import description
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import Parameters
from p3dof.methods.pinocchio import armature_of

_BLOCK = 64  # designs whose forces at all samples are in the memory at a time


@dataclass(frozen=True)
class OfFigure(OfDesigns):
    """A measure that is a figure of `DesignForces`, with the compiled gradient."""

    figure: str  # the field of `DesignForces`
    total: bool = False  # the sum over the actuators, instead of the worst of them

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,)."""
        return worst_of(self.each(population), self.better)

    def each(self, population: Population) -> FloatArray:
        """Return its pieces, (D, P)."""
        return self._together(getattr(population.forces, self.figure))

    def pieces(self, population: Population) -> Pieces:
        """Return its pieces and their gradients."""
        slopes = population.slopes
        found = self._together(getattr(slopes, self.figure))
        by = {
            name: self._together(slopes.gradients[name][self.figure])
            for name in population.columns
            if name in population.setting.of_machine
        }
        moved = [by.get(name, np.zeros_like(found)) for name in population.setting.names]
        return Pieces(found, np.stack(moved, axis=-1))

    def _together(self, values: FloatArray) -> FloatArray:
        columns = values.reshape(len(values), -1)
        return columns.sum(axis=1, keepdims=True) if self.total else columns


class PeakForce(OfDesigns):
    """Largest magnitude of any actuator's force over the motion; its pieces are all forces at all samples."""

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,)."""
        return np.asarray(population.forces.peak_force.max(axis=1))

    def pieces(self, population: Population) -> Pieces:
        """Return its pieces and their gradients."""
        found = joined(population.sampled.found.forces)

        def gradients() -> FloatArray:
            names = population.setting.names
            moved = [joined(population.rates(name).forces, found.shape) for name in names]
            return np.asarray(np.sign(found)[..., None] * np.stack(moved, axis=-1))

        return Pieces(np.abs(found), gradients)


class PeakPower(OfDesigns):
    """Largest power that an actuator gives over the motion; its pieces are all powers at all samples."""

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,)."""
        assert population.forces.peak_power is not None  # noqa: S101 - it is asked for
        return np.asarray(population.forces.peak_power.max(axis=1))

    def pieces(self, population: Population) -> Pieces:
        """Return its pieces and their gradients."""
        return Pieces(powers(population), lambda: power_rates(population))


class RmsPower(OfDesigns):
    """Root mean square over the motion of the sum of the magnitudes of the actuators' powers."""

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,)."""
        found = np.empty(len(population))
        for start in range(0, len(found), _BLOCK):
            rows = slice(start, start + _BLOCK)
            part = Population(population.setting, population.values[rows])
            with np.errstate(all="ignore"):
                total = np.abs(np.stack(part.sampled.powers, axis=1)).sum(axis=1)  # (D, N)
                found[rows] = np.sqrt(total**2 @ part.setting.samples.mean)
        return found

    def pieces(self, population: Population) -> Pieces:
        """Return its one piece and its gradient."""
        mean = population.setting.samples.mean
        shape = len(population), 3, len(mean)
        power = powers(population)
        size = np.abs(power).reshape(shape).sum(axis=1)
        value = np.sqrt(size**2 @ mean)

        def gradient() -> FloatArray:
            slopes = np.sign(power)[..., None] * power_rates(population)
            slopes = slopes.reshape(*shape, -1).sum(axis=1)  # (D, N, n)
            found = np.einsum("dt,t,dtn->dn", size, mean, slopes) / value[:, None]
            return np.asarray(found[:, None])

        return Pieces(value[:, None], gradient)


class LeftToLimits(OfDesigns):
    """What is left to the nearest limit of the machine over the motion; negative beyond it."""

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,)."""
        figure = {"stroke_margin": "travel_margin"}.get(self.name, self.name)
        return np.asarray(getattr(population.forces, figure))

    def pieces(self, population: Population) -> Pieces:
        """Return its pieces and their gradients."""
        limits, names = population.setting.machine.limits, population.setting.names
        found = population.sampled.found
        group = {"stroke_margin": "sliders", "speed_margin": "speeds"}.get(self.name, "forces")
        values = joined(getattr(found, group))

        def moved() -> FloatArray:
            return np.stack(
                [joined(getattr(population.rates(name), group), values.shape) for name in names], axis=-1
            )

        if self.name == "stroke_margin":
            low, high = limits.travel
            both = np.concatenate([values - low, high - values], axis=1)
            return Pieces(both, lambda: np.concatenate([moved(), -moved()], axis=1))
        most = limits.force if group == "forces" else limits.speed
        return Pieces(most - np.abs(values), lambda: np.asarray(-np.sign(values)[..., None] * moved()))


def joined(of_actuators: Any, shape: tuple[int, ...] | None = None) -> FloatArray:
    """Return three arrays (D, N) beside each other, (D, 3 N)."""
    if shape is not None:
        of_actuators = [np.broadcast_to(values, (shape[0], shape[1] // 3)) for values in of_actuators]
    return np.concatenate(list(of_actuators), axis=1)


def powers(population: Population) -> FloatArray:
    """Return the powers of A, B, C at all samples (D, 3 N) [W]."""
    found = population.sampled.found
    return joined(found.forces) * joined(found.speeds)


def power_rates(population: Population) -> FloatArray:
    """Return the derivatives of the powers by the variables (D, 3 N, n)."""
    found, moved = population.sampled.found, []
    forces, speeds = joined(found.forces), joined(found.speeds)
    for name in population.setting.names:
        rates = population.rates(name)
        moved.append(
            joined(rates.forces, forces.shape) * speeds + forces * joined(rates.speeds, forces.shape)
        )
    return np.stack(moved, axis=-1)


OF_MOTION = (
    PeakForce(
        "peak_force", "N", "small", "largest magnitude of an actuator's force over the motion", over="worst"
    ),
    OfFigure(
        "rms_force", "N", "small", "largest root mean square of an actuator's force", "rms_force", over="rms"
    ),
    PeakPower(
        "peak_power",
        "W",
        "small",
        "largest power that one actuator gives over the motion",
        figures=("power",),
        over="worst",
    ),
    RmsPower(
        "rms_power",
        "W",
        "small",
        "root mean square over time of the sum of |power| of the actuators",
        over="rms",
    ),
    OfFigure(
        *("energy", "J", "small", "work that the actuators give over the motion", "positive_work", True),
        figures=("power",),
        over="sum",
    ),
    OfFigure(
        *("peak_speed", "m/s", "small", "largest speed of a slider over the motion", "peak_speed"),
        figures=("sliders",),
        over="worst",
    ),
    OfFigure(
        *("motion_singularity", "rad", "large", "least angle from det J = 0 over the motion", "actuation"),
        figures=("singularity",),
        over="worst",
    ),
    *(
        LeftToLimits(
            name, unit, "large", f"margin of {limit} over the motion", figures=("sliders",), over="worst"
        )
        for name, unit, limit in (
            ("stroke_margin", "m", "the sliders' travel"),
            ("speed_margin", "m/s", "the sliders' speed"),
            ("force_margin", "N", "the actuator force"),
        )
    ),
)
"""Measures over the motion."""


NODES = 400
_STEP_OF_TIMES = (
    2e-3  # of differences, as a share of the range of a variable: times are known to some 1e-6 of them
)
_SLOW = 1e-3  # least speed along the motion by the largest: where it stands, its time is no parameter


@dataclass(frozen=True)
class FastestTime(OfDesigns):
    """Least time for the path of the motion within force and speed of the machine's limits, rest to rest.

    The law along the path is that of `p3dof.design.tasks.fastest`; gradients are central differences, the
    only ones here that are not exact. One design takes some tenths of a second, over a task a second or two.
    """

    slow: bool = True
    rough: bool = True

    def of_task(self, population: Population, index: int, duty: int) -> dict[str, float]:
        """Return it of one design over a task, along the task's own path."""
        return {"": duties_of(population, self.name).fastest(population, index, duty)}

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,)."""
        feasible = population.feasible
        found = np.full(len(population), np.nan)
        for index in np.flatnonzero(feasible):
            found[index] = _time(population, int(index))
        return found

    def pieces(self, population: Population) -> Pieces:
        """Return its one piece and its gradient."""
        return Pieces(self.values(population)[:, None], lambda: self._differences(population))

    def _differences(self, population: Population) -> FloatArray:
        setting, values = population.setting, population.values
        slopes = []
        for index in range(values.shape[1]):
            step = np.zeros(values.shape[1])
            step[index] = _STEP_OF_TIMES * max(abs(float(values[:, index].mean())), 1e-3)
            ahead, behind = (self.values(Population(setting, values + sign * step)) for sign in (1.0, -1.0))
            slopes.append((ahead - behind) / (2 * step[index]))
        return np.stack(slopes, axis=-1)[:, None]


FASTEST = FastestTime(
    *("fastest_time", "s", "small"),
    "least time for the path of the motion within the machine's force and speed, from rest to rest",
    over="task",
)


def _time(population: Population, index: int) -> float:
    limits = population.setting.machine.limits
    way = _Way(population, index)
    motion = population.setting.motion
    end = float(motion.time[-1] - motion.time[0])
    try:
        law = fastest_law(end * _graded(NODES), way, AxisLimits(limits.force, limits.speed))
    except TaskError:
        return float("nan")
    return float(law.duration)


def _graded(count: int) -> FloatArray:
    """Return shares from 0 to 1 that are closer together at both ends, (count + 1,)."""
    even = np.linspace(0.0, 1.0, count + 1)
    return np.asarray(even**2 * (3 - 2 * even))


class _Way:
    """What the path of a motion takes of the actuators of one design; its parameter is the motion's time."""

    def __init__(self, population: Population, index: int) -> None:
        self._setting: Setting = population.setting
        _require_moving(self._setting)
        numbers = population.numbers.folded.numbers
        self._numbers = [n[index] if isinstance(n, np.ndarray) and n.ndim else n for n in numbers]
        offset = [
            population.columns.get(f"offset.{axis}", np.zeros(len(population)))
            for axis in ("y", "z", "theta")
        ]
        self._offset = np.array([column[index] for column in offset])

    @property
    def lossy(self) -> bool:
        """Whether there is friction."""
        return len(self._numbers) > len(MODEL)

    def demand(self, place: FloatArray, middle: FloatArray) -> Demand:  # noqa: ARG002 - the path has no corners
        """Return what is needed at parameters (P,)."""
        pose, slope, bend, load = self._at(place)
        none, bare = np.zeros_like(pose), self._numbers[: len(MODEL)]
        rest = _forces(bare, pose, none, none, load)[0]
        mass = _forces(bare, pose, none, slope, load)[0] - rest
        moving, rate = _forces(bare, pose, slope, bend, load)
        unused = np.zeros_like(rate)
        return Demand(mass, moving - rest, rest, rate, unused, unused * np.nan, np.zeros(3), unused)

    def friction(self, place: FloatArray, speed: FloatArray) -> FloatArray:
        """Return what friction adds to the forces, (P, 3) [N], at parameters and speeds ṡ (P,)."""
        pose, slope, _, load = self._at(place)
        velocity, none = slope * speed[:, None], np.zeros_like(pose)
        bare = self._numbers[: len(MODEL)]
        with_, without = (_forces(n, pose, velocity, none, load)[0] for n in (self._numbers, bare))
        return with_ - without

    def _at(self, place: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return pose, its first two derivatives and the load at parameters."""
        motion = self._setting.motion
        time, back = np.unique(
            np.clip(place + motion.time[0], motion.time[0], motion.time[-1]), return_inverse=True
        )
        there = motion.resampled(time)
        load = np.zeros((len(time), 3))
        if self._setting.wrench is not None:
            columns = np.asarray(self._setting.wrench)[:, list(WRENCH_ROWS)].T
            load = np.stack([np.interp(time, motion.time, column) for column in columns], axis=1)
        return (
            there.pose[back] + self._offset, there.velocity[back], there.acceleration[back], load[back]
        )  # fmt: skip


def _forces(
    numbers: list[Any], pose: FloatArray, velocity: FloatArray, acceleration: FloatArray, load: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the forces of A, B, C and the sliders' speeds, (P, 3) each."""
    inputs = [*pose.T, *velocity.T, *acceleration.T, *load.T]
    with np.errstate(all="ignore"):
        found = outputs(numbers, inputs)
    shape = (len(pose),)
    forces, speeds = (
        np.stack([np.broadcast_to(column, shape) for column in group], axis=1)
        for group in (found.forces, found.speeds)
    )
    return forces, speeds


def _require_moving(setting: Setting) -> None:
    scale = np.array([1.0, 1.0, setting.machine.geometry.r])
    speed = np.linalg.norm(setting.motion.velocity * scale, axis=1)
    if speed.min() < _SLOW * speed.max():
        at = float(setting.motion.time[int(speed.argmin())])
        raise InputError(
            f"fastest_time: expected a motion that never stands still, for its path; it does at {at:g} s"
        )


class Legs(NamedTuple):
    """The legs at poses, (D, G) each."""

    wa: Any  # horizontal extents; that of C in the plane x, z [m]
    wb: Any
    wc: Any
    Sa: Any  # drops [m]
    Sb: Any
    Sc: Any


def sizes_of(n: Numbers) -> Sizes:
    """Return the lengths that the workspace depends on, (D, 1) each."""
    return Sizes(*np.broadcast_arrays(n.r, n.R, n.L))


def legs(n: Numbers, y: Any, theta: Any) -> Legs:
    """Return the legs at poses (G,); NaN out of reach."""
    sizes = sizes_of(n)
    return Legs(*extents(sizes, y, theta), *drops(sizes, y, theta))


def box_of(population: Population) -> Box:
    """Return the box of a problem."""
    if population.setting.box is None:
        raise InputError("box: measures over poses need a box of them: box=Box(y=..., theta=...)")
    return population.setting.box


def _margin(n: Numbers, population: Population, name: str) -> Any:
    """Return an exact margin of the whole box; see `p3dof.analysis.workspace.margins.BoxMargins`."""
    box, (lowest, highest) = box_of(population), population.setting.machine.limits.travel
    return getattr(box_margins(sizes_of(n), box.y, box.theta, highest - lowest), name)


def _transmission(n: Numbers, population: Population) -> Any:
    """Input indices S/L; output indices: sin of the angle between rods A and B, and that of C."""
    y, theta = box_of(population).poses
    x = legs(n, y, theta)
    between = (x.wa * x.Sb + x.wb * x.Sa) / n.L**2
    of_c = (np.cos(theta) * x.Sc - np.sin(theta) * x.wc) / n.L
    inputs = (x.Sa / n.L, x.Sb / n.L, x.Sc / n.L)
    return np.concatenate(np.broadcast_arrays(*inputs, between, of_c), axis=1)


def _rows(n: Numbers, y: Any, theta: Any) -> tuple[tuple[Any, ...], ...]:
    """Return the rows of J = ∂(λA, λB, λC)/∂(y, z, θ); see eq. of `reduced.slider_rates`."""
    x = legs(n, y, theta)
    arm = n.r * (np.cos(theta) - np.sin(theta) * x.wc / x.Sc)
    one = np.ones_like(x.Sa)
    none = np.zeros_like(x.Sa)
    return (-x.wa / x.Sa, one, none), (x.wb / x.Sb, one, none), (-y / x.Sc, one, arm)


def _inverse_rows(n: Numbers, population: Population) -> tuple[Any, ...]:
    """Return the rows of J⁻¹, solved by hand: A and B move y and z, C turns."""
    (ta, _, _), (tb, _, _), (tc, _, arm) = _rows(n, *box_of(population).poses)
    span = tb - ta
    by_y = (-1 / span, 1 / span, 0 * span)
    by_z = (tb / span, -ta / span, 0 * span)
    by_theta = tuple(((j == 2) - by_z[j] - tc * by_y[j]) / arm for j in range(3))
    return by_y, by_z, by_theta


def _accuracy(n: Numbers, population: Population, row: int) -> Any:
    """Return the sum of magnitudes of a row of J⁻¹: the worst that errors of all sliders make together."""
    total: Any = 0
    for entry in _inverse_rows(n, population)[row]:
        total = total + entry * np.sign(np.real(entry))
    return total


def _frequencies(n: Numbers, population: Population) -> Any:
    """Lowest natural frequency at the middle and the corners of the box.

    M of the dynamics; K = Jᵀ diag(k) J with the drive and the rods in series. A complex step moves the
    eigenvalue ω² as its eigenvector v says: v·(dK - ω² dM) v by v·M v.
    """
    y, theta = box_of(population).corners
    setting, model = population.setting, n.model
    x = reduced.shape(model, y, theta, _ARRAYS)
    M = _matrix(reduced.mass_matrix(model, x, y, _ARRAYS))
    area = np.pi * n.size("rod_radius") ** 2
    rod = setting.modulus * area / n.L
    K: Any = 0
    for row, drop, rods in zip(_rows(n, y, theta), (x.Sa, x.Sb, x.Sc), (1, 1, 2), strict=True):
        stiffness = 1 / (1 / setting.drive_stiffness + 1 / (rods * rod * (drop / n.L) ** 2))
        entries = [[stiffness * a * b for b in row] for a in row]
        K = K + _matrix(entries)
    return _lowest(K, M)


def _matrix(entries: Any) -> Any:
    """Return 3 × 3 entries as matrices (D, G, 3, 3)."""
    flat = np.broadcast_arrays(*(entry for row in entries for entry in row))
    return np.stack(flat, axis=-1).reshape(*flat[0].shape, 3, 3)


def _lowest(K: Any, M: Any) -> Any:
    good = np.isfinite(K).all(axis=(-1, -2)) & np.isfinite(M).all(axis=(-1, -2))
    safe = np.where(good[..., None, None], M, np.eye(3)), np.where(good[..., None, None], K, np.eye(3))
    L = np.linalg.cholesky(np.real(safe[0]))
    inverse = np.linalg.inv(L)
    turned = inverse @ np.real(safe[1]) @ np.swapaxes(inverse, -1, -2)
    values, vectors = np.linalg.eigh(turned)
    square, v = values[..., 0], (np.swapaxes(inverse, -1, -2) @ vectors[..., :, :1])[..., 0]  # v·M v = 1
    if np.iscomplexobj(K) or np.iscomplexobj(M):
        moved = np.imag(safe[1]) / STEP - square[..., None, None] * np.imag(safe[0]) / STEP
        square = square + 1j * STEP * np.einsum("...i,...ij,...j->...", v, moved, v)
    return np.where(good, np.sqrt(square) / (2 * np.pi), np.nan)


_ARRAYS: Namespace = np

OF_POSES = (
    *(
        ClosedForm(name, unit, "large", about, partial(_margin, name=margin))
        for name, unit, margin, about in (
            (
                "box_height",
                "m",
                "height",
                "height in z that the sliders' travel leaves for the whole box at once",
            ),
            ("singularity", "rad", "actuation", "least angle from det J = 0 in the box"),
            ("serial_reach", "", "serial", "least S/L of a leg over the box: drop by length"),
        )
    ),
    ClosedForm(
        *("transmission", "", "large"),
        "local transmission index LTI: least ITI and OTI over the box",
        _transmission,
    ),
    *(
        ClosedForm(
            *(f"accuracy_{name}", unit, "small"),
            f"largest |δ{sign}| of errors |δλ| ≤ 1 over the box",
            partial(_accuracy, row=row),
        )
        for row, (name, sign, unit) in enumerate(
            (("y", "y", "m/m"), ("z", "z", "m/m"), ("theta", "θ", "rad/m"))
        )
    ),
    ClosedForm(
        *("lowest_frequency", "Hz", "large"),
        "lowest natural frequency at the middle and the corners of the box, drives and rods elastic",
        _frequencies,
    ),
)
"""Measures over a box of poses."""


def loop_of(machine: Parameters) -> ClosedLoopModel:
    """Return the mechanism of a machine as a general closed-loop model."""
    mechanism = description.describe(machine)
    urdf = description.urdf(mechanism)
    sidecar = description.sidecar(mechanism.bare())  # the method adds it itself
    loop = ClosedLoopModel.from_urdf(urdf, sidecar, mimic=False)
    loop.model.gravity.linear = machine.gravity  # a URDF has no place for it
    loop.model.armature = armature_of(loop.model, machine.actuators)  # nor for this
    return loop


_RODS = ("leg_a", "leg_b", "rod_left", "rod_right")
_STEP = 1e-5  # of differences, as a share of a variable
_SAMPLES = 101  # most samples of the motion that reactions are found at


def central_differences(
    population: Population, pieces: Callable[[Population], FloatArray], share: float
) -> FloatArray:
    """Return the derivatives of pieces (D, P) by all variables, (D, P, n), by steps of a share of each."""
    values, slopes = population.values, []
    for index in range(values.shape[1]):
        step = np.zeros_like(values)
        step[:, index] = share * np.maximum(np.abs(values[:, index]), 1e-3)
        ahead, behind = (pieces(Population(population.setting, values + sign * step)) for sign in (1.0, -1.0))
        slopes.append((ahead - behind) / (2 * step[:, [index]]))
    return np.stack(slopes, axis=-1)


@dataclass(frozen=True)
class RodLoad(OfDesigns):
    """The worst compression by Euler's load, both ends hinged, or axial force by the section [Pa] of a rod.

    Gradients are central differences.
    """

    slow: bool = True

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,)."""
        return np.asarray(self._of_rods(population).max(axis=1))

    def pieces(self, population: Population) -> Pieces:
        """Return that of each leg and rod, and the gradients."""
        return Pieces(self._of_rods(population), lambda: self._differences(population))

    def _differences(self, population: Population) -> FloatArray:
        return central_differences(population, self._of_rods, _STEP)

    def _of_rods(self, population: Population) -> FloatArray:
        found = np.full((len(population), len(_RODS)), np.nan)
        radius = np.broadcast_to(population.numbers.size("rod_radius"), (len(population), 1))[:, 0]
        for index in np.flatnonzero(population.feasible):
            section = RodSection(diameter=2 * float(radius[index]), young=population.setting.modulus)
            try:
                rods = _rods(population, int(index), section)
            except P3dofError:
                continue
            area = math.pi * float(radius[index]) ** 2
            found[index] = [self._one(rod, area) for rod in rods]
        return found

    def _one(self, rod: RodCheck, area: float) -> float:
        if self.name == "rod_stress":
            return max(rod.compression, rod.tension) / area
        return rod.compression / rod.buckling


def _rods(population: Population, index: int, section: RodSection) -> list[RodCheck]:
    from p3dof.analysis.reactions.evaluation import over_motion

    setting, machine = population.setting, population.designs[index]
    motion, load = setting.motion, setting.wrench
    every = max(1, -(-len(motion) // _SAMPLES))
    load = None if load is None else np.asarray(load)[::every]
    shift = [float(population.columns[n][index]) if n in population.columns else 0.0 for n in OFFSETS]
    pose, velocity, acceleration = (
        rows[::every] for rows in (motion.pose + np.array(shift), motion.velocity, motion.acceleration)
    )
    motion = Motion(motion.time[::every], pose, velocity, acceleration, check=False, start=motion.start)
    stiffness = replace(Stiffness(), rods=section)
    found = over_motion(loop_of(machine), machine, motion, "elastic", load, stiffness=stiffness)
    assert isinstance(found, Reactions)  # noqa: S101 - one way was asked for
    return [rod_check(machine, found, name, section) for name in _RODS]


OF_RODS = (
    RodLoad(
        *("rod_buckling_share", "", "small"),
        "largest compression of a leg or rod over the motion, by Euler's load",
        over="worst",
    ),
    RodLoad(
        "rod_stress", "Pa", "small", "largest axial stress of a leg or rod over the motion", over="worst"
    ),
)
"""Measures of legs and rods."""


_STEP_OF_LENGTHS = 1e-4  # of differences of distances, which are known to some 1e-11 m


@dataclass(frozen=True)
class OfSweep(OfDesigns):
    """Distances of parts at the samples of the motion, and the box around all that moves over it.

    With the surroundings of the problem. Gradients are central differences.
    """

    slow: bool = True

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,)."""
        found = self._pieces(population)
        return np.asarray(found.min(axis=1) if self.better == "large" else found.max(axis=1))

    def pieces(self, population: Population) -> Pieces:
        """Return that of each pair of parts, or the size of the box, and the gradients."""
        return Pieces(self._pieces(population), lambda: self._differences(population))

    def _differences(self, population: Population) -> FloatArray:
        return central_differences(population, self._pieces, _STEP_OF_LENGTHS)

    def _pieces(self, population: Population) -> FloatArray:
        rows = [self._one(population, int(index)) for index in np.flatnonzero(population.feasible)]
        found = np.full((len(population), len(rows[0]) if rows else 1), np.nan)
        if rows:
            found[population.feasible] = rows
        return found

    def _one(self, population: Population, index: int) -> FloatArray:
        setting, machine = population.setting, population.designs[index]
        model = CollisionModel(machine, setting.surroundings)
        shift = [float(population.columns[n][index]) if n in population.columns else 0.0 for n in OFFSETS]
        pose = setting.motion.pose + np.array(shift)
        if self.name == "motion_clearance":
            return np.asarray(model.distances(pose).min(axis=0))
        low, high = model.sweep(pose)
        sides = high - low
        return np.asarray(sides[2:] if self.name == "height" else sides.prod(keepdims=True))


OF_SWEEP = (
    OfSweep(
        *("motion_clearance", "m", "large"),
        "least distance of two parts that are no neighbours, and of surroundings, over the motion",
    ),
    OfSweep("height", "m", "small", "height of the box around all that moves, over the motion"),
    OfSweep("room", "m³", "small", "volume of the box around all that moves, over the motion"),
)
"""Measures of the space that a machine takes."""


def _width(n: Numbers, population: Population) -> Any:
    return _column(2 * n.R, population)


def _mass(n: Numbers, population: Population) -> Any:
    """All that moves moves along z: the entry of the mass matrix."""
    none = np.zeros(1)
    x = reduced.shape(n.model, none, none, np)
    return _column(reduced.mass_matrix(n.model, x, none, np)[1][1], population)


def _bending(n: Numbers, population: Population) -> Any:
    """First natural frequency of a rod between hinges, (π / 2 L²) √(E I / μ), with √(I/A) = radius / 2."""
    radius = n.size("rod_radius")
    return _column(
        np.pi * radius / (4 * n.L**2) * np.sqrt(population.setting.modulus / n.density), population
    )


def _buckling(n: Numbers, population: Population) -> Any:
    """Euler's load of a rod between two hinges, π² E I / L²."""
    radius = n.size("rod_radius")
    return _column(np.pi**3 * population.setting.modulus * radius**4 / (4 * n.L**2), population)


def _clearance(n: Numbers, population: Population) -> Any:
    """Gaps between solids at all poses of the box or at home: sliders and plate, rods, sliders."""
    edge, rod, corner = n.size("slider_edge"), n.size("rod_radius"), n.size("corner_radius")
    thickness = n.size("plate_thickness")
    box = population.setting.box
    y, theta = (np.zeros(1), np.zeros(1)) if box is None else box.poses
    x = legs(n, y, theta)
    edges = thickness / 2 * np.cos(theta) + corner * np.abs(np.sin(theta))  # of the plate, upward
    gaps = [
        np.maximum(across - edge / 2 - corner, drop - edge / 2 - upward)
        for across, drop, upward in (
            (x.wa, x.Sa, thickness / 2),
            (x.wb, x.Sb, thickness / 2),
            (x.wc, x.Sc, edges),
        )
    ]
    gaps += [_column(2 * n.b - 2 * rod, population), _column(n.R - edge, population)]
    rows = [np.broadcast_to(gap, (len(population), np.shape(gap)[-1])) for gap in gaps]
    return np.concatenate(rows, axis=1)


def _column(values: Any, population: Population) -> Any:
    return np.broadcast_to(values, (len(population), 1))


OF_SOLIDS = (
    ClosedForm("width", "m", "small", "width of the base between the guides of A and B, 2R", _width),
    ClosedForm("moving_mass", "kg", "small", "moving mass", _mass),
    ClosedForm(
        "rod_frequency", "Hz", "large", "first bending frequency of a rod between its hinges", _bending
    ),
    ClosedForm("rod_buckling", "N", "large", "Euler's buckling load of a rod between its hinges", _buckling),
    ClosedForm("clearance", "m", "large", "least gap between solids that come side by side", _clearance),
)
"""Measures of the machine as it stands."""

_ALL: tuple[Any, ...] = (*OF_MOTION, FASTEST, *OF_POSES, *OF_SOLIDS, *OF_RODS, *OF_SWEEP, *OF_TASKS)

MEASURES: Mapping[str, Measure] = {measure.name: measure for measure in _ALL}
"""What designs can be optimised for, and bounded in, by name."""


def measure_of(given: Any, where: str) -> Measure:
    """Return a measure of its name, or one's own as it is."""
    if isinstance(given, str):
        if given in MEASURES:
            return MEASURES[given]
        hint = meant(given, MEASURES, 0.5) or "."
        raise InputError(f"{where}: unknown measure {shown(given)}{hint} There are {', '.join(MEASURES)}")
    if not isinstance(given, Measure):
        raise InputError(f"{where}: expected the name of a measure or a Measure, got {shown(given)}")
    return given
