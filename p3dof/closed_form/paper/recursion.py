"""The paper's frames and its recursions (8)-(13): every body's motion, on components.

Frames T_k are the paper's: `Frame.a` takes components from T_{k-1} to T_k, `Frame.a0` from T_0 to T_k.
Motions are written in the axes of T_k, as in the paper; `body_axes` connects the frames of `Body` with
these.
"""

from __future__ import annotations

from typing import NamedTuple

from p3dof._base.algebra import (
    U3,
    ZERO,
    Matrix,
    Scalar,
    Vector,
    add,
    apply,
    apply_transposed,
    cross,
    product,
    scale,
)
from p3dof.closed_form.paper.formulas import Configuration, Lengths, Rates

# (2): constant matrices. a_α and a^φ turn about the same axis, so that they stand together as `turn`.
A1: Matrix = ((0, -1, 0), (1, 0, 0), (0, 0, 1))
A2: Matrix = ((0, 1, 0), (-1, 0, 0), (0, 0, 1))
A3: Matrix = ((-1, 0, 0), (0, -1, 0), (0, 0, 1))
A4: Matrix = ((0, 0, -1), (-1, 0, 0), (0, 1, 0))
A5: Matrix = ((-1, 0, 0), (0, 1, 0), (0, 0, -1))
A6: Matrix = ((0, 0, -1), (0, -1, 0), (-1, 0, 0))
C50_HOME: Matrix = ((1, 0, 0), (0, 0, -1), (0, 1, 0))  # (4)


class Frame(NamedTuple):
    """One frame T_k: where it is, and how it and its origin, the joint A_k, move.

    `a`, `r` are relative to T_{k-1}: its axes and the joint's position there. `a0` are its axes and
    `position` the joint in T_0; `velocity`, `acceleration` of the joint and `omega`, `epsilon` of the body
    are absolute, in the axes of T_k.
    """

    a: Matrix
    r: Vector
    a0: Matrix
    position: Vector
    velocity: Vector
    acceleration: Vector
    omega: Vector
    epsilon: Vector


def turn(sine: Scalar, cosine: Scalar) -> Matrix:
    """Return a^φ a_α of (2): the axes turned about z by φ + α, from the direction cosines of the sum."""
    return ((cosine, sine, 0), (-sine, cosine, 0), (0, 0, 1))


def slider(a: Matrix, position: Vector, speed: Scalar, acceleration: Scalar) -> Frame:
    """Return T_1 of a leg, which only moves along z0 (9)."""
    return Frame(a, position, a, position, scale(speed, U3), scale(acceleration, U3), ZERO, ZERO)


def attach(previous: Frame, a: Matrix, r: Vector, omega: Scalar, epsilon: Scalar) -> Frame:
    """Go from T_{k-1} to T_k: the recursions (10)-(13)."""
    carried = apply(a, previous.omega)
    velocity = add(previous.velocity, cross(previous.omega, r))  # (12)
    acceleration = add(previous.acceleration, rigid_acceleration(previous, r))  # (13), third line
    return Frame(
        a=a,
        r=r,
        a0=product(a, previous.a0),
        position=add(previous.position, apply_transposed(previous.a0, r)),
        velocity=apply(a, velocity),
        acceleration=apply(a, acceleration),
        omega=add(carried, scale(omega, U3)),  # (8), (11)
        epsilon=add(  # (13), first line
            apply(a, previous.epsilon), scale(epsilon, U3), scale(omega, cross(carried, U3))
        ),
    )


def rigid_acceleration(frame: Frame, r: Vector) -> Vector:
    """Return (ω̃ω̃ + ε̃) r: what a point at r of the body has beyond the acceleration of its joint."""
    return add(cross(frame.omega, cross(frame.omega, r)), cross(frame.epsilon, r))


def frames(lengths: Lengths, x: Configuration, v: Rates, a: Rates) -> dict[str, Frame]:
    """Return the frame of every moving body, by link name, in the order of the paper's legs."""
    R, L, b = lengths.R, lengths.L, lengths.b
    swing_a, swing_b = turn(x.sin_a, x.cos_a), turn(x.sin_b, x.cos_b)
    swing_c, swing_rod = turn(x.sin_c, x.cos_c), turn(x.sin_rod, x.cos_rod)
    swing_platform = turn(x.sin_54, x.cos_54)
    bodies: dict[str, Frame] = {}
    bodies["slider_a"] = slider(A1, (0, -R, x.sliders[0]), v.sliders[0], a.sliders[0])
    bodies["leg_a"] = attach(bodies["slider_a"], product(swing_a, A4), ZERO, v.w21a, a.w21a)
    bodies["slider_b"] = slider(A2, (0, R, x.sliders[1]), v.sliders[1], a.sliders[1])
    bodies["leg_b"] = attach(bodies["slider_b"], product(swing_b, A4), ZERO, v.w21b, a.w21b)
    bodies["slider_c"] = slider(A3, (-R, 0, x.sliders[2]), v.sliders[2], a.sliders[2])
    bodies["crossbar_upper"] = attach(bodies["slider_c"], product(swing_c, A4), ZERO, v.w21c, a.w21c)
    upper = bodies["crossbar_upper"]
    bodies["rod_left"] = attach(upper, product(swing_rod, A4), (0, 0, -b), v.w32c, a.w32c)
    bodies["crossbar_lower"] = attach(bodies["rod_left"], product(swing_rod, A5), (0, -L, 0), v.w32c, a.w32c)
    bodies["platform"] = attach(
        bodies["crossbar_lower"], product(swing_platform, A6), (b, 0, 0), v.w54c, a.w54c
    )
    bodies["rod_right"] = attach(upper, product(swing_rod, A4), (0, 0, b), v.w32c, a.w32c)
    return bodies


def body_axes(lengths: Lengths) -> dict[str, tuple[Matrix, Vector]]:
    """Return, for every link, its `Body` axes in the axes of T_k and its `Body` origin from the joint A_k.

    The matrix takes components from the `Body` axes to T_k; the vector is in T_k [m].
    """
    home = turn((lengths.R - lengths.r) / lengths.L, lengths.h / lengths.L)
    upper = product(home, A4, A3)
    rod: Matrix = ((0, 0, -1), (-1, 0, 0), (0, 1, 0))
    return {
        "slider_a": (A1, ZERO),
        "leg_a": (((1, 0, 0), (0, 0, -1), (0, 1, 0)), ZERO),
        "slider_b": (A2, ZERO),
        "leg_b": (((1, 0, 0), (0, 0, 1), (0, -1, 0)), ZERO),
        "slider_c": (A3, ZERO),
        "crossbar_upper": (upper, ZERO),
        "rod_left": (rod, ZERO),
        "crossbar_lower": (product(A5, A4, upper), (lengths.b, 0, 0)),
        "platform": (C50_HOME, (lengths.r, 0, 0)),
        "rod_right": (rod, ZERO),
    }
