"""Closures and couplings as formulas: errors, rows of the Jacobian, and accelerations at the closures.

All of a closure is in the axes of the body of frame 1. Its rows are those of the general layer where the
loops are closed; their errors agree to first order. The point whose velocity counts is the origin of frame 2.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from p3dof._base.tracing import Number, Symbol, Tape
from p3dof.loops.bushings import Bushing, Bushings
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.compiled.dynamics import BodyRates
from p3dof.loops.coordinates import TurningSpring, joint_named, single_joint
from p3dof.loops.sidecar import Closure, Coupling, JointData
from p3dof.loops.tree_formulas import (
    ZERO,
    Matrix,
    Placements,
    RelativeBody,
    Tree,
    Vector,
    axial,
    back,
    between,
    cross,
    dot,
    matrix_of,
    minus,
    numbers,
    of_quaternion,
    plus,
    product,
    times,
    transposed,
    turned,
)

Row = dict[int, "Number"]  # entries of a row of the Jacobian, by their place in v


@dataclass(frozen=True)
class _Ends:
    """A closure and where its frames are: the part and the placement on its body, of frame 1 and frame 2."""

    closure: Closure
    parts: tuple[int, int]
    R1: Matrix
    p1: Vector
    R2: Matrix
    p2: Vector


class Loops:
    """The closures and couplings of a robot as formulas on one tape."""

    def __init__(self, tree: Tree, kinematics: LoopKinematics, where: Placements) -> None:
        self._tree, self._where = tree, where
        self.size = kinematics.size
        self._closures = []
        for closure, ends in zip(kinematics.closures, kinematics.ends, strict=True):
            joint1, place1, joint2, place2 = ends
            parts = tree.of_joint[int(joint1)], tree.of_joint[int(joint2)]
            placed = [(matrix_of(p.rotation), numbers(p.translation, tree.size)) for p in (place1, place2)]
            self._closures.append(_Ends(closure, parts, *placed[0], *placed[1]))
        self._relative = [between(tree, where, ends.parts, ends.p2) for ends in self._closures]
        self.parts = sorted(
            {part for ends in self._closures for end in ends.parts for part in tree.path(end)}
        )
        """The parts that closures hang on, and all before them."""

    def rows(self) -> list[Row]:
        """Return the rows of the Jacobian: closures, in the order of the general layer."""
        found = []
        for ends, relative in zip(self._closures, self._relative, strict=True):
            forms = self._forms(ends, relative)
            for along, about in forms:
                row = {}
                for place, (velocity, turning) in relative.columns.items():
                    value = dot(along, velocity) + dot(about, turning)
                    if not (isinstance(value, float) and value == 0.0):
                        row[place] = value
                found.append(row)
        return found

    def errors(self) -> list[Number]:
        """Return how far the closures are open, in the order of the rows."""
        found: list[Number] = []
        for ends, relative in zip(self._closures, self._relative, strict=True):
            d = minus(relative.point, ends.p1)
            found += _ERRORS[ends.closure.kind](ends, relative, d)
        return found

    def accelerations(self, v: Sequence[Number], moving: BodyRates, opening: bool = False) -> list[Number]:
        """Return the second derivatives of the errors of closed loops that stay closed, or open slowly."""
        found: list[Number] = []
        for ends, relative in zip(self._closures, self._relative, strict=True):
            first, second = ends.parts
            omega = minus(turned(relative.R, moving.omega[second]), moving.omega[first])
            alpha = minus(
                minus(turned(relative.R, moving.alpha[second]), moving.alpha[first]),
                cross(moving.omega[first], omega),
            )
            here = plus(moving.A[second], turned(moving.U[second], ends.p2))
            there = plus(moving.A[first], turned(moving.U[first], relative.point))
            d_ddot = minus(turned(relative.R, here), there)
            d_dot = ZERO
            if opening or ends.closure.kind not in _POINTS:
                for place, (velocity, _) in relative.columns.items():
                    d_dot = plus(d_dot, times(v[place], velocity))
                d_ddot = minus(d_ddot, times(2.0, cross(moving.omega[first], d_dot)))
            forms = self._forms(ends, relative)
            plain = [dot(along, d_ddot) + dot(about, alpha) for along, about in forms]
            more = _BIASES.get(ends.closure.kind)
            if more is not None:
                biases = more(ends, relative, d_dot, omega)
                plain = [x + y for x, y in zip(plain, biases, strict=True)]
            found += plain
        return found

    def multipliers(self, values: Sequence[Number]) -> list[Number]:
        """Return the multipliers of the general layer: those of points and frames in the axes of frame 1."""
        found, start = list(values), 0
        for ends in self._closures:
            if ends.closure.kind in ("3d", "6d"):
                for at in range(start, start + ends.closure.rows, 3):
                    x, y, z = values[at : at + 3]
                    found[at : at + 3] = back(ends.R1, (x, y, z))
            start += ends.closure.rows
        return found

    def general_rows(self) -> list[Row]:
        """Return the rows of the Jacobian as the general layer has them, to which its multipliers belong."""
        rows = self.rows()
        columns = {
            place: self.multipliers([row.get(place, 0.0) for row in rows])
            for place in sorted({place for row in rows for place in row})
        }
        found: list[Row] = []
        for i in range(len(rows)):
            entries = {place: column[i] for place, column in columns.items()}
            found.append({place: x for place, x in entries.items() if isinstance(x, Symbol) or x != 0.0})
        return found

    def wrenches(self, multipliers: Sequence[Number]) -> list[Number]:
        """Return what each closure exerts on body 2 at the origin of frame 2, in the axes of body 1."""
        found: list[Number] = []
        start = 0
        for ends, relative in zip(self._closures, self._relative, strict=True):
            forms = self._forms(ends, relative)
            if ends.closure.kind in ("3d", "6d"):
                axes = transposed(ends.R1)
                forms = [*((axis, ZERO) for axis in axes), *((ZERO, axis) for axis in axes)][: len(forms)]
            force, moment = ZERO, ZERO
            for (along, about), value in zip(forms, multipliers[start:], strict=False):
                force, moment = plus(force, times(value, along)), plus(moment, times(value, about))
            found += [*force, *moment]
            start += len(forms)
        return found

    def _forms(self, ends: _Ends, relative: RelativeBody) -> list[tuple[Vector, Vector]]:
        """Return what of velocity and rotation each row takes."""
        x, y, z = transposed(ends.R1)
        kind = ends.closure.kind
        base = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        if kind in ("3d", "6d"):
            points: list[tuple[Vector, Vector]] = [(axis, ZERO) for axis in base]
            return points if kind == "3d" else [*points, *((ZERO, axis) for axis in base)]
        if kind == "distance":
            d = minus(relative.point, ends.p1)
            return [(times(1.0 / _length(ends), d), ZERO)]
        position = {"hinge": (x, y, z), "universal": (x, y, z), "slider": (x, y), "cylindrical": (x, y)}
        rotation: Sequence[Vector] = {"slider": (x, y, z)}.get(kind, (x, y))
        if kind == "universal":
            rotation = (cross(x, turned(relative.R, transposed(ends.R2)[1])),)
        along = [(axis, ZERO) for axis in position.get(kind, (z,))]
        return [*along, *((ZERO, axis) for axis in rotation)]

    def aligned(self) -> list[Number]:
        """Return what must be positive besides small errors: axes that agree are not opposite."""
        found: list[Number] = []
        for ends, relative in zip(self._closures, self._relative, strict=True):
            if ends.closure.kind in ("hinge", "cylindrical", "planar"):
                found.append(dot(transposed(ends.R1)[2], _axes_of_two(ends, relative)[2]))
            elif ends.closure.kind in ("slider", "6d"):
                x, y, z = _axes_of_two(ends, relative)
                one = transposed(ends.R1)
                found.append(dot(one[0], x) + dot(one[1], y) + dot(one[2], z))
        return found


def _length(ends: _Ends) -> float:
    return float(ends.closure.length or np.nan)


def _axes_of_two(ends: _Ends, relative: RelativeBody) -> Matrix:
    """Return x2, y2, z2 in the axes of body 1."""
    x, y, z = (turned(relative.R, axis) for axis in transposed(ends.R2))
    return x, y, z


def _components(ends: _Ends, d: Vector, which: str) -> list[Number]:
    axes = dict(zip("xyz", transposed(ends.R1), strict=True))
    return [dot(axes[name], d) for name in which]


def _tilt(ends: _Ends, relative: RelativeBody) -> list[Number]:
    """How far z2 is from z1, about x1 and y1."""
    x, y, _ = transposed(ends.R1)
    z2 = _axes_of_two(ends, relative)[2]
    return [-dot(y, z2), dot(x, z2)]


def _turn(ends: _Ends, relative: RelativeBody) -> Vector:
    """Half of the axial vector of the rotation from frame 1 to 2, in the axes of body 1."""
    return times(0.5, axial(product(transposed(_axes_of_two(ends, relative)), transposed(ends.R1))))


def _square(ends: _Ends, relative: RelativeBody) -> list[Number]:
    return [-dot(transposed(ends.R1)[0], _axes_of_two(ends, relative)[1])]


def _rod(ends: _Ends, d: Vector) -> list[Number]:
    length = _length(ends)
    return [(dot(d, d) - length * length) * (0.5 / length)]


_ERRORS: dict[str, Callable[[_Ends, RelativeBody, Vector], list[Number]]] = {
    "3d": lambda _e, _r, d: [*d],
    "6d": lambda e, r, d: [*d, *_turn(e, r)],
    "hinge": lambda e, r, d: [*_components(e, d, "xyz"), *_tilt(e, r)],
    "slider": lambda e, r, d: [*_components(e, d, "xy"), *back(e.R1, _turn(e, r))],
    "universal": lambda e, r, d: [*_components(e, d, "xyz"), *_square(e, r)],
    "cylindrical": lambda e, r, d: [*_components(e, d, "xy"), *_tilt(e, r)],
    "planar": lambda e, r, d: [*_components(e, d, "z"), *_tilt(e, r)],
    "distance": lambda e, _r, d: _rod(e, d),
}


def _square_bias(ends: _Ends, relative: RelativeBody, _d_dot: Vector, omega: Vector) -> list[Number]:
    y2 = _axes_of_two(ends, relative)[1]
    return [0.0, 0.0, 0.0, -dot(transposed(ends.R1)[0], cross(omega, cross(omega, y2)))]


def _rod_bias(ends: _Ends, _relative: RelativeBody, d_dot: Vector, _omega: Vector) -> list[Number]:
    return [dot(d_dot, d_dot) * (1.0 / _length(ends))]


_BIASES = {"universal": _square_bias, "distance": _rod_bias}
_POINTS = ("3d", "6d", "hinge", "universal")
"""Kinds whose frames have one origin: that of frame 2 does not move in the axes of body 1."""


class CoupledJoints:
    """The couplings of a robot on one tape."""

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


_TINY = 1e-200  # square of a length that is none


class PassiveJoints:
    """What acts in a tree by itself, as `Passive`."""

    def __init__(self, model: pin.Model, entries: Sequence[JointData], bushings: Sequence[Bushing]) -> None:
        self._nv = int(model.nv)
        self._bushings = Bushings(model, bushings) if bushings else None
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
                    value = value - entry.friction * tape.tanh(v[place] * (1.0 / entry.smoothing))
                if entry.stiffness and len(places) == 1:
                    rest = float(entry.rest)  # type: ignore[arg-type]  # of a joint with one freedom
                    value = value - entry.stiffness * _stretch(tape, q, at_q, rest, circle)
                found[place] = value
        for spring in self._turning:
            values = _turning_stretch(tape, list(q[spring.q]), spring.rest.tolist())
            for place, stretch in zip(range(spring.v.start, spring.v.stop), values, strict=True):
                found[place] = found[place] - spring.stiffness * stretch
        for place, force in self._bushings.traced_forces(tape, q, v).items() if self._bushings else ():
            found[place] = found[place] + force
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
