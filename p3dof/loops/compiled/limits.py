"""What a result must keep to be trusted, as numbers that are positive then; formulas on a tape."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from p3dof._base.tracing import Number, Tape
from p3dof.loops.accuracy import NORMALISED, SURELY
from p3dof.loops.compiled.formulas import At
from p3dof.loops.compiled.rates import units
from p3dof.loops.compiled.vectors import dot

EVIDENCE = ("margin", "gap", "trusted")
"""Outputs that say how good a result is, the last ones of a function."""
MARGIN = 1e-3
"""Smallest pivot, compared with those that the partition was made on, that is trusted."""
MARGIN_OF_STATES = 2e-2
"""The same where accelerations are found: NᵀM N squares what is large near a singular partition."""
LIGHTEST = 1e-10
"""Smallest inertia of a free motion, of what moves in it, that is more than rounding."""


def stays_closed(
    tape: Tape, opening: Sequence[Number], relative: float, v: Sequence[Number], a: Sequence[Number] = ()
) -> Number:
    """Return what is positive where closures open by less than a part of the motion, or of one unit.

    The mean square stands for the largest entry, than which it is smaller.
    """
    if not opening:
        return 1.0
    speed = dot(v, v) * (1.0 / len(v))
    size = larger(tape, dot(a, a) * (1.0 / len(a)), speed * speed) if a else speed
    return tape.subtract(relative * relative * larger(tape, size, 1.0), dot(opening, opening))


def nothing_missing(tape: Tape, missing: Sequence[Number], forces: Sequence[Number]) -> Number:
    """Return what is positive where no force is missing that no actuator gives."""
    if not missing:
        return 1.0
    allowed = dot(forces, forces) * (SURELY * SURELY)
    return tape.add(tape.subtract(allowed, dot(missing, missing)), 1e-300)


def normalised(at: At) -> list[Number]:
    """Return what is positive where circles and quaternions in q are normalised."""
    squares = [dot(unit, unit) - 1.0 for unit in units(at)]
    return [at.tape.subtract(4.0 * NORMALISED * NORMALISED, off * off) for off in squares]


def larger(tape: Tape, a: Number, b: Number) -> Number:
    """Return the larger one of two numbers."""
    return -tape.minimum(-a, -b)


def applied(row: Mapping[int, Number], v: Sequence[Number]) -> Number:
    """Return a row of the Jacobian times a velocity."""
    total: Number = 0.0
    for place, factor in row.items():
        total = total + factor * v[place]
    return total
