"""Multipliers of closures as what they are: a force and a moment in space, at their place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from p3dof._base.checks import FloatArray, as_floats, frozen_array
from p3dof._base.errors import InputError
from p3dof._base.threads import Own
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.loop_model import LoopModel

_NONE, _PARTLY, _WHOLLY = 0, 1, 2


@dataclass(frozen=True, eq=False)
class ClosureWrench:
    """What closures exert on the bodies of their second frames; those of the first ones get the opposite.

    Parameters
    ----------
    places : (n, 3) array
        Origins of the second frames, where the forces act [m].
    forces, moments : (n, 3) array
        In world axes [N, N m]: what the multipliers that are known make up.
    determined : (n,) array of int
        2 where all multipliers of the closure are known, 1 where some are, 0 where none is.
    """

    places: FloatArray
    forces: FloatArray
    moments: FloatArray
    determined: NDArray[np.int_]

    @property
    def known(self) -> NDArray[np.bool_]:
        """Whether anything of a closure is known, (n,)."""
        return np.asarray(self.determined != _NONE)

    @property
    def whole(self) -> NDArray[np.bool_]:
        """Whether all of a closure is known, (n,)."""
        return np.asarray(self.determined == _WHOLLY)


class ClosureWrenches:
    """Turns multipliers of a robot's closures into forces and moments in space.

    Parameters
    ----------
    loop : LoopModel
        The robot.
    """

    def __init__(self, loop: LoopModel) -> None:
        self._kinematics = LoopKinematics(loop.model, loop.sidecar)
        self._data = Own(loop.model.createData)

    def places(self, q: ArrayLike) -> tuple[list[pin.SE3], list[pin.SE3]]:
        """Return where the first and the second frames of the closures are, at joints (nq,)."""
        model, data = self._kinematics.model, self._data.here
        pin.forwardKinematics(model, data, frozen_array("q", q, (model.nq,)))
        ends = self._kinematics.ends
        return [data.oMi[a] * A for a, A, _, _ in ends], [data.oMi[b] * B for _, _, b, B in ends]

    def at(self, q: ArrayLike, multipliers: ArrayLike) -> ClosureWrench:
        """Return what the closures exert.

        Parameters
        ----------
        q : (nq,) array
            Configuration with closed loops.
        multipliers : (rows,) array
            As `InverseDynamics.lambda_`, with NaN where they are not known.

        Returns
        -------
        ClosureWrench

        Raises
        ------
        InputError
            If a shape does not fit.
        """
        k = self._kinematics
        lambda_ = as_floats("multipliers", multipliers)
        if lambda_.shape != (k.size,):
            raise InputError(f"multipliers: expected shape ({k.size},), got {lambda_.shape}")
        first, second = self.places(q)
        wrenches, determined = np.zeros((len(first), 6)), np.full(len(first), _PARTLY)
        for i, rates in enumerate(self._rates(first, second)):
            own = lambda_[k.rows[i]]
            known = np.isfinite(own)
            wrench = rates[known].T @ own[known]
            wrenches[i] = (wrench.reshape(2, 3) @ first[i].rotation.T).reshape(6)
            if not known.any() or known.all():
                determined[i] = _WHOLLY if known.all() else _NONE
        places = np.array([end.translation for end in second]).reshape(-1, 3)
        return ClosureWrench(places, wrenches[:, :3], wrenches[:, 3:], determined)

    def _rates(self, first: list[pin.SE3], second: list[pin.SE3]) -> list[FloatArray]:
        """Return, by closure, the matrix (rows, 6) from the relative motion (ḋ, ω) to the errors' rates."""
        k = self._kinematics
        found = [np.eye(6)[: closure.rows] for closure in k.closures]  # of points and frames
        between = [first[i].actInv(second[i]) for i in k.own]
        turn = np.zeros((len(between), 3))
        for i in k.kinds.turning:
            turn[i] = pin.log3(between[i].rotation)
        d = np.array([place.translation for place in between]).reshape(-1, 3)
        axes = np.array([place.rotation for place in between]).reshape(-1, 3, 3)
        for group in k.kinds.at(d, axes, turn):
            for number, rates in zip(np.arange(len(between))[group.which], group.A, strict=True):
                found[k.own[number]] = rates
        return found
