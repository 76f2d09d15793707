"""`Measure`: a number of a design that can be an objective or be bounded, with its exact gradient.

Most measures are the worst of several *pieces*: a peak is the largest of the forces at all samples, a margin
the least over all poses. Each piece is smooth where the worst of them is not, so that optimisers which need
gradients are given the pieces (in epigraph form), and all others the worst.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, Literal, Protocol, TypeAlias, runtime_checkable

import numpy as np

from p3dof._base.checks import FloatArray, Readable, shown
from p3dof._base.errors import InputError
from p3dof.analysis.designs import Designs
from p3dof.analysis.designs.figures import FigureGroup
from p3dof.design.optimisation.population import STEP, Numbers, Population

Better: TypeAlias = Literal["small", "large"]
"""Whether small or large numbers of a measure are good; its worst piece is the other end."""


class Pieces:
    """The pieces of a measure, and their derivatives by all variables of the problem.

    `gradients`: by the variables, in SI units; a function that returns them is called when they are asked
    for.
    """

    def __init__(self, values: FloatArray, gradients: FloatArray | Callable[[], FloatArray]) -> None:
        self.values, self._gradients = values, gradients

    @cached_property
    def gradients(self) -> FloatArray:
        """Derivatives by the variables, (D, P, n)."""
        return self._gradients() if callable(self._gradients) else self._gradients


@runtime_checkable
class Measure(Protocol):
    """A number of a design. Objects of any class with these doors will do, if they can be pickled."""

    @property
    def name(self) -> str:
        """What it is called in tables and files."""

    @property
    def unit(self) -> str:
        """Its SI unit; empty for plain numbers."""

    @property
    def better(self) -> Better:
        """Whether small or large is good."""

    @property
    def figures(self) -> tuple[FigureGroup, ...]:
        """Groups of figures over the motion that it needs beside the forces."""

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,); NaN where there is none."""

    def pieces(self, population: Population) -> Pieces:
        """Return its pieces and their gradients."""


@dataclass(frozen=True)
class OfDesigns:
    """What is known of a measure that has a name here."""

    name: str  # as of `Measure`
    unit: str
    better: Better
    about: str  # what it is, in a line
    figures: tuple[FigureGroup, ...] = field(default=(), kw_only=True)


@dataclass(frozen=True)
class ClosedForm(OfDesigns):
    """A measure that is a formula of the numbers of designs, differentiated by complex steps."""

    formula: Callable[[Numbers, Population], Any]
    """From `Numbers` and `Population` to pieces (D, P): analytic in the numbers."""

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,)."""
        with np.errstate(all="ignore"):
            found = np.asarray(self.formula(population.numbers, population), dtype=np.float64)
        found = np.broadcast_to(found, (len(population), found.shape[-1]))
        return worst_of(found, self.better)

    def pieces(self, population: Population) -> Pieces:
        """Return its pieces and their gradients."""
        with np.errstate(all="ignore"):
            values = np.asarray(self.formula(population.numbers, population), dtype=np.float64)
        shape = (len(population), values.shape[-1])
        return Pieces(np.broadcast_to(values, shape), partial(self._gradients, population, shape))

    def _gradients(self, population: Population, shape: tuple[int, int]) -> FloatArray:
        with np.errstate(all="ignore"):
            moved = [
                np.imag(self.formula(population.stepped(name), population)) / STEP
                for name in population.setting.names
            ]
        return np.stack([np.broadcast_to(each, shape) for each in moved], axis=-1)


@dataclass(frozen=True)
class FunctionMeasure(Readable):
    """A measure by a function of one's own.

    Parameters
    ----------
    name, unit, better
        As of `Measure`.
    function : callable
        Called with `Designs` and with the full names of the variables. Returns values (D,) or pieces (D, P),
        and derivatives (D, n) or (D, P, n) by the variables, or None in their place where no names are given
        (``()``): then only values are needed.
    figures : tuple
        As of `Measure`.

    Raises
    ------
    InputError
        If `better` is neither ``"small"`` nor ``"large"``.
    """

    name: str
    unit: str
    function: Callable[[Designs, tuple[str, ...]], tuple[FloatArray, FloatArray | None]]
    better: Better = "small"
    figures: tuple[FigureGroup, ...] = field(default=())

    def __post_init__(self) -> None:
        if self.better not in ("small", "large"):
            raise InputError(f"better: expected 'small' or 'large', got {shown(self.better)}")

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,)."""
        found = np.asarray(self.function(population.designs, ())[0], dtype=np.float64)
        self._require(found.shape[:1] == (len(population),) and found.ndim <= 2, found.shape)
        return found if found.ndim == 1 else worst_of(found, self.better)

    def pieces(self, population: Population) -> Pieces:
        """Return its pieces and their gradients."""
        names = population.setting.names
        values, gradients = self.function(population.designs, names)
        if gradients is None:
            raise InputError(f"{self.name}: expected derivatives by {', '.join(names)}, got None")
        values = np.asarray(values, dtype=np.float64).reshape(len(population), -1)
        expected = (*values.shape, len(names))
        found = np.asarray(gradients, dtype=np.float64)
        self._require(found.size == np.prod(expected), found.shape)
        return Pieces(values, found.reshape(expected))

    def _require(self, fits: bool, shape: tuple[int, ...]) -> None:
        if not fits:
            raise InputError(f"{self.name}: expected a number for each design, got the shape {shape}")


def worst_of(pieces: FloatArray, better: Better) -> FloatArray:
    """Return the worst of pieces (D, P) of each design, (D,)."""
    found: FloatArray = pieces.max(axis=1) if better == "small" else pieces.min(axis=1)
    return found


def worst_gradient(pieces: Pieces, better: Better) -> FloatArray:
    """Return the derivatives of the worst of pieces, (D, n): where two tie, those of the first."""
    at = pieces.values.argmax(axis=1) if better == "small" else pieces.values.argmin(axis=1)
    found: FloatArray = np.take_along_axis(pieces.gradients, at[:, None, None], axis=1)[:, 0]
    return found
