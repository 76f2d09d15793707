"""Springs, balances, damping and friction in joints as formulas."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pinocchio as pin

from p3dof._base.tracing import Number, Tape
from p3dof.loops.compiled.tree import of_quaternion
from p3dof.loops.compiled.vectors import Vector, back, cross, dot, minus, plus, times
from p3dof.loops.joint_data import JointData
from p3dof.loops.joints import joint_named
from p3dof.loops.passive import SMOOTHING
from p3dof.loops.turning_springs import TurningSpring

_TINY = 1e-200
"""Square of a length that is none."""


class PassiveJoints:
    """What acts in joints by itself.

    Parameters
    ----------
    model : pin.Model
        The tree.
    entries : sequence of JointData
        What the sidecar says of its joints.
    """

    def __init__(self, model: pin.Model, entries: Sequence[JointData]) -> None:
        self._nv = int(model.nv)
        self._entries = []
        self._turning = []
        for entry in entries:
            joint = joint_named(model, entry.joint, "joint data")
            q, v, sizes = model.idx_qs[joint], model.idx_vs[joint], (model.nqs[joint], model.nvs[joint])
            self._entries.append((entry, q, range(v, v + sizes[1]), sizes[0] == 2))
            if entry.stiffness and sizes[1] > 1:
                self._turning.append(TurningSpring.of(model, joint, entry))

    def forces(self, tape: Tape, q: Sequence[Number], v: Sequence[Number]) -> list[Number]:
        """Return the generalised forces (nv,)."""
        found: list[Number] = [0.0] * self._nv
        for entry, at_q, places, circle in self._entries:
            for place in places:
                value = -entry.damping * v[place]
                if entry.force:
                    value = value + entry.force
                if entry.friction:
                    value = value - entry.friction * tape.tanh(v[place] * (1.0 / SMOOTHING))
                if entry.stiffness and len(places) == 1:
                    rest = float(entry.rest)  # type: ignore[arg-type]  # of a joint with one freedom
                    value = value - entry.stiffness * _stretch(tape, q, at_q, rest, circle)
                found[place] = value
        for spring in self._turning:
            values = _turning_stretch(tape, list(q[spring.q]), spring.rest.tolist())
            for place, stretch in zip(range(spring.v.start, spring.v.stop), values, strict=True):
                found[place] = found[place] - spring.stiffness * stretch
        return found


def _stretch(tape: Tape, q: Sequence[Number], at: int, rest: float, circle: bool) -> Number:
    if not circle:
        return q[at] - rest
    c, s = math.cos(rest), math.sin(rest)
    return tape.atan2(q[at + 1] * c - q[at] * s, q[at] * c + q[at + 1] * s)


def _turning_stretch(tape: Tape, q: Sequence[Number], rest: Sequence[float]) -> list[Number]:
    """Return how far a ball or a free joint is from rest, as `TurningSpring.stretch`."""
    now: Vector = (q[-4], q[-3], q[-2])
    back_u, w = (-rest[-4], -rest[-3], -rest[-2]), rest[-1]
    vector = plus(times(w, now), times(q[-1], back_u), cross(back_u, now))
    scalar = w * q[-1] - dot(back_u, now)
    size = tape.sqrt(scalar * scalar)
    # Where there is no turn, the angle over its sine is 2, and the tiny number keeps it from being 0 / 0.
    length = tape.sqrt(dot(vector, vector) + _TINY)
    share = tape.divide(2.0 * tape.atan2(length, size) * scalar, length * size)
    turn = times(share, vector)
    if len(q) == 4:
        return [*turn]
    shift = minus((q[0], q[1], q[2]), (rest[0], rest[1], rest[2]))
    return [*back(of_quaternion(q[3:]), shift), *turn]
