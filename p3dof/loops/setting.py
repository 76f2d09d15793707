"""A robot as its analyses compute it: in its own unit of length, with the factors to SI units."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.threads import Workspace
from p3dof.loops.closure_kinds import lengths_of
from p3dof.loops.independent import Independent, coordinate_names
from p3dof.loops.loop_model import LoopModel
from p3dof.loops.tree_tangents import Tree


class Setting(Workspace):
    """A robot in its own unit of length.

    Parameters
    ----------
    loop : LoopModel
        The robot.

    Raises
    ------
    ModelError
        If a joint is of a kind that is no chain of joints with fixed axes.
    """

    def __init__(self, loop: LoopModel) -> None:
        scaled, model = loop._scaled, loop.model
        self.core: LoopModel = loop if scaled is None else scaled.core
        """The robot in these units; itself if they are metres."""
        self._scaled = scaled
        self.kinematics, self.couplings = self.core._kinematics, self.core.sidecar.couplings
        self.actuated = loop.actuated_v
        self.names = coordinate_names(model)
        self.tree = Tree(self.core.model)
        self.si_tree = self.tree if scaled is None else Tree(model)
        lengths = self.kinematics.lengths
        self.length = 1.0 if scaled is None else scaled.units.length
        """The unit of length [m]."""
        u = self.length
        self.q = np.ones(model.nq) if scaled is None else scaled.units.motion(scaled.units.q)
        self.v: FloatArray = np.where(lengths, u, 1.0)
        self.force: FloatArray = np.where(lengths, u, u**2)
        rows = [is_length for closure in self.kinematics.closures for is_length in lengths_of(closure.kind)]
        rows += lengths[self.kinematics.couplings.following].tolist()
        self.length_rows = np.array(rows, dtype=bool)
        """Which rows of closures and couplings are lengths."""
        self.rows: FloatArray = np.where(self.length_rows, u, u**2)
        """Units of their multipliers."""
        linear = np.arange(6) < 3
        self.twist: FloatArray = np.where(linear, u, 1.0)
        self.wrench: FloatArray = np.where(linear, u, u**2)

    @contextmanager
    def open(self) -> Iterator[None]:
        """Bring masses up to date, and say in errors in which unit their numbers are."""
        if self._scaled is not None:
            with self._scaled.in_words():
                self.tree.refresh()
                self.si_tree.refresh()
                yield
        else:
            self.tree.refresh()
            yield

    def motion(self, independent: Independent) -> FloatArray:
        """Return N (nv, n) of coordinates in SI units."""
        return np.asarray(self.v[:, None] * independent.N / self.v[independent.v])
