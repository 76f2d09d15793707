"""How far a closed mechanism is from its singularities: numbers without dimension, and what would move.

Lengths are divided by one characteristic length ℓ first, in joints, closures and frames, so that the numbers
do not depend on units or on the size of the robot. With the closures' Jacobian J, orthonormal free motions N
of it, and singular values σ₁ ≥ σ₂ ≥ ... of a matrix:

- actuation: σₖ of Bᵀ N, k the smaller of motors and free motions: the share that the motors see of the free
  motion that they see least. At zero it goes on with locked motors, and no force of theirs resists. 0 to 1;
- closures: σᵣ / σ₁ of J, r its rank elsewhere. At zero the closures leave one more free motion;
- output: σₖ of the frame's Jacobian times N, k its rank elsewhere: how far the frame moves along the
  direction that it follows least, in a free motion of unit size. At zero it cannot move along it.

References
----------
C. Gosselin, J. Angeles, Singularity analysis of closed-loop kinematic chains, IEEE Transactions on Robotics
and Automation 6 (1990) 281-290.
D. Zlatanov, R. Fenton, B. Benhabib, A unifying framework for classification and interpretation of mechanism
singularities, Journal of Mechanical Design 117 (1995) 566-572.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, Readable, positive
from p3dof._base.errors import AssemblyError, DynamicsError, InputError
from p3dof.loops.closed_tree import CLOSED
from p3dof.loops.minimal import Setting, stacked
from p3dof.loops.regressor import random_motions
from p3dof.loops.units import size_of

_ELSEWHERE = 3  # random configurations at which ranks elsewhere are found

_MOVES = 0.1  # share of the largest speed from which on a freedom counts as moving
_RANK = 1e-7  # singular values of a frame's motion up to this one count as zero


@dataclass(frozen=True, eq=False)
class SingularityMargins(Readable):
    """Distances from singularities, at one configuration or (leading axis N) at many.

    All are without dimension and zero at the singularity; what they are `p3dof.loops.margins` says.

    Parameters
    ----------
    length : float
        The characteristic length [m].
    freedoms : tuple of str
        Names of the entries of v.
    actuation : (...) array
        Share of the least seen free motion that the motors see.
    actuation_direction : (..., nv) array
        That motion, as a velocity of the tree [m/s, rad/s], at unit size: near the singularity what moves
        with locked motors.
    closures : (...) array
        Least singular value of the closures' Jacobian, relative to the largest.
    closures_direction : (..., nv) array
        The motion that the closures resist least: what becomes free.
    output : (...) array
        Least motion of the frame; NaN without a frame.
    output_direction : (..., nv) array
        The free motion in which the frame moves least.
    output_twist : (..., 6) array
        The direction that the frame follows least, linear and angular, the former in units of `length`.
    """

    length: float
    freedoms: tuple[str, ...]
    actuation: FloatArray
    actuation_direction: FloatArray
    closures: FloatArray
    closures_direction: FloatArray
    output: FloatArray
    output_direction: FloatArray
    output_twist: FloatArray

    def moving(self, direction: FloatArray) -> tuple[str, ...]:
        """Return which freedoms move in a direction (nv,), the fastest first.

        Parameters
        ----------
        direction : (nv,) array
            One of the directions.
        """
        size = np.abs(np.asarray(direction))
        order = np.argsort(-size, kind="stable")
        return tuple(self.freedoms[k] for k in order if size[k] > _MOVES * size.max(initial=0.0))


class Homogeneous:
    """The Jacobian of the closures, free motions and frames of a configuration, without dimensions."""

    def __init__(self, J: FloatArray, rank: int, units_v: FloatArray, units_rows: FloatArray) -> None:
        self.units = units_v
        self._s, self._Vt = np.linalg.svd(J * units_v / units_rows[:, None])[1:]
        self.N = self._Vt[rank:].T

    def closures(self, rank: int) -> tuple[float, FloatArray]:
        """Return the margin of the closures, and its direction, for a rank elsewhere."""
        if not rank:
            return 1.0, np.zeros(len(self.units))
        return float(self._s[rank - 1] / self._s[0]), self._Vt[rank - 1] * self.units

    def actuation(self, actuated: NDArray[np.int_]) -> tuple[float, FloatArray]:
        """Return the margin of the actuation, and its direction."""
        seen = self.N[actuated]
        k = min(seen.shape)
        if not k:
            return 1.0, np.zeros(len(self.units))
        _, s, Vt = np.linalg.svd(seen)
        return float(s[k - 1]), self.N @ Vt[k - 1] * self.units

    def output(self, frame: FloatArray, rank: int) -> tuple[float, FloatArray, FloatArray]:
        """Return the margin of a frame (k, nv) for a rank elsewhere, the free motion, the direction (k,)."""
        U, s, Vt = np.linalg.svd(frame * self.units @ self.N)
        if not rank or rank > len(s):
            return 0.0, np.zeros(len(self.units)), np.zeros(len(frame))
        return float(s[rank - 1]), self.N @ Vt[rank - 1] * self.units, U[:, rank - 1]

    def output_rank(self, frame: FloatArray) -> int:
        """Return in how many directions a frame (k, nv) moves here."""
        s = np.linalg.svd(frame * self.units @ self.N, compute_uv=False)
        return int(np.count_nonzero(s > _RANK))


class Margins:
    """The margins of one robot, and what is known of its ranks elsewhere."""

    def __init__(self, setting: Setting) -> None:
        self._setting = setting
        self._output_ranks: dict[tuple[str, tuple[bool, ...]], int] = {}

    def at(
        self,
        q: ArrayLike,
        frame: str | None,
        components: Sequence[bool] | NDArray[np.bool_],
        length: float | None,
    ) -> SingularityMargins:
        """Return the margins at a configuration, see `ClosedLoopModel.singularity_margins`."""
        setting = self._setting
        if np.ndim(q) == 2:
            each = [self.at(one, frame, components, length) for one in setting.samples(q, None)[0]]
            return stacked(each, ("length", "freedoms"))
        unit = self._length if length is None else positive("length", length, InputError)
        mask = _checked(components)
        with setting.open():
            own = setting.robot.configuration("q", q) / setting.q
            setting.core.at(own, CLOSED)
            here = self._homogeneous(own, unit)
            held, held_direction = here.actuation(setting.actuated_v)
            rank = max(setting.core.generic_rank or 0, setting.core.rank(own))
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
        return size_of(self._setting.robot.model, self._setting.robot.sidecar) or 1.0

    @cached_property
    def _elsewhere(self) -> list[FloatArray]:
        """Some configurations with closed loops, in the model's own units."""
        try:
            draw = random_motions(self._setting.core, np.random.default_rng(0))
            return [draw()[0].q for _ in range(_ELSEWHERE)]
        except (AssemblyError, DynamicsError):
            return []

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
        lengths = setting.kinematics.lengths, setting.scaled.units.rows
        return Homogeneous(point.J, point.svd.rank, *(np.where(part, ratio, 1.0) for part in lengths))

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
