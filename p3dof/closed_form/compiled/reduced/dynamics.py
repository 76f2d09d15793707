"""Forces, mass matrix and accelerations of the reduced form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from p3dof._base.algebra import Matrix, Namespace, Ordered, Scalar, Vector, add, dot, plus, times
from p3dof._base.tracing import Number, derivatives
from p3dof.closed_form.compiled.reduced.constants import Model
from p3dof.closed_form.compiled.reduced.shapes import NEAR_REACH, Bar, Shape, bar_of, home_depth, roots_of_u
from p3dof.machine.parameters import PASSIVE, SLIDES, Friction


class State(NamedTuple):
    """What moves the forces: y, θ and the first two derivatives of the pose; with springs z too."""

    y: Scalar
    theta: Scalar
    vy: Scalar
    vtheta: Scalar
    ay: Scalar
    az: Scalar
    atheta: Scalar
    z: Scalar


MOVING = State._fields[:-1]
"""All but z, whose derivatives are the springs' stiffness, whatever the state."""


def loads(
    model: Model, x: Shape, state: State, xp: Namespace, wrench: Vector = (0, 0, 0)
) -> tuple[Vector, Vector]:
    """Return what a motion takes at the sliders' own coordinates, and of y, z, θ beside it.

    The forces of the actuators are F + J⁻ᵀ Q, the generalized forces Jᵀ F + Q [N, N, N m].
    """
    c, (held, pulled) = model.bodies, _held(model, x, state.z, xp)
    a_a, a_b, a_c = upper_masses(model)
    gx, gy = model.gx, model.gy
    vy, vt = state.vy, state.vtheta
    az = state.az - model.gz  # gravity is an acceleration of the fixed frame
    ay = state.ay - gy
    # Legs A and B: accelerations of their drops, from S² + w² = L².
    vy2 = vy * vy
    spin = (model.L * model.L) * vy2
    drop_a = -x.ia * (x.wa * state.ay + spin * (x.ia * x.ia))
    drop_b = x.ib * (x.wb * state.ay - spin * (x.ib * x.ib))
    # Leg C: its lower end at (-q, ·, p), its drop, and its slider less the platform.
    vt2 = vt * vt
    vX = x.p * vt
    aX = x.p * state.atheta + x.q * vt2
    aZ = x.q * state.atheta - x.p * vt2
    # The plane of the parallelogram, with its angle β and S_C = u cos β.
    bar = bar_of(model, x, state.y, xp)
    drop_c, w2, twice, turn = (_leg_c_at_once if x.short_chains else _leg_c)(x, bar, state, vX, aX)
    rise = aZ + drop_c
    lean = c.h3 * bar.cos
    H_c = bar.G * turn - bar.H * w2 + lean * state.ay - (c.h3 * bar.sin) * twice
    bend = c.n1 * (model.L * model.L) * (bar.iu * bar.iu2)  # ∂N/∂y
    slider_c = az + rise
    F_beta = (
        (bar.K * turn + bar.slope * twice) + (bar.N * state.ay + bend * vy2) + (slider_c * bar.G + gx * bar.H)
    )
    F_y = (bar.N * turn - bar.slope * w2) + slider_c * lean + c.h3 * (gx * bar.sin + gy * bar.tan)
    reach = c.c_c * rise
    Q = (
        (c.m * ay - gy * (c.c_a + c.c_b + c.c_c))
        + ((c.d_a + c.d_b) * az + c.d_a * drop_a + c.d_b * drop_b)
        + (F_y + bar.y * F_beta)
        - wrench[0],
        ((c.m + c.c_a + c.c_b + c.c_c) * az + c.c_a * drop_a + c.c_b * drop_b)
        + (reach + c.k * aZ - c.e * aX + gy * (c.d_a + c.d_b))
        - wrench[1],
        c.i * state.atheta
        + x.q * ((c.k + c.c_c) * az + reach - gx * c.e)
        + x.p * (x.ic * F_beta - c.e * az - gx * (c.k + c.c_c))
        - wrench[2],
    )
    F = (
        plus(plus((a_a + c.c_a) * az, held[0]) + a_a * drop_a + c.d_a * ay, pulled[0]),
        plus(plus((a_b + c.c_b) * az, held[1]) + a_b * drop_b + c.d_b * ay, pulled[1]),
        plus(plus(a_c * slider_c, held[2]) + c.c_c * (az + aZ) + H_c, pulled[2]),
    )
    return F, Q


def upper_masses(model: Model) -> Vector:
    """Return what moves with the sliders A, B, C as the upper ends of their legs do, armature included."""
    c, more = model.bodies, model.actuators
    return plus(c.a_a, more.armature_a), plus(c.a_b, more.armature_b), plus(c.a_c, more.armature_c)


def _held(model: Model, x: Shape, z: Scalar, xp: Namespace) -> tuple[Vector, Vector]:
    """Return what acts at the sliders by itself, constant and by springs from λ: weight less balances."""
    more, gz = model.actuators, model.gz
    constant: Vector = (
        plus(times(more.armature_a, gz), -more.balance_a),
        plus(times(more.armature_b, gz), -more.balance_b),
        plus(times(more.armature_c, gz), -more.balance_c),
    )
    springs = more.spring_a, more.spring_b, more.spring_c
    if all(type(spring) is int and spring == 0 for spring in springs):
        return constant, (0, 0, 0)
    depth = home_depth(model, xp)
    a, b, c = (plus(rest, -times(spring, depth)) for rest, spring in zip(constant, springs, strict=True))
    rises = (z + x.Sa, z + x.Sb, (z + x.p) + x.Sc)
    d, e, f = (times(spring, rise) for spring, rise in zip(springs, rises, strict=True))
    return (a, b, c), (d, e, f)


def _leg_c(x: Shape, bar: Bar, state: State, vX: Scalar, aX: Scalar) -> tuple[Scalar, ...]:
    """Return the acceleration of leg C's drop, β̇², 2 ẏ β̇, and β̈ but for what ẏ makes of it."""
    vy = state.vy
    vS = x.tc * vX + x.ty * vy  # less the velocity of the drop
    drop = -x.ic * (x.wc * aX + state.y * state.ay + vX * vX + vy * vy + vS * vS)
    w = x.ic * vX + bar.y * vy
    twice = 2 * vy * w
    return drop, w * w, twice, (x.Sc * aX - x.wc * drop + state.y * twice) * bar.iu2


def _leg_c_at_once(x: Shape, bar: Bar, state: State, vX: Scalar, aX: Scalar) -> tuple[Scalar, ...]:
    """Return the same with 1/S_C, which is there last, taken out of all sums."""
    vy, ay, ic2 = state.vy, state.ay, 1 / x.squares[2]
    vS = x.wc * vX + state.y * vy
    shrink = (x.wc * aX + state.y * ay) + (vX * vX + vy * vy) + ic2 * (vS * vS)
    w = vX + (x.wc * (state.y * bar.iu2)) * vy
    turn = x.squares[2] * aX + (2 * state.y * vy) * w + x.wc * shrink
    return -x.ic * shrink, ic2 * (w * w), x.ic * (2 * vy * w), (x.ic * bar.iu2) * turn


def solve_transposed(x: Shape, Q: Vector) -> Vector:
    """Solve Jᵀ f = Q for the forces at the sliders, written out."""
    f_c = Q[2] * (1 / x.arm)  # reciprocals can be had before the motion is: shorter chains
    rest = Q[1] - f_c
    f_b = (Q[0] + x.ty * f_c + x.ta * rest) * (1 / (x.ta + x.tb))
    return rest - f_b, f_b, f_c


def transposed(x: Shape, f: Vector) -> Vector:
    """Return Jᵀ f, the generalized forces of forces at the sliders."""
    return x.tb * f[1] - x.ta * f[0] - x.ty * f[2], f[0] + f[1] + f[2], x.arm * f[2]


def actuator_forces(
    model: Model, x: Shape, state: State, xp: Namespace, wrench: Vector = (0, 0, 0)
) -> Vector:
    """Return the actuator forces; equal to `closed_form.paper.virtual_power.actuator_forces` without losses.

    Of A, B, C [N].
    """
    F, Q = loads(model, x, state, xp, wrench)
    if not x.short_chains:
        return add(F, solve_transposed(x, Q))
    across = 1 / (x.ta + x.tb)
    f_c = Q[2] * (1 / x.arm)
    f_b = (Q[0] + x.ta * Q[1]) * across + ((x.ty - x.ta) * across) * f_c
    return (F[0] + (Q[1] - f_c)) - f_b, F[1] + f_b, F[2] + f_c


def mass_matrix(model: Model, x: Shape, y: Scalar, xp: Namespace) -> Matrix:
    """Return the mass matrix in y, z, θ; 3 × 3, symmetric; its middle entry is constant."""
    c, bar = model.bodies, bar_of(model, x, y, xp)
    lean = c.h3 * bar.cos
    H_y, H_t = bar.G * bar.y + lean, bar.G * bar.theta
    a_a, a_b, a_c = upper_masses(model)
    upper_a, upper_b, upper_c = a_a + c.c_a, a_b + c.c_b, a_c + c.c_c
    spin_y, spin_t = bar.K * bar.y + bar.N, bar.K * bar.theta
    yy = (
        (c.m + x.ta * (a_a * x.ta - 2 * c.d_a) + x.tb * (a_b * x.tb + 2 * c.d_b))
        + x.ty * (a_c * x.ty - 2 * H_y)
        + bar.y * (spin_y + bar.N)
    )
    zz = c.m + (c.c_a + c.c_b + c.c_c) + upper_a + upper_b + upper_c
    yz = (upper_b * x.tb - upper_a * x.ta - upper_c * x.ty) + (c.d_a + c.d_b) + H_y
    zt = upper_c * x.arm + (c.k + c.c_c) * x.q - c.e * x.p + H_t
    tilted = c.c_c * x.q + H_t
    yt = x.arm * H_y - x.ty * (a_c * x.arm + tilted) + spin_y * bar.theta
    tt = c.i + x.arm * (a_c * x.arm + 2 * tilted) + bar.theta * spin_t
    return (yy, yz, yt), (yz, zz, zt), (yt, zt, tt)


def forward_dynamics(
    model: Model, x: Shape, state: State, forces: Vector, xp: Namespace, wrench: Vector
) -> Vector:
    """Return the acceleration of the pose under actuator forces; ÿ, z̈, θ̈."""
    F, Q = loads(model, x, state._replace(ay=0, az=0, atheta=0), xp, wrench)
    acting = transposed(x, (forces[0] - F[0], forces[1] - F[1], forces[2] - F[2]))
    M = mass_matrix(model, x, state.y, xp)
    return solve_about_z(M, (acting[0] - Q[0], acting[1] - Q[1], acting[2] - Q[2]))


def coriolis_matrix(M: Matrix, coordinates: Vector, velocity: Vector) -> list[list[Number]]:
    """Return the matrix C of centrifugal and Coriolis forces, by Christoffel's symbols.

    Its column z is zero: the momentum along z is the rate of the first moment Σ m z of all bodies, so that
    M_zi = ∂(Σ m z)/∂x_i and ∂M_zi/∂x_j = ∂M_zj/∂x_i, and nothing depends on z.

    3 × 3; C times the velocity are forces, Ṁ - 2C is skew.
    """
    D = [derivatives(row, coordinates) for row in M]  # D[i][j][k] = ∂M_ij/∂x_k
    half, axes = [0.5 * rate for rate in velocity], range(3)

    def entry(i: int, j: int) -> Number:
        terms = [(D[i][j][k] + D[i][k][j] - D[j][k][i]) * half[k] for k in axes]
        total: Number = terms[0] + terms[1] + terms[2]
        return total

    return [[entry(i, 0), 0, entry(i, 2)] for i in axes]


def solve_about_z(M: Matrix, b: Vector) -> Vector:
    """Solve M a = b for a symmetric M, taking z out first, whose mass is constant."""
    iz = 1 / M[1][1]
    fy, ft = M[0][1] * iz, M[1][2] * iz
    yy = M[0][0] - fy * M[0][1]
    yt = M[0][2] - fy * M[1][2]
    tt = M[2][2] - ft * M[1][2]
    by, bt = b[0] - fy * b[1], b[2] - ft * b[1]
    share = 1 / (yy * tt - yt * yt)
    ay, at = (tt * by - yt * bt) * share, (yy * bt - yt * by) * share
    return ay, b[1] * iz - fy * ay - ft * at, at


def assembled(model: Model, sliders: Vector, xp: Ordered) -> tuple[Vector, Scalar]:
    """Return the pose at slider positions, and by how much it is clearly good."""
    r, R, L = model[:3]
    width = R - r
    mean, half = (sliders[0] + sliders[1]) * 0.5, (sliders[1] - sliders[0]) * 0.5
    distance = xp.sqrt(width * width + half * half)  # half of that between the centres of the circles A, B
    circles = (L - distance) * (L + distance)
    reach, share = xp.sqrt(circles), 1 / distance
    y = reach * half * share
    p = mean - reach * width * share  # z - h
    q = sliders[2] - p
    rho2 = R * R + q * q
    rho = xp.sqrt(rho2)
    K = (q * q + (r * r + R * R) - (L - y) * (L + y)) * (1 / (2 * r))
    closure = (rho - K) * (rho + K)
    theta = xp.atan2(q, R) - xp.atan2(xp.sqrt(closure), K)
    drops = (sliders[0] - p, sliders[1] - p, q - r * xp.sin(theta))
    squares = xp.minimum(circles, closure)
    lowest = xp.minimum(xp.minimum(drops[0], drops[1]), drops[2])
    found = xp.minimum(squares - NEAR_REACH * (L * L), L * lowest - NEAR_REACH * (L * L))
    pose = (y, p + xp.sqrt((L - width) * (L + width)), theta)
    total = y + pose[1] + theta
    return pose, found + (total - total)  # NaN where a result is not finite


JOINTS = (*SLIDES, *PASSIVE)
"""All joints that can have friction."""

TOGETHER = (
    ("slide_a",),
    ("slide_b",),
    ("slide_c",),
    ("hinge_a", "universal_a"),
    ("hinge_b", "universal_b"),
    ("hinge_c",),
    ("hinge_left", "hinge_right", "hinge_lower", "hinge_lower_right"),
    ("hinge_platform",),
    ("universal_a", "universal_b"),
)
"""Which joints move at the rates of `gradients`; the axes of a universal joint are in two of them."""

FRICTION = (
    *(f"viscous_{i}" for i in range(len(TOGETHER))),
    *(f"coulomb_{i}" for i in range(len(TOGETHER))),
    "steepness",
)
"""Coefficients of the nine rates, and one over the rate that smooths."""


def friction_numbers(friction: Friction) -> list[float]:
    """Return the coefficients of a machine in the order of `FRICTION`."""
    found = [*folded(friction.viscous), *folded(friction.coulomb), 1 / friction.smoothing]
    return [float(number) for number in found]


def folded(coefficients: Mapping[str, Scalar]) -> list[Scalar]:
    """Return the coefficients of joints as those of the nine rates."""
    found: list[Scalar] = []
    for joints in TOGETHER:
        total: Scalar = 0
        for joint in joints:
            total = plus(total, coefficients.get(joint, 0))
        found.append(total)
    return found


def gradients(x: Shape, y: Scalar, xp: Namespace) -> list[Vector]:
    """Return how the nine rates follow from ẏ, ż, θ̇, up to their signs, which friction does not see.

    Slides A, B, C, legs A, B, plane of the parallelogram, rods in it, platform to the lower cross-bar,
    platform about y0.
    """
    iu2 = 1 / x.u2 if x.rsqrt is None else roots_of_u(x, xp)[2]  # as in the reduced form, which then has it
    beta_y, beta_theta = x.tc * (y * iu2), x.p * x.ic
    return [
        (-x.ta, 1, 0),
        (x.tb, 1, 0),
        (-x.ty, 1, x.arm),
        (x.ia, 0, 0),
        (x.ib, 0, 0),
        (beta_y, 0, beta_theta),
        (roots_of_u(x, xp)[1], 0, 0),
        (beta_y, 0, beta_theta + 1),
        (0, 0, 1),
    ]


def generalized_friction(
    x: Shape,
    y: Scalar,
    velocity: Vector,
    coefficients: tuple[Sequence[Scalar], Sequence[Scalar], Scalar],
    xp: Namespace,
) -> Vector:
    """Return the forces of y, z, θ that friction takes: `closed_form.paper.friction.generalized_losses`."""
    viscous, coulomb, steepness = coefficients
    total: list[Scalar] = [0, 0, 0]
    for gradient, linear, dry in zip(gradients(x, y, xp), viscous, coulomb, strict=True):
        rate = dot(gradient, velocity)
        force = plus(times(linear, rate), times(dry, xp.tanh(rate * steepness)))
        total = [plus(sum_, times(entry, force)) for sum_, entry in zip(total, gradient, strict=True)]
    return total[0], total[1], total[2]
