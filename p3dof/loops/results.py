"""What is found of one sample's dynamics; evidence when it is asked for."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from typing_extensions import Self

from p3dof._base.checks import FloatArray, Readable
from p3dof.loops.closures import ClosurePoint, max_abs
from p3dof.loops.linear import Decomposition, actuation_of, determined


class ClosureForces:
    """What the closures have to bear in a motion."""

    _rows: FloatArray | None = None
    _force_unit = 1.0
    _length = 1.0

    def __init__(self, point: ClosurePoint, force: FloatArray, lambda_: FloatArray | None = None) -> None:
        self.point, self._force, self._known = point, force, lambda_

    def in_units(self, rows: FloatArray, force: float, length: float) -> Self:
        """Return the same in other units: of the multipliers (rows,), of the largest force, of length."""
        same = copy(self)
        for name in ("lambda_", "residual"):
            vars(same).pop(name, None)
        same._rows, same._force_unit, same._length = rows, force, length
        return same

    @cached_property
    def lambda_(self) -> FloatArray:
        """The smallest multipliers (rows,)."""
        return read_only(self._multipliers if self._rows is None else self._multipliers * self._rows)

    @cached_property
    def residual(self) -> float:
        """The largest error of the full equation of motion."""
        return self._force_unit * max_abs(self._force - self.point.J.T @ self._multipliers)

    @property
    def gap(self) -> float:
        """The largest closure error."""
        return self.point.gap * self._length

    @property
    def _multipliers(self) -> FloatArray:
        if self._known is None:
            self._known = self.point.svd.solve_transpose(self._force)
        return self._known


class ActuatedForces(ClosureForces):
    """What actuators and closures have to bear in a motion; also see `ClosureForces`."""

    def __init__(
        self,
        point: ClosurePoint,
        force: FloatArray,
        actuated_v: NDArray[np.int_],
        lambda_: FloatArray | None = None,
        actuation: Decomposition | None = None,
    ) -> None:
        super().__init__(point, force, lambda_)
        self._actuated_v = actuated_v
        if actuation is not None:
            self.actuation = actuation

    @cached_property
    def actuation(self) -> Decomposition:
        """See `actuation_of`."""
        return actuation_of(self.point.svd, self._actuated_v)

    @property
    def rank(self) -> int:
        """Rank of the closures' Jacobian."""
        return self.point.svd.rank

    @property
    def mobility(self) -> int:
        """Free motions of the closed mechanism."""
        return self.point.J.shape[1] - self.rank

    @property
    def tau_unique(self) -> bool:
        """Whether the forces are determined."""
        return self.actuation.rank == len(self._actuated_v)

    @cached_property
    def unique(self) -> NDArray[np.bool_]:
        """Which multipliers are determined (rows,)."""
        return read_only(determined(self.point.svd, self.actuation, self._actuated_v))

    @property
    def conditioning(self) -> float:
        """The smallest singular value of Nᵀ B; one without any."""
        return self.actuation.least


class AcceleratedClosures(ClosureForces):
    """What the closures have to bear under given forces; also see `ClosureForces`."""

    def __init__(
        self, point: ClosurePoint, force: FloatArray, opening: FloatArray, lambda_: FloatArray | None = None
    ) -> None:
        super().__init__(point, force, lambda_)
        self._opening = opening

    @property
    def closure_residual(self) -> float:
        """The largest relative acceleration that is left at a closure."""
        return max_abs(self._opening) * self._length


class _Proven(Readable):
    """What the evidence for the dynamics of a sample tells of the closures."""

    evidence: ClosureForces

    @property
    def lambda_(self) -> FloatArray:
        """Multipliers of closures and couplings (rows,), in their order.

        ``3d`` and ``6d``: force [N], then moment [N m], that the closure exerts on the body of `frame2`, in
        the axes of `frame1` at their common origin; the body of `frame1` gets the opposite. The same for
        those rows of the other kinds that prescribe a position or a rotation, see
        `p3dof.loops.closure_kinds`; the force acts at the origin of `frame2`. A coupling: the force
        [N or N m] that it exerts in the joint that follows; `on` gets that times -p'(q_on), each of `others`
        times -f. The smallest possible where not unique.
        """
        return self.evidence.lambda_

    @property
    def residual(self) -> float:
        """Largest error of the full equation of motion [N or N m]."""
        return self.evidence.residual

    @property
    def gap(self) -> float:
        """Largest closure error of the configuration [m or rad]."""
        return self.evidence.gap


class _Driven(_Proven):
    """What it tells of the actuators too."""

    evidence: ActuatedForces

    @property
    def unique(self) -> NDArray[np.bool_]:
        """Which multipliers are determined, (rows,) array of bool."""
        return self.evidence.unique

    @property
    def tau_unique(self) -> bool:
        """Whether `tau` is determined: no actuator's force can change with nothing but closures bearing it.

        Not so if the mechanism has more actuators than mobility, or where it is singular.
        """
        return self.evidence.tau_unique

    @property
    def rank(self) -> int:
        """Rank of the closures' Jacobian."""
        return self.evidence.rank

    @property
    def mobility(self) -> int:
        """Free motions of the closed mechanism: nv - rank."""
        return self.evidence.mobility

    @property
    def conditioning(self) -> float:
        """Smallest singular value of Nᵀ B, between 0 and 1, N being orthonormal free motions.

        Up to rounding it is 0 where the actuators cannot hold the mechanism although there are enough of
        them, and where forces of some of them do nothing although there are none to spare; nowhere else.
        """
        return self.evidence.conditioning


@dataclass(frozen=True, eq=False)
class InverseDynamics(_Driven):
    """Actuator forces that produce a motion, and the evidence for them.

    Parameters
    ----------
    tau : (n_actuated,) array
        Forces of the actuated joints [N or N m]; the smallest possible if they are not unique.
    evidence : ActuatedForces
        What all other attributes ask: it is found out when it is asked for, from what the call has stored.
    """

    tau: FloatArray
    evidence: ActuatedForces


@dataclass(frozen=True, eq=False)
class ForwardDynamics(_Proven):
    """Acceleration that actuator forces produce, and the evidence for it.

    Parameters
    ----------
    a : (nv,) array
        Acceleration of the whole tree.
    evidence : AcceleratedClosures
        What all other attributes ask: it is found out when it is asked for, from what the call has stored.
    """

    a: FloatArray
    evidence: AcceleratedClosures

    @property
    def closure_residual(self) -> float:
        """Largest relative acceleration that is left at a closure, J a + J̇ v [m/s² or rad/s²].

        What the stabilisation puts there is not counted.
        """
        return self.evidence.closure_residual


def read_only(array: np.ndarray) -> np.ndarray:
    """Return an array that nobody can write to any more."""
    array.setflags(write=False)
    return array


class PrescribedMotion(ActuatedForces):
    """What closures have to bear where accelerations are prescribed; also see `ActuatedForces`."""

    def __init__(
        self,
        point: ClosurePoint,
        force: FloatArray,
        actuated_v: NDArray[np.int_],
        prescribed: FloatArray,
        errors: tuple[FloatArray, FloatArray],
    ) -> None:
        super().__init__(point, force, actuated_v)
        self.opening, self.off = errors
        self._prescribed = prescribed

    @property
    def prescribed_residual(self) -> float:
        """The largest error of a prescribed acceleration."""
        return max_abs(self.off) * max(1.0, self._length)

    @property
    def closure_residual(self) -> float:
        """The largest relative acceleration that is left at a closure."""
        return max_abs(self.opening) * max(1.0, self._length)

    @cached_property
    def prescribed_conditioning(self) -> float:
        """The smallest singular value of S N; one without any."""
        s = np.linalg.svd(self._prescribed @ self.point.svd.null_space, compute_uv=False)
        return float(s[-1]) if s.size else 1.0


@dataclass(frozen=True, eq=False)
class HybridDynamics(_Driven):
    """Actuator forces that produce prescribed accelerations, the motion with them, and the evidence.

    Parameters
    ----------
    tau : (n_actuated,) array
        Forces of the actuated joints [N or N m]; the smallest possible if they are not unique.
    a : (nv,) array
        Acceleration of the whole tree: as prescribed, and of the passive freedoms what follows.
    evidence : PrescribedMotion
        What all other attributes ask: it is found out when it is asked for, from what the call has stored.
    """

    tau: FloatArray
    a: FloatArray
    evidence: PrescribedMotion

    @property
    def prescribed_residual(self) -> float:
        """Largest error of a prescribed acceleration [m/s² or rad/s²]."""
        return self.evidence.prescribed_residual

    @property
    def closure_residual(self) -> float:
        """Largest relative acceleration that is left at a closure, J a + J̇ v [m/s² or rad/s²]."""
        return self.evidence.closure_residual

    @property
    def prescribed_conditioning(self) -> float:
        """Smallest singular value of S N: how well the prescribed accelerations are seen.

        S picks them, and N are the orthonormal free motions. It is 0 where they cannot be chosen freely.
        Where those of the actuated joints are prescribed it is the `conditioning`.
        """
        return self.evidence.prescribed_conditioning
