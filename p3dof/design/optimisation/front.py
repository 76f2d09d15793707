"""`Front`: designs that no other one is better than in all objectives, and what the start is beside them."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from p3dof._base.blocks import nondominated
from p3dof._base.checks import FloatArray, frozen_array
from p3dof._base.errors import InputError
from p3dof._base.files import write_table
from p3dof.design.optimisation.checking import Check, checked
from p3dof.design.optimisation.evaluated import Evaluated
from p3dof.design.optimisation.statement import Statement
from p3dof.machine.parameters import Parameters

_DIGITS = 9
"""In which objectives of two designs must differ."""


@dataclass(frozen=True, eq=False, repr=False)
class Front:
    """A Pareto front.

    Parameters
    ----------
    problem : Statement
        What was asked; two objectives or more.
    designs : ndarray, shape (K, n)
        Variables of designs that keep all constraints and do not dominate each other, by the second
        objective rising [SI units].
    unpolished : ndarray, shape (U, M)
        Objectives of what the genetic algorithm came to; empty where there was none.
    method : str
        How it was found.
    seed : int
        Of all random numbers.
    """

    problem: Statement
    designs: FloatArray
    unpolished: FloatArray
    method: str
    seed: int

    def __len__(self) -> int:
        return len(self.designs)

    def __repr__(self) -> str:
        names = ", ".join(measure.name for measure in self.problem.objectives)
        return f"Front({len(self)} designs by {names})"

    @cached_property
    def found(self) -> Evaluated:
        """Objectives and constraints of the designs."""
        return self.problem.evaluate(self.designs)

    @cached_property
    def start(self) -> Evaluated:
        """The same of the machine that there was."""
        return self.problem.evaluate(np.nan_to_num(self.problem.start, nan=0.0))

    @property
    def objectives(self) -> FloatArray:
        """Objectives of the designs, (K, M)."""
        return self.found.objectives

    def machine(self, index: int) -> Parameters:
        """Return one of the designs as a machine."""
        return self.problem.machine(self.designs[index])

    @cached_property
    def check(self) -> Check:
        """The design in the middle of the front, looked at again; see `Optimum.check`."""
        return checked(self.problem, self.designs[len(self) // 2])

    def hypervolume(self, reference: Any) -> float:
        """Return the size of what the front dominates, up to a reference point.

        Parameters
        ----------
        reference : array-like, shape (M,)
            The worst values that count, in the units of the objectives.

        Returns
        -------
        float
            In the product of these units.

        Raises
        ------
        InputError
            If the point has another shape.
        """
        signs = signs_of(self.problem)
        corner = signs * frozen_array("reference", reference, (len(signs),))
        return hypervolume(signs * self.objectives, corner)

    def to_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write all designs to a CSV file, one a row; `p3dof designs` reads their variables.

        Parameters
        ----------
        path : path-like
            The file; replaced whole or not at all.

        Returns
        -------
        Path
            The path written.

        Raises
        ------
        InputError
            If its name does not end in ``.csv``.
        FileError
            If the file cannot be written.
        """
        columns = self.found.to_columns()
        return write_table(path, list(columns), tuple(columns.values()))


def signs_of(problem: Statement) -> FloatArray:
    """Return 1 for objectives that are to be small, -1 for others, (M,)."""
    return np.array([1.0 if measure.better == "small" else -1.0 for measure in problem.objectives])


def efficient(problem: Statement, designs: FloatArray) -> FloatArray:
    """Return the designs that keep all constraints and that none of the others dominates, in an order.

    Parameters
    ----------
    problem : Statement
        What they are designs of.
    designs : ndarray, shape (K, n)
        Variables [SI units].

    Returns
    -------
    ndarray, shape (E, n)
        By the second objective rising.
    """
    found = problem.evaluate(designs)
    costs = signs_of(problem) * found.objectives
    good = np.flatnonzero(found.feasible & np.isfinite(costs).all(axis=1))
    scales = np.maximum(np.abs(costs[good]).max(axis=0, initial=0.0), 1e-300)
    rounded = (costs[good] / scales).round(
        _DIGITS
    )  # optima of different starts are the same but for rounding
    _, first = np.unique(rounded, axis=0, return_index=True)
    good, rounded = good[first], rounded[first]
    good = good[nondominated(rounded)]
    return designs[good[np.argsort(found.objectives[good, 1], kind="stable")]]


def hypervolume(costs: FloatArray, corner: FloatArray) -> float:
    """Return the volume between costs that are to be small and a corner, slice by slice of the last one.

    Parameters
    ----------
    costs : ndarray, shape (K, M)
        Those beyond the corner do not count.
    corner : ndarray, shape (M,)
        The worst costs.

    Returns
    -------
    float
    """
    inside = costs[(costs < corner).all(axis=1)]
    if not len(inside):
        return 0.0
    if costs.shape[1] == 1:
        return float(corner[0] - inside.min())
    order = inside[np.argsort(inside[:, -1], kind="stable")]
    steps = np.append(order[1:, -1], corner[-1]) - order[:, -1]
    parts = [
        step * hypervolume(order[: index + 1, :-1], corner[:-1])
        for index, step in enumerate(steps)
        if step > 0
    ]
    return float(sum(parts))


def require_objectives(problem: Statement) -> None:
    """Raise `InputError` unless there are two objectives or more."""
    if len(problem.objectives) < 2:
        raise InputError("objectives: expected two or more for a Pareto front, got one")
