"""The evidence of a motion, on components: every joint, the gaps of the loops, the rate of the energy.

It is found from the frames of the paper's recursion, body by body, and not from forces.
"""

from __future__ import annotations

from collections.abc import Mapping

from p3dof._base.algebra import (
    Matrix,
    Ordered,
    Scalar,
    Vector,
    add,
    apply,
    apply_transposed,
    congruent,
    cross,
    dot,
    plus,
    subtract,
    times,
)
from p3dof.closed_form.paper.formulas import Configuration, Lengths, Rates
from p3dof.closed_form.paper.friction import Actuation
from p3dof.closed_form.paper.recursion import Frame, body_axes, frames, rigid_acceleration
from p3dof.machine.parameters.body import Inertial


def evidence(
    lengths: Lengths,
    bodies: Mapping[str, Inertial],
    gravity: Vector,
    actuation: Actuation,
    x: Configuration,
    v: Rates,
    a: Rates,
    xp: Ordered,
) -> tuple[Scalar, Scalar]:
    """Return the largest gap of the loops [m], and the rate of kinetic and potential energy [W]."""
    moving, axes = frames(lengths, x, v, a), body_axes(lengths)
    rate: Scalar = 0
    for leg, (position, speed, change) in enumerate(zip(x.sliders, v.sliders, a.sliders, strict=True)):
        rate = plus(rate, times(speed, actuation.force(leg, position, change)))
    for name, body in bodies.items():
        rate = plus(rate, power_into(body, moving[name], axes[name], gravity))
    return closure_error(lengths, moving, axes, xp), rate


def joints(
    lengths: Lengths, x: Configuration, v: Rates, a: Rates, theta: Scalar, xp: Ordered
) -> tuple[tuple[Scalar, ...], ...]:
    """Return positions, velocities and accelerations of all joints, as `in_order`."""
    angles = paper_angles(lengths, x, theta, xp)
    return in_order(x.sliders, *angles), in_order(v.sliders, *v[1:]), in_order(a.sliders, *a[1:])


def in_order(
    sliders: Vector, phi21_a: Scalar, phi21_b: Scalar, phi21_c: Scalar, phi32_c: Scalar, phi54_c: Scalar
) -> tuple[Scalar, ...]:
    """Return the paper's coordinates (or their rates) in the URDF's order of joints, with its signs."""
    a, b, c = sliders
    return a, phi21_a, b, -phi21_b, c, -phi21_c, phi32_c, -phi32_c, phi54_c, phi32_c


def paper_angles(lengths: Lengths, x: Configuration, theta: Scalar, xp: Ordered) -> tuple[Scalar, ...]:
    """Return φ21 of A, B, C, φ32 and φ54, relative and zero at home, as `in_order` takes them."""
    home = xp.atan2(lengths.R - lengths.r, lengths.h)  # α of (7)
    phi21_c = xp.atan2(x.sin_c, x.cos_c) - home
    return (
        xp.atan2(x.sin_a, x.cos_a) - home,
        xp.atan2(x.sin_b, x.cos_b) - home,
        phi21_c,
        xp.atan2(x.sin_rod, x.cos_rod),
        theta + phi21_c,
    )


def power_into(body: Inertial, frame: Frame, axes: tuple[Matrix, Vector], gravity: Vector) -> Scalar:
    """Return a body's rate of energy v·m(a-g) + ω·(Iα + ω×Iω) [W]; the last, without work, is left out."""
    mass, com, inertia = body
    to_frame, offset = axes
    arm, turned = add(offset, apply(to_frame, com)), congruent(to_frame, inertia)
    v = add(frame.velocity, cross(frame.omega, arm))
    a = add(frame.acceleration, rigid_acceleration(frame, arm))
    moving = times(mass, dot(v, subtract(a, apply(frame.a0, gravity))))
    return plus(moving, dot(frame.omega, apply(turned, frame.epsilon)))


def closure_error(
    lengths: Lengths, moving: Mapping[str, Frame], axes: Mapping[str, tuple[Matrix, Vector]], xp: Ordered
) -> Scalar:
    """Return the largest gap of the loops [m]: the left sides of (6) less the right ones."""

    def place(name: str, point: Vector) -> Vector:
        to_frame, offset = axes[name]
        own = add(offset, apply(to_frame, point))
        return add(moving[name].position, apply_transposed(moving[name].a0, own))

    r, L, b = lengths.r, lengths.L, lengths.b
    gaps = [
        subtract(place("leg_a", (L, 0, 0)), place("platform", (0, -r, 0))),
        subtract(place("leg_b", (L, 0, 0)), place("platform", (0, r, 0))),
        subtract(place("rod_right", (L, 0, 0)), place("crossbar_lower", (0, -b, 0))),
    ]
    one, two, three = (-dot(gap, gap) for gap in gaps)
    return xp.sqrt(-xp.minimum(xp.minimum(one, two), three))
