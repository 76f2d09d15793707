"""Errors of couplings of joints, their Jacobian and drift, at one configuration or at many."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.errors import ModelError
from p3dof.loops.constraints import MAX_COEFFICIENTS, Coupling
from p3dof.loops.joints import single_joint

IndexArray: TypeAlias = NDArray[np.int_]

_LARGEST_DENOMINATOR = 1000
"""Of the ratio of two continuous joints; a gear with more teeth could be turned by one unnoticed."""
_EXACT = 1e-12
"""How near a ratio is to its fraction."""


class CouplingRows:
    """The couplings q_joint = p(q_on) + Σ f q_other of a model; leading axes, if any, count samples.

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
        self._others = _Others(model, couplings)
        each = zip(couplings, *circles, self._others.on_circles, strict=True)
        self.periods = np.array([_period(coupling, *known) for coupling, *known in each])
        """Up to multiples of what each holds; zero where it holds as it is."""
        self._wrapped = np.flatnonzero(self.periods)

    def errors(self, q: FloatArray) -> FloatArray:
        """Return q_joint - p(q_on) - Σ f q_other (..., size), to the nearest that continuous joints allow."""
        error = self._values(q, 0) - self._derivative(q, 0) - self._others.sums(q)
        period = self.periods[self._wrapped]
        error[..., self._wrapped] -= period * np.round(error[..., self._wrapped] / period)
        return error

    def jacobian(self, q: FloatArray) -> FloatArray:
        """Return the Jacobian (..., size, nv)."""
        J, rows = np.zeros((*q.shape[:-1], self.size, self._nv)), np.arange(self.size)
        J[..., rows, self._v[0]] = 1.0
        J[..., self._on, self._v[1, self._on]] = -self._derivative(q, 1)[..., self._on]
        J[..., self._others.rows, self._others.v] = -self._others.factors
        return J

    def drift(self, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return J̇ v (..., size)."""
        return np.asarray(-self._derivative(q, 2) * v[..., self._v[1]] ** 2)

    def _values(self, q: FloatArray, end: int) -> FloatArray:
        """Return the values of the joints at one end."""
        return _angles(q, self._q[end], self._circles[end])

    def _derivative(self, q: FloatArray, order: int) -> FloatArray:
        """Return p, p' or p'' of the joints at the other end."""
        powers = self._values(q, 1)[..., None] ** self._powers
        return np.asarray(np.sum(self._polynomials[order] * powers, axis=-1))


class _Others:
    """The linear terms of further joints, all couplings together."""

    def __init__(self, model: pin.Model, couplings: Sequence[Coupling]) -> None:
        terms = [
            (row, single_joint(model, name, f"coupling {coupling.title}"), factor)
            for row, coupling in enumerate(couplings)
            for name, factor in coupling.others
        ]
        rows, joints, factors = zip(*terms, strict=True) if terms else ((), (), ())
        self.rows, self.factors = np.array(rows, dtype=int), np.array(factors)
        """Of each term, the coupling and the factor."""
        chosen = np.array(joints, dtype=int)
        self.v, self._q = np.array(model.idx_vs)[chosen], np.array(model.idx_qs)[chosen]
        """Of each term, where its joint is in v."""
        circles = np.array(model.nqs)[chosen] == 2
        self._circles = np.flatnonzero(circles)
        self.on_circles = [self.factors[circles & (self.rows == row)] for row in range(len(couplings))]
        """Of each coupling, the factors of continuous joints."""
        self._sums = np.zeros((len(terms), len(couplings)))
        self._sums[np.arange(len(terms)), self.rows] = self.factors

    def sums(self, q: FloatArray) -> FloatArray:
        """Return Σ f q_other (..., size)."""
        return np.asarray(_angles(q, self._q, self._circles) @ self._sums) if len(self.rows) else np.zeros(())


def _angles(q: FloatArray, indices: IndexArray, circles: IndexArray) -> FloatArray:
    """Return values of joints, for continuous ones their angles within half a turn."""
    values = q[..., indices]
    if len(circles):
        cosine = indices[circles]
        values[..., circles] = np.arctan2(q[..., cosine + 1], q[..., cosine])
    return values


def _ends(model: pin.Model, coupling: Coupling) -> tuple[int, int]:
    """Return the joint that follows, and the other one or 0."""
    what = f"coupling {coupling.title}"
    joint = single_joint(model, coupling.joint, what)
    return joint, 0 if coupling.on is None else single_joint(model, coupling.on, what)


def _period(coupling: Coupling, circle: bool, on_circle: bool, others: FloatArray) -> float:
    """Return up to multiples of what the coupling holds: what whole turns of continuous joints leave open."""
    ratio = coupling.coefficients[1] if len(coupling.coefficients) > 1 else 0.0
    help_ = "the turns of a continuous joint are not counted: make it revolute"
    if on_circle and any(coupling.coefficients[2:]):
        raise ModelError(f"coupling {coupling.title}: {coupling.on!r} enters in a higher power; {help_}")
    turns = [1.0 if circle else 0.0, ratio if on_circle else 0.0, *others.tolist()]
    factors = [abs(factor) for factor in turns if factor]
    if not factors:
        return 0.0
    shares = [Fraction(factor / factors[0]).limit_denominator(_LARGEST_DENOMINATOR) for factor in factors]
    for factor, share in zip(factors, shares, strict=True):
        if abs(float(share) * factors[0] - factor) > _EXACT * factor:
            ratio = factor / factors[0]
            raise ModelError(
                f"coupling {coupling.title}: the ratio {ratio:.12g} of two continuous joints is no fraction "
                f"with a denominator of at most {_LARGEST_DENOMINATOR}; {help_}"
            )
    common = math.lcm(*(share.denominator for share in shares))
    if common > _LARGEST_DENOMINATOR:
        raise ModelError(
            f"coupling {coupling.title}: the ratios of its continuous joints have the common denominator "
            f"{common}, expected at most {_LARGEST_DENOMINATOR}; {help_}"
        )
    divisor = math.gcd(*(int(share * common) for share in shares))
    return float(2.0 * np.pi * factors[0] * divisor / common)
