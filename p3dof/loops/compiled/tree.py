"""A tree as a list of elementary joints with constants, and their placements as formulas of q.

Every joint of Pinocchio becomes a chain of parts whose axes are fixed in the body that they move; all but
the last body of a chain have no mass. Velocities keep Pinocchio's meaning.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from p3dof._base.errors import ModelError
from p3dof._base.tracing import Number, Tape
from p3dof.loops.compiled.vectors import (
    IDENTITY,
    NOTHING,
    ZERO,
    Matrix,
    Vector,
    added,
    matrix_of,
    numbers,
    outer,
    plus,
    product,
    times,
    turned,
)

_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Part:
    """An elementary joint and the body that it moves.

    Parameters
    ----------
    kind : str
        ``revolute``, ``unbounded`` (cosine and sine in q), ``prismatic``, ``helical``, ``ball`` (quaternion),
        ``free`` (position and quaternion), ``planar`` (x, y, cosine, sine), ``translation``.
    parent : int
        The part before, 0 for the world.
    R0, p0 : Matrix, Vector
        Placement of the joint in the axes of the body before.
    axis : Vector
        Of a joint with one freedom.
    pitch : float
        Of a helical one [m/rad].
    q, v : tuple of int
        Its places in q and v.
    mass, first, second : float, Vector, Matrix
        Mass, first moment and second moment ∫ r rᵀ dm of the body about its origin.
    """

    kind: str
    parent: int
    R0: Matrix
    p0: Vector
    axis: Vector
    pitch: float
    q: tuple[int, ...]
    v: tuple[int, ...]
    mass: Number = 0.0
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
    """The parts of a tree, the world first, and which of them carries each joint of the model.

    Parameters
    ----------
    parts : tuple of Part
        The first is the world.
    of_joint : tuple of int
        By joint of the model, the part whose body is that of the joint.
    nq, nv : int
        Sizes of q and v.
    gravity : Vector
        [m/s²].
    armature : tuple of float
        By entry of v.
    size : float
        Its largest length, one if that is longer or nothing: beside it rounding is told [m].
    """

    parts: tuple[Part, ...]
    of_joint: tuple[int, ...]
    nq: int
    nv: int
    gravity: Vector
    armature: tuple[float, ...]
    size: float = 1.0

    def path(self, part: int) -> list[int]:
        """Return the parts from one up to the world, which is left out."""
        found = []
        while part:
            found.append(part)
            part = self.parts[part].parent
        return found


def tree_of(model: pin.Model) -> Tree:
    """Return the parts of a tree.

    Parameters
    ----------
    model : pin.Model
        The tree.

    Returns
    -------
    Tree

    Raises
    ------
    ModelError
        If a joint is of a kind that is not known here; the message names it.
    """
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
    """Return a part with other inertial parameters.

    Parameters
    ----------
    part : Part
        The part.
    values : (10,) numbers
        Mass, first moment, and the inertia about the origin as xx, xy, yy, xz, yz, zz: Pinocchio's order.

    Returns
    -------
    Part
    """
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
    """Where every body is in the axes of the body before, as formulas of q.

    Parameters
    ----------
    R : list of Matrix
        By part; takes vectors in its axes to those of the body before.
    r : list of Vector
        By part, its origin in the axes of the body before.
    """

    R: list[Matrix]
    r: list[Vector]


def placements(tree: Tree, tape: Tape, q: Sequence[Number]) -> Placements:
    """Return the formulas of a tree's placements.

    Parameters
    ----------
    tree : Tree
        The parts.
    tape : Tape
        Where functions are taken from.
    q : sequence of (nq,) numbers
        The configuration.

    Returns
    -------
    Placements
    """
    R, r = [IDENTITY], [ZERO]
    for part in tree.parts[1:]:
        rotation, shift = _MOVES[part.kind](part, tape, [q[i] for i in part.q])
        R.append(part.R0 if rotation is IDENTITY else product(part.R0, rotation))
        r.append(part.p0 if shift is ZERO else plus(part.p0, turned(part.R0, shift)))
    return Placements(R, r)


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
