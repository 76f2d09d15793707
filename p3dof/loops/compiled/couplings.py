"""Couplings of joints as formulas: errors, rows of the Jacobian, accelerations."""

from __future__ import annotations

from collections.abc import Sequence

import pinocchio as pin

from p3dof._base.tracing import Number, Tape
from p3dof.loops.constraints import Coupling
from p3dof.loops.joints import single_joint


class CoupledJoints:
    """The couplings of a robot on one tape.

    Parameters
    ----------
    model : pin.Model
        The tree.
    couplings : sequence of Coupling
        The couplings.
    periods : sequence of float
        By coupling, up to multiples of what it holds; zero where it holds as it is.
    """

    def __init__(self, model: pin.Model, couplings: Sequence[Coupling], periods: Sequence[float]) -> None:
        self._model, self._couplings, self._periods = model, couplings, periods

    def rows(self, tape: Tape, q: Sequence[Number]) -> list[dict[int, Number]]:
        """Return the rows of the Jacobian, by place in v."""
        found = []
        for coupling in self._couplings:
            row: dict[int, Number] = {self._v(coupling.joint): 1.0}
            if coupling.on is not None:
                slope = _polynomial(_derived(coupling.coefficients), self._power_base(tape, q, coupling))
                if not (isinstance(slope, float) and slope == 0.0):
                    row[self._v(coupling.on)] = -slope
            for name, factor in coupling.others:
                row[self._v(name)] = -factor
            found.append(row)
        return found

    def errors(self, tape: Tape, q: Sequence[Number]) -> list[Number]:
        """Return how far the couplings are off, to the nearest that continuous joints allow."""
        found = []
        for coupling, period in zip(self._couplings, self._periods, strict=True):
            error = self._value(tape, q, coupling.joint)
            on = 0.0 if coupling.on is None else self._value(tape, q, coupling.on)
            error = error - _polynomial(coupling.coefficients, on)
            for name, factor in coupling.others:
                error = error - factor * self._value(tape, q, name)
            if period:
                error = error - period * tape.floor(error * (1.0 / period) + 0.5)
            found.append(error)
        return found

    def accelerations(
        self, tape: Tape, q: Sequence[Number], v: Sequence[Number], a: Sequence[Number]
    ) -> list[Number]:
        """Return the second derivatives of the errors."""
        found = []
        for coupling, row in zip(self._couplings, self.rows(tape, q), strict=True):
            value: Number = 0.0
            for place, factor in row.items():
                value = value + factor * a[place]
            if coupling.on is not None and len(coupling.coefficients) > 2:
                bent = _polynomial(
                    _derived(_derived(coupling.coefficients)), self._power_base(tape, q, coupling)
                )
                speed = v[self._v(coupling.on)]
                value = value - bent * (speed * speed)
            found.append(value)
        return found

    def _power_base(self, tape: Tape, q: Sequence[Number], coupling: Coupling) -> Number:
        """Return the value that enters a polynomial; not asked for where it is linear."""
        assert coupling.on is not None  # noqa: S101 - by the callers
        return self._value(tape, q, coupling.on) if len(coupling.coefficients) > 2 else 0.0

    def _value(self, tape: Tape, q: Sequence[Number], name: str) -> Number:
        joint = single_joint(self._model, name, "coupling")
        at = self._model.idx_qs[joint]
        return tape.atan2(q[at + 1], q[at]) if self._model.nqs[joint] == 2 else q[at]

    def _v(self, name: str) -> int:
        return int(self._model.idx_vs[single_joint(self._model, name, "coupling")])


def _polynomial(coefficients: Sequence[float], x: Number) -> Number:
    total: Number = 0.0
    for coefficient in reversed(coefficients):
        total = total * x + float(coefficient)
    return total


def _derived(coefficients: Sequence[float]) -> list[float]:
    return [k * c for k, c in enumerate(coefficients)][1:] or [0.0]
