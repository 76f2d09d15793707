"""Closures and couplings as formulas: errors, rows of the Jacobian, and accelerations at the closures.

All of a closure is in the axes of the body of frame 1. Its rows are those of the general layer where the
loops are closed; their errors agree to first order. The point whose velocity counts is the origin of frame 2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from p3dof._base.tracing import Number
from p3dof.loops.closures import LoopKinematics
from p3dof.loops.compiled.dynamics import Motion
from p3dof.loops.compiled.tree import Placements, Tree
from p3dof.loops.compiled.vectors import (
    IDENTITY,
    ZERO,
    Matrix,
    Vector,
    axial,
    back,
    cross,
    dot,
    matrix_of,
    minus,
    numbers,
    plus,
    product,
    times,
    transposed,
    turned,
)
from p3dof.loops.constraints import Closure

Row = dict[int, "Number"]
"""Entries of a row of the Jacobian, by their place in v."""


@dataclass(frozen=True)
class _Ends:
    """A closure and where its frames are: the part and the placement on its body, of frame 1 and frame 2."""

    closure: Closure
    parts: tuple[int, int]
    R1: Matrix
    p1: Vector
    R2: Matrix
    p2: Vector


@dataclass(frozen=True)
class _Relative:
    """Body 2 in the axes of body 1, and its rates by place in v: of the origin of frame 2, of rotation."""

    R: Matrix
    point: Vector
    columns: dict[int, tuple[Vector, Vector]] = field(default_factory=dict)


class Loops:
    """The closures and couplings of a robot as formulas on one tape.

    Parameters
    ----------
    tree : Tree
        The parts.
    kinematics : LoopKinematics
        The closures and couplings.
    where : Placements
        The tree's placements.
    """

    def __init__(self, tree: Tree, kinematics: LoopKinematics, where: Placements) -> None:
        self._tree, self._where = tree, where
        self.size = kinematics.size
        self._closures = []
        for closure, ends in zip(kinematics.closures, kinematics.ends, strict=True):
            joint1, place1, joint2, place2 = ends
            parts = tree.of_joint[int(joint1)], tree.of_joint[int(joint2)]
            placed = [(matrix_of(p.rotation), numbers(p.translation, tree.size)) for p in (place1, place2)]
            self._closures.append(_Ends(closure, parts, *placed[0], *placed[1]))
        self._relative = [self._between(ends) for ends in self._closures]
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

    def accelerations(self, v: Sequence[Number], moving: Motion, opening: bool = False) -> list[Number]:
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

    def _between(self, ends: _Ends) -> _Relative:
        """Return body 2 in the axes of body 1, by the shortest way through the tree."""
        tree, where = self._tree, self._where
        one, two = tree.path(ends.parts[0]), tree.path(ends.parts[1])
        common = set(one) & set(two)
        up, down = [i for i in one if i not in common], [i for i in two if i not in common]
        R, p, stations = IDENTITY, ZERO, []
        for part in up:
            stations.append((part, R, p, -1.0))
            R = product(R, transposed(where.R[part]))
            p = minus(p, turned(R, where.r[part]))
        for part in reversed(down):
            p = plus(p, turned(R, where.r[part]))
            R = product(R, where.R[part])
            stations.append((part, R, p, 1.0))
        point = plus(p, turned(R, ends.p2))
        relative = _Relative(R, point)
        for part, axes, origin, sign in stations:
            here = tree.parts[part]
            for axis, slide, place in zip(here.turning, here.sliding, here.v, strict=True):
                turning = times(sign, turned(axes, axis))
                velocity = plus(times(sign, turned(axes, slide)), cross(turning, minus(point, origin)))
                relative.columns[place] = velocity, turning
        return relative

    def _forms(self, ends: _Ends, relative: _Relative) -> list[tuple[Vector, Vector]]:
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


def _axes_of_two(ends: _Ends, relative: _Relative) -> Matrix:
    """Return x2, y2, z2 in the axes of body 1."""
    x, y, z = (turned(relative.R, axis) for axis in transposed(ends.R2))
    return x, y, z


def _components(ends: _Ends, d: Vector, which: str) -> list[Number]:
    axes = dict(zip("xyz", transposed(ends.R1), strict=True))
    return [dot(axes[name], d) for name in which]


def _tilt(ends: _Ends, relative: _Relative) -> list[Number]:
    """How far z2 is from z1, about x1 and y1."""
    x, y, _ = transposed(ends.R1)
    z2 = _axes_of_two(ends, relative)[2]
    return [-dot(y, z2), dot(x, z2)]


def _turn(ends: _Ends, relative: _Relative) -> Vector:
    """Half of the axial vector of the rotation from frame 1 to 2, in the axes of body 1."""
    return times(0.5, axial(product(transposed(_axes_of_two(ends, relative)), transposed(ends.R1))))


def _square(ends: _Ends, relative: _Relative) -> list[Number]:
    return [-dot(transposed(ends.R1)[0], _axes_of_two(ends, relative)[1])]


def _rod(ends: _Ends, d: Vector) -> list[Number]:
    length = _length(ends)
    return [(dot(d, d) - length * length) * (0.5 / length)]


_ERRORS: dict[str, Callable[[_Ends, _Relative, Vector], list[Number]]] = {
    "3d": lambda _e, _r, d: [*d],
    "6d": lambda e, r, d: [*d, *_turn(e, r)],
    "hinge": lambda e, r, d: [*_components(e, d, "xyz"), *_tilt(e, r)],
    "slider": lambda e, r, d: [*_components(e, d, "xy"), *back(e.R1, _turn(e, r))],
    "universal": lambda e, r, d: [*_components(e, d, "xyz"), *_square(e, r)],
    "cylindrical": lambda e, r, d: [*_components(e, d, "xy"), *_tilt(e, r)],
    "planar": lambda e, r, d: [*_components(e, d, "z"), *_tilt(e, r)],
    "distance": lambda e, _r, d: _rod(e, d),
}


def _square_bias(ends: _Ends, relative: _Relative, _d_dot: Vector, omega: Vector) -> list[Number]:
    y2 = _axes_of_two(ends, relative)[1]
    return [0.0, 0.0, 0.0, -dot(transposed(ends.R1)[0], cross(omega, cross(omega, y2)))]


def _rod_bias(ends: _Ends, _relative: _Relative, d_dot: Vector, _omega: Vector) -> list[Number]:
    return [dot(d_dot, d_dot) * (1.0 / _length(ends))]


_BIASES = {"universal": _square_bias, "distance": _rod_bias}
_POINTS = ("3d", "6d", "hinge", "universal")
"""Kinds whose frames have one origin: that of frame 2 does not move in the axes of body 1."""
