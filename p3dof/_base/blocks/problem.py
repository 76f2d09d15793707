"""`Problem`: what a sweep computes, in blocks whose content depends on their number and the seed alone."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, Readable, meant, one_line, shown, whole
from p3dof._base.errors import InputError, SweepError

Columns: TypeAlias = Mapping[str, NDArray[Any]]
"""Numbers of the items of a block by name, each of shape (n,), float64 or int64."""

NAME = re.compile(r"[A-Za-z_][\w.]{0,79}", re.ASCII)
"""What a column may be called: it stands in file names of archives."""

UNIT = re.compile(r"[^\[\]\x00-\x1f\x7f]{1,20}")  # what a unit looks like

MOST_ITEMS = 10**13  # most items of a sweep

LARGEST_BLOCK = 10**7  # most items of a block


@dataclass(frozen=True)
class Block:
    """Some items of a sweep, one after the other.

    Parameters
    ----------
    number : int
        Which block it is, from 0.
    start, stop : int
        Its first item, and the one behind its last.
    seed : int
        Of the sweep.
    """

    number: int
    start: int
    stop: int
    seed: int

    def __len__(self) -> int:
        return self.stop - self.start

    @property
    def generator(self) -> np.random.Generator:
        """Random numbers of this block: the same each time, independent of those of all others."""
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(self.number,)))


@runtime_checkable
class Problem(Protocol):
    """What a sweep computes. Objects of any class with these doors will do, if they can be pickled.

    A mapping ``units``, from columns to their units, is told in tables and figures where there is one.

    ``compute`` must depend on nothing but the block (its items, `Block.generator`) and on what ``settings``
    tells: a sweep is resumed only where these are the same.
    """

    @property
    def count(self) -> int:
        """How many items there are."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns, inputs and outputs."""

    @property
    def block_size(self) -> int:
        """Items of a block where nobody says how many: a second of work or so."""

    def settings(self) -> Mapping[str, Any]:
        """Return everything that the results depend on, as plain data for JSON; arrays by `digest`."""

    def compute(self, block: Block) -> Columns:
        """Return the columns of a block, each of shape (n,)."""


class Sampling(Protocol):
    """Where the inputs of a problem come from: columns of a block."""

    @property
    def count(self) -> int:
        """How many items there are."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""

    def settings(self) -> Mapping[str, Any]:
        """Return what the columns depend on, besides the seed."""

    def draw(self, block: Block) -> dict[str, FloatArray]:
        """Return the columns of a block, each of shape (n,)."""


@dataclass(frozen=True)
class FunctionProblem(Readable):
    """A problem made of a sampling and a function of columns.

    Parameters
    ----------
    sampling : Sampling
        The inputs: random numbers, a grid, rows of a file (`p3dof.blocks.sampling`).
    function : callable
        Is given a dict of input columns, each (n,), and returns a dict of output columns, each (n,). It must
        be importable where the workers are, or be sent to them by the client (Dask does).
    outputs : tuple of str
        Names of the output columns.
    about : mapping
        What else the function depends on: plain data, told in the manifest.
    block_size : int
        Items of a block where nobody says how many.
    units : mapping of str to str
        Of columns that have one.
    """

    sampling: Sampling
    function: Callable[[dict[str, FloatArray]], Columns]
    outputs: tuple[str, ...]
    about: Mapping[str, Any] = field(default_factory=dict)
    block_size: int = 1000
    units: Mapping[str, str] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """How many items there are."""
        return self.sampling.count

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return (*self.sampling.names, *self.outputs)

    def settings(self) -> dict[str, Any]:
        """Return everything that the results depend on."""
        name = f"{self.function.__module__}.{self.function.__qualname__}"
        return {"function": name, "sampling": dict(self.sampling.settings()), **self.about}

    def compute(self, block: Block) -> Columns:
        """Return the columns of a block."""
        inputs = self.sampling.draw(block)
        return {**inputs, **self.function(dict(inputs))}


def not_among(name: str, columns: Sequence[str]) -> str:
    """Return what an error says of a column that is not there; with the names that come close, or all."""
    near = meant(name, columns) or ";"
    return f"unknown column {shown(name)}{near} expected one of the columns {', '.join(columns)}"


def digest(*arrays: Any) -> str:
    """Return the SHA-256 of arrays of numbers, their shapes included, for the settings of a problem."""
    found = hashlib.sha256()
    for array in arrays:
        numbers = np.ascontiguousarray(array, dtype="<f8")
        found.update(f"{numbers.shape}".encode())
        found.update(numbers.tobytes())
    return found.hexdigest()


def computed(problem: Problem, block: Block) -> dict[str, NDArray[Any]]:
    """Return the columns of a block, checked, in their order; dict of str to ndarray, shape (n,)."""
    found = problem.compute(block)
    if not isinstance(found, Mapping) or set(found) != set(problem.columns):
        got = ", ".join(map(str, found)) if isinstance(found, Mapping) else shown(found)
        expected = ", ".join(problem.columns)
        raise SweepError(f"block {block.number}: expected the columns {expected}, got {one_line(got)}")
    columns = {}
    for name in problem.columns:
        array = np.asarray(found[name])
        if array.dtype.kind not in "fiub" or array.shape != (len(block),):
            raise SweepError(
                f"block {block.number}: expected {len(block)} numbers in the column {name}, "
                f"got the shape {array.shape} of {array.dtype}"
            )
        kind = np.float64 if array.dtype.kind == "f" else np.int64
        columns[name] = np.ascontiguousarray(array, dtype=kind)
    return columns


def check_problem(problem: Any) -> None:
    """Raise unless something is a problem, with a count and names that can be used."""
    if not isinstance(problem, Problem):
        doors = [name for name in _DOORS if not hasattr(problem, name)]
        raise InputError(f"problem: expected an object with {', '.join(doors)}, got {shown(problem)}")
    whole("the problem's count", problem.count, 1, MOST_ITEMS)
    names = tuple(problem.columns)
    for name in names:
        if not isinstance(name, str) or not NAME.fullmatch(name):
            raise InputError(f"columns: expected names of letters, digits, _ and dots, got {shown(name)}")
    if not names or len(set(names)) != len(names):
        raise InputError("columns: expected one column or more, each with a name of its own")


_DOORS = ("count", "columns", "block_size", "settings", "compute")
