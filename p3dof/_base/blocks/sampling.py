"""Columns of inputs, block by block: random numbers, Latin hypercubes, Sobol points, grids."""

from __future__ import annotations

import math
import threading
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from p3dof._base.blocks.problem import MOST_ITEMS, NAME, Block
from p3dof._base.checks import FloatArray, Readable, frozen_array, positive, shown, whole
from p3dof._base.errors import InputError


class Distribution(ABC):
    """A distribution: a frozen dataclass of numbers."""

    @abstractmethod
    def at(self, share: FloatArray) -> FloatArray:
        """Return the numbers below which the given shares of all are; shape (n,)."""

    def settings(self) -> dict[str, Any]:
        """Return what it is, as plain data."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}  # type: ignore[arg-type]
        return {"kind": type(self).__name__, **values}


@dataclass(frozen=True)
class Uniform(Distribution):
    """Numbers evenly spread over a range.

    Parameters
    ----------
    low, high : float
        The range.

    Raises
    ------
    InputError
        Unless low < high.
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        _range(self)

    def at(self, share: FloatArray) -> FloatArray:
        """Return the numbers below which the given shares of all are."""
        return np.clip(self.low + (self.high - self.low) * share, self.low, self.high)


@dataclass(frozen=True)
class LogUniform(Distribution):
    """Positive numbers whose logarithms are evenly spread over a range."""

    low: float  # the range
    high: float

    def __post_init__(self) -> None:
        _range(self)
        positive("low", self.low, InputError)

    def at(self, share: FloatArray) -> FloatArray:
        """Return the numbers below which the given shares of all are."""
        return np.clip(self.low * np.exp(math.log(self.high / self.low) * share), self.low, self.high)


@dataclass(frozen=True)
class Normal(Distribution):
    """Numbers spread about a mean as errors are.

    Parameters
    ----------
    mean : float
        The mean.
    deviation : float
        The standard deviation.

    Raises
    ------
    InputError
        If the mean is not finite, or the deviation not positive.
    """

    mean: float
    deviation: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "mean", float(frozen_array("mean", self.mean, ())))
        object.__setattr__(self, "deviation", positive("deviation", self.deviation, InputError))

    def at(self, share: FloatArray) -> FloatArray:
        """Return the numbers below which the given shares of all are."""
        from scipy.special import ndtri

        inside = np.clip(share, 2.0**-54, 1 - 2.0**-53)  # both ends are infinitely far away
        found: FloatArray = self.mean + self.deviation * ndtri(inside)
        return found


def _range(distribution: Any) -> None:
    for name in ("low", "high"):
        value = float(frozen_array(name, getattr(distribution, name), ()))
        object.__setattr__(distribution, name, value)
    if not distribution.low < distribution.high:
        raise InputError(
            f"low, high: expected low < high, got {distribution.low:g} and {distribution.high:g}"
        )


Method: TypeAlias = Literal["random", "latin-hypercube", "sobol"]

METHODS: tuple[str, ...] = get_args(Method)
"""How `Samples` fill the ranges of columns."""

SOBOL_BITS = 32
"""Bits of Sobol points: so many of them, and as many steps of each number. SciPy cannot skip with more."""


@dataclass(frozen=True)
class Samples(Readable):
    """Points that fill the ranges of some columns.

    Parameters
    ----------
    variables : mapping of str to Distribution
        How each column is spread.
    count : int
        How many points.
    method : {"random", "latin-hypercube", "sobol"}
        Independent random numbers; a Latin hypercube in each block (as many layers as the block has items, in
        every column); or Sobol's sequence, scrambled by the seed, of which each block has its part.

    Raises
    ------
    InputError
        If an argument does not fit.
    """

    variables: Mapping[str, Distribution]
    count: int
    method: Method = "random"

    def __post_init__(self) -> None:
        object.__setattr__(self, "variables", dict(self.variables))
        require_names(self.names)
        for name, distribution in self.variables.items():
            if not isinstance(distribution, Distribution):
                raise InputError(f"{name}: expected Uniform, Normal or the like, got {shown(distribution)}")
        if self.method not in METHODS:
            raise InputError(f"method: expected {', '.join(METHODS)}, got {shown(self.method)}")
        most = 2**SOBOL_BITS if self.method == "sobol" else MOST_ITEMS
        object.__setattr__(self, "count", whole("count", self.count, 1, most))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(self.variables)

    def settings(self) -> dict[str, Any]:
        """Return what the columns depend on, besides the seed."""
        variables = {name: item.settings() for name, item in self.variables.items()}
        return {"kind": self.method, "order": list(self.names), "variables": variables}

    def draw(self, block: Block) -> dict[str, FloatArray]:
        """Return the columns of a block."""
        shares = _SHARES[self.method](block, len(self.variables))  # (n, d)
        return {name: item.at(shares[:, i]) for i, (name, item) in enumerate(self.variables.items())}


@dataclass(frozen=True)
class Grid(Readable):
    """All combinations of some values of each column; the last column changes fastest."""

    values: Mapping[str, Sequence[float]]  # the values of each column

    def __post_init__(self) -> None:
        axes = {name: frozen_array(name, value, ("N",)) for name, value in dict(self.values).items()}
        require_names(tuple(axes))
        for name, axis in axes.items():
            if not len(axis):
                raise InputError(f"{name}: expected one value or more, got none")
        object.__setattr__(self, "values", {name: tuple(axis.tolist()) for name, axis in axes.items()})
        whole("count", self.count, 1, MOST_ITEMS)

    @property
    def count(self) -> int:
        """How many combinations there are."""
        return math.prod(len(axis) for axis in self.values.values())

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(self.values)

    def settings(self) -> dict[str, Any]:
        """Return what the columns depend on."""
        return {"kind": "grid", "order": list(self.names), "values": {**self.values}}

    def draw(self, block: Block) -> dict[str, FloatArray]:
        """Return the columns of a block."""
        shape = [len(axis) for axis in self.values.values()]
        places = np.unravel_index(np.arange(block.start, block.stop), shape)
        pairs = zip(self.values.items(), places, strict=True)
        return {name: np.array(axis)[place] for (name, axis), place in pairs}


def require_names(names: tuple[Any, ...]) -> None:
    """Raise `InputError` unless there are names that columns can have."""
    if not names:
        raise InputError("variables: expected one column or more, got none")
    for name in names:
        if not isinstance(name, str) or not NAME.fullmatch(name):
            raise InputError(f"variables: expected names of letters, digits, _ and dots, got {shown(name)}")


def _random(block: Block, columns: int) -> FloatArray:
    return block.generator.random((len(block), columns))


def _latin_hypercube(block: Block, columns: int) -> FloatArray:
    from scipy.stats import qmc

    shares: FloatArray = qmc.LatinHypercube(columns, rng=block.generator).random(len(block))
    return shares


_sequences = threading.local()


def _sobol(block: Block, columns: int) -> FloatArray:
    """Return a part of Sobol's sequence; the last place is remembered, as blocks mostly follow each other."""
    from scipy.stats import qmc

    known = getattr(_sequences, "known", None)
    if known is None or known[0] != (block.seed, columns):
        generator = np.random.default_rng(np.random.SeedSequence(block.seed))
        try:
            sampler = qmc.Sobol(columns, bits=SOBOL_BITS, rng=generator)
        except ValueError as error:
            raise InputError(f"sobol: {error}") from error
        known = _sequences.known = ((block.seed, columns), sampler)
    sampler = known[1]
    if sampler.num_generated > block.start:
        sampler.reset()
    if sampler.num_generated < block.start:
        sampler.fast_forward(block.start - sampler.num_generated)
    if sampler.num_generated == 0 and len(block) > 1:  # SciPy asks for a power of two to begin with
        first = sampler.random(1)
        return np.concatenate([first, sampler.random(len(block) - 1)])
    shares: FloatArray = sampler.random(len(block))
    return shares


_SHARES = {"random": _random, "latin-hypercube": _latin_hypercube, "sobol": _sobol}
