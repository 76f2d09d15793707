"""Springs in balls and free joints, which turn back about the axis of their turn, as in MuJoCo."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import ModelError
from p3dof.loops.joint_data import JointData

_KINDS = {"JointModelSpherical": False, "JointModelFreeFlyer": True}
"""Which joints may have one, and whether they shift."""


@dataclass(frozen=True, eq=False)
class TurningSpring:
    """A spring in a ball or a free joint.

    Parameters
    ----------
    q, v : slice
        Where the joint is in configuration and velocity.
    stiffness : float
        [N m/rad], and for the shift of a free joint [N/m].
    rest : (4,) or (7,) array
        Values of the joint without force.
    """

    q: slice
    v: slice
    stiffness: float
    rest: FloatArray

    @classmethod
    def of(cls, model: pin.Model, joint: int, entry: JointData) -> TurningSpring:
        """Return the spring of a joint.

        Raises
        ------
        ModelError
            If it is neither a ball nor a free joint, or the rest is none of its values.
        """
        where, kind = f"joint data of {shown(entry.joint)}", str(model.joints[joint].shortname())
        if kind not in _KINDS:
            raise ModelError(
                f"{where}: stiffness: only a joint with one degree of freedom, a ball or a free joint can "
                f"have a spring, it has {model.nvs[joint]}"
            )
        size = int(model.nqs[joint])
        rest: FloatArray = np.zeros(size)
        rest[-1] = 1.0
        if isinstance(entry.rest, tuple):
            if len(entry.rest) != size or abs(np.linalg.norm(entry.rest[-4:]) - 1) > 1e-6:
                raise ModelError(f"{where}: rest: expected {size} values that end in a unit quaternion")
            rest = np.array(entry.rest)
            rest[-4:] /= np.linalg.norm(rest[-4:])
        elif entry.rest:
            raise ModelError(f"{where}: rest: expected {size} values, got one")
        v = slice(model.idx_vs[joint], model.idx_vs[joint] + model.nvs[joint])
        return cls(slice(model.idx_qs[joint], model.idx_qs[joint] + size), v, entry.stiffness, rest)

    def stretch(self, q: FloatArray) -> FloatArray:
        """Return how far the joint is from rest, in its own axes: (..., 3), or shift and turn (..., 6)."""
        values = q[..., self.q]
        turn = _turn(self.rest[-4:], values[..., -4:])
        if len(self.rest) == 4:
            return turn
        shift = _turned_back(values[..., 3:], values[..., :3] - self.rest[:3])
        return np.concatenate([shift, turn], axis=-1)

    def stretch_by_q(self, q: FloatArray) -> FloatArray:
        """Return the derivative of `stretch` at one configuration by small motions in the joint's axes."""
        found = self.stretch(q)
        R = pin.exp3(found[-3:])
        by_turn = np.array(pin.Jlog3(R))
        if len(self.rest) == 4:
            return by_turn
        whole = np.zeros((6, 6))
        whole[:3, :3], whole[:3, 3:], whole[3:, 3:] = np.eye(3), pin.skew(found[:3]), by_turn
        return whole


def _turn(rest: FloatArray, now: FloatArray) -> FloatArray:
    """Return the rotation vector (..., 3) from a quaternion x, y, z, w to others, the shorter way."""
    u, w = -rest[:3], rest[3]
    vector = w * now[..., :3] + now[..., 3:] * u + np.cross(u, now[..., :3])
    scalar = w * now[..., 3] - np.sum(u * now[..., :3], axis=-1)
    sign = np.where(scalar < 0, -1.0, 1.0)
    length = np.linalg.norm(vector, axis=-1)
    angle = 2.0 * np.arctan2(length, sign * scalar)
    share = np.where(length > 1e-12, angle / np.where(length > 1e-12, length, 1.0), 2.0)
    return np.asarray((sign * share)[..., None] * vector)


def _turned_back(quaternion: FloatArray, vector: FloatArray) -> FloatArray:
    """Return vectors (..., 3) in the axes of a body with a quaternion x, y, z, w."""
    u, w = -quaternion[..., :3], quaternion[..., 3:]
    once = 2.0 * np.cross(u, vector)
    return np.asarray(vector + w * once + np.cross(u, once))
