"""States of blocks merged into states of a sweep, a few at a time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from p3dof._base.blocks.manifest import Manifest
from p3dof._base.blocks.reduction import State

_FEW = 16
"""States that wait to be merged together."""


class Totals:
    """What reductions found in the blocks that were added, in any order.

    Parameters
    ----------
    manifest : Manifest
        Of the sweep.
    """

    def __init__(self, manifest: Manifest) -> None:
        self._reductions = manifest.reductions
        nothing = {name: np.zeros(0) for name in manifest.columns}
        self._waiting: list[list[State]] = [[reduction.of(nothing, 0)] for reduction in self._reductions]

    def add(self, states: Sequence[State]) -> None:
        """Add what was found in one block."""
        for reduction, waiting, state in zip(self._reductions, self._waiting, states, strict=True):
            waiting.append(state)
            if len(waiting) > _FEW:
                waiting[:] = [reduction.merge(waiting)]

    def states(self) -> tuple[State, ...]:
        """Return one state of each reduction."""
        return tuple(
            reduction.merge(waiting)
            for reduction, waiting in zip(self._reductions, self._waiting, strict=True)
        )
