"""Sobol' indices of anything: matched samples, block by block, and what shares of the variance they show.

Rows of Saltelli's scheme: two independent points A and B, and for each variable A with that one number of B.
Jansen's estimators, with standard errors of the ratios; see Saltelli et al., Comput. Phys. Commun. 181 (2010)
259.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from p3dof._base.blocks import Block, Distribution, Samples, Uniform
from p3dof._base.blocks.problem import whole
from p3dof._base.checks import FloatArray, as_floats, shown
from p3dof._base.errors import InputError
from p3dof._base.tables import ShownInNotebook

OnMissing: TypeAlias = Literal["raise", "drop"]
"""Refuse results that are missing, or leave out the rows that they are in."""

_MOST_ROWS = 2**28
_NORMAL = 1.959963984540054


@dataclass(frozen=True)
class MatchedSamples:
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

    variables: Mapping[str, Distribution]
    rows: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "variables", dict(self.variables))
        whole("rows", self.rows, 2, _MOST_ROWS)
        Samples(self.variables, self.count)  # checks names and distributions

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

    def draw(self, block: Block) -> dict[str, FloatArray]:
        """Return the columns of a block."""
        first, last = block.start // self.width, (block.stop - 1) // self.width + 1
        doubled = {f"{half}{i}": Uniform(0.0, 1.0) for half in "ab" for i in range(len(self.variables))}
        points = Samples(doubled, self.rows, "sobol").draw(Block(block.number, first, last, block.seed))
        items = np.arange(block.start, block.stop)
        row, place = items // self.width - first, items % self.width
        columns = {}
        for i, (name, spread) in enumerate(self.variables.items()):
            of_b = (place == 1) | (place == i + 2)
            columns[name] = spread.at(np.where(of_b, points[f"b{i}"][row], points[f"a{i}"][row]))
        return columns


@dataclass(frozen=True, eq=False, repr=False)
class SobolIndices(ShownInNotebook):
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

    Returns
    -------
    SobolIndices

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
