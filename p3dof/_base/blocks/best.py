"""The best items of a sweep: by one column, or by several at a time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from p3dof._base.blocks.problem import Columns, whole
from p3dof._base.blocks.reduction import RowsReduction
from p3dof._base.checks import FloatArray, positive, shown
from p3dof._base.errors import InputError, SweepError

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

    Parameters
    ----------
    costs : ndarray, shape (n, d)
        The points, without NaN.

    Returns
    -------
    ndarray of int, shape (m,)
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
    """Take the points by the sum of their ranks: what dominates a point comes before it.

    Ranks keep the order of each coordinate, so that no rounding can turn it around.
    """
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
