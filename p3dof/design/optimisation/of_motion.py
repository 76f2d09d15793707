"""Measures over the motion: forces, powers, what is left to limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import InputError, TaskError
from p3dof._base.time_series.wrenches import WRENCH_ROWS
from p3dof.analysis.designs.figures import outputs
from p3dof.closed_form.compiled.formulas import MODEL
from p3dof.design.optimisation.measure import OfDesigns, Pieces
from p3dof.design.optimisation.population import Population, Setting
from p3dof.design.tasks.fastest import fastest_law
from p3dof.design.tasks.limits import AxisLimits, Demand

_BLOCK = 64  # designs whose forces at all samples are in the memory at a time


@dataclass(frozen=True)
class OfFigure(OfDesigns):
    """A measure that is a figure of `DesignForces`, with the compiled gradient."""

    figure: str  # the field of `DesignForces`
    total: bool = False  # the sum over the actuators, instead of the worst of them

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,)."""
        found = self._together(getattr(population.forces, self.figure))
        return np.asarray(found.max(axis=1) if self.better == "small" else found.min(axis=1))

    def pieces(self, population: Population) -> Pieces:
        """Return its pieces and their gradients."""
        slopes = population.slopes
        moved = [self._together(slopes.gradients[name][self.figure]) for name in population.setting.names]
        return Pieces(self._together(getattr(slopes, self.figure)), np.stack(moved, axis=-1))

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
    PeakForce("peak_force", "N", "small", "largest magnitude of an actuator's force over the motion"),
    OfFigure("rms_force", "N", "small", "largest root mean square of an actuator's force", "rms_force"),
    PeakPower(
        "peak_power",
        "W",
        "small",
        "largest power that one actuator gives over the motion",
        figures=("power",),
    ),
    RmsPower("rms_power", "W", "small", "root mean square over time of the sum of |power| of the actuators"),
    OfFigure(
        *("energy", "J", "small", "work that the actuators give over the motion", "positive_work", True),
        figures=("power",),
    ),
    OfFigure(
        *("peak_speed", "m/s", "small", "largest speed of a slider over the motion", "peak_speed"),
        figures=("sliders",),
    ),
    OfFigure(
        *("motion_singularity", "rad", "large", "least angle from det J = 0 over the motion", "actuation"),
        figures=("singularity",),
    ),
    *(
        LeftToLimits(name, unit, "large", f"margin of {limit} over the motion", figures=("sliders",))
        for name, unit, limit in (
            ("stroke_margin", "m", "the sliders' travel"),
            ("speed_margin", "m/s", "the sliders' speed"),
            ("force_margin", "N", "the actuator force"),
        )
    ),
)
"""Measures over the motion."""


NODES = 400
_STEP = 2e-3  # of differences, as a share of the range of a variable: times are known to some 1e-6 of them
_SLOW = 1e-3  # least speed along the motion by the largest: where it stands, its time is no parameter


@dataclass(frozen=True)
class FastestTime(OfDesigns):
    """Least time for the path of the motion within force and speed of the machine's limits, rest to rest.

    The law along the path is that of `p3dof.design.tasks.fastest`; gradients are central differences, the
    only ones here that are not exact. One design takes some tenths of a second.
    """

    slow: bool = True

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
            step[index] = _STEP * max(abs(float(values[:, index].mean())), 1e-3)
            ahead, behind = (self.values(Population(setting, values + sign * step)) for sign in (1.0, -1.0))
            slopes.append((ahead - behind) / (2 * step[index]))
        return np.stack(slopes, axis=-1)[:, None]


FASTEST = FastestTime(
    *("fastest_time", "s", "small"),
    "least time for the path of the motion within the machine's force and speed, from rest to rest",
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
