"""`sensitivity`: which parameters of a machine a figure of its forces depends on.

Sobol' indices of anything: matched samples, block by block, and what shares of the variance they show.

Rows of Saltelli's scheme: two independent points A and B, and for each variable A with that one number of B.
Jansen's estimators, with standard errors of the ratios; see Saltelli et al., Comput. Phys. Commun. 181 (2010)
259.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from p3dof._base import blocks
from p3dof._base.checks import FloatArray, Progress, Readable, as_floats, shown, whole
from p3dof._base.errors import InputError, ParameterError
from p3dof._base.tables import ShownInNotebook, Tabular
from p3dof._base.time_series.wrenches import Load, WrenchOverTime
from p3dof.analysis.designs.columns import QUANTITIES, BodiesOfDesigns, Designs
from p3dof.analysis.designs.evaluation import DesignEvaluation
from p3dof.analysis.designs.figures import BITS, FIGURES
from p3dof.analysis.designs.results import DesignStatus
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
from p3dof.closed_form.compiled.designs import compiled_level
from p3dof.closed_form.compiled.kernels import NUMPY
from p3dof.machine.motion import Motion
from p3dof.machine.motion.core import require_motion
from p3dof.machine.parameters import Parameters

OnMissing: TypeAlias = Literal["raise", "drop"]
"""Refuse results that are missing, or leave out the rows that they are in."""

_MOST_ROWS = 2**28
_NORMAL = 1.959963984540054


@dataclass(frozen=True)
class MatchedSamples(Readable):
    """The samples that Sobol' indices need, as a sampling of `p3dof.blocks.FunctionProblem`.

    Item i belongs to row i // (d + 2), and is its point A, its point B, or A with one number of B.

    Parameters
    ----------
    variables : mapping of str to Distribution
        How each of the d variables is spread, independent of the others.
    rows : int
        How many rows, each d + 2 items; a power of two fills the ranges best.

    Raises
    ------
    InputError
        If an argument does not fit.
    """

    variables: Mapping[str, blocks.Distribution]
    rows: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "variables", dict(self.variables))
        whole("rows", self.rows, 2, _MOST_ROWS)
        blocks.Samples(self.variables, self.count)  # checks names and distributions

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(self.variables)

    @property
    def width(self) -> int:
        """Items of a row."""
        return len(self.variables) + 2

    @property
    def count(self) -> int:
        """How many items there are."""
        return self.rows * self.width

    def settings(self) -> dict[str, Any]:
        """Return what the columns depend on, besides the seed."""
        variables = {name: item.settings() for name, item in self.variables.items()}
        return {"kind": "matched", "order": list(self.names), "variables": variables, "rows": self.rows}

    def draw(self, block: blocks.Block) -> dict[str, FloatArray]:
        """Return the columns of a block."""
        first, last = block.start // self.width, (block.stop - 1) // self.width + 1
        doubled = {
            f"{half}{i}": blocks.Uniform(0.0, 1.0) for half in "ab" for i in range(len(self.variables))
        }
        points = blocks.Samples(doubled, self.rows, "sobol").draw(
            blocks.Block(block.number, first, last, block.seed)
        )
        items = np.arange(block.start, block.stop)
        row, place = items // self.width - first, items % self.width
        columns = {}
        for i, (name, spread) in enumerate(self.variables.items()):
            of_b = (place == 1) | (place == i + 2)
            columns[name] = spread.at(np.where(of_b, points[f"b{i}"][row], points[f"a{i}"][row]))
        return columns


@dataclass(frozen=True, eq=False, repr=False)
class SobolIndices(ShownInNotebook, Tabular):
    """Which variables the variance of a result comes from.

    Parameters
    ----------
    result, unit : str
        What varies, and its unit.
    names : tuple of str
        Of the d variables.
    first : ndarray, shape (d,)
        S1: share of the variance that goes away, on average, when this variable is known.
    total : ndarray, shape (d,)
        ST: share that is left when all others are known; it has the interactions.
    first_error, total_error : ndarray, shape (d,)
        Half widths of their 95 % confidence intervals.
    mean, deviation : float
        Of the result.
    low, high : float
        Between which 95 % of all results are.
    rows : int
        Matched rows that were used.
    missing_rows : int
        Rows that were left out, as a result was missing.
    values : ndarray, shape (2 rows,)
        Results of independent points.
    """

    _row_name = "parameter"

    result: str
    unit: str
    names: tuple[str, ...]
    first: FloatArray
    total: FloatArray
    first_error: FloatArray
    total_error: FloatArray
    mean: float
    deviation: float
    low: float
    high: float
    rows: int
    missing_rows: int
    values: FloatArray

    def to_columns(self) -> dict[str, NDArray[Any]]:
        """Return the indices and their confidence intervals, (d,) each; one parameter a row."""
        kinds = ("first", "first_error", "total", "total_error")
        return {"parameter": np.array(self.names)} | {kind: getattr(self, kind) for kind in kinds}

    def __repr__(self) -> str:
        order = np.argsort(-self.total)[:3]
        told = ", ".join(f"{self.names[i]} {self.total[i]:.3g}" for i in order)
        return f"SobolIndices({self.result}: ST of {told})"


def sobol_indices(
    values: Any,
    names: tuple[str, ...],
    result: str = "result",
    unit: str = "",
    on_missing: OnMissing = "raise",
) -> SobolIndices:
    """Return Sobol' indices of the results of `MatchedSamples`.

    Parameters
    ----------
    values : array-like, shape (rows * (d + 2),)
        The results, in the order of the items.
    names : tuple of str
        Of the d variables.
    result, unit : str
        What the results are.
    on_missing : {"raise", "drop"}
        What to do with NaN and infinity: refuse with a count, or leave out whole rows. What is left out makes
        the indices those of the possible machines only, whose variables are no longer quite independent.

    Raises
    ------
    InputError
        If the results do not fit the variables, some are missing, too few are left, or all are the same.
    """
    if on_missing not in ("raise", "drop"):
        raise InputError(f"on_missing: expected 'raise' or 'drop', got {shown(on_missing)}")
    width = len(names) + 2
    flat = as_floats("values", values)
    if flat.ndim != 1 or not names or flat.size % width or flat.size < 2 * width:
        raise InputError(
            f"values: expected complete rows of {width} results each, two or more, got {flat.shape}"
        )
    rows = flat.reshape(-1, width)
    good = np.isfinite(rows).all(axis=1)
    if not good.all():
        gone, left_out = int((~np.isfinite(rows)).sum()), int((~good).sum())
        if on_missing == "raise":
            raise InputError(
                f"values: {gone} of {flat.size} results are missing; on_missing='drop' leaves out "
                f"the {left_out} of {len(rows)} matched rows that they are in"
            )
        if good.sum() < 2:
            raise InputError(f"values: results are missing in {left_out} of {len(rows)} matched rows")
    return _indices(rows[good], names, result, unit, len(rows) - int(good.sum()))


def _indices(rows: FloatArray, names: tuple[str, ...], result: str, unit: str, missing: int) -> SobolIndices:
    count = len(rows)
    a, b, mixed = rows[:, :1], rows[:, 1:2], rows[:, 2:]
    both = rows[:, :2].ravel(order="F")
    mean = float(both.mean())
    square = ((a - mean) ** 2 + (b - mean) ** 2) / 2
    variance = float(square.mean())
    if not variance > 0:
        raise InputError(f"values: all results are the same, {mean:g}: there is no variance to share")
    shares, errors = [], []
    for point in (b, a):
        gap = (point - mixed) ** 2 / 2
        share = gap.mean(axis=0) / variance
        influence = (gap - share * square) / variance
        shares.append(share)
        errors.append(_NORMAL * influence.std(axis=0, ddof=1) / np.sqrt(count))
    low, high = np.quantile(both, [0.025, 0.975])
    return SobolIndices(
        result, unit, names, 1 - shares[0], shares[1], errors[0], errors[1], mean,
        float(both.std(ddof=1)), float(low), float(high), count, missing, both,
    )  # fmt: skip


SensitivityMethod: TypeAlias = Literal["sobol", "gradient"]
"""Shares of the variance over ranges, or exact derivatives at the machine."""

BLOCK = 20_000


@dataclass(frozen=True, eq=False, repr=False)
class LocalSensitivity(ShownInNotebook, Tabular):
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
    """

    _row_name = "parameter"

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

    def to_columns(self) -> dict[str, NDArray[Any]]:
        """Return the parameters with units, numbers and derivatives, (d,) each, by name; one a row.

        ``gradient`` is in the unit of the figure by that of the parameter.
        """
        found: dict[str, NDArray[Any]] = {"parameter": np.array(self.names), "unit": np.array(self.units)}
        return found | {name: getattr(self, name) for name in ("nominal", "gradient", "normalised")}

    def __repr__(self) -> str:
        order = np.argsort(-np.abs(self.normalised))[:3]
        told = ", ".join(f"{self.names[i]} {self.normalised[i]:+.3g} %/%" for i in order)
        return f"LocalSensitivity({self.result} = {self.value:.6g} {self.unit}: {told})"


@dataclass(frozen=True, eq=False)
class FigureOfMachines:
    """One figure of machines over a motion, as a function of columns of parameters."""

    machine: Parameters  # the nominal machine
    motion: Motion  # what it does
    directions: tuple[Direction, ...]
    """What varies; columns have their names, and numbers (not deviations) in SI units."""
    figure: str  # a figure of `DesignForces`; of three actuators the largest, or that of one: `peak_force_a`
    bodies: BodiesOfDesigns  # where bodies come from
    wrench: Any  # external load at the samples
    level: str  # of the kernels
    fixed: Mapping[str, float]  # numbers that are not those of the machine, such as sizes of its solids

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
        """Return the figure of each machine by its name: NaN for machines that cannot perform the motion."""
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
            raise InputError(f"robot: the nominal machine cannot perform the motion: {found.reason(0)}")
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
        Numbers that are not those of the machine, such as sizes and density of its solids.
    wrench : array-like or callable, optional
        External force and moment on the platform, as of `Manipulator.inverse_dynamics`.
    rows : int
        Matched rows of machines, each as many as there are variables and two; a power of two is best.
    on_missing : {"raise", "drop"}
        Where machines cannot perform the motion: refuse with a count, or leave out their whole rows.
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

    Raises
    ------
    InputError
        If an argument does not fit, or machines cannot perform the motion.
    SweepError, FileError
        As `sweep`.
    """
    if method not in get_args(SensitivityMethod):
        raise InputError(f"method: expected 'sobol' or 'gradient', got {shown(method)}")
    motion = require_motion(motion)
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
    problem = blocks.FunctionProblem(sampling, asked.compute, (figure,), _about(asked), BLOCK)
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


_SPREADS: dict[str, Callable[..., blocks.Distribution]] = {
    "uniform": blocks.Uniform,
    "normal": blocks.Normal,
    "log-uniform": blocks.LogUniform,
}


def spread_of(direction: Direction, value: Any) -> blocks.Distribution:
    """Return how a parameter is spread: a distribution, a share about its number, or a range."""
    where = f"variables: {direction.name}"
    if isinstance(value, blocks.Distribution):
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
    return blocks.Uniform(direction.nominal - half, direction.nominal + half)


def _about(asked: FigureOfMachines) -> dict[str, Any]:
    motion = asked.motion
    return {
        "machine": asked.machine.to_dict(),
        "bodies": asked.bodies,
        "fixed": dict(asked.fixed),
        "motion": blocks.digest(motion.time, motion.pose, motion.velocity, motion.acceleration),
        "wrench": None if asked.wrench is None else blocks.digest(asked.wrench),
        "level": asked.level,
    }
