"""A tree as a list of elementary joints with constants, and their placements and rates as formulas.

Every joint of Pinocchio becomes a chain of parts whose axes are fixed in the body that they move; all but
the last body of a chain have no mass. Velocities keep Pinocchio's meaning.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin

from p3dof._base.errors import ModelError
from p3dof._base.tracing import Number, Tape

Vector: TypeAlias = tuple[Number, Number, Number]
Matrix: TypeAlias = tuple[Vector, Vector, Vector]

_SNAP = 1e-14  # entries below this part of a size are rounding of angles in a file, and become zero

ZERO: Vector = (0.0, 0.0, 0.0)
IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
NOTHING: Matrix = (ZERO, ZERO, ZERO)


def numbers(values: Sequence[float], size: float = 1.0) -> Vector:
    """Return three known numbers; those that are nothing beside a size become zero."""
    x, y, z = (_snapped(float(value), size) for value in values)
    return x, y, z


def matrix_of(values: np.ndarray, size: float = 1.0) -> Matrix:
    """Return a known matrix; entries that are nothing beside a size become zero."""
    a, b, c = (numbers(row, size) for row in np.asarray(values))
    return a, b, c


def _snapped(value: float, size: float) -> float:
    if abs(value) <= _SNAP * size:
        return 0.0
    for whole in (1.0, -1.0):
        if abs(value - whole) < _SNAP:
            return whole
    return value


def plus(a: Vector, *others: Vector) -> Vector:
    """Return a sum."""
    x, y, z = a
    for b in others:
        x, y, z = x + b[0], y + b[1], z + b[2]
    return x, y, z


def minus(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def times(factor: Number, a: Vector) -> Vector:
    """Return a multiple."""
    return factor * a[0], factor * a[1], factor * a[2]


def dot(a: Sequence[Number], b: Sequence[Number]) -> Number:
    """Return a · b."""
    total: Number = 0.0
    for x, y in zip(a, b, strict=True):
        total = total + x * y
    return total


def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def turned(R: Matrix, a: Vector) -> Vector:
    """Return R a."""
    return dot(R[0], a), dot(R[1], a), dot(R[2], a)


def transposed(R: Matrix) -> Matrix:
    """Return the transposed matrix."""
    return ((R[0][0], R[1][0], R[2][0]), (R[0][1], R[1][1], R[2][1]), (R[0][2], R[1][2], R[2][2]))


def back(R: Matrix, a: Vector) -> Vector:
    """Return Rᵀ a."""
    return turned(transposed(R), a)


def product(A: Matrix, B: Matrix) -> Matrix:
    """Return A B."""
    columns = transposed(B)
    x, y, z = ((dot(row, columns[0]), dot(row, columns[1]), dot(row, columns[2])) for row in A)
    return x, y, z


def added(A: Matrix, B: Matrix) -> Matrix:
    """Return A + B."""
    return plus(A[0], B[0]), plus(A[1], B[1]), plus(A[2], B[2])


def outer(a: Vector, b: Vector) -> Matrix:
    """Return a bᵀ."""
    return times(a[0], b), times(a[1], b), times(a[2], b)


def rate_matrix(omega: Vector, alpha: Vector) -> Matrix:
    """Return [α]x + [ω]x [ω]x: what the acceleration of points of a body has by their places."""
    x, y, z = omega
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    return (
        (-(yy + zz), xy - alpha[2], xz + alpha[1]),
        (xy + alpha[2], -(xx + zz), yz - alpha[0]),
        (xz - alpha[1], yz + alpha[0], -(xx + yy)),
    )


def axial(A: Matrix) -> Vector:
    """Return the vector of A - Aᵀ: that of [a]x is 2 a."""
    return A[2][1] - A[1][2], A[0][2] - A[2][0], A[1][0] - A[0][1]


_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Part:
    """An elementary joint and the body that it moves."""

    kind: str
    """`revolute`, `unbounded` (cosine and sine in q), `prismatic`, `helical`, `ball` (quaternion), `free`
    (position and quaternion), `planar` (x, y, cosine, sine), `translation`."""
    parent: int  # the part before, 0 for the world
    R0: Matrix  # placement of the joint in the axes of the body before
    p0: Vector
    axis: Vector  # of a joint with one freedom
    pitch: float  # of a helical one [m/rad]
    q: tuple[int, ...]  # its places in q and v
    v: tuple[int, ...]
    mass: Number = 0.0  # mass, first moment and second moment ∫ r rᵀ dm of the body about its origin
    first: Vector = ZERO
    second: Matrix = NOTHING

    @property
    def solid(self) -> bool:
        """Whether the body has a mass or an inertia."""
        known = self.mass == 0.0 and self.second == NOTHING
        return not known

    @property
    def turning(self) -> tuple[Vector, ...]:
        """The angular velocity of the body for each unit speed, in its own axes."""
        return {
            "revolute": (self.axis,),
            "unbounded": (self.axis,),
            "helical": (self.axis,),
            "prismatic": (ZERO,),
            "ball": _AXES,
            "free": (ZERO, ZERO, ZERO, *_AXES),
            "planar": (ZERO, ZERO, _AXES[2]),
            "translation": (ZERO, ZERO, ZERO),
        }[self.kind]

    @property
    def sliding(self) -> tuple[Vector, ...]:
        """The velocity of the body's origin for each unit speed, in its own axes."""
        return {
            "revolute": (ZERO,),
            "unbounded": (ZERO,),
            "helical": (times(self.pitch, self.axis),),
            "prismatic": (self.axis,),
            "ball": (ZERO, ZERO, ZERO),
            "free": (*_AXES, ZERO, ZERO, ZERO),
            "planar": (_AXES[0], _AXES[1], ZERO),
            "translation": _AXES,
        }[self.kind]


@dataclass(frozen=True)
class Tree:
    """The parts of a tree, the world first, and which of them carries each joint of the model."""

    parts: tuple[Part, ...]  # the first is the world
    of_joint: tuple[int, ...]  # by joint of the model, the part whose body is that of the joint
    nq: int  # sizes of q and v
    nv: int
    gravity: Vector  # [m/s²]
    armature: tuple[float, ...]  # by entry of v
    size: float = 1.0  # its largest length, one if that is longer or nothing: beside it rounding is told [m]

    def path(self, part: int) -> list[int]:
        """Return the parts from one up to the world, which is left out."""
        found = []
        while part:
            found.append(part)
            part = self.parts[part].parent
        return found


def tree_of(model: pin.Model) -> Tree:
    """Return the parts of a tree."""
    size = _size(model)
    world = Part("prismatic", 0, IDENTITY, ZERO, ZERO, 0.0, (), ())
    parts, of_joint = [world], [0]
    for i in range(1, model.njoints):
        chain = _chain(model.joints[i], str(model.names[i]), model.jointPlacements[i], size)
        above = of_joint[int(model.parents[i])]
        for link in chain:
            parts.append(replace(link, parent=above))
            above = len(parts) - 1
        parts[-1] = _with_body(parts[-1], model.inertias[i], size)
        of_joint.append(above)
    gravity = numbers(model.gravity.linear)
    armature = tuple(map(float, model.armature))
    return Tree(tuple(parts), tuple(of_joint), model.nq, model.nv, gravity, armature, size)


def _size(model: pin.Model) -> float:
    placed = [*model.jointPlacements, *(frame.placement for frame in model.frames)]
    largest = max(float(np.abs(placement.translation).max()) for placement in placed)
    return min(1.0, largest) or 1.0


def _with_body(part: Part, inertia: pin.Inertia, size: float) -> Part:
    mass, lever = float(inertia.mass), numbers(inertia.lever, size)
    about_centre = np.array(inertia.inertia)
    second = matrix_of(
        np.trace(about_centre) / 2 * np.eye(3) - about_centre, float(np.abs(about_centre).max())
    )
    first = times(mass, lever)
    return replace(part, mass=mass, first=first, second=added(second, outer(first, lever)))


def with_parameters(part: Part, values: Sequence[Number]) -> Part:
    """Return a part with other inertial parameters."""
    mass, hx, hy, hz, xx, xy, yy, xz, yz, zz = values
    half = (xx + yy + zz) * 0.5
    second = (half - xx, -xy, -xz), (-xy, half - yy, -yz), (-xz, -yz, half - zz)
    return replace(part, mass=mass, first=(hx, hy, hz), second=second)


def _chain(joint: Any, name: str, placement: pin.SE3, size: float) -> list[Part]:
    """Return the parts of a joint; their parents are not known yet."""
    kind = joint.shortname().removeprefix("JointModel")
    R0, p0 = matrix_of(placement.rotation), numbers(placement.translation, size)
    at_q, at_v = joint.idx_q, joint.idx_v
    if kind == "Composite":
        inner = joint.extract()
        pairs = zip(inner.joints, inner.jointPlacements, strict=True)
        links = [link for each, where in pairs for link in _chain(each, name, where, size)]
        first = links[0]
        links[0] = replace(first, R0=product(R0, first.R0), p0=plus(p0, turned(R0, first.p0)))
        return links
    axes = _chain_of_axes(joint, kind)
    if axes is not None:
        links = [
            Part("revolute", 0, IDENTITY, ZERO, numbers(axis), 0.0, (at_q + i,), (at_v + i,))
            for i, axis in enumerate(axes)
        ]
        links[0] = replace(links[0], R0=R0, p0=p0)
        return links
    known = _kind_of(kind)
    if known is None:
        raise ModelError(f"joint {name!r}: a joint of the type {kind} cannot be compiled")
    axis, pitch = _axis(joint, known)
    q, v = (tuple(range(at, at + size)) for at, size in ((at_q, joint.nq), (at_v, joint.nv)))
    return [Part(known, 0, R0, p0, axis, pitch, q, v)]


def _chain_of_axes(joint: Any, kind: str) -> Sequence[Sequence[float]] | None:
    if kind == "Universal":
        inner = joint.extract()
        return inner.axis1, inner.axis2
    return (_AXES[2], _AXES[1], _AXES[0]) if kind == "SphericalZYX" else None


def _kind_of(kind: str) -> str | None:
    starts = (
        ("RevoluteUnbounded", "unbounded"),
        ("RUB", "unbounded"),
        ("Revolute", "revolute"),
        ("R", "revolute"),
        ("Prismatic", "prismatic"),
        ("Planar", "planar"),
        ("P", "prismatic"),
        ("H", "helical"),
        ("FreeFlyer", "free"),
        ("Spherical", "ball"),
        ("Translation", "translation"),
    )
    return next((known for start, known in starts if kind.startswith(start)), None)


def _axis(joint: Any, kind: str) -> tuple[Vector, float]:
    if kind not in {"revolute", "unbounded", "prismatic", "helical"}:
        return ZERO, 0.0
    data = joint.createData()
    q = np.zeros(joint.idx_q + joint.nq)
    q[joint.idx_q] = 1.0 if kind == "unbounded" else 0.0
    joint.calc(data, q)
    S = np.asarray(data.S).reshape(6)
    if kind == "prismatic":
        return numbers(S[:3].tolist()), 0.0
    return numbers(S[3:].tolist()), float(S[:3] @ S[3:])


@dataclass(frozen=True)
class Placements:
    """Where every body is in the axes of the body before, as formulas of q."""

    R: list[Matrix]  # by part; takes vectors in its axes to those of the body before
    r: list[Vector]  # by part, its origin in the axes of the body before


def placements(tree: Tree, tape: Tape, q: Sequence[Number]) -> Placements:
    """Return the formulas of a tree's placements."""
    R, r = [IDENTITY], [ZERO]
    for part in tree.parts[1:]:
        rotation, shift = _MOVES[part.kind](part, tape, [q[i] for i in part.q])
        R.append(part.R0 if rotation is IDENTITY else product(part.R0, rotation))
        r.append(part.p0 if shift is ZERO else plus(part.p0, turned(part.R0, shift)))
    return Placements(R, r)


@dataclass(frozen=True)
class RelativeBody:
    """A body in the axes of another one, and its rates by place in v: of a point of it, of rotation."""

    R: Matrix
    point: Vector
    columns: dict[int, tuple[Vector, Vector]] = field(default_factory=dict)


def between(tree: Tree, where: Placements, parts: tuple[int, int], place: Vector) -> RelativeBody:
    """Return the body of the second part, and a point in its axes, in those of the first's body.

    By the shortest way through the tree.
    """
    one, two = tree.path(parts[0]), tree.path(parts[1])
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
    relative = RelativeBody(R, plus(p, turned(R, place)))
    for part, axes, origin, sign in stations:
        here = tree.parts[part]
        for axis, slide, at in zip(here.turning, here.sliding, here.v, strict=True):
            turning = times(sign, turned(axes, axis))
            arm = minus(relative.point, origin)
            relative.columns[at] = plus(times(sign, turned(axes, slide)), cross(turning, arm)), turning
    return relative


_Move = Callable[[Part, Tape, "list[Number]"], tuple[Matrix, Vector]]


def _revolute(part: Part, tape: Tape, q: list[Number]) -> tuple[Matrix, Vector]:
    return _about(part.axis, tape.cos(q[0]), tape.sin(q[0])), ZERO


def _unbounded(part: Part, _tape: Tape, q: list[Number]) -> tuple[Matrix, Vector]:
    return _about(part.axis, q[0], q[1]), ZERO


def _prismatic(part: Part, _tape: Tape, q: list[Number]) -> tuple[Matrix, Vector]:
    return IDENTITY, times(q[0], part.axis)


def _helical(part: Part, tape: Tape, q: list[Number]) -> tuple[Matrix, Vector]:
    return _revolute(part, tape, q)[0], times(part.pitch * q[0], part.axis)


def _ball(_part: Part, _tape: Tape, q: list[Number]) -> tuple[Matrix, Vector]:
    return of_quaternion(q), ZERO


def _free(_part: Part, _tape: Tape, q: list[Number]) -> tuple[Matrix, Vector]:
    return of_quaternion(q[3:]), (q[0], q[1], q[2])


def _planar(_part: Part, _tape: Tape, q: list[Number]) -> tuple[Matrix, Vector]:
    return _about(_AXES[2], q[2], q[3]), (q[0], q[1], 0.0)


def _translation(_part: Part, _tape: Tape, q: list[Number]) -> tuple[Matrix, Vector]:
    return IDENTITY, (q[0], q[1], q[2])


_MOVES: dict[str, _Move] = {
    "revolute": _revolute,
    "unbounded": _unbounded,
    "prismatic": _prismatic,
    "helical": _helical,
    "ball": _ball,
    "free": _free,
    "planar": _planar,
    "translation": _translation,
}


def _about(axis: Vector, c: Number, s: Number) -> Matrix:
    """Return the rotation about a known axis with a cosine and a sine (Rodrigues' formula)."""
    x, y, z = axis
    if axis in _AXES or times(-1.0, axis) in _AXES:
        xx, yy, zz = (c if a == 0.0 else 1.0 for a in axis)
        return (xx, -(z * s), y * s), (z * s, yy, -(x * s)), (-(y * s), x * s, zz)
    one = 1.0 - c
    return (
        (x * x * one + c, x * y * one - z * s, x * z * one + y * s),
        (x * y * one + z * s, y * y * one + c, y * z * one - x * s),
        (x * z * one - y * s, y * z * one + x * s, z * z * one + c),
    )


def of_quaternion(q: Sequence[Number]) -> Matrix:
    """Return the rotation of a unit quaternion x, y, z, w."""
    x, y, z, w = q
    x2, y2, z2 = x + x, y + y, z + z
    xx, yy, zz, xy, xz, yz = x * x2, y * y2, z * z2, x * y2, x * z2, y * z2
    wx, wy, wz = w * x2, w * y2, w * z2
    return (
        (1.0 - (yy + zz), xy - wz, xz + wy),
        (xy + wz, 1.0 - (xx + zz), yz - wx),
        (xz - wy, yz + wx, 1.0 - (xx + yy)),
    )


def _ball_rate(q: Sequence[Number], x: Sequence[Number]) -> list[Number]:
    """Return the rate of a quaternion by an angular velocity in the body's axes."""
    qx, qy, qz, qw = q
    a, b, c = (value * 0.5 for value in x)
    return [
        qw * a + qy * c - qz * b,
        qw * b + qz * a - qx * c,
        qw * c + qx * b - qy * a,
        -(qx * a + qy * b + qz * c),
    ]


def _free_rate(q: Sequence[Number], x: Sequence[Number]) -> list[Number]:
    qx, qy, qz, qw = q[3:]
    vx, vy, vz = x[:3]
    # R v = v + 2 w (u x v) + 2 u x (u x v)
    tx, ty, tz = (qy * vz - qz * vy) * 2.0, (qz * vx - qx * vz) * 2.0, (qx * vy - qy * vx) * 2.0
    return [
        vx + qw * tx + qy * tz - qz * ty,
        vy + qw * ty + qz * tx - qx * tz,
        vz + qw * tz + qx * ty - qy * tx,
        *_ball_rate(q[3:], x[3:]),
    ]


def _planar_rate(q: Sequence[Number], x: Sequence[Number]) -> list[Number]:
    c, s = q[2:]
    return [c * x[0] - s * x[1], s * x[0] + c * x[1], -(s * x[2]), c * x[2]]


RATES: dict[str, Callable[[Sequence[Number], Sequence[Number]], list[Number]]] = {
    "revolute": lambda _q, x: [x[0]],
    "helical": lambda _q, x: [x[0]],
    "prismatic": lambda _q, x: [x[0]],
    "unbounded": lambda q, x: [-(q[1] * x[0]), q[0] * x[0]],
    "translation": lambda _q, x: list(x),
    "planar": _planar_rate,
    "ball": _ball_rate,
    "free": _free_rate,
}
"""Rates of q by those of v."""
