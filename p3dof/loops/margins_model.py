"""`MarginsModel`: how far any robot is from its singularities."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, positive
from p3dof._base.errors import AssemblyError, DynamicsError, InputError
from p3dof.loops.base_parameters import random_motions
from p3dof.loops.closed_tree import CLOSED
from p3dof.loops.identification_model import IdentificationModel
from p3dof.loops.margins import Homogeneous, SingularityMargins
from p3dof.loops.minimal import stacked
from p3dof.loops.units import size_of

_ELSEWHERE = 3
"""Random configurations at which ranks elsewhere are found."""


class MarginsModel(IdentificationModel):
    """Distances of any robot from its singularities."""

    def singularity_margins(
        self,
        q: ArrayLike,
        frame: str | None = None,
        components: Sequence[bool] | NDArray[np.bool_] = (True,) * 6,
        length: float | None = None,
    ) -> SingularityMargins:
        """Return how far a configuration is from singularities of actuation, closures and a frame.

        Parameters
        ----------
        q : (nq,) or (N, nq) array
            Configuration, with closed loops; or many of them.
        frame : str, optional
            The frame whose motion counts.
        components : (6,) array of bool
            Which of x, y, z, rx, ry, rz of the frame count, in world axes.
        length : float, optional
            The characteristic length by which lengths are divided [m]; by default the longest distance
            between the origin of a joint and what the model fixes to its body.

        Returns
        -------
        SingularityMargins

        Raises
        ------
        InputError
            If `q` has the wrong shape, is not finite or not normalised, the loops are open by more than 1e-5,
            the frame does not exist, or the length is not positive.
        """
        if np.ndim(q) == 2:
            q, _ = self._samples(q, None)
            each = [self.singularity_margins(one, frame, components, length) for one in q]
            return stacked(each, ("length", "freedoms"))
        unit = self._length if length is None else positive("length", length, InputError)
        mask = _checked(components)
        setting = self._setting
        with setting.open():
            own = self._configuration("q", q) / setting.q
            setting.core._at(own, CLOSED)
            here = self._homogeneous(own, unit)
            held, held_direction = here.actuation(self.actuated_v)
            rank = max(self.generic_rank or 0, setting.core.rank(own))
            loops, loops_direction = here.closures(rank)
            moved, twist = np.nan, np.full(6, np.nan)
            moved_direction: FloatArray = np.full(len(here.units), np.nan)
            if frame is not None:
                J = self._frame_rows(own, frame, mask, unit)
                elsewhere = self._output_rank(frame, mask, unit)
                moved, moved_direction, along = here.output(J, max(elsewhere, here.output_rank(J)))
                twist = np.zeros(6)
                twist[mask] = along
        return SingularityMargins(
            length=unit,
            freedoms=setting.names,
            actuation=np.array(held),
            actuation_direction=held_direction,
            closures=np.array(loops),
            closures_direction=loops_direction,
            output=np.array(moved),
            output_direction=moved_direction,
            output_twist=twist,
        )

    @cached_property
    def _length(self) -> float:
        """The default characteristic length [m]."""
        return size_of(self.model, self.sidecar) or 1.0

    @cached_property
    def _elsewhere(self) -> list[FloatArray]:
        """Some configurations with closed loops, in the model's own units."""
        try:
            draw = random_motions(self._setting.core, np.random.default_rng(0))
            return [draw()[0].q for _ in range(_ELSEWHERE)]
        except (AssemblyError, DynamicsError):
            return []

    @cached_property
    def _output_ranks(self) -> dict[tuple[str, tuple[bool, ...]], int]:
        return {}

    def _output_rank(self, frame: str, mask: NDArray[np.bool_], unit: float) -> int:
        """Return in how many directions a frame moves at other configurations."""
        key = frame, tuple(mask.tolist())
        if key not in self._output_ranks:
            ranks = [
                self._homogeneous(q, unit).output_rank(self._frame_rows(q, frame, mask, unit))
                for q in self._elsewhere
            ]
            self._output_ranks[key] = max(ranks, default=0)
        return self._output_ranks[key]

    def _homogeneous(self, own: FloatArray, unit: float) -> Homogeneous:
        """Return closures and free motions at a configuration in the model's own units."""
        setting = self._setting
        point, ratio = setting.kinematics.at(own), unit / setting.length
        lengths = setting.kinematics.lengths
        return Homogeneous(
            point.J, point.svd.rank, np.where(lengths, ratio, 1.0), np.where(setting.length_rows, ratio, 1.0)
        )

    def _frame_rows(self, own: FloatArray, frame: str, mask: NDArray[np.bool_], unit: float) -> FloatArray:
        """Return the rows (k, nv) of a frame's Jacobian, lengths divided by the characteristic one."""
        k = self._setting.kinematics
        k.at(own)
        place = k.frame(frame, "frame", InputError)
        arguments = k.model, k.data, place.parentJoint, place.placement, pin.LOCAL_WORLD_ALIGNED
        J = np.array(pin.getFrameJacobian(*arguments))
        J[:3] /= unit / self._setting.length
        return J[mask]


def _checked(components: Sequence[bool] | NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which components count, as an array."""
    try:
        mask = np.array(components)
    except ValueError:  # of parts of several lengths
        mask = np.zeros(0)
    if mask.shape != (6,) or mask.dtype != np.bool_ or not mask.any():
        raise InputError("components: expected six bools, at least one of them true")
    return mask
