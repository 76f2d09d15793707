"""The least time for the path of the motion, from rest to rest, as a measure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import InputError, TaskError
from p3dof.analysis.designs.figures import FigureGroup
from p3dof.analysis.designs.formula import outputs
from p3dof.closed_form.compiled.formulas import MODEL
from p3dof.design.optimisation.measure import Better, Pieces
from p3dof.design.optimisation.population import Population, Setting
from p3dof.design.tasks.fastest import fastest_law
from p3dof.design.tasks.limits import AxisLimits, Demand
from p3dof.machine.motion.wrenches import WRENCH_ROWS

NODES = 400
_STEP = 2e-3
"""Of differences, as a share of the range of a variable: times are known to some 1e-6 of them."""
_SLOW = 1e-3
"""Least speed along the motion, as a share of the largest: where it stands, its time is no parameter."""


@dataclass(frozen=True)
class FastestTime:
    """Least time for the path of the motion within force and speed of the machine's limits, rest to rest.

    The law along the path is that of `p3dof.design.tasks.fastest`; gradients are central differences, the
    only ones here that are not exact. One design takes some tenths of a second.
    """

    name: str = "fastest_time"
    unit: str = "s"
    better: Better = "small"
    about: str = (
        "least time for the path of the motion within the machine's force and speed, from rest to rest"
    )
    figures: tuple[FigureGroup, ...] = ()
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
