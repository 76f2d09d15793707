"""`Robust`: a measure of machines that are not built exactly: its mean and spread, or its worst case.

The same points are taken for all designs (common random numbers), so that the measure is as smooth in the
variables as the one that it is made of, and its gradient is exact.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from p3dof._base.blocks import Block, Normal, Samples
from p3dof._base.checks import FloatArray, Readable, positive, shown, whole
from p3dof._base.errors import InputError
from p3dof.analysis.designs.columns import DENSITY, QUANTITIES, SIZES, full_name, members_of, numbers_of
from p3dof.analysis.designs.figures import FigureGroup
from p3dof.analysis.tolerances.directions import amount_of, direction_of
from p3dof.design.optimisation.measures import measure_of
from p3dof.design.optimisation.population import Better, Pieces, Population, Setting, worst_gradient

RobustKind: TypeAlias = Literal["spread", "worst"]
"""Mean and `k` standard deviations, or the worst of all corners that are `k` standard deviations off."""

_MOST_CORNERS = 8  # most parameters of which all corners are looked at

_LARGEST = 4096


@dataclass(frozen=True)
class Robust(Readable):
    """A measure of machines whose parts are not exactly what the design says.

    Parameters
    ----------
    measure : str or Measure
        What it is made of, such as ``"peak_force"``.
    sigma : mapping of str to float or str
        Standard deviations by names of parameters, as of `p3dof.tolerance`; a share (``"2 %"``) is one of the
        design at hand.
    k : float
        How many standard deviations are kept from the mean, or in the worst case.
    kind : {"spread", "worst"}
        The mean and `k` standard deviations to the bad side, over points that are drawn normally; or the
        worst of the corners at which each parameter is `k` standard deviations off, to first or other order:
        all corners of up to eight parameters, else `points` of them.
    points : int
        Machines around each design; an even number, as each has one opposite, and at least four a parameter.
        Where the measure is linear, mean and spread are exact whatever the number is.
    seed : int
        Of the points.

    Raises
    ------
    InputError
        If an argument does not fit.
    """

    measure: Any
    sigma: Any
    k: float = 3.0
    kind: RobustKind = "spread"
    points: int = 32
    seed: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "measure", measure_of(self.measure, "measure"))
        if not isinstance(self.sigma, Mapping) or not self.sigma:
            raise InputError(f"sigma: expected numbers by names of parameters, got {shown(self.sigma)}")
        object.__setattr__(self, "k", positive("k", self.k, InputError))
        if self.kind not in get_args(RobustKind):
            raise InputError(f"kind: expected 'spread' or 'worst', got {shown(self.kind)}")
        least = 4 * len(self.sigma)
        if whole("points", self.points, 2, _LARGEST) % 2 or (self.kind == "spread" and self.points < least):
            raise InputError(
                f"points: expected an even number, at least {least} for {len(self.sigma)} parameters, "
                f"got {self.points}"
            )
        whole("seed", self.seed, 0, 2**63)
        sizes = {full_name(str(name)): value for name, value in self.sigma.items()}
        object.__setattr__(self, "sigma", _Sizes(sizes))

    @property
    def name(self) -> str:
        """What it is called in tables and files."""
        inner: str = self.measure.name
        return f"{inner}_worst_{self.k:g}_sigma" if self.kind == "worst" else f"{inner}_with_{self.k:g}_sigma"

    @property
    def unit(self) -> str:
        """Its SI unit."""
        return str(self.measure.unit)

    @property
    def better(self) -> Better:
        """Whether small or large is good."""
        found: Better = self.measure.better
        return found

    @property
    def figures(self) -> tuple[FigureGroup, ...]:
        """Groups of figures over the motion that it needs."""
        found: tuple[FigureGroup, ...] = self.measure.figures
        return found

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,)."""
        around = _around(self, population.setting)
        found = self.measure.values(around.population(population)).reshape(len(population), -1)
        if self.kind == "worst":
            return np.asarray(found.max(axis=1) if self.better == "small" else found.min(axis=1))
        sign = 1.0 if self.better == "small" else -1.0
        return np.asarray(found.mean(axis=1) + sign * self.k * found.std(axis=1, ddof=1))

    def pieces(self, population: Population) -> Pieces:
        """Return its pieces and their gradients: one, or one a corner in the worst case."""
        around = _around(self, population.setting)
        moved = around.population(population)
        found = self.measure.pieces(moved)
        slopes = worst_gradient(found, self.better)
        values = found.values.max(axis=1) if self.better == "small" else found.values.min(axis=1)
        rows = values.reshape(len(population), -1)  # (D, M)
        by = around.chained(slopes, len(population))  # (D, M, n)
        if self.kind == "worst":
            return Pieces(rows, by)
        sign = 1.0 if self.better == "small" else -1.0
        mean, deviation = rows.mean(axis=1), rows.std(axis=1, ddof=1)
        apart = (rows - mean[:, None])[..., None] * (by - by.mean(axis=1, keepdims=True))
        spread = apart.sum(axis=1) / ((rows.shape[1] - 1) * np.where(deviation > 0, deviation, 1.0))[:, None]
        value = mean + sign * self.k * deviation
        return Pieces(value[:, None], (by.mean(axis=1) + sign * self.k * spread)[:, None])


class _Sizes(dict[str, Any]):
    """Numbers by name that do not change, so that they can be hashed."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(tuple(self.items()))


class _Around(NamedTuple):
    """Machines around designs."""

    setting: Setting  # of the designs, with all columns that are moved as further variables
    variables: int  # how many variables designs have; further ones follow
    base: FloatArray  # (n',): numbers of the further columns; 0 for variables
    moves: FloatArray  # (M, n'): what is added to each column, in SI units
    factors: FloatArray  # (M, n'): what each column is multiplied by first

    def population(self, population: Population) -> Population:
        """Return the machines around each of some designs, M each."""
        rows = np.tile(self.base, (len(population), 1))
        rows[:, : self.variables] = population.values
        moved = rows[:, None] * self.factors + self.moves  # (D, M, n')
        return Population(self.setting, moved.reshape(-1, moved.shape[-1]))

    def chained(self, slopes: FloatArray, designs: int) -> FloatArray:
        """Return derivatives by the variables of designs, (D, M, n), of those by moved columns."""
        by = slopes.reshape(designs, len(self.moves), -1)[..., : self.variables]
        found: FloatArray = by * self.factors[:, : self.variables]
        return found


@lru_cache(maxsize=16)
def _around(robust: Robust, setting: Setting) -> _Around:
    """Return which columns are moved, and by what."""
    units = _unit_points(robust)
    columns = dict.fromkeys(setting.names, 0.0)
    shifts: list[tuple[str, FloatArray, bool]] = []
    for (name, value), unit in zip(robust.sigma.items(), units.T, strict=True):
        rates, nominal = _moving(name, setting)
        share = isinstance(value, str) and value.strip().endswith("%")
        if share and name in setting.names:
            shifts.append((name, amount_of(value, 1.0, QUANTITIES[name], f"sigma of {name}") * unit, True))
            continue
        size = amount_of(value, nominal, QUANTITIES[name], f"sigma of {name}")
        for column, rate in rates.items():
            if column not in columns:
                columns[column] = _base(column, setting)
            shifts.append((column, rate * size * unit, False))
    names = tuple(columns)
    moves, factors = np.zeros((len(units), len(names))), np.ones((len(units), len(names)))
    for column, change, share in shifts:
        (factors if share else moves)[:, names.index(column)] += change
    fixed = {name: value for name, value in setting.fixed.items() if name not in columns}
    own = replace(setting, names=names, fixed=fixed)
    return _Around(own, len(setting.names), np.array(list(columns.values())), moves, factors)


def _moving(name: str, setting: Setting) -> tuple[Mapping[str, float], float]:
    """Return the columns that a parameter moves, and its nominal number where it is no variable."""
    if name in setting.names:
        return {name: 1.0}, 0.0
    full = full_name(name) if isinstance(name, str) else ""
    kept = full.startswith("bodies.") and set(members_of(full)) & set(setting.fixed)
    direction = direction_of(name, setting.machine, "kept" if kept else setting.bodies)
    return direction.rates, float(setting.fixed.get(name, direction.nominal))


def _base(column: str, setting: Setting) -> float:
    """Return the number of a column that is no variable."""
    if column in setting.fixed:
        return float(setting.fixed[column])
    if column in SIZES and column.partition(".")[2] not in setting.machine.dimensions:
        raise InputError(
            f"sigma: {column} follows from the lengths: give it in `fixed`, or make it a variable"
        )
    if column in (*SIZES, DENSITY):
        return direction_of(column, setting.machine, setting.bodies).nominal
    return numbers_of(setting.machine).get(column, 0.0)


def _unit_points(robust: Robust) -> FloatArray:
    """Return points (M, P) in standard deviations; with each its opposite."""
    count = len(robust.sigma)
    if robust.kind == "worst" and count <= _MOST_CORNERS:
        return robust.k * np.array(list(product((-1.0, 1.0), repeat=count)))
    half = robust.points // 2
    spreads = {f"p{i}": Normal(0.0, 1.0) for i in range(count)}
    drawn = Samples(spreads, half, "sobol").draw(Block(0, 0, half, robust.seed))
    one = np.stack(list(drawn.values()), axis=1)
    points: FloatArray = np.concatenate([one, -one])
    if robust.kind == "worst":
        return robust.k * np.sign(points)
    spread = np.linalg.cholesky(points.T @ points / (len(points) - 1))
    found: FloatArray = np.linalg.solve(spread, points.T).T  # independent, of standard deviation 1, exactly
    return found
