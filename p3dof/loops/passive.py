"""Springs, balances, damping and friction in joints of a tree: forces, energy, power, at any states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import ModelError
from p3dof.loops.joint_data import JointData
from p3dof.loops.joints import joint_named
from p3dof.loops.turning_springs import TurningSpring

SMOOTHING = 1e-3
"""Speed over which Coulomb friction changes its sign [m/s or rad/s]: that of `p3dof.Friction`."""


class Passive:
    """What acts in the joints of a tree by itself.

    Parameters
    ----------
    model : pin.Model
        The tree.
    entries : sequence of JointData
        What acts where.

    Raises
    ------
    ModelError
        If a joint does not exist, a spring is in one of several freedoms other than a ball or a free joint,
        is negative there, or its rest does not fit; a constant force is in a joint of several freedoms or
        without ends; or the tree lacks what an entry says of rotors.
    """

    def __init__(self, model: pin.Model, entries: Sequence[JointData]) -> None:
        self._nv = int(model.nv)
        self._any = bool(entries)
        self._damping, self._friction, self._force = np.zeros((3, model.nv))
        pushed = []
        self._turning: list[TurningSpring] = []
        springs = []
        for entry in entries:
            joint = joint_named(model, entry.joint, "joint data")
            span = slice(model.idx_vs[joint], model.idx_vs[joint] + model.nvs[joint])
            _require_rotor(entry, np.asarray(model.armature)[span])
            self._damping[span], self._friction[span] = entry.damping, entry.friction
            _require_one(entry, model.nvs[joint], model.nqs[joint])
            if entry.force:
                self._force[span] = entry.force
                pushed.append((model.idx_qs[joint], model.idx_vs[joint]))
            if entry.stiffness and model.nvs[joint] > 1:
                self._turning.append(TurningSpring.of(model, joint, entry))
            elif entry.stiffness:
                if isinstance(entry.rest, tuple):
                    raise ModelError(f"joint data of {shown(entry.joint)}: rest: expected one number")
                places = model.idx_qs[joint], model.idx_vs[joint], model.nqs[joint] == 2
                springs.append((*places, entry.stiffness, entry.rest))
        columns = np.array(springs, dtype=float).reshape(-1, 5).T
        self._q, self._v = columns[:2].astype(int)
        self._circles = np.flatnonzero(columns[2])
        self._stiffness, self._rest = columns[3:]
        self._pushed_q, self._pushed_v = np.array(pushed, dtype=int).reshape(-1, 2).T

    def __bool__(self) -> bool:
        return self._any

    def forces(self, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return the generalised forces (..., nv) at configurations (..., nq) and velocities (..., nv)."""
        found: FloatArray = self._force - self._damping * v - self._friction * np.tanh(v / SMOOTHING)
        if len(self._q):
            found[..., self._v] -= self._stiffness * self._stretch(q)
        for spring in self._turning:
            found[..., spring.v] -= spring.stiffness * spring.stretch(q)
        return found

    def derivatives(self, q: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of the forces by the positions (nv, nv) and by the speeds (nv,).

        Friction is smooth: away from rest its derivative fades out within a few times `SMOOTHING`.
        """
        by_q = np.zeros((self._nv, self._nv))
        by_q[self._v, self._v] = -self._stiffness
        for spring in self._turning:
            by_q[spring.v, spring.v] = -spring.stiffness * spring.stretch_by_q(q)
        return by_q, -self._damping - self._friction / SMOOTHING * (1.0 - np.tanh(v / SMOOTHING) ** 2)

    def energy(self, q: FloatArray) -> FloatArray:
        """Return the energy in springs and balances (...) [J]."""
        found = np.asarray(np.sum(self._stiffness * self._stretch(q) ** 2, axis=-1) / 2)
        for spring in self._turning:
            found = found + spring.stiffness * np.sum(spring.stretch(q) ** 2, axis=-1) / 2
        if len(self._pushed_q):
            found = found - np.sum(self._force[self._pushed_v] * q[..., self._pushed_q], axis=-1)
        return np.asarray(found)

    def power(self, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return how fast springs and balances take up energy (...) [W]."""
        found = np.sum(self._stiffness * self._stretch(q) * v[..., self._v], axis=-1)
        for spring in self._turning:
            found = found + spring.stiffness * np.sum(spring.stretch(q) * v[..., spring.v], axis=-1)
        if len(self._pushed_v):
            found = found - np.sum(self._force[self._pushed_v] * v[..., self._pushed_v], axis=-1)
        return np.asarray(found)

    def dissipation(self, v: FloatArray) -> FloatArray:
        """Return what damping and friction take (...) [W]."""
        lost = self._damping * v**2 + self._friction * v * np.tanh(v / SMOOTHING)
        return np.asarray(np.sum(lost, axis=-1))

    def _stretch(self, q: FloatArray) -> FloatArray:
        """Return how far the joints with springs are from rest (..., n)."""
        values = q[..., self._q] - self._rest
        if len(self._circles):
            at = self._q[self._circles]
            angle = np.arctan2(q[..., at + 1], q[..., at]) - self._rest[self._circles]
            values[..., self._circles] = np.arctan2(np.sin(angle), np.cos(angle))
        return np.asarray(values)


def _require_one(entry: JointData, freedoms: int, values: int) -> None:
    """Refuse a constant force, or a negative spring, where it has no direction."""
    where = f"joint data of {shown(entry.joint)}"
    if entry.force and (freedoms != 1 or values != 1):
        raise ModelError(
            f"{where}: force: expected a joint with one degree of freedom that is not continuous"
        )
    if entry.stiffness < 0 and freedoms != 1:
        raise ModelError(f"{where}: stiffness: expected zero or more, got {entry.stiffness:g}")


def _require_rotor(entry: JointData, armature: FloatArray) -> None:
    """Refuse data of a rotor that the tree does not have."""
    where = f"joint data of {shown(entry.joint)}"
    if entry.armature:
        raise ModelError(f"{where}: armature: it belongs to the tree, model.armature")
    if (armature < entry.reflected_inertia * (1 - 1e-9)).any():
        raise ModelError(
            f"{where}: rotor_inertia: the tree has {float(armature.min()):g} in model.armature, less than "
            f"gear_ratio² rotor_inertia = {entry.reflected_inertia:g}"
        )


def with_armature(model: pin.Model, entries: Sequence[JointData]) -> tuple[JointData, ...]:
    """Give a tree the rotors of its joints, and return what is left to act in them.

    Parameters
    ----------
    model : pin.Model
        The tree, which changes.
    entries : sequence of JointData
        What a file says of its joints.

    Returns
    -------
    tuple of JointData

    Raises
    ------
    ModelError
        If a joint does not exist.
    """
    armature = np.array(model.armature)
    left = []
    for entry in entries:
        joint = joint_named(model, entry.joint, "joint data")
        rotor = entry.armature + entry.reflected_inertia
        if rotor:
            armature[model.idx_vs[joint] : model.idx_vs[joint] + model.nvs[joint]] = rotor
        left.append(replace(entry, armature=0.0))
    model.armature = armature
    return tuple(entry for entry in left if entry)


def losses_of(model: pin.Model) -> tuple[JointData, ...]:
    """Return the damping and the friction that the file of a tree gives to its joints.

    Parameters
    ----------
    model : pin.Model
        The tree.

    Returns
    -------
    tuple of JointData
    """
    found = []
    for i in range(1, model.njoints):
        if model.nvs[i]:
            at = model.idx_vs[i]
            losses = max(0.0, float(model.damping[at])), max(0.0, float(model.upperDryFrictionLimit[at]))
            found.append(JointData(str(model.names[i]), damping=losses[0], friction=losses[1]))
    return tuple(entry for entry in found if entry)
