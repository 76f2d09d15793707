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

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray

_MOVES = 0.1
"""Share of the largest speed from which on a freedom counts as moving."""
_RANK = 1e-7
"""Singular values of a frame's motion up to this one count as zero."""


@dataclass(frozen=True, eq=False)
class SingularityMargins:
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
    """The Jacobian of the closures, free motions and frames of a configuration, without dimensions.

    Parameters
    ----------
    J : (rows, nv) array
        Jacobian of the closures.
    rank : int
        Its rank at the configuration.
    units_v : (nv,) array
        ℓ where an entry of v is a length, else 1.
    units_rows : (rows,) array
        The same of the closures' rows.
    """

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
