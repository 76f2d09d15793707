"""Errors of couplings of joints, their Jacobian and drift, at one configuration or at many."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
import pinocchio as pin

from p3dof.checks import FloatArray
from p3dof.closed_loop.constraints import MAX_COEFFICIENTS, Coupling
from p3dof.closed_loop.joints import single_joint
from p3dof.errors import ModelError

_LARGEST_DENOMINATOR = 1000
"""Of the ratio of two continuous joints; a gear with more teeth could be turned by one unnoticed."""
_EXACT = 1e-12
"""How near a ratio is to its fraction."""


class CouplingRows:
    """The couplings q_joint = p(q_on) of a model; leading axes, if there are any, count samples.

    Parameters
    ----------
    model : pin.Model
        The tree.
    couplings : sequence of Coupling
        The couplings, one row each.

    Raises
    ------
    ModelError
        If a joint does not exist or has several degrees of freedom, or a continuous joint is coupled in a way
        that needs its turns counted.
    """

    def __init__(self, model: pin.Model, couplings: Sequence[Coupling]) -> None:
        self.size, self._nv = len(couplings), int(model.nv)
        joints = np.array([_ends(model, c) for c in couplings], dtype=int).reshape(-1, 2).T
        self._q, self._v = np.array(model.idx_qs)[joints], np.array(model.idx_vs)[joints]
        self.following = self._v[0]
        """Indices in v of the joints that follow."""
        circles = np.array(model.nqs)[joints] == 2
        circles[joints == 0] = False
        self._circles = [np.flatnonzero(end) for end in circles]
        self._on = np.flatnonzero(joints[1])
        coefficients = np.zeros((self.size, MAX_COEFFICIENTS))
        for row, coupling in enumerate(couplings):
            coefficients[row, : len(coupling.coefficients)] = coupling.coefficients
        powers = np.arange(MAX_COEFFICIENTS)
        first = np.roll(coefficients * powers, -1, axis=1)
        self._polynomials = np.stack((coefficients, first, np.roll(first * powers, -1, axis=1)))
        self._powers = powers
        each = zip(couplings, *circles, strict=True)
        self._period = np.array([_period(coupling, *known) for coupling, *known in each])
        self._wrapped = np.flatnonzero(self._period)

    def errors(self, q: FloatArray) -> FloatArray:
        """Return q_joint - p(q_on), taken to the nearest value that continuous joints allow, (..., size)."""
        error = self._values(q, 0) - self._derivative(q, 0)
        period = self._period[self._wrapped]
        error[..., self._wrapped] -= period * np.round(error[..., self._wrapped] / period)
        return error

    def jacobian(self, q: FloatArray) -> FloatArray:
        """Return the Jacobian (..., size, nv)."""
        J, rows = np.zeros((*q.shape[:-1], self.size, self._nv)), np.arange(self.size)
        J[..., rows, self._v[0]] = 1.0
        J[..., self._on, self._v[1, self._on]] = -self._derivative(q, 1)[..., self._on]
        return J

    def drift(self, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return J̇ v (..., size)."""
        return np.asarray(-self._derivative(q, 2) * v[..., self._v[1]] ** 2)

    def _values(self, q: FloatArray, end: int) -> FloatArray:
        """Return the values of the joints at one end, for continuous ones their angles within half a turn."""
        values = q[..., self._q[end]]
        circles = self._circles[end]
        if len(circles):
            cosine = self._q[end, circles]
            values[..., circles] = np.arctan2(q[..., cosine + 1], q[..., cosine])
        return values

    def _derivative(self, q: FloatArray, order: int) -> FloatArray:
        """Return p, p' or p'' of the joints at the other end."""
        powers = self._values(q, 1)[..., None] ** self._powers
        return np.asarray(np.sum(self._polynomials[order] * powers, axis=-1))


def _ends(model: pin.Model, coupling: Coupling) -> tuple[int, int]:
    """Return the joint that follows, and the other one or 0."""
    what = f"coupling {coupling.title}"
    joint = single_joint(model, coupling.joint, what)
    return joint, 0 if coupling.on is None else single_joint(model, coupling.on, what)


def _period(coupling: Coupling, circle: bool, on_circle: bool) -> float:
    """Return up to multiples of what the coupling holds: what whole turns of continuous joints leave open."""
    ratio = coupling.coefficients[1] if len(coupling.coefficients) > 1 else 0.0
    if not on_circle or not any(coupling.coefficients[1:]):
        return 2.0 * np.pi if circle else 0.0
    help_ = "the turns of a continuous joint are not counted: make it revolute"
    if any(coupling.coefficients[2:]):
        raise ModelError(f"coupling {coupling.title}: {coupling.on!r} enters in a higher power; {help_}")
    if not circle:
        return float(2.0 * np.pi * abs(ratio))
    fraction = Fraction(ratio).limit_denominator(_LARGEST_DENOMINATOR)
    if abs(float(fraction) - ratio) > _EXACT * abs(ratio):
        raise ModelError(
            f"coupling {coupling.title}: the ratio {ratio:.12g} of two continuous joints is no fraction with "
            f"a denominator of at most {_LARGEST_DENOMINATOR}; {help_}"
        )
    return float(2.0 * np.pi / fraction.denominator)
