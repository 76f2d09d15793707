"""Measures over the motion: forces, powers, what is left to limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.analysis.designs.figures import FigureGroup
from p3dof.design.optimisation.measure import Better, Pieces
from p3dof.design.optimisation.population import Population

_BLOCK = 64
"""Designs whose forces at all samples are in the memory at a time."""


@dataclass(frozen=True)
class OfFigure:
    """A measure that is a figure of `DesignForces`, with the compiled gradient.

    Parameters
    ----------
    name, unit, better
        As of `Measure`.
    about : str
        What it is, in a line.
    figure : str
        The field of `DesignForces`.
    groups : tuple of str
        Figures that it needs.
    total : bool
        The sum over the actuators, instead of the worst of them.
    """

    name: str
    unit: str
    better: Better
    about: str
    figure: str
    figures: tuple[FigureGroup, ...] = ()
    total: bool = False

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


@dataclass(frozen=True)
class PeakForce:
    """Largest magnitude of any actuator's force over the motion; its pieces are all forces at all samples."""

    name: str = "peak_force"
    unit: str = "N"
    better: Better = "small"
    about: str = "largest magnitude of an actuator's force over the motion"
    figures: tuple[FigureGroup, ...] = ()

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


@dataclass(frozen=True)
class PeakPower:
    """Largest power that an actuator gives over the motion; its pieces are all powers at all samples."""

    name: str = "peak_power"
    unit: str = "W"
    better: Better = "small"
    about: str = "largest power that one actuator gives over the motion"
    figures: tuple[FigureGroup, ...] = ("power",)

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,)."""
        assert population.forces.peak_power is not None  # noqa: S101 - it is asked for
        return np.asarray(population.forces.peak_power.max(axis=1))

    def pieces(self, population: Population) -> Pieces:
        """Return its pieces and their gradients."""
        return Pieces(powers(population), lambda: power_rates(population))


@dataclass(frozen=True)
class RmsPower:
    """Root mean square over the motion of the sum of the magnitudes of the actuators' powers."""

    name: str = "rms_power"
    unit: str = "W"
    better: Better = "small"
    about: str = "root mean square over time of the sum of |power| of the actuators"
    figures: tuple[FigureGroup, ...] = ()

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


@dataclass(frozen=True)
class LeftToLimits:
    """What is left to the nearest limit of the machine over the motion; negative beyond it.

    Parameters
    ----------
    name : {"stroke_margin", "speed_margin", "force_margin"}
        Of slider positions, of their speeds, of the forces.
    unit : str
        Its SI unit.
    about : str
        What it is, in a line.
    """

    name: str
    unit: str
    about: str
    better: Better = "large"
    figures: tuple[FigureGroup, ...] = ("sliders",)

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
    PeakForce(),
    OfFigure("rms_force", "N", "small", "largest root mean square of an actuator's force", "rms_force"),
    PeakPower(),
    RmsPower(),
    OfFigure(
        "energy",
        "J",
        "small",
        "work that the actuators give over the motion",
        "positive_work",
        ("power",),
        True,
    ),
    OfFigure(
        "peak_speed", "m/s", "small", "largest speed of a slider over the motion", "peak_speed", ("sliders",)
    ),
    OfFigure(
        "motion_singularity",
        "rad",
        "large",
        "least angle from det J = 0 over the motion",
        "actuation",
        ("singularity",),
    ),
    LeftToLimits("stroke_margin", "m", "what the sliders' travel leaves over the motion"),
    LeftToLimits("speed_margin", "m/s", "what the limit of the sliders' speed leaves over the motion"),
    LeftToLimits("force_margin", "N", "what the limit of force leaves over the motion"),
)
"""Measures over the motion."""
