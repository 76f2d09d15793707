"""Designs computed elsewhere: handed to a client in blocks, or as a problem of `p3dof.sweep`."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from p3dof.checks import FloatArray, Progress, shown
from p3dof.designs.columns import BodiesOfDesigns, Designs
from p3dof.designs.names import full_name
from p3dof.designs.problem import BLOCK, DesignProblem
from p3dof.designs.results import DesignForces
from p3dof.errors import InputError
from p3dof.parameters import PAPER, Parameters

AT_A_TIME = 16 * BLOCK
"""Designs of a block: tenths of a second of work."""

_IN_FLIGHT = 32
"""Blocks that are handed over before the first one is asked for."""


def evaluate_with(
    client: Any, problem: DesignProblem, designs: Designs, progress: Progress | None = None
) -> DesignForces:
    """Return what designs need over a motion, computed by the workers of a client.

    Parameters
    ----------
    client : distributed.Client or concurrent.futures.Executor
        Who computes.
    problem : DesignProblem
        What is asked of the designs.
    designs : Designs
        The machines.
    progress : callable, optional
        Called with the number of designs done and of all.

    Returns
    -------
    DesignForces
        The same bits as of this process.

    Raises
    ------
    InputError
        If `client` is something else, or a column to differentiate by is missing.
    """
    if not callable(getattr(client, "submit", None)):
        raise InputError(
            f"client: expected a distributed.Client or an executor of concurrent.futures, got {shown(client)}"
        )
    problem.check(designs)
    options = {"pure": False} if hasattr(client, "scheduler_info") else {}  # Dask would hash all columns
    starts = range(0, len(designs), AT_A_TIME) or range(1)
    pending: deque[Any] = deque()
    found: list[DesignForces] = []
    waiting = iter(starts)
    try:
        while len(found) < len(starts):
            while len(pending) < _IN_FLIGHT and (start := next(waiting, None)) is not None:
                part = designs.part(start, min(start + AT_A_TIME, len(designs)))
                pending.append(client.submit(problem.evaluate, part, **options))
            found.append(pending.popleft().result())
            if progress is not None:
                progress(min(len(found) * AT_A_TIME, len(designs)), len(designs))
    finally:
        for future in pending:
            future.cancel()
    return joined(found)


def joined(parts: list[DesignForces]) -> DesignForces:
    """Return the results of several blocks as one."""
    values: dict[str, Any] = {}
    for item in fields(DesignForces):
        each = [getattr(part, item.name) for part in parts]
        if item.name != "gradients":
            values[item.name] = None if each[0] is None else np.concatenate(each)
    gradients = {
        name: {figure: np.concatenate([part.gradients[name][figure] for part in parts]) for figure in figures}
        for name, figures in parts[0].gradients.items()
    }
    return DesignForces(**values, gradients=gradients)


class _Sampling(Protocol):
    """Where designs come from: such as `p3dof.blocks.Samples` or `p3dof.blocks.Grid`."""

    @property
    def count(self) -> int: ...
    @property
    def names(self) -> tuple[str, ...]: ...
    def settings(self) -> Mapping[str, Any]: ...
    def draw(self, block: Any) -> dict[str, FloatArray]: ...


@dataclass(frozen=True, eq=False)
class DesignSweep:
    """Designs as a problem of `p3dof.blocks.sweep`: of any number, drawn block by block, stored or reduced.

    Parameters
    ----------
    problem : DesignProblem
        What is asked of the designs.
    sampling : Sampling
        Columns of designs, in SI units, by the names of `Designs`: random numbers, a grid.
    machine : Parameters
        What has no column.
    bodies : {"kept", "solids"}
        Where the bodies come from, as of `Designs`.
    block_size : int
        Designs of a block where nobody says how many.

    Raises
    ------
    InputError
        If a column has no meaning.
    """

    problem: DesignProblem
    sampling: _Sampling
    machine: Parameters = field(default_factory=lambda: PAPER)
    bodies: BodiesOfDesigns = "kept"
    block_size: int = AT_A_TIME

    def __post_init__(self) -> None:
        for name in self.sampling.names:
            full_name(name)
        self.problem.check(self._designs({name: np.zeros(1) for name in self.sampling.names}))

    @property
    def count(self) -> int:
        """How many designs there are."""
        return self.sampling.count

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns: of the designs, ``status``, and the figures without their units."""
        return (*self.sampling.names, *self._named(self._none()))

    def settings(self) -> dict[str, Any]:
        """Return everything that the results depend on."""
        return {
            "figures": self.problem.settings(),
            "machine": self.machine.to_dict(),
            "bodies": self.bodies,
            "sampling": dict(self.sampling.settings()),
        }

    def compute(self, block: Any) -> dict[str, NDArray[Any]]:
        """Return the columns of a block."""
        columns = self.sampling.draw(block)
        return {**columns, **self._named(self.problem.evaluate(self._designs(columns)))}

    def _designs(self, columns: Mapping[str, FloatArray]) -> Designs:
        return Designs(columns, self.machine, self.bodies)

    def _none(self) -> DesignForces:
        nothing = {name: np.zeros(0) for name in self.sampling.names}
        return self.problem.evaluate(self._designs(nothing))

    def _named(self, found: DesignForces) -> dict[str, NDArray[Any]]:
        """Return figures by names without units: ``d_peak_force_a.geometry.R`` of a gradient."""
        return {
            name.partition(" [")[0].replace("/d_", "."): column for name, column in found.to_columns().items()
        }
