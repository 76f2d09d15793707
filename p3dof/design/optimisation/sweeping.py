"""`ProblemSweep`: any number of designs of a problem, as a problem of `p3dof.sweep`."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.blocks import Block, ParetoArchive, Samples, Uniform
from p3dof._base.blocks.sampling import Method
from p3dof.design.optimisation.measure import Measure
from p3dof.design.optimisation.statement import Statement


class ProblemSweep:
    """Designs that fill the bounds of a design problem, for `p3dof.sweep`.

    The columns are the variables by their full names, the objectives and the bounded measures by theirs,
    ``violation`` (0 for designs that keep all constraints) and ``status`` (a `DesignStatus`). Objectives of
    designs that miss constraints are NaN, so that reductions leave them out.

    Parameters
    ----------
    problem : Statement
        What designs are measured by.
    count : int
        How many designs.
    sampling : {"sobol", "random", "latin-hypercube"}
        How they fill the bounds.
    block_size : int
        Designs of a block where nobody says how many.

    Raises
    ------
    InputError
        If an argument does not fit.
    """

    def __init__(
        self, problem: Statement, count: int, sampling: Method = "sobol", block_size: int = 5000
    ) -> None:
        bounds = zip(problem.variables.low.tolist(), problem.variables.high.tolist(), strict=True)
        spreads = (Uniform(low, high) for low, high in bounds)
        self.sampling = Samples(dict(zip(problem.variables.names, spreads, strict=True)), count, sampling)
        self.problem, self.block_size = problem, block_size

    @property
    def count(self) -> int:
        """How many designs there are."""
        return self.sampling.count

    @cached_property
    def _measures(self) -> dict[str, Measure]:
        named = {measure.name: measure for measure in self.problem.objectives}
        for index, item in enumerate(self.problem.constraints):
            simple = item.measure.name.replace("_", "").isalnum()
            named.setdefault(item.measure.name if simple else f"relation_{index}", item.measure)
        return named

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return (*self.problem.variables.names, *self._measures, "violation", "status")

    @property
    def units(self) -> dict[str, str]:
        """Units of the columns that have one."""
        known = dict(zip(self.problem.variables.names, self.problem.variables.units, strict=True))
        known |= {name: measure.unit for name, measure in self._measures.items()}
        return {name: unit for name, unit in known.items() if unit}

    @property
    def reductions(self) -> tuple[ParetoArchive, ...]:
        """What to find where nobody says: the Pareto front of the objectives."""
        ways: Any = {m.name: "min" if m.better == "small" else "max" for m in self.problem.objectives}
        return (ParetoArchive(ways),)

    def settings(self) -> dict[str, Any]:
        """Return everything that the results depend on."""
        return {"problem": self.problem.settings(), "sampling": dict(self.sampling.settings())}

    def compute(self, block: Block) -> dict[str, NDArray[Any]]:
        """Return the columns of a block."""
        drawn = self.sampling.draw(block)
        found = self.problem.evaluate(np.column_stack(list(drawn.values())))
        good, columns = found.feasible, dict[str, NDArray[Any]](drawn)
        objectives = {measure.name for measure in self.problem.objectives}
        values = np.concatenate([found.objectives, found.constraints], axis=1)
        measures = [*self.problem.objectives, *(item.measure for item in self.problem.constraints)]
        for name, measure in self._measures.items():
            column = values[:, next(k for k, each in enumerate(measures) if each is measure)]
            columns[name] = np.where(good, column, np.nan) if name in objectives else column
        return {**columns, "violation": found.violation, "status": found.status.astype(np.int64)}
