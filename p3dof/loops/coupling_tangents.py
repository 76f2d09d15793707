"""How velocities and accelerations at couplings of joints change with configuration and velocity; exact."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof.loops.constraints import Coupling
from p3dof.loops.joints import single_joint


class CouplingTangents:
    """Derivatives of the couplings q_joint = p(q_on) + Σ f q_other at one configuration.

    Only p is curved, so that all of them are in the column of the joint `on`.

    Parameters
    ----------
    model : pin.Model
        The tree.
    couplings : sequence of Coupling
        The couplings, one row each.
    q : (nq,) array
        Configuration.
    """

    def __init__(self, model: pin.Model, couplings: Sequence[Coupling], q: FloatArray) -> None:
        self._nv, self._size = int(model.nv), len(couplings)
        curved = [(row, c, c.on) for row, c in enumerate(couplings) if c.on and any(c.coefficients[2:])]
        self._rows = np.array([row for row, _, _ in curved], dtype=int)
        joints = [single_joint(model, on, f"coupling {c.title}") for _, c, on in curved]
        self._on = np.array([model.idx_vs[joint] for joint in joints], dtype=int)
        bends = []
        for (_, coupling, _), joint in zip(curved, joints, strict=True):
            p, value = np.polynomial.Polynomial(coupling.coefficients), q[model.idx_qs[joint]]
            bends.append((p.deriv(2)(value), p.deriv(3)(value)))  # no continuous joint enters in a power
        self._second, self._third = np.array(bends, dtype=float).reshape(-1, 2).T

    def velocity_by_q(self, w: FloatArray) -> FloatArray:
        """Return the derivative by q of J w (size, nv), w (nv,) being constant."""
        return self._placed(-self._second * w[self._on])

    def jacobian_rate(self, v: FloatArray) -> FloatArray:
        """Return J̇ (size, nv) at a velocity (nv,)."""
        return self._placed(-self._second * v[self._on])

    def acceleration(self, v: FloatArray, a: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives (size, nv) by q and by v of the accelerations J a + J̇ v."""
        v, a = v[self._on], a[self._on]
        return self._placed(-self._second * a - self._third * v**2), self._placed(-2.0 * self._second * v)

    def force_by_q(self, lambda_: FloatArray) -> FloatArray:
        """Return the derivative by q of Jᵀ λ (nv, nv), λ (size,) being constant."""
        total = np.zeros((self._nv, self._nv))
        np.add.at(total, (self._on, self._on), -self._second * lambda_[self._rows])
        return total

    def _placed(self, values: FloatArray) -> FloatArray:
        result = np.zeros((self._size, self._nv))
        result[self._rows, self._on] = values
        return result
