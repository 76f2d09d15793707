"""Newton and Euler's equations of a tree, in body axes with accelerations of points; as formulas.

The acceleration of the point x of a body is A + U x, where A is that of its origin and U = [α]x + [ω]x[ω]x;
the force on the body is then m A + U h and its moment about the origin h × A and the vector of U Σ, with the
first and second moments h = ∫ r dm and Σ = ∫ r rᵀ dm.

References
----------
R. Featherstone, Rigid Body Dynamics Algorithms, Springer 2008, chapters 5 and 6.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from p3dof._base.tracing import Number
from p3dof.loops.tree_formulas import (
    NOTHING,
    ZERO,
    Matrix,
    Placements,
    Tree,
    Vector,
    added,
    axial,
    back,
    cross,
    dot,
    minus,
    outer,
    plus,
    product,
    rate_matrix,
    times,
    transposed,
    turned,
)


@dataclass(frozen=True)
class BodyRates:
    """Velocities and accelerations of bodies in their own axes."""

    omega: list[Vector]  # angular velocity and acceleration, by part
    alpha: list[Vector]
    A: list[Vector]  # acceleration of the origin, less gravity
    U: list[Matrix]  # what the acceleration of a point has by its place


def velocities(tree: Tree, where: Placements, v: Sequence[Number]) -> list[Vector]:
    """Return the angular velocity of every body in its own axes."""
    omega = [ZERO]
    for i, part in enumerate(tree.parts[1:], 1):
        omega.append(plus(back(where.R[i], omega[part.parent]), _sum(part.turning, part.v, v)))
    return omega


def motion(
    tree: Tree,
    where: Placements,
    v: Sequence[Number],
    a: Sequence[Number],
    omega: list[Vector],
    gravity: Vector,
    only: Collection[int] | None = None,
) -> BodyRates:
    """Return the accelerations of bodies."""
    alpha, A, U = [ZERO], [times(-1.0, gravity)], [NOTHING]
    for i, part in enumerate(tree.parts[1:], 1):
        if only is not None and i not in only:
            alpha.append(ZERO)
            A.append(ZERO)
            U.append(NOTHING)
            continue
        above, R = part.parent, where.R[i]
        turning, sliding = _sum(part.turning, part.v, v), _sum(part.sliding, part.v, v)
        alpha_i = plus(back(R, alpha[above]), cross(omega[i], turning), _sum(part.turning, part.v, a))
        start = back(R, plus(A[above], turned(U[above], where.r[i])))
        if any(sliding) or any(_sum(part.sliding, part.v, a)):
            # The origin slides in the axes of the body before, which turn with ω less the joint's own.
            carried = minus(omega[i], turning)
            start = plus(start, cross(plus(omega[i], carried), sliding), _sum(part.sliding, part.v, a))
        alpha.append(alpha_i)
        A.append(start)
        U.append(rate_matrix(omega[i], alpha_i))
    return BodyRates(omega, alpha, A, U)


def forces(
    tree: Tree, where: Placements, moving: BodyRates, loads: Mapping[int, tuple[Vector, Vector]]
) -> list[Number]:
    """Return the generalised forces (nv,) that bodies need, less what external wrenches give; no armature."""
    count = len(tree.parts)
    pushed, turning = [ZERO] * count, [ZERO] * count
    found: list[Number] = [0.0] * tree.nv
    for i in range(1, count):
        part = tree.parts[i]
        if part.solid:
            A, U = moving.A[i], moving.U[i]
            pushed[i] = plus(times(part.mass, A), turned(U, part.first))
            turning[i] = plus(axial(product(U, part.second)), cross(part.first, A))
        if i in loads:
            force, moment = loads[i]
            pushed[i], turning[i] = minus(pushed[i], force), minus(turning[i], moment)
    for i in range(count - 1, 0, -1):
        part = tree.parts[i]
        for axis, slide, place in zip(part.turning, part.sliding, part.v, strict=True):
            found[place] = dot(axis, turning[i]) + dot(slide, pushed[i])
        if part.parent:
            force = turned(where.R[i], pushed[i])
            above = part.parent
            pushed[above] = plus(pushed[above], force)
            moment = plus(turned(where.R[i], turning[i]), cross(where.r[i], force))
            turning[above] = plus(turning[above], moment)
    return found


def mass_matrix(tree: Tree, where: Placements) -> list[dict[int, Number]]:
    """Return the mass matrix with the armature, as the entries of each row that can be there; both halves."""
    mass = [part.mass for part in tree.parts]
    first = [part.first for part in tree.parts]
    second = [part.second for part in tree.parts]
    rows: list[dict[int, Number]] = [{i: value} if value else {} for i, value in enumerate(tree.armature)]
    for i in range(len(tree.parts) - 1, 0, -1):
        part = tree.parts[i]
        for axis, slide, place in zip(part.turning, part.sliding, part.v, strict=True):
            force, moment = _momentum(mass[i], first[i], second[i], axis, slide)
            _enter(tree, where, i, place, force, moment, rows)
        if part.parent:
            R, r, above = where.R[i], where.r[i], part.parent
            h = turned(R, first[i])
            turned_second = product(product(R, second[i]), transposed(R))
            shift = added(outer(h, r), outer(r, h))
            moved = added(added(turned_second, shift), outer(times(mass[i], r), r))
            second[above] = added(second[above], moved)
            first[above] = plus(first[above], h, times(mass[i], r))
            mass[above] = mass[above] + mass[i]
    return rows


def _enter(
    tree: Tree,
    where: Placements,
    part: int,
    place: int,
    force: Vector,
    moment: Vector,
    rows: list[dict[int, Number]],
) -> None:
    """Enter what a unit acceleration asks of the joints from a part up to the world."""
    at = part
    while at:
        here = tree.parts[at]
        for axis, slide, other in zip(here.turning, here.sliding, here.v, strict=True):
            if at != part or other >= place:
                value = dot(axis, moment) + dot(slide, force)
                if other == place:
                    rows[place][place] = rows[place].get(place, 0.0) + value
                else:
                    rows[place][other] = rows[other][place] = value
        up = turned(where.R[at], force)
        moment = plus(turned(where.R[at], moment), cross(where.r[at], up))
        force, at = up, here.parent


def _momentum(
    mass: Number, first: Vector, second: Matrix, axis: Vector, slide: Vector
) -> tuple[Vector, Vector]:
    """Return the momentum of a body that moves with unit speed, and its moment about the origin."""
    force = plus(times(mass, slide), cross(axis, first))
    trace = second[0][0] + second[1][1] + second[2][2]
    moment = plus(minus(times(trace, axis), turned(second, axis)), cross(first, slide))
    return force, moment


def _sum(axes: Sequence[Vector], places: Sequence[int], values: Sequence[Number]) -> Vector:
    total = ZERO
    for axis, place in zip(axes, places, strict=True):
        total = plus(total, times(values[place], axis))
    return total
