"""`ClosedTree`: a tree model with its loop closures, and what states it takes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike
from typing_extensions import Self

from p3dof._base.checks import FloatArray, frozen_array
from p3dof._base.errors import InputError, ModelError
from p3dof.loops.accuracy import NORMALISED
from p3dof.loops.closures import ClosurePoint, LoopKinematics, max_abs
from p3dof.loops.joints import configuration_of, single_joint
from p3dof.loops.scaled_model import ScaledModel, scaled
from p3dof.loops.sidecar import Sidecar
from p3dof.loops.trees import check_tree

CLOSED = 1e-5
"""Largest gap at which inverse dynamics has a meaning [m or rad]."""
NEARLY_CLOSED = 1e-3
"""Largest gap at which forward dynamics has: an integrator's intermediate stages are a little open."""
CONSISTENT = 1e-6
"""Largest relative error of velocities and accelerations at the closures, for inverse dynamics."""
NEARLY_CONSISTENT = 1e-2
"""Largest relative error of velocities at the closures, for forward dynamics: likewise."""


class ClosedTree:
    """A tree model with its loop closures and actuators: how far loops are open, and how they let it move.

    Parameters
    ----------
    model : pin.Model
        A tree. Its frames and joints must stay as they are; masses and gravity may be changed.
    sidecar : Sidecar
        Loop closures, couplings, actuated joints, and perhaps the reference configuration.
    """

    def __init__(self, model: pin.Model, sidecar: Sidecar) -> None:
        if not isinstance(model, pin.Model):
            raise ModelError(f"model: expected a pinocchio.Model, got {type(model).__name__}")
        if not isinstance(sidecar, Sidecar):
            raise ModelError(f"sidecar: expected a Sidecar, got {type(sidecar).__name__}")
        check_tree(model)
        self.model = model
        self.sidecar = sidecar
        self._kinematics = LoopKinematics(model, sidecar)
        self.reference = configuration_of(model, sidecar.reference)
        """The configuration (nq,) that says which assembly is meant; neutral if the sidecar says nothing."""
        self.reference.setflags(write=False)
        self._joints = [single_joint(model, name, "actuated") for name in sidecar.actuated]
        self.actuated_v = np.array([model.idx_vs[j] for j in self._joints], dtype=int)
        self.actuated_v.setflags(write=False)
        self._scaled: ScaledModel[Any] | None = scaled(model, sidecar, type(self))

    def __reduce__(self) -> tuple[type[Self], tuple[pin.Model, Sidecar]]:
        return type(self), (self.model, self.sidecar)  # so that it can be sent to another process

    def __repr__(self) -> str:
        kind, loops, names = type(self).__name__, len(self.sidecar.closures), ", ".join(self.actuated)
        coupled = f", couplings={len(self.sidecar.couplings)}" if self.sidecar.couplings else ""
        return (
            f"{kind}({self.model.name!r}, nv={self.model.nv}, closures={loops}{coupled}, actuated=[{names}])"
        )

    @property
    def actuated(self) -> tuple[str, ...]:
        """Names of the actuated joints, in the order of `tau`."""
        return self.sidecar.actuated

    @property
    def constraint_models(self) -> pin.StdVec_ConstraintModel:
        """The closures that Pinocchio knows, points and frames, as its constraint models; a copy."""
        return self._kinematics.constraint_models.copy()

    @property
    def constraint_rows(self) -> tuple[slice, ...]:
        """Rows of each closure, then coupling, in `closure_error`, `closure_jacobian` and the multipliers."""
        return tuple(self._kinematics.rows)

    @property
    def unit_of_length(self) -> float:
        """The unit that a model much larger or smaller than a metre is computed in [m]; else 1."""
        return 1.0 if self._scaled is None else self._scaled.units.length

    def closure_error(self, q: ArrayLike) -> FloatArray:
        """Return how far each closure is open, and how far off each coupling is.

        Parameters
        ----------
        q : (nq,) array
            Configuration.

        Returns
        -------
        (rows,) array
            ``3d``: R1ᵀ(p2 - p1) [m]; ``6d``: log6(M1⁻¹ M2) [m, rad]; the others as in
            `p3dof.loops.closure_kinds`: positions, then rotations. Couplings: q_joint - p(q_on)
            [m or rad], where joints are continuous the nearest of the values that differ by whole turns.

        Raises
        ------
        InputError
            If `q` has the wrong shape, is not finite or not normalised.
        """
        return self._at(q).error.copy()

    def closure_gaps(self, q: ArrayLike) -> FloatArray:
        """Return one number for each closure, then coupling: how far it is open.

        Parameters
        ----------
        q : (nq,) array
            Configuration.

        Returns
        -------
        (closures + couplings,) array
            The distance by which the closure's positions are off [m] or the angle by which its rotations are
            [rad], whichever is the larger number; the absolute error of a coupling.

        Raises
        ------
        InputError
            If `q` has the wrong shape, is not finite or not normalised.
        """
        return self._kinematics.gaps(self._at(q).error)

    def closure_jacobian(self, q: ArrayLike) -> FloatArray:
        """Return the Jacobian J of closures and couplings.

        For ``3d`` and ``6d`` J v is the velocity of frame 2 seen from frame 1, in the axes of frame 1. It is
        the derivative of `closure_error`; that of a ``6d`` where it is closed.

        Parameters
        ----------
        q : (nq,) array
            Configuration.

        Returns
        -------
        (rows, nv) array

        Raises
        ------
        InputError
            If `q` has the wrong shape, is not finite or not normalised.
        """
        return self._at(q).J.copy()

    def rank(self, q: ArrayLike) -> int:
        """Return the rank of the closures' Jacobian at `q` (nq,), whose loops should be closed."""
        if self._scaled is not None:
            return int(self._scaled.core.rank(self._scaled.q(self._configuration("q", q))))
        return self._at(q).svd.rank

    def mobility(self, q: ArrayLike) -> int:
        """Return the number of free motions of the closed mechanism at `q` (nq,): nv - rank."""
        return int(self.model.nv) - self.rank(q)

    def _configuration(self, name: str, q: ArrayLike) -> FloatArray:
        array = frozen_array(name, q, (self.model.nq,))
        if self.model.nq != self.model.nv and not pin.isNormalized(self.model, array, NORMALISED):
            raise InputError(
                f"{name}: not normalised (unit quaternions and circles); see pinocchio.normalize"
            )
        return array

    def _at(self, q: ArrayLike, largest_gap: float = np.inf) -> ClosurePoint:
        point = self._kinematics.at(self._configuration("q", q))
        self._check_gap(point, largest_gap)
        return point

    def _check_gap(self, point: ClosurePoint, largest_gap: float) -> None:
        if not point.tight and not point.gap <= largest_gap:
            raise InputError(
                f"q: the {self._kinematics.worst(point.error)} is open by {point.gap:.3g} m or rad, "
                f"expected at most {largest_gap:g}; assemble(None, guess=q) closes it"
            )

    def _closed_at(self, q: ArrayLike, v: FloatArray) -> ClosurePoint:
        """Return the closures at a state that nearly keeps them closed; a scaled core checks for itself."""
        point = self._at(q, NEARLY_CLOSED if self._scaled is None else np.inf)
        if self._scaled is None and point.J.size:
            opening = point.J @ v
            if not opening.dot(opening) <= NEARLY_CONSISTENT**2:  # else the largest is less, too
                self._check_opening("v", opening, NEARLY_CONSISTENT * max(1.0, max_abs(v)))
        return point

    def _moving(self, q: ArrayLike, v: FloatArray, a: FloatArray) -> ClosurePoint:
        """Return the closures at a motion that keeps them closed."""
        k, q = self._kinematics, self._configuration("q", q)
        k.move(q, v, a)
        point = k.at(q)
        if point.J.size:
            self._check_gap(point, CLOSED)
            relative = CONSISTENT + (0.0 if point.tight else 100.0 * point.gap)
            opening = point.J @ v
            if not opening.dot(opening) <= relative**2:  # else the largest is less, too
                self._check_opening("v", opening, relative * max(1.0, max_abs(v)))
            opening = k.acceleration()
            if not opening.dot(opening) <= relative**2:
                allowed = relative * max(1.0, max_abs(a), max_abs(v) ** 2)
                self._check_opening("a", opening, allowed)
        return point

    def _check_opening(self, name: str, opening: FloatArray, allowed: float) -> None:
        worst = max_abs(opening)
        if worst > allowed:
            raise InputError(
                f"{name}: opens the {self._kinematics.worst(opening)} by {worst:.3g} (SI units), "
                f"expected at most {allowed:.1g}; complete() finds motions that keep the loops closed"
            )
