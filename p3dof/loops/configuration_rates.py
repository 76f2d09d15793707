"""How fast a configuration changes: at the velocity, but for quaternions and circles."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof._base.errors import ModelError


class ConfigurationRates:
    """Configuration and velocity of one model to the time derivative of the configuration.

    Parameters
    ----------
    model : pin.Model
        The tree.

    Raises
    ------
    ModelError
        If a joint that turns freely is of a kind that is not known here.
    """

    def __init__(self, model: pin.Model) -> None:
        self.flat = bool(model.nq == model.nv)
        self._straight: list[tuple[slice, slice]] = []
        self._turning: list[tuple[slice, slice, Callable[[FloatArray, FloatArray], FloatArray]]] = []
        self._nq = int(model.nq)
        for name, joint in zip(list(model.names)[1:], list(model.joints)[1:], strict=True):
            q = slice(joint.idx_q, joint.idx_q + joint.nq)
            v = slice(joint.idx_v, joint.idx_v + joint.nv)
            if joint.nq == joint.nv:
                self._straight.append((q, v))
                continue
            kind = joint.shortname()
            rates = [rate for start, rate in _KINDS.items() if kind.startswith(start)]
            if not rates:
                raise ModelError(f"the joint {name!r} ({kind}) cannot be integrated: expected a simple joint")
            self._turning.append((q, v, rates[0]))

    def __call__(self, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return dq/dt (nq,) at a normalised configuration q (nq,) with velocity v (nv,)."""
        if self.flat:
            return v
        result = np.empty(self._nq)
        for at, of in self._straight:
            result[at] = v[of]
        for at, of, rate in self._turning:
            result[at] = rate(q[at], v[of])
        return result


def _circle(q: FloatArray, v: FloatArray) -> FloatArray:
    """Of cosine and sine."""
    return np.array([-q[1] * v[0], q[0] * v[0]])


def _quaternion(q: FloatArray, omega: FloatArray) -> FloatArray:
    """Of a unit quaternion x, y, z, w, for an angular velocity in the axes of the body: q ⊗ ω / 2."""
    (x, y, z, w), (a, b, c) = q.tolist(), omega.tolist()
    return 0.5 * np.array(
        [
            w * a + y * c - z * b,
            w * b + z * a - x * c,
            w * c + x * b - y * a,
            -(x * a + y * b + z * c),
        ]
    )


def _free(q: FloatArray, v: FloatArray) -> FloatArray:
    R = np.array(pin.Quaternion(q[3:]).toRotationMatrix())
    return np.concatenate([R @ v[:3], _quaternion(q[3:], v[3:])])


def _planar(q: FloatArray, v: FloatArray) -> FloatArray:
    c, s = q[2:]
    return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1], -s * v[2], c * v[2]])


_KINDS: dict[str, Callable[[FloatArray, FloatArray], FloatArray]] = {
    "JointModelRUB": _circle,
    "JointModelRevoluteUnboundedUnaligned": _circle,
    "JointModelSpherical": _quaternion,
    "JointModelFreeFlyer": _free,
    "JointModelPlanar": _planar,
}
"""By the beginning of a joint's name in Pinocchio."""
