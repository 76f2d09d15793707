"""Friction for the Pinocchio route: joint forces in the tree, pairs of moments where its loops are cut.

The rates are those of Pinocchio's own joints and frames; no closed form of the mechanism is used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof._base.threads import Own
from p3dof.loops import ClosedLoopModel
from p3dof.loops.batch.kinematics import Sweep
from p3dof.machine.parameters import PLATFORM, Friction
from p3dof.methods.coulomb import CoulombLimits
from p3dof.methods.solution import JointStates

_UNIVERSALS = ("universal_a", "universal_b")
_UNIVERSAL = np.eye(3)[:2]
"""In the closed mechanism a leg turns about x0 only, the platform about y0 only."""

CUTS = {
    "universal_a": ("leg_a_tip", "platform_a"),
    "universal_b": ("leg_b_tip", "platform_b"),
    "hinge_lower_right": ("rod_right_tip", "crossbar_lower_right"),
}
"""The joints at which the loops are cut: the frames on both sides."""


@dataclass(frozen=True, eq=False)
class Resistance:
    """What friction does at one state, or at N of them.

    Parameters
    ----------
    joint_forces : (nv,) or (N, nv) array
        Friction in the joints of the tree [N or N m].
    external : dict of str to (6,) or (N, 6) array
        Wrenches on the frames at the cuts, in world axes.
    power : float or (N,) array
        Power that is lost [W].
    """

    joint_forces: FloatArray
    external: dict[str, FloatArray]
    power: float | FloatArray

    def external_with(self, wrench: FloatArray | None) -> dict[str, FloatArray]:
        """Return all wrenches on frames: these, and one on the platform at P if there is one."""
        return self.external if wrench is None else {PLATFORM: wrench, **self.external}

    def plus(self, other: Resistance) -> Resistance:
        """Return both together."""
        external = dict(self.external)
        for frame, wrench in other.external.items():
            external[frame] = external[frame] + wrench if frame in external else wrench
        return Resistance(self.joint_forces + other.joint_forces, external, self.power + other.power)


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
        self._model = loop.model
        friction = friction or Friction()
        self._frictionless, self._smoothing = not friction, friction.smoothing
        self._viscous, self._coulomb = np.zeros((2, self._model.nv))
        self._of_cuts: dict[str, tuple[float, float | FloatArray]] = {}
        places = places_of(loop)
        for name in friction.joints:
            viscous, coulomb = friction.viscous.get(name, 0.0), friction.coulomb.get(name, 0.0)
            if name in places:
                self._viscous[places[name]], self._coulomb[places[name]] = viscous, coulomb
            else:
                self._of_cuts[name] = viscous, coulomb
        self._watch(tuple(self._of_cuts))

    @classmethod
    def of_limits(cls, loop: ClosedLoopModel, coulomb: CoulombLimits) -> FrictionForces:
        """Return Coulomb friction that differs from sample to sample, for `over` these samples.

        Parameters
        ----------
        loop : ClosedLoopModel
            The mechanism.
        coulomb : CoulombLimits
            At N samples.

        Returns
        -------
        FrictionForces
        """
        found, places = cls(loop, None), places_of(loop)
        found._frictionless, found._smoothing = False, coulomb.smoothing
        count = max((len(values) for values in coulomb.limits.values()), default=0)
        found._coulomb = np.zeros((count, loop.model.nv))
        for name, values in coulomb.limits.items():
            if name in places:
                found._coulomb[:, places[name]] = values[:, 0]
            else:
                found._of_cuts[name] = 0.0, values
        found._watch(tuple(found._of_cuts))
        return found

    def _watch(self, cuts: tuple[str, ...]) -> None:
        """Keep in mind at which cuts there is friction."""
        self._cuts = cuts
        self._frames = {frame: self._model.getFrameId(frame) for name in self._cuts for frame in CUTS[name]}
        self._data = Own(self._model.createData)
        self._nothing = Resistance(np.zeros(self._model.nv), {}, 0.0)

    def at(self, q: FloatArray, v: FloatArray) -> Resistance:
        """Return what friction does at one state.

        Parameters
        ----------
        q, v : (nv,) array
            Configuration and velocity of the tree.

        Returns
        -------
        Resistance
        """
        if self._frictionless:
            return self._nothing
        turning: dict[str, tuple[FloatArray, FloatArray]] = {}
        data = self._data.here
        if self._cuts:
            pin.forwardKinematics(self._model, data, q, v)
        for name in self._cuts:
            one, other = (self._frames[frame] for frame in CUTS[name])
            axes = _UNIVERSAL
            if name not in _UNIVERSALS:
                axes = pin.updateFramePlacement(self._model, data, one).rotation[None, :, 1]
            turning[name] = self._spin(data, other) - self._spin(data, one), axes
        return self._resistance(v, turning)

    def over(self, q: FloatArray, v: FloatArray) -> Resistance:
        """Return what friction does at N states.

        Parameters
        ----------
        q, v : (N, nv) array
            Configurations and velocities of the tree.

        Returns
        -------
        Resistance
        """
        turning: dict[str, tuple[FloatArray, FloatArray]] = {}
        if self._cuts:
            sweep = Sweep(self._model)
            samples = sweep.at(q)
            spins = sweep.twists(samples.J, v)[..., 3:]
        for name in self._cuts:
            one, other = (self._model.frames[self._frames[frame]] for frame in CUTS[name])
            axes = _UNIVERSAL
            if name not in _UNIVERSALS:
                axes = (samples.R[:, one.parentJoint] @ one.placement.rotation[:, 1])[:, None]
            turning[name] = spins[:, other.parentJoint] - spins[:, one.parentJoint], axes
        return self._resistance(v, turning)

    def _resistance(self, v: FloatArray, turning: dict[str, tuple[FloatArray, FloatArray]]) -> Resistance:
        """Return the resistance from v (..., nv), and the relative spin (..., 3) and axes of every cut."""
        forces = -self._viscous * v - self._coulomb * np.tanh(v / self._smoothing)
        power = -(forces * v).sum(axis=-1)
        external: dict[str, FloatArray] = {}
        for name, (omega, axes) in turning.items():
            viscous, coulomb = self._of_cuts[name]
            rates = (axes @ omega[..., None])[..., 0]
            resisting = viscous * rates + coulomb * np.tanh(rates / self._smoothing)
            power = power + (resisting * rates).sum(axis=-1)
            wrench = np.zeros((*omega.shape[:-1], 6))
            wrench[..., 3:] = -(resisting[..., None, :] @ axes)[..., 0, :]
            one, other = CUTS[name]
            external[one], external[other] = -wrench, wrench
        return Resistance(forces, external, power)

    def _spin(self, data: pin.Data, frame: int) -> FloatArray:
        found = pin.getFrameVelocity(self._model, data, frame, pin.LOCAL_WORLD_ALIGNED).angular
        return np.array(found)


def places_of(loop: ClosedLoopModel) -> dict[str, int]:
    """Return where the velocity of each joint of the tree stands.

    Parameters
    ----------
    loop : ClosedLoopModel
        The mechanism.

    Returns
    -------
    dict of str to int
    """
    return {str(name): loop.model.idx_vs[i] for i, name in enumerate(loop.model.names) if i}


def forces_against(
    loop: ClosedLoopModel, joints: JointStates, coulomb: CoulombLimits
) -> tuple[FloatArray, FloatArray]:
    """Return what actuators need more because of Coulomb friction that differs from sample to sample.

    Forces are linear in it, so that they are the difference of those that hold the machine at rest with and
    without what the joints resist with.

    Parameters
    ----------
    loop : ClosedLoopModel
        The mechanism.
    joints : JointStates
        Its joints in Pinocchio's order, N samples; rows of NaN are left out.
    coulomb : CoulombLimits
        At the same samples.

    Returns
    -------
    forces : ndarray, shape (N, 3)
        [N]
    power : ndarray, shape (N,)
        Power that is lost [W].

    Raises
    ------
    P3dofError
        Of the first sample that has no forces.
    """
    forces, power = np.full((len(joints.q), len(loop.actuated)), np.nan), np.full(len(joints.q), np.nan)
    known = np.isfinite(joints.q).all(axis=1)
    q, v = joints.q[known], joints.v[known]
    rows = CoulombLimits({name: values[known] for name, values in coulomb.limits.items()}, coulomb.smoothing)
    lost, still = FrictionForces.of_limits(loop, rows).over(q, v), np.zeros_like(v)
    held = [
        loop.inverse_dynamics_batch(q, still, still, *against)
        for against in ((lost.external, lost.joint_forces), (None, None))
    ]
    for one in held:
        if one.errors:
            raise next(iter(one.errors.values()))
    forces[known], power[known] = held[0].tau - held[1].tau, lost.power
    return forces, power
