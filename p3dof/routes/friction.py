"""Friction for the Pinocchio route: joint forces in the tree, pairs of moments where its loops are cut.

The rates are those of Pinocchio's own joints and frames; no closed form of the mechanism is used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from p3dof.checks import FloatArray
from p3dof.closed_loop import ClosedLoopModel
from p3dof.parameters import Friction

_X, _Y, _ = np.eye(3)

PLATFORM = "platform_center"
"""The frame at P."""

CUTS = {
    "universal_a": ("leg_a_tip", "platform_a"),
    "universal_b": ("leg_b_tip", "platform_b"),
    "hinge_lower_right": ("rod_right_tip", "crossbar_lower_right"),
}
"""The joints at which the loops are cut: the frames on both sides."""


@dataclass(frozen=True, eq=False)
class Resistance:
    """What friction does at one state.

    Parameters
    ----------
    joint_forces : (nv,) array
        Friction in the joints of the tree [N or N m].
    external : dict of str to (6,) array
        Wrenches on the frames at the cuts, in world axes.
    power : float
        Power that is lost [W].
    """

    joint_forces: FloatArray
    external: dict[str, FloatArray]
    power: float

    def external_with(self, wrench: FloatArray | None) -> dict[str, FloatArray]:
        """Return all wrenches on frames: these, and one on the platform at P (6,) if there is one."""
        return self.external if wrench is None else {PLATFORM: wrench, **self.external}


class FrictionForces:
    """Friction of a machine in its closed-loop model.

    Parameters
    ----------
    loop : ClosedLoopModel
        The mechanism.
    friction : Friction, optional
        What its joints lose.
    """

    def __init__(self, loop: ClosedLoopModel, friction: Friction | None) -> None:
        self._model, self._data = loop.model, loop.model.createData()
        self._friction = friction or Friction()
        joints = self._friction.joints
        names = [str(name) for name in self._model.names]
        self._viscous, self._coulomb = np.zeros((2, self._model.nv))
        for name in joints:
            if name in names:
                index = self._model.idx_vs[names.index(name)]
                self._viscous[index] = self._friction.viscous.get(name, 0.0)
                self._coulomb[index] = self._friction.coulomb.get(name, 0.0)
        self._cuts = [name for name in joints if name in CUTS]
        self._frames = {frame: self._model.getFrameId(frame) for name in self._cuts for frame in CUTS[name]}
        self._nothing = Resistance(np.zeros(self._model.nv), {}, 0.0)

    def at(self, q: FloatArray, v: FloatArray) -> Resistance:
        """Return what friction does at a state.

        Parameters
        ----------
        q, v : (nv,) array
            Configuration and velocity of the tree.

        Returns
        -------
        Resistance
        """
        if not self._friction:
            return self._nothing
        forces = -self._viscous * v - self._coulomb * np.tanh(v / self._friction.smoothing)
        power = -float(forces @ v)
        external: dict[str, FloatArray] = {}
        if self._cuts:
            pin.forwardKinematics(self._model, self._data, q, v)
        for name in self._cuts:
            moment, lost = self._at_cut(name)
            one, other = CUTS[name]
            external[one] = np.concatenate([np.zeros(3), -moment])
            external[other] = np.concatenate([np.zeros(3), moment])
            power += lost
        return Resistance(forces, external, power)

    def _at_cut(self, name: str) -> tuple[FloatArray, float]:
        """Return the moment on the second frame of a cut [N m], and the power that is lost there [W]."""
        one, other = (self._frames[frame] for frame in CUTS[name])
        omega = self._spin(other) - self._spin(one)
        if name.startswith("universal"):
            axes = [_X, _Y]  # in the closed mechanism a leg turns about x0 only, the platform about y0 only
        else:
            axes = [pin.updateFramePlacement(self._model, self._data, one).rotation[:, 1]]
        moment, power = np.zeros(3), 0.0
        viscous, coulomb = self._friction.viscous.get(name, 0.0), self._friction.coulomb.get(name, 0.0)
        for axis in axes:
            rate = axis @ omega
            resisting = viscous * rate + coulomb * np.tanh(rate / self._friction.smoothing)
            moment = moment - resisting * axis
            power += float(resisting * rate)
        return moment, power

    def _spin(self, frame: int) -> FloatArray:
        found = pin.getFrameVelocity(self._model, self._data, frame, pin.LOCAL_WORLD_ALIGNED).angular
        return np.array(found)
