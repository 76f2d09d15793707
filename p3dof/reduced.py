"""The machine's dynamics in as few operations as we could find: bodies folded once into 21 numbers.

Derivation
----------
The three legs hang in *natural coordinates*: with the velocities of both ends of a rod, its kinetic energy
has constant coefficients, whatever its mass distribution. Leg A moves in the plane y, z; its upper end has
the velocity λ̇ ẑ, its lower end (ẏ, ż), so that with the mass m, the mass centre (c_x, ·, c_z) and the
inertia I about the hinge

    T = ½ a λ̇² + c λ̇ ż + ½ k (ẏ² + ż²) + d λ̇ ẏ,
    k = I / L²,   c = m c_x / L - k,   a = m - 2 m c_x / L + k,   d = -m c_z / L.

There are no Coriolis terms: the forces of inertia are these constants times λ̈, ÿ, z̈; gravity is taken off
the accelerations. The slider's mass joins a; what is at the lower end joins the platform. The two rods of leg
C move alike and are one rod with the sum of their masses, moments and inertias; the same holds for its ends,
the upper one on the slider C, the lower one at C5 = P + (-q, ·, p) with p = r sin θ, q = r cos θ. The
platform is a rod from P to C5 in the same sense (p q̈ - q p̈ cancels: its inertia and that of the mass at C5
are one).

What is left turns about y0 with the plane of the parallelogram, at the angle β from the vertical: the
cross-bars and what the rods are more than end masses. In the velocities of β and y

    T = ½ K β̇² + N β̇ ẏ + λ̇_C Ḣ,      H = h1 sin β + (h2 + h3 y) cos β,
    K = k0 + k1 y² + 2 (k2 y + k3) u,   N = n0 + n1 y / u,   u² = L² - y².

The first moments l1, l2 of the lower cross-bar would add (lower end)·(Ġ, Ḣ) with H = l1 sin β + l2 cos β and
G = ∂H/∂β. But the ends are (u sin β, -u cos β) apart, and so this is λ̇_C Ḣ + l1 (y / u) β̇ ẏ - l2 u β̇²: they
join h1 and n1, h2 and k3.

So the forces need the 21 numbers of `Reduced`; they are linear in them and need all of them: these are the
base inertial parameters of the force model. The generalized forces Q of y, z, θ (without what acts at the
sliders' own coordinates, F) are solved by hand: f = F + J⁻ᵀ Q. Neither z nor ż enters.

The mass matrix follows from the same energies; forward dynamics takes z out first, whose mass is constant.

`tests/test_reduced.py` holds this against the full recursion of `p3dof.virtual_power`, Lagrange's equations
and the rank of the regressor.

References
----------
J. García de Jalón, E. Bayo, Kinematic and Dynamic Simulation of Multibody Systems, Springer 1994, ch. 4
(natural coordinates). M. Gautier, W. Khalil, Direct Calculation of Minimum Set of Inertial Parameters of
Serial Robots, IEEE Trans. Robotics and Automation 6 (1990).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from p3dof.algebra import (
    Matrix,
    Namespace,
    Ordered,
    Scalar,
    Vector,
    add,
    matrix_sum,
    plus,
    scale,
    steiner,
    times,
)
from p3dof.inertials import Inertial, inertials, numbers
from p3dof.kinematics.formulas import Lengths
from p3dof.parameters import Parameters


class Moments(NamedTuple):
    """Mass, first moments and inertia of a body about the origin of its axes: forces are linear in them."""

    mass: Scalar
    first: Vector
    second: Matrix


class Reduced(NamedTuple):
    """The base inertial parameters, numbers or symbols; see the module for what they multiply.

    The legs A and B have no Coriolis terms, rods and cross-bars turn with β, ``i`` is about y0.
    """

    a_a: Scalar  # [kg] slider and upper end of leg A
    c_a: Scalar  # [kg] between the ends
    d_a: Scalar  # [kg] mass centre beside the line of the ends
    a_b: Scalar
    c_b: Scalar
    d_b: Scalar
    a_c: Scalar  # [kg] slider and upper end of the rods of leg C
    c_c: Scalar
    m: Scalar  # [kg] all that moves along y with the platform
    k: Scalar  # [kg] at C5, less the platform's first moment along its arm over r
    e: Scalar  # [kg] the platform's first moment across its arm over r
    i: Scalar  # [kg m²] platform and what is at C5, about P
    k0: Scalar  # [kg m²] about y0, with β
    k1: Scalar  # [kg]
    k2: Scalar  # [kg]
    k3: Scalar  # [kg m]
    n0: Scalar  # [kg m]
    n1: Scalar  # [kg m]
    h1: Scalar  # [kg m] first moments on the upper cross-bar's pivot
    h2: Scalar  # [kg m]
    h3: Scalar  # [kg]


class Model(NamedTuple):
    """All that the reduced formulas need of a machine: lengths, gravity, and the folded bodies."""

    r: Scalar
    R: Scalar
    L: Scalar
    gx: Scalar
    gy: Scalar
    gz: Scalar
    bodies: Reduced

    @property
    def numbers(self) -> tuple[Scalar, ...]:
        """The 27 numbers in a row."""
        return (*self[:6], *self.bodies)

    @classmethod
    def of_numbers(cls, row: tuple[Scalar, ...]) -> Model:
        """Return the model of 27 numbers in a row."""
        r, R, L, gx, gy, gz, *bodies = row
        return cls(r, R, L, gx, gy, gz, Reduced(*bodies))


class State(NamedTuple):
    """What moves the forces: y, θ and the first two derivatives of the pose."""

    y: Scalar
    theta: Scalar
    vy: Scalar
    vtheta: Scalar
    ay: Scalar
    az: Scalar
    atheta: Scalar


class Shape(NamedTuple):
    """Where the mechanism is, for one y and θ."""

    p: Scalar  # r sin θ
    q: Scalar  # r cos θ
    wa: Scalar  # horizontal extents of the legs [m]
    wb: Scalar
    wc: Scalar
    Sa: Scalar  # their drops [m]
    Sb: Scalar
    Sc: Scalar
    ia: Scalar  # 1 / S
    ib: Scalar
    ic: Scalar
    ta: Scalar  # w / S
    tb: Scalar
    tc: Scalar
    ty: Scalar  # y / Sc
    u2: Scalar  # u² = L² - y²
    squares: Vector  # S² of the legs
    arm: Scalar  # ∂λC/∂θ


NEAR_REACH = 1e-12
"""Share of L² that the squares of all drops have in a state that is clearly good."""

NEAR_SINGULAR = 4e-12
"""Square of the sine of the angle from the actuation singularity that it has."""

SYMMETRIC_ZEROS = ("d_a", "d_b", "e", "k2", "k3", "n0", "n1", "h1", "h2", "h3")
"""What is zero for bodies that are symmetric as the paper's are."""


def fold(lengths: Lengths, bodies: Mapping[str, Inertial]) -> Reduced:
    """Fold all bodies into the base inertial parameters, on numbers or symbols.

    Parameters
    ----------
    lengths : Lengths
        Lengths of the mechanism [m].
    bodies : mapping of str to Inertial
        Every moving link by its name.

    Returns
    -------
    Reduced
    """
    return fold_moments(lengths, {name: _moments(body) for name, body in bodies.items()})


def fold_moments(lengths: Lengths, bodies: Mapping[str, Moments]) -> Reduced:
    """Fold all bodies, given by their moments, in which the result is linear.

    Parameters
    ----------
    lengths : Lengths
        Lengths of the mechanism [m].
    bodies : mapping of str to Moments
        Every moving link by its name.

    Returns
    -------
    Reduced
    """
    r, L = lengths.r, lengths.L
    a_a, c_a, k_a, d_a = _rod(L, bodies["leg_a"])
    a_b, c_b, k_b, d_b = _rod(L, bodies["leg_b"])
    left, right = bodies["rod_left"], bodies["rod_right"]
    rods = Moments(
        plus(left.mass, right.mass), add(left.first, right.first), matrix_sum(left.second, right.second)
    )
    first, second = rods.first, rods.second
    a_c, c_c, k_c, d_c = _rod(L, rods)
    upper, i_upper = _crossbar(lengths, bodies["crossbar_upper"])
    lower, i_lower = _crossbar(lengths, bodies["crossbar_lower"])
    platform, moment, inertia = bodies["platform"]
    at_c5 = plus(k_c, bodies["crossbar_lower"].mass)
    L2 = L * L
    return Reduced(
        a_a=plus(a_a, bodies["slider_a"].mass),
        c_a=c_a,
        d_a=d_a,
        a_b=plus(a_b, bodies["slider_b"].mass),
        c_b=c_b,
        d_b=d_b,
        a_c=plus(plus(a_c, bodies["slider_c"].mass), bodies["crossbar_upper"].mass),
        c_c=c_c,
        m=plus(plus(k_a, k_b), plus(at_c5, platform)),
        k=plus(at_c5, _over(-moment[0], r)),
        e=_over(moment[2], r),
        i=plus(inertia[1][1], times(at_c5, r * r)),
        k0=plus(plus(second[2][2], -second[1][1]), plus(i_upper, i_lower)),
        k1=_over(plus(plus(second[0][0], second[1][1]), -second[2][2]), L2),
        k2=_over(-second[0][2], L2),
        k3=-lower[1],
        n0=_over(second[1][2], L),
        n1=plus(_over(-second[0][1], L), lower[0]),
        h1=plus(first[1], plus(upper[0], lower[0])),
        h2=plus(upper[1], lower[1]),
        h3=d_c,
    )


def model_of(parameters: Parameters) -> Model:
    """Return the numbers of a machine; exact zeros become structural ones and cost nothing.

    Parameters
    ----------
    parameters : Parameters
        The machine.

    Returns
    -------
    Model
    """
    lengths = Lengths.of(parameters.geometry)
    folded = Reduced(*(value or 0 for value in fold(lengths, inertials(parameters.bodies))))
    return Model(lengths.r, lengths.R, lengths.L, *numbers(parameters.gravity), folded)


def shape(model: Model, y: Scalar, theta: Scalar, xp: Namespace) -> Shape:
    """Return where the mechanism is.

    Parameters
    ----------
    model : Model
        The machine.
    y, theta : number, array or symbol
        Of the pose [m, rad].
    xp : Namespace
        Where sqrt, sin and cos come from.

    Returns
    -------
    Shape
    """
    r, R, L = model[:3]
    width = R - r
    p, q = r * xp.sin(theta), r * xp.cos(theta)
    wa, wb, wc = width + y, width - y, R - q
    u2 = (L - y) * (L + y)
    squares = (((L - width) - y) * ((L + width) + y), ((L - width) + y) * ((L + width) - y), u2 - wc * wc)
    Sa, Sb, Sc = (xp.sqrt(square) for square in squares)
    ia, ib, ic = 1 / Sa, 1 / Sb, 1 / Sc
    tc = wc * ic
    return Shape(
        p=p,
        q=q,
        wa=wa,
        wb=wb,
        wc=wc,
        Sa=Sa,
        Sb=Sb,
        Sc=Sc,
        ia=ia,
        ib=ib,
        ic=ic,
        ta=wa * ia,
        tb=wb * ib,
        tc=tc,
        ty=y * ic,
        u2=u2,
        squares=squares,
        arm=q - tc * p,
    )


class _Bar(NamedTuple):
    """How the plane of the parallelogram stands, and the moments that turn with it."""

    y: Scalar  # ∂β/∂y
    theta: Scalar  # ∂β/∂θ
    u: Scalar
    sin: Scalar  # sin β
    cos: Scalar
    iu: Scalar  # 1 / u
    iu2: Scalar
    tan: Scalar  # y / u, of the rods' angle in the plane
    K: Scalar
    slope: Scalar  # ½ ∂K/∂y
    N: Scalar
    H: Scalar  # first moments of what turns, along z0 and along x0
    G: Scalar


def _bar(model: Model, x: Shape, y: Scalar, xp: Namespace) -> _Bar:
    c = model.bodies
    iu2 = 1 / x.u2
    u = xp.sqrt(x.u2)
    iu = u * iu2
    sin, cos, tan = x.wc * iu, x.Sc * iu, y * iu
    across, bulge, stretch = c.h2 + c.h3 * y, c.k2 * y + c.k3, c.k1 * y
    return _Bar(
        y=x.tc * (y * iu2),
        theta=x.p * x.ic,
        u=u,
        sin=sin,
        cos=cos,
        iu=iu,
        iu2=iu2,
        tan=tan,
        K=c.k0 + y * stretch + (2 * bulge) * u,
        slope=stretch + (c.k2 * u - tan * bulge),
        N=c.n0 + c.n1 * tan,
        H=c.h1 * sin + across * cos,
        G=c.h1 * cos - across * sin,
    )


def loads(
    model: Model, x: Shape, state: State, xp: Namespace, wrench: Vector = (0, 0, 0)
) -> tuple[Vector, Vector]:
    """Return what a motion takes at the sliders' own coordinates, and of y, z, θ beside it.

    Parameters
    ----------
    model : Model
        The machine.
    x : Shape
        Where it is.
    state : State
        How it moves.
    xp : Namespace
        Where sqrt comes from.
    wrench : tuple
        F_y, F_z and M_y of the external wrench on the platform at P [N, N, N m].

    Returns
    -------
    F, Q : tuple
        The forces of the actuators are F + J⁻ᵀ Q, the generalized forces Jᵀ F + Q [N, N, N m].
    """
    c = model.bodies
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
    vS = x.tc * vX + x.ty * vy  # less the velocity of the drop
    drop_c = -x.ic * (x.wc * aX + state.y * state.ay + vX * vX + vy2 + vS * vS)
    rise = aZ + drop_c
    # The plane of the parallelogram, with its angle β and S_C = u cos β.
    bar = _bar(model, x, state.y, xp)
    w = x.ic * vX + bar.y * vy
    w2 = w * w
    twice = 2 * vy * w
    turn = (x.Sc * aX - x.wc * drop_c + state.y * twice) * bar.iu2
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
        (c.a_a + c.c_a) * az + c.a_a * drop_a + c.d_a * ay,
        (c.a_b + c.c_b) * az + c.a_b * drop_b + c.d_b * ay,
        c.a_c * slider_c + c.c_c * (az + aZ) + H_c,
    )
    return F, Q


def solve_transposed(x: Shape, Q: Vector) -> Vector:
    """Solve Jᵀ f = Q for the forces at the sliders, written out.

    Parameters
    ----------
    x : Shape
        Where the mechanism is.
    Q : tuple
        Forces of y, z, θ.

    Returns
    -------
    tuple
    """
    f_c = Q[2] * (1 / x.arm)  # reciprocals can be had before the motion is: shorter chains
    rest = Q[1] - f_c
    f_b = (Q[0] + x.ty * f_c + x.ta * rest) * (1 / (x.ta + x.tb))
    return rest - f_b, f_b, f_c


def transposed(x: Shape, f: Vector) -> Vector:
    """Return Jᵀ f, the generalized forces of forces at the sliders.

    Parameters
    ----------
    x : Shape
        Where the mechanism is.
    f : tuple
        Forces of A, B, C.

    Returns
    -------
    tuple
    """
    return x.tb * f[1] - x.ta * f[0] - x.ty * f[2], f[0] + f[1] + f[2], x.arm * f[2]


def actuator_forces(
    model: Model, x: Shape, state: State, xp: Namespace, wrench: Vector = (0, 0, 0)
) -> Vector:
    """Return the actuator forces; equal to `p3dof.virtual_power.actuator_forces` without losses.

    Parameters
    ----------
    model, x, state, xp, wrench
        As for `loads`.

    Returns
    -------
    tuple
        Of A, B, C [N].
    """
    F, Q = loads(model, x, state, xp, wrench)
    return add(F, solve_transposed(x, Q))


def mass_matrix(model: Model, x: Shape, y: Scalar, xp: Namespace) -> Matrix:
    """Return the mass matrix in y, z, θ.

    Parameters
    ----------
    model : Model
        The machine.
    x : Shape
        Where it is.
    y : number, array or symbol
        Of the pose [m].
    xp : Namespace
        Where sqrt comes from.

    Returns
    -------
    tuple
        3 × 3, symmetric; its middle entry is constant.
    """
    c, bar = model.bodies, _bar(model, x, y, xp)
    lean = c.h3 * bar.cos
    H_y, H_t = bar.G * bar.y + lean, bar.G * bar.theta
    upper_a, upper_b, upper_c = c.a_a + c.c_a, c.a_b + c.c_b, c.a_c + c.c_c
    spin_y, spin_t = bar.K * bar.y + bar.N, bar.K * bar.theta
    yy = (
        (c.m + x.ta * (c.a_a * x.ta - 2 * c.d_a) + x.tb * (c.a_b * x.tb + 2 * c.d_b))
        + x.ty * (c.a_c * x.ty - 2 * H_y)
        + bar.y * (spin_y + bar.N)
    )
    zz = c.m + (c.c_a + c.c_b + c.c_c) + upper_a + upper_b + upper_c
    yz = (upper_b * x.tb - upper_a * x.ta - upper_c * x.ty) + (c.d_a + c.d_b) + H_y
    zt = upper_c * x.arm + (c.k + c.c_c) * x.q - c.e * x.p + H_t
    tilted = c.c_c * x.q + H_t
    yt = x.arm * H_y - x.ty * (c.a_c * x.arm + tilted) + spin_y * bar.theta
    tt = c.i + x.arm * (c.a_c * x.arm + 2 * tilted) + bar.theta * spin_t
    return (yy, yz, yt), (yz, zz, zt), (yt, zt, tt)


def forward_dynamics(
    model: Model, x: Shape, state: State, forces: Vector, xp: Namespace, wrench: Vector = (0, 0, 0)
) -> Vector:
    """Return the acceleration of the pose under actuator forces.

    Parameters
    ----------
    model, x, xp, wrench
        As for `loads`.
    state : State
        Its accelerations are not used.
    forces : tuple
        Of A, B, C [N].

    Returns
    -------
    tuple
        ÿ, z̈, θ̈.
    """
    F, Q = loads(model, x, state._replace(ay=0, az=0, atheta=0), xp, wrench)
    acting = transposed(x, (forces[0] - F[0], forces[1] - F[1], forces[2] - F[2]))
    M = mass_matrix(model, x, state.y, xp)
    return solve_about_z(M, (acting[0] - Q[0], acting[1] - Q[1], acting[2] - Q[2]))


def solve_about_z(M: Matrix, b: Vector) -> Vector:
    """Solve M a = b for a symmetric M, taking z out first, whose mass is constant.

    Parameters
    ----------
    M : tuple
        3 × 3, positive definite.
    b : tuple
        Right side.

    Returns
    -------
    tuple
    """
    iz = 1 / M[1][1]
    fy, ft = M[0][1] * iz, M[1][2] * iz
    yy = M[0][0] - fy * M[0][1]
    yt = M[0][2] - fy * M[1][2]
    tt = M[2][2] - ft * M[1][2]
    by, bt = b[0] - fy * b[1], b[2] - ft * b[1]
    share = 1 / (yy * tt - yt * yt)
    ay, at = (tt * by - yt * bt) * share, (yy * bt - yt * by) * share
    return ay, b[1] * iz - fy * ay - ft * at, at


def sliders(model: Model, x: Shape, z: Scalar, xp: Namespace) -> Vector:
    """Return the slider positions.

    Parameters
    ----------
    model : Model
        The machine.
    x : Shape
        Where it is.
    z : number, array or symbol
        Of the pose [m].
    xp : Namespace
        Where sqrt comes from.

    Returns
    -------
    tuple
        λ10 of A, B, C [m].
    """
    width = model.R - model.r
    height = z - xp.sqrt((model.L - width) * (model.L + width))  # of P below the sliders at home
    return height + x.Sa, height + x.Sb, height + x.p + x.Sc


def margin(model: Model, x: Shape, xp: Ordered, results: Sequence[Scalar], held: bool = True) -> Scalar:
    """Return what is positive where a state is clearly good; see `kinematics.validity` for what is not.

    Parameters
    ----------
    model : Model
        The machine.
    x : Shape
        Where it is.
    xp : Ordered
        Where `minimum` comes from.
    results : sequence
        What must be finite.
    held : bool
        The actuators must hold the platform.

    Returns
    -------
    number, array or symbol
        Zero, negative or NaN out of reach, near to it, or near the actuation singularity.
    """
    lowest = xp.minimum(xp.minimum(x.squares[0], x.squares[1]), x.squares[2])
    found = lowest - NEAR_REACH * (model.L * model.L)
    if held:
        sine = x.arm * x.Sc  # of the angle from det J = 0, times r u
        found = xp.minimum(found, sine * sine - (NEAR_SINGULAR * (model.r * model.r)) * x.u2)
    total = sum(results[1:], results[0])
    return found + (total - total)  # NaN where a result is not finite


def _moments(body: Inertial) -> Moments:
    m, com, inertia = body
    return Moments(m, scale(m, com), matrix_sum(inertia, steiner(m, com)))


def _rod(L: Scalar, body: Moments) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """Return a, c, k, d of a body between two ends, the first its origin, the second at (L, 0, 0)."""
    m, first, second = body
    k, along = _over(second[1][1], L * L), _over(first[0], L)
    c = plus(along, -k)
    return plus(m, plus(-along, -c)), c, k, _over(-first[2], L)


def _crossbar(lengths: Lengths, body: Moments) -> tuple[tuple[Scalar, Scalar], Scalar]:
    """Return the first moments of a cross-bar along sin β and cos β, and its inertia about y0."""
    _, first, second = body
    sin, cos = (lengths.R - lengths.r) / lengths.L, lengths.h / lengths.L  # of β at home
    one = plus(times(first[0], cos), times(first[2], sin))
    other = plus(times(first[2], cos), -times(first[0], sin))
    return (one, other), second[1][1]


def _over(a: Scalar, b: Scalar) -> Scalar:
    return 0 if type(a) is int and a == 0 else a / b
