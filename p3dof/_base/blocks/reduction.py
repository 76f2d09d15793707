"""`Reduction`: what is kept of a sweep where its items are too many: best items, histograms, means."""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from fractions import Fraction
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from typing_extensions import Self

from p3dof._base.blocks.problem import Columns, not_among
from p3dof._base.checks import FloatArray, Readable, frozen_array, positive, shown, whole
from p3dof._base.errors import InputError, SweepError

State: TypeAlias = Mapping[str, NDArray[Any]]
"""What a reduction has found so far: arrays of float64, int64 or text by name."""

Form: TypeAlias = Mapping[str, tuple[str, tuple[int | str, ...]]]
"""What the arrays of a state look like: NumPy's letters for the kinds that may be (such as ``"fi"``), and the
shape, in which ``"N"`` stands for a length that all share, at most `Reduction.most`."""


class Reduction(Readable, ABC):
    """A reduction: a frozen dataclass of plain data that makes states of columns.

    Subclasses are frozen dataclasses whose fields are plain data; the fields are what the manifest tells.
    """

    most: int = 100_000
    """Most rows of a state."""

    @property
    @abstractmethod
    def name(self) -> str:
        """What to call its result."""

    @property
    @abstractmethod
    def needs(self) -> tuple[str, ...]:
        """The columns that it looks at."""

    @abstractmethod
    def form(self) -> Form:
        """Return what its states look like."""

    @abstractmethod
    def of(self, columns: Columns, start: int) -> State:
        """Return the state of a block whose first item is `start`."""

    @abstractmethod
    def merge(self, states: Sequence[State]) -> State:
        """Return one state of one or more; the order does not matter, to the last bit."""

    @abstractmethod
    def result(self, state: State) -> Any:
        """Return what users get of a state."""

    def over(self, columns: tuple[str, ...]) -> Self:
        """Return this reduction for a problem with these columns.

        Raises
        ------
        InputError
            If one that it needs is missing.
        """
        self._require(self.needs, columns)
        return self

    def _require(self, wanted: Sequence[str], columns: tuple[str, ...]) -> None:
        for column in wanted:
            if column not in columns:
                raise InputError(f"{self.name}: {not_among(column, columns)}")

    def settings(self) -> dict[str, Any]:
        """Return what it is, as plain data for JSON."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}  # type: ignore[arg-type]
        return {"kind": type(self).__name__, **values}


@dataclass(frozen=True, eq=False)
class Rows(Readable):
    """Some items of a sweep, with all their columns."""

    index: NDArray[np.int64]  # (n,): which items they are
    columns: Columns  # (n,): their numbers

    def __len__(self) -> int:
        return len(self.index)


class RowsReduction(Reduction):
    """A reduction that keeps whole items: a frozen dataclass with a field `columns`."""

    columns: tuple[str, ...] | None

    def over(self, columns: tuple[str, ...]) -> Self:
        """Return this reduction for a problem with these columns: all are kept unless some are named."""
        super().over(columns)
        self._require(self.columns or (), columns)
        return self if self.columns is not None else replace(self, columns=columns)  # type: ignore[type-var]

    def form(self) -> Form:
        """Return what its states look like."""
        return {"index": ("i", ("N",)), **{f"of.{name}": ("fi", ("N",)) for name in self._kept}}

    @property
    def _kept(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys((*self.needs, *(self.columns or ()))))

    def of(self, columns: Columns, start: int) -> State:
        """Return the state of a block."""
        count = len(columns[self.needs[0]])
        rows = self.chosen({name: columns[name] for name in self.needs}, np.arange(start, start + count))
        return {"index": rows + start, **{f"of.{name}": columns[name][rows] for name in self._kept}}

    def merge(self, states: Sequence[State]) -> State:
        """Return one state of several."""
        filled = [state for state in states if len(state["index"])] or states[:1]  # empty ones have no type
        joined = {name: np.concatenate([state[name] for state in filled]) for name in self.form()}
        rows = self.chosen({name: joined[f"of.{name}"] for name in self.needs}, joined["index"])
        return {name: array[rows] for name, array in joined.items()}

    @abstractmethod
    def chosen(self, columns: Columns, index: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return which rows to keep, in their order; `index` says which items they are."""

    def result(self, state: State) -> Rows:
        """Return the items that are kept."""
        return Rows(state["index"], {name: state[f"of.{name}"] for name in self._kept})


Direction: TypeAlias = Literal["min", "max"]


@dataclass(frozen=True)
class TopK(RowsReduction):
    """The items with the smallest (or largest) numbers in a column.

    Of equal numbers those of lower items come first; items without a number (NaN) are left out.

    Parameters
    ----------
    by : str
        The column.
    count : int
        How many items to keep.
    largest : bool
        Keep the largest numbers instead.
    columns : tuple of str, optional
        Columns to keep of them; all by default.

    Raises
    ------
    InputError
        If `count` is not from 1 to `most`.
    """

    by: str
    count: int = 10
    largest: bool = False
    columns: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "count", whole("count", self.count, 1, self.most))
        object.__setattr__(self, "columns", _names(self.columns))

    @property
    def name(self) -> str:
        """What to call its result."""
        return f"{self.count} {'largest' if self.largest else 'smallest'} {self.by}"

    @property
    def needs(self) -> tuple[str, ...]:
        """The columns that it looks at."""
        return (self.by,)

    def chosen(self, columns: Columns, index: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return which rows to keep, the best first."""
        values = columns[self.by]
        costs = -values if self.largest else values
        rows = np.flatnonzero(~np.isnan(costs))
        if len(rows) > self.count:  # no sorting of what is far behind
            worst = np.partition(costs[rows], self.count - 1)[self.count - 1]
            rows = rows[costs[rows] <= worst]
        best: NDArray[np.int64] = rows[np.lexsort((index[rows], costs[rows]))][: self.count]
        return best


@dataclass(frozen=True)
class ParetoArchive(RowsReduction):
    """The items that no other one is better than in all of some columns: the Pareto front.

    An item is left out if another one is at least as good in all columns and better in one. Items that are
    equal in all of them stay together; items with a NaN in one are left out.

    Parameters
    ----------
    objectives : mapping of str to {"min", "max"}
        The columns, and whether small or large numbers are good.
    resolution : mapping of str to float
        Of some objectives, the step in which they are compared: of items that are in one box of such steps
        the best one by the first objective stays (then by the second, and so on; then the lower item). The
        front of a large sweep is then small.
    columns : tuple of str, optional
        Columns to keep of the items; all by default.

    Raises
    ------
    InputError
        If an objective is neither to be small nor to be large, or a resolution is not positive.
    """

    objectives: Mapping[str, Direction]
    resolution: Mapping[str, float] = field(default_factory=dict)
    columns: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.objectives, Mapping) or not self.objectives:
            raise InputError("objectives: expected one column or more, each 'min' or 'max'")
        for name, direction in self.objectives.items():
            if direction not in ("min", "max"):
                raise InputError(f"objectives: {name}: expected 'min' or 'max', got {shown(direction)}")
        steps = {}
        for name, step in dict(self.resolution).items():
            if name not in self.objectives:
                raise InputError(f"resolution: expected one of the objectives, got {shown(name)}")
            steps[name] = positive(f"resolution: {name}", step, InputError)
        object.__setattr__(self, "objectives", dict(self.objectives))
        object.__setattr__(self, "resolution", steps)
        object.__setattr__(self, "columns", _names(self.columns))

    @property
    def name(self) -> str:
        """What to call its result."""
        return "Pareto front of " + ", ".join(f"{way} {name}" for name, way in self.objectives.items())

    @property
    def needs(self) -> tuple[str, ...]:
        """The columns that it looks at."""
        return tuple(self.objectives)

    def chosen(self, columns: Columns, index: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return which rows to keep, by the number of their items."""
        signs = {name: 1.0 if way == "min" else -1.0 for name, way in self.objectives.items()}
        costs = np.column_stack([sign * columns[name] for name, sign in signs.items()]).astype(np.float64)
        rows = np.flatnonzero(~np.isnan(costs).any(axis=1))
        if self.resolution:
            rows = self._one_a_box(costs, index, rows)
            costs = self._boxes(costs)
        rows = rows[nondominated(costs[rows])]
        if len(rows) > self.most:
            raise SweepError(
                f"{self.name}: more than {self.most} items; with a `resolution` of its columns they are fewer"
            )
        front: NDArray[np.int64] = rows[np.argsort(index[rows], kind="stable")]
        return front

    def _boxes(self, costs: FloatArray) -> FloatArray:
        boxes = costs.copy()
        for i, name in enumerate(self.objectives):
            if name in self.resolution:
                boxes[:, i] = np.floor(costs[:, i] / self.resolution[name])
        return boxes

    def _one_a_box(
        self, costs: FloatArray, index: NDArray[np.int64], rows: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        boxes = self._boxes(costs)[rows]
        keys = (index[rows], *costs[rows].T[::-1], *boxes.T[::-1])
        order = np.lexsort(keys)
        first = np.ones(len(order), dtype=bool)
        first[1:] = (boxes[order][1:] != boxes[order][:-1]).any(axis=1)
        chosen: NDArray[np.int64] = rows[order[first]]
        return chosen


def nondominated(costs: FloatArray) -> NDArray[np.int64]:
    """Return which points are not dominated: no other is as low in all coordinates and lower in one.

    Their rows, rising.
    """
    if len(costs) == 0:
        return np.zeros(0, dtype=np.int64)
    found = _of_two(costs) if costs.shape[1] == 2 else _of_many(costs)
    return np.sort(found)


def _of_two(costs: FloatArray) -> NDArray[Any]:
    """Walk along the first coordinate: of points with the same one, the lowest, if below all before."""
    order = np.lexsort((costs[:, 1], costs[:, 0]))
    first, second = costs[order].T
    starts = np.flatnonzero(np.append(True, first[1:] != first[:-1]))
    group = np.cumsum(np.append(False, first[1:] != first[:-1]))
    lowest = second[starts]
    before = np.append(np.inf, np.minimum.accumulate(lowest)[:-1])
    good = (lowest < before) | ((np.arange(len(starts)) == 0) & (lowest == np.inf))
    found: NDArray[Any] = order[(second == lowest[group]) & good[group]]
    return found


def _of_many(costs: FloatArray) -> NDArray[Any]:
    """Take points by the sum of ranks, which no rounding turns around: what dominates comes before."""
    ranks = np.column_stack([np.unique(column, return_inverse=True)[1] for column in costs.T])  # (n, d)
    order = np.argsort(ranks.sum(axis=1), kind="stable")
    left, found = ranks[order], []
    while len(order):
        found.append(order[0])
        worse = (left >= left[0]).all(axis=1) & (left > left[0]).any(axis=1)
        worse[0] = True  # it is taken
        order, left = order[~worse], left[~worse]
    return np.array(found)


def _names(columns: Any) -> tuple[str, ...] | None:
    return None if columns is None else tuple(columns)


_LARGEST = 1e150  # largest number that means are made of: its square has a value

_FRACTION = re.compile(r"-?\d{1,2000}(/\d{1,2000})?", re.ASCII)


@dataclass(frozen=True, eq=False)
class Counts(Readable):
    """How many items there are in each bin of a histogram."""

    column: str  # the column
    edges: FloatArray  # (bins + 1,): between the bins
    counts: NDArray[np.int64]
    """(bins,): items from one edge up to the next; the last bin has its upper edge too."""
    below: int  # items outside of the bins, and items without a number
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
    """Mean and range of a column."""

    count: int  # items with and without a number
    invalid: int
    mean: float
    """The mean, and the standard deviation about it (of the items, not of what they are a sample of)."""
    deviation: float
    low: float  # the smallest and the largest number
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
