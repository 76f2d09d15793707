"""Numbers about all items of a sweep: histograms, and means that no order of adding changes."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.blocks.problem import Columns, whole
from p3dof._base.blocks.reduction import Form, Reduction, State
from p3dof._base.checks import FloatArray, frozen_array
from p3dof._base.errors import InputError, SweepError

_LARGEST = 1e150
"""Largest number that means are made of: its square has a value."""

_FRACTION = re.compile(r"-?\d{1,2000}(/\d{1,2000})?", re.ASCII)


@dataclass(frozen=True, eq=False)
class Counts:
    """How many items there are in each bin of a histogram.

    Parameters
    ----------
    column : str
        The column.
    edges : ndarray, shape (bins + 1,)
        Between the bins.
    counts : ndarray of int, shape (bins,)
        Items from one edge up to the next; the last bin has its upper edge too.
    below, above, invalid : int
        Items outside of the bins, and items without a number.
    """

    column: str
    edges: FloatArray
    counts: NDArray[np.int64]
    below: int
    above: int
    invalid: int


@dataclass(frozen=True)
class Histogram(Reduction):
    """How many items there are in equal bins of a column.

    Parameters
    ----------
    column : str
        The column.
    low, high : float
        Where the first bin begins and the last one ends.
    bins : int
        How many bins.

    Raises
    ------
    InputError
        If there is no room between `low` and `high`, or the bins are not from 1 to `most`.
    """

    column: str
    low: float
    high: float
    bins: int = 50

    def __post_init__(self) -> None:
        object.__setattr__(self, "bins", whole("bins", self.bins, 1, self.most))
        for name in ("low", "high"):
            object.__setattr__(self, name, float(frozen_array(name, getattr(self, name), ())))
        if not self.low < self.high or len(np.unique(self.edges)) != self.bins + 1:
            raise InputError(
                f"low, high: expected room for {self.bins} bins, got {self.low:g} to {self.high:g}"
            )

    @property
    def edges(self) -> FloatArray:
        """The edges of its bins, shape (bins + 1,)."""
        return np.linspace(self.low, self.high, self.bins + 1, dtype=np.float64)

    @property
    def name(self) -> str:
        """What to call its result."""
        return f"histogram of {self.column}"

    @property
    def needs(self) -> tuple[str, ...]:
        """The columns that it looks at."""
        return (self.column,)

    def form(self) -> Form:
        """Return what its states look like."""
        return {"counts": ("i", (self.bins,)), "outside": ("i", (3,))}

    def of(self, columns: Columns, start: int) -> State:  # noqa: ARG002 - it does not matter which items
        """Return the state of a block."""
        values = columns[self.column]
        below, above = values < self.low, values > self.high
        counts = np.histogram(values[(values >= self.low) & (values <= self.high)], self.edges)[0]
        invalid = int(np.isnan(values).sum())
        outside = np.array([below.sum(), above.sum(), invalid], dtype=np.int64)
        return {"counts": counts.astype(np.int64), "outside": outside}

    def merge(self, states: Sequence[State]) -> State:
        """Return one state of several."""
        return {name: np.sum([state[name] for state in states], axis=0) for name in self.form()}

    def result(self, state: State) -> Counts:
        """Return the counts."""
        return Counts(self.column, self.edges, state["counts"], *map(int, state["outside"]))


@dataclass(frozen=True)
class ColumnMoments:
    """Mean and range of a column.

    Parameters
    ----------
    count, invalid : int
        Items with and without a number.
    mean, deviation : float
        The mean, and the standard deviation about it (of the items, not of what they are a sample of).
    low, high : float
        The smallest and the largest number.
    """

    count: int
    invalid: int
    mean: float
    deviation: float
    low: float
    high: float


@dataclass(frozen=True)
class Moments(Reduction):
    """Mean, standard deviation and range of some columns.

    The sums of blocks are added without rounding, as fractions: their order changes no bit.

    Parameters
    ----------
    columns : str or tuple of str
        The columns.
    """

    columns: tuple[str, ...]

    def __post_init__(self) -> None:
        columns: Any = self.columns
        given = (columns,) if isinstance(columns, str) else tuple(columns)
        if not given:
            raise InputError("columns: expected one column or more, got none")
        object.__setattr__(self, "columns", given)

    @property
    def name(self) -> str:
        """What to call its result."""
        return f"mean and range of {', '.join(self.columns)}"

    @property
    def needs(self) -> tuple[str, ...]:
        """The columns that it looks at."""
        return self.columns

    def form(self) -> Form:
        """Return what its states look like."""
        n = len(self.columns)
        return {"counts": ("i", (n, 2)), "range": ("f", (n, 2)), "sums": ("U", (n, 3))}

    def of(self, columns: Columns, start: int) -> State:  # noqa: ARG002 - it does not matter which items
        """Return the state of a block."""
        parts = [_of_column(columns[name]) for name in self.columns]
        return _state(parts)

    def merge(self, states: Sequence[State]) -> State:
        """Return one state of several."""
        parts = []
        for i in range(len(self.columns)):
            counts = np.sum([state["counts"][i] for state in states], axis=0)
            low = min(float(state["range"][i, 0]) for state in states)
            high = max(float(state["range"][i, 1]) for state in states)
            sums = [sum(_fraction(state["sums"][i, j]) for state in states) for j in range(3)]
            parts.append((counts, (low, high), sums))
        return _state(parts)

    def result(self, state: State) -> dict[str, ColumnMoments]:
        """Return mean and range of each column."""
        found = {}
        for i, name in enumerate(self.columns):
            count, invalid = map(int, state["counts"][i])
            within, first, second = map(_fraction, state["sums"][i])
            mean = deviation = low = high = math.nan
            if count:
                mean = float(first / count)
                deviation = math.sqrt((within + second - first**2 / count) / count)
                low, high = map(float, state["range"][i])
            found[name] = ColumnMoments(count, invalid, mean, deviation, low, high)
        return found


def _of_column(values: NDArray[Any]) -> tuple[Any, tuple[float, float], list[Fraction]]:
    """Return counts, range, and the sums of (x - c)², c and c² over the items, c the mean of the block."""
    good = values[np.abs(values) <= _LARGEST].astype(np.float64)
    counts = np.array([len(good), len(values) - len(good)], dtype=np.int64)
    if not len(good):
        return counts, (math.inf, -math.inf), [Fraction(0)] * 3
    mean = float(good.sum()) / len(good)
    center = Fraction(mean)
    within = Fraction(float(np.square(good - mean).sum()))
    sums = [within, len(good) * center, len(good) * center**2]
    ends = (float(good.min()) + 0.0, float(good.max()) + 0.0)  # one zero: -0.0 is neither less nor more
    return counts, ends, sums


def _state(parts: Sequence[tuple[Any, tuple[float, float], Sequence[Any]]]) -> State:
    return {
        "counts": np.array([counts for counts, _, _ in parts], dtype=np.int64),
        "range": np.array([ends for _, ends, _ in parts], dtype=np.float64),
        "sums": np.array([[str(number) for number in sums] for _, _, sums in parts]),
    }


def _fraction(text: Any) -> Fraction:
    if not _FRACTION.fullmatch(str(text)) or str(text).endswith("/0"):
        raise SweepError("sums: expected fractions")
    return Fraction(str(text))
