"""`sensitivity`: which parameters of a machine a figure of its forces depends on."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from p3dof._base.blocks import Distribution, FunctionProblem, LogUniform, Normal, Uniform, digest
from p3dof._base.checks import FloatArray, Progress, shown
from p3dof._base.errors import InputError, ParameterError
from p3dof._base.tables import ShownInNotebook
from p3dof.analysis.designs.columns import BodiesOfDesigns, Designs
from p3dof.analysis.designs.evaluation import DesignEvaluation
from p3dof.analysis.designs.figures import BITS, FIGURES
from p3dof.analysis.designs.names import QUANTITIES
from p3dof.analysis.designs.status import DesignStatus
from p3dof.analysis.tolerances.directions import (
    AnyMachine,
    Direction,
    amount_of,
    designs_of,
    directions_of,
    fixed_of,
    parameters_of,
)
from p3dof.analysis.tolerances.draws import Draws
from p3dof.analysis.tolerances.sobol import MatchedSamples, OnMissing, SobolIndices, sobol_indices
from p3dof.closed_form.compiled.designs import compiled_level
from p3dof.closed_form.compiled.kernels import NUMPY
from p3dof.machine.motion import Motion
from p3dof.machine.motion.wrenches import Load, WrenchOverTime
from p3dof.machine.parameters import Parameters

SensitivityMethod: TypeAlias = Literal["sobol", "gradient"]
"""Shares of the variance over ranges, or exact derivatives at the machine."""

BLOCK = 20_000


@dataclass(frozen=True, eq=False, repr=False)
class LocalSensitivity(ShownInNotebook):
    """How a figure changes with each parameter at the machine, exactly.

    Parameters
    ----------
    result, unit : str
        The figure, and its unit.
    value : float
        Of the machine.
    names, units : tuple of str
        Of the d parameters.
    nominal : ndarray, shape (d,)
        Their numbers, in SI units.
    gradient : ndarray, shape (d,)
        Derivative of the figure by each, in SI units.
    normalised : ndarray, shape (d,)
        By how many percent the figure changes when the parameter grows by one percent.
    """

    result: str
    unit: str
    value: float
    names: tuple[str, ...]
    units: tuple[str, ...]
    nominal: FloatArray
    gradient: FloatArray

    @property
    def normalised(self) -> FloatArray:
        """By how many percent the figure changes when the parameter grows by one percent (d,)."""
        return self.gradient * self.nominal / (self.value or np.nan)

    def __repr__(self) -> str:
        order = np.argsort(-np.abs(self.normalised))[:3]
        told = ", ".join(f"{self.names[i]} {self.normalised[i]:+.3g} %/%" for i in order)
        return f"LocalSensitivity({self.result} = {self.value:.6g} {self.unit}: {told})"


@dataclass(frozen=True, eq=False)
class FigureOfMachines:
    """One figure of machines over a motion, as a function of columns of parameters.

    Parameters
    ----------
    machine : Parameters
        The nominal machine.
    motion : Motion
        What it does.
    directions : tuple of Direction
        What varies; columns have their names, and numbers (not deviations) in SI units.
    figure : str
        A figure of `p3dof.DesignForces`; of three actuators the largest, or that of one: ``peak_force_a``.
    bodies : {"kept", "solids"}
        Where bodies come from.
    wrench : ndarray, optional
        External load at the samples.
    level : str
        Of the kernels.
    fixed : mapping of str to float
        Numbers that are not those of the machine, such as sizes of its solids.
    """

    machine: Parameters
    motion: Motion
    directions: tuple[Direction, ...]
    figure: str
    bodies: BodiesOfDesigns
    wrench: Any
    level: str
    fixed: Mapping[str, float]

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_evaluation"}

    @property
    def plain(self) -> str:
        """The figure without the actuator."""
        return self.figure if self.figure in FIGURES else self.figure[:-2]

    @cached_property
    def _evaluation(self) -> DesignEvaluation:
        return self._asking(())

    def _asking(self, gradients: tuple[str, ...]) -> DesignEvaluation:
        bit = FIGURES[self.plain].bit
        groups: Any = [name for name, each in BITS.items() if each == bit]
        return DesignEvaluation(self.motion, self.wrench, groups, gradients, self.level, 1)

    def compute(self, columns: Mapping[str, FloatArray]) -> dict[str, NDArray[Any]]:
        """Return the figure of each machine by its name: NaN for machines that cannot make the motion."""
        moved = np.stack([columns[each.name] - each.nominal for each in self.directions], axis=1)
        found = self._evaluation.evaluate(self._designs(moved))
        values = getattr(found, self.plain)
        chosen = self._chosen(values) if values.ndim == 2 else values
        return {self.figure: np.where(found.status == DesignStatus.FEASIBLE, chosen, np.nan)}

    def _designs(self, moved: FloatArray) -> Designs:
        return designs_of(self.directions, self.machine, self.bodies, moved, self.fixed)

    def _chosen(self, values: FloatArray) -> FloatArray:
        column: FloatArray
        column = values.max(axis=1) if self.figure == self.plain else values[:, "abc".index(self.figure[-1])]
        return column

    def gradient(self) -> tuple[float, FloatArray]:
        """Return the figure of the nominal machine, and its derivatives by the parameters (d,)."""
        by = tuple(dict.fromkeys(column for each in self.directions for column in each.rates))
        designs = self._designs(np.zeros((1, len(self.directions))))
        found = self._asking(by).evaluate(designs)
        if found.status[0] != DesignStatus.FEASIBLE:
            raise InputError(f"robot: the nominal machine cannot make the motion: {found.reason(0)}")
        values = np.atleast_1d(getattr(found, self.plain)[0])
        place = int(values.argmax()) if self.figure == self.plain else "abc".index(self.figure[-1])
        slopes = {name: float(np.atleast_1d(found.gradients[name][self.plain][0])[place]) for name in by}
        gradient = [
            sum(rate * slopes[column] for column, rate in each.rates.items()) for each in self.directions
        ]
        return float(values[place]), np.array(gradient)


def sensitivity(
    robot: AnyMachine = None,
    motion: Motion | None = None,
    variables: Mapping[str, Any] | None = None,
    figure: str = "peak_force",
    *,
    method: SensitivityMethod = "sobol",
    bodies: BodiesOfDesigns = "kept",
    fixed: Mapping[str, float | str] | None = None,
    wrench: WrenchOverTime = None,
    rows: int = 4096,
    on_missing: OnMissing = "raise",
    seed: int = 0,
    folder: str | os.PathLike[str] | None = None,
    resume: bool = False,
    client: Any = None,
    progress: Progress | None = None,
) -> SobolIndices | LocalSensitivity:
    """Return which parameters a figure of the forces depends on, and how much.

    Parameters
    ----------
    robot : Manipulator or Parameters, optional
        The machine; the paper's by default.
    motion : Motion
        What it does.
    variables : mapping of str to Distribution, str or pair
        What varies, by names as of `tolerance`: a `p3dof.blocks` distribution of the number in SI units, a
        share such as ``"10 %"`` (evenly spread between 90 and 110 %), a range ``("240 mm", "260 mm")``, or
        ``{"normal": ["8 kg", "200 g"]}``, mean and standard deviation.
        With ``method="gradient"`` only the names count.
    figure : str
        A figure of `DesignForces`: ``peak_force``, ``rms_force``, ``peak_power``, ``actuation``...; of three
        actuators the largest, or that of one, ``peak_force_a``.
    method : {"sobol", "gradient"}
        Sobol' indices over the ranges, or exact derivatives at the machine.
    bodies : {"kept", "solids"}
        Keep the bodies whatever the lengths are, or compute them anew from solids.
    fixed : mapping of str to float or str, optional
        Numbers that are not those of the machine: sizes of its solids, where they are not the paper's scaled.
    wrench : array-like or callable, optional
        External force and moment on the platform, as of `Manipulator.inverse_dynamics`.
    rows : int
        Matched rows of machines, each as many as there are variables and two; a power of two is best.
    on_missing : {"raise", "drop"}
        What to do where machines cannot make the motion: refuse with a count, or leave out their whole rows.
    seed : int
        Of the points.
    folder : path-like, optional
        Where to store results, block by block.
    resume : bool
        Go on with what is in the folder: ends in the same bits.
    client : distributed.Client or concurrent.futures.Executor, optional
        Who computes; this process by default.
    progress : callable, optional
        Called with the number of machines done and of all.

    Returns
    -------
    SobolIndices or LocalSensitivity

    Raises
    ------
    InputError
        If an argument does not fit, or machines cannot make the motion.
    SweepError, FileError
        As `sweep`.

    Examples
    --------
    >>> import p3dof
    >>> ranges = dict.fromkeys(("r", "R", "L", "rod_radius"), "10 %")
    >>> p3dof.sensitivity(p3dof.SOLIDS, p3dof.paper_motion(201), ranges, bodies="solids")
    """
    if method not in get_args(SensitivityMethod):
        raise InputError(f"method: expected 'sobol' or 'gradient', got {shown(method)}")
    if not isinstance(motion, Motion):
        raise InputError(f"motion: expected a Motion, got {shown(motion)}")
    machine = parameters_of(robot)
    if bodies not in get_args(BodiesOfDesigns):
        raise InputError(f"bodies: expected 'kept' or 'solids', got {shown(bodies)}")
    given: Any = {} if variables is None else variables
    numbers = fixed_of(fixed, bodies)
    directions, values = directions_of(given, "variables", machine, bodies, numbers)
    load = None if wrench is None else Load(wrench, motion.start).over(motion.time)
    level = compiled_level(None, 1)[0] or NUMPY
    asked = FigureOfMachines(machine, motion, directions, _known(figure), bodies, load, level, numbers)
    unit = FIGURES[asked.plain].unit
    names = tuple(each.name for each in directions)
    if method == "gradient":
        value, gradient = asked.gradient()
        nominal = np.array([each.nominal for each in directions])
        units = tuple(each.unit for each in directions)
        return LocalSensitivity(figure, unit, value, names, units, nominal, gradient)
    spreads = {each.name: spread_of(each, value) for each, value in zip(directions, values, strict=True)}
    sampling = MatchedSamples(spreads, rows)
    problem = FunctionProblem(sampling, asked.compute, (figure,), _about(asked), BLOCK)
    draws = Draws(0, seed, "normal", folder, resume, client, progress)
    found = draws.columns(draws.made(problem, (figure,)), (figure,))[:, 0]
    return sobol_indices(found, names, figure, unit, on_missing)


def _known(figure: Any) -> str:
    plain = figure[:-2] if isinstance(figure, str) and figure[-2:] in ("_a", "_b", "_c") else figure
    width = FIGURES[plain].width if plain in FIGURES and plain != "peak_time" else 0
    if width == 3 or (width == 1 and plain == figure):
        return str(figure)
    there = ", ".join(name for name in FIGURES if name != "peak_time")
    raise InputError(f"figure: expected one of {there}, or that of one actuator (_a), got {shown(figure)}")


_SPREADS: dict[str, Callable[..., Distribution]] = {
    "uniform": Uniform,
    "normal": Normal,
    "log-uniform": LogUniform,
}


def spread_of(direction: Direction, value: Any) -> Distribution:
    """Return how a parameter is spread: a distribution, a share about its number, or a range."""
    where = f"variables: {direction.name}"
    if isinstance(value, Distribution):
        return value
    quantity = QUANTITIES[direction.name]
    if isinstance(value, list | tuple):
        value = {"uniform": value}
    if isinstance(value, Mapping):
        if len(value) != 1 or not set(value) <= set(_SPREADS):
            raise InputError(f"{where}: expected one of {', '.join(_SPREADS)}, got {shown(value)}")
        ((kind, numbers),) = value.items()
        if not isinstance(numbers, list | tuple) or len(numbers) != 2:
            raise InputError(f"{where}: expected two numbers, got {shown(numbers)}")
        try:
            first, second = (quantity.read(number, where) for number in numbers)
            return _SPREADS[kind](first, second)
        except (ParameterError, InputError) as error:
            told = str(error.args[0]).removeprefix(f"{where}: ")
            raise InputError(f"{where}: {told}") from error
    half = amount_of(value, direction.nominal, quantity, where)
    return Uniform(direction.nominal - half, direction.nominal + half)


def _about(asked: FigureOfMachines) -> dict[str, Any]:
    motion = asked.motion
    return {
        "machine": asked.machine.to_dict(),
        "bodies": asked.bodies,
        "fixed": dict(asked.fixed),
        "motion": digest(motion.time, motion.pose, motion.velocity, motion.acceleration),
        "wrench": None if asked.wrench is None else digest(asked.wrench),
        "level": asked.level,
    }
