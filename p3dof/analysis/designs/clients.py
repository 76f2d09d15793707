"""Designs computed elsewhere: handed to the workers of a client in blocks, in memory.

`p3dof.design.sweeps` stores blocks, resumes, and reduces what is too much to store.
"""

from __future__ import annotations

from collections import deque
from dataclasses import fields
from typing import Any

import numpy as np

from p3dof._base.checks import Progress, shown
from p3dof._base.errors import InputError
from p3dof.analysis.designs.columns import Designs
from p3dof.analysis.designs.evaluation import BLOCK, DesignEvaluation
from p3dof.analysis.designs.results import DesignForces

AT_A_TIME = 16 * BLOCK
"""Designs of a block: tenths of a second of work."""

_IN_FLIGHT = 32
"""Blocks that are handed over before the first one is asked for."""


def evaluate_with(
    client: Any, evaluation: DesignEvaluation, designs: Designs, progress: Progress | None = None
) -> DesignForces:
    """Return what designs need over a motion, computed by the workers of a client.

    Parameters
    ----------
    client : distributed.Client or concurrent.futures.Executor
        Who computes.
    evaluation : DesignEvaluation
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
    evaluation.check(designs)
    options = {"pure": False} if hasattr(client, "scheduler_info") else {}  # Dask would hash all columns
    starts = range(0, len(designs), AT_A_TIME) or range(1)
    pending: deque[Any] = deque()
    found: list[DesignForces] = []
    waiting = iter(starts)
    try:
        while len(found) < len(starts):
            while len(pending) < _IN_FLIGHT and (start := next(waiting, None)) is not None:
                part = designs.part(start, min(start + AT_A_TIME, len(designs)))
                pending.append(client.submit(evaluation.evaluate, part, **options))
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
