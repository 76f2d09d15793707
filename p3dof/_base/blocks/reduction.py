"""`Reduction`: what is kept of a sweep where its items are too many to be kept.

A reduction makes a small state of a block, and one state of several; the order in which states are merged
changes no bit of the result. States are arrays by name, so that they are stored beside or instead of columns.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from typing_extensions import Self

from p3dof._base.blocks.problem import Columns, not_among
from p3dof._base.errors import InputError

State: TypeAlias = Mapping[str, NDArray[Any]]
"""What a reduction has found so far: arrays of float64, int64 or text by name."""

Form: TypeAlias = Mapping[str, tuple[str, tuple[int | str, ...]]]
"""What the arrays of a state look like: NumPy's letters for the kinds that may be (such as ``"fi"``), and the
shape, in which ``"N"`` stands for a length that all share, at most `Reduction.most`."""


class Reduction(ABC):
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
class Rows:
    """Some items of a sweep, with all their columns.

    Parameters
    ----------
    index : ndarray of int, shape (n,)
        Which items they are.
    columns : mapping of str to ndarray, shape (n,)
        Their numbers.
    """

    index: NDArray[np.int64]
    columns: Columns

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
