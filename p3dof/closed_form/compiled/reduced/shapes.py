"""Where the mechanism is: what the dynamics need of one y and θ, and whether that is clearly good."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from p3dof._base.algebra import Namespace, Ordered, Scalar, Vector
from p3dof._base.tracing import Symbol
from p3dof.closed_form.compiled.reduced.constants import Model

NEAR_REACH = 1e-12
"""Share of L² that the squares of all drops have in a state that is clearly good, and those of roots in an
assembly that is; of L that its drops have."""

NEAR_SINGULAR = 4e-12  # square of the sine of the angle from the actuation singularity that it has


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
    short_chains: bool
    rsqrt: Callable[[Any], Any] | None


class Bar(NamedTuple):
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


def shape(
    model: Model,
    y: Scalar,
    theta: Scalar,
    xp: Namespace,
    short_chains: bool = False,
    rsqrt: Callable[[Any], Any] | None = None,
) -> Shape:
    """Return where the mechanism is.

    `rsqrt`: returns one over the square root, from which roots and reciprocals are made then; for processors
    whose divider is what all else waits for.
    """
    r, R, L = model[:3]
    width = R - r
    p, q = r * xp.sin(theta), r * xp.cos(theta)
    wa, wb, wc = width + y, width - y, R - q
    u2 = (L - y) * (L + y)
    squares = (((L - width) - y) * ((L + width) + y), ((L - width) + y) * ((L + width) - y), u2 - wc * wc)
    if rsqrt is None:
        Sa, Sb, Sc = (xp.sqrt(square) for square in squares)
    if rsqrt is not None:
        ia, ib, ic = (rsqrt(square) for square in squares)
        Sa, Sb, Sc = (square * i for square, i in zip(squares, (ia, ib, ic), strict=True))
    elif short_chains:  # with divisions that need not wait for the roots
        ia, ib, ic = (S * (1 / square) for S, square in zip((Sa, Sb, Sc), squares, strict=True))
    else:
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
        short_chains=short_chains,
        rsqrt=rsqrt,
    )


def roots_of_u(x: Shape, xp: Namespace, rooted: bool = True) -> Vector:
    """Return u, 1/u and 1/u²."""
    if x.rsqrt is not None and rooted:
        iu = x.rsqrt(x.u2)
        return x.u2 * iu, iu, iu * iu
    iu2 = 1 / x.u2
    u = xp.sqrt(x.u2)
    return u, u * iu2, iu2


def bar_of(model: Model, x: Shape, y: Scalar, xp: Namespace) -> Bar:
    """Return how the plane of the parallelogram stands."""
    c = model.bodies
    u, iu, iu2 = roots_of_u(x, xp, rooted=any(isinstance(value, Symbol) for value in c[-7:]))
    sin, cos, tan = x.wc * iu, x.Sc * iu, y * iu
    across, bulge, stretch = c.h2 + c.h3 * y, c.k2 * y + c.k3, c.k1 * y
    return Bar(
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


def sliders(model: Model, x: Shape, z: Scalar, xp: Namespace) -> Vector:
    """Return the slider positions; λ10 of A, B, C [m]."""
    height = z - home_depth(model, xp)
    return height + x.Sa, height + x.Sb, height + x.p + x.Sc


def home_depth(model: Model, xp: Namespace) -> Scalar:
    """Return how far P is below the sliders at home, h [m]."""
    width = model.R - model.r
    return xp.sqrt((model.L - width) * (model.L + width))


def slider_rates(x: Shape, velocity: Vector) -> Vector:
    """Return the slider velocities; of A, B, C [m/s]."""
    vy, vz, vtheta = velocity
    return vz - x.ta * vy, vz + x.tb * vy, vz - x.ty * vy + x.arm * vtheta


def limit_cosines(
    model: Model, x: Shape, y: Scalar, velocity: Vector, xp: Namespace
) -> tuple[tuple[Scalar, ...], tuple[Scalar, ...]]:
    """Return what is zero at the border of reach and where the sliders lose hold, and how fast it changes.

    Drops of the legs A, B, C by their lengths, for C in the plane of its rods, and cos(φ54 + α); [1/s].
    """
    vy, _, vtheta = velocity
    iu2 = 1 / x.u2
    iu = xp.sqrt(x.u2) * iu2
    iL, lean = 1 / model.L, y * iu2 * vy  # of u the rate is -lean u
    cos_c = x.Sc * iu
    drop_c = -(x.ty * vy + x.tc * x.p * vtheta)
    scale = iu * (1 / model.r)
    turn = x.p * x.ic * vtheta + x.tc * lean  # of leg C in the plane of its rods
    sin_54 = (x.p * x.Sc + x.q * x.wc) * scale
    cosines = x.Sa * iL, x.Sb * iL, cos_c, (x.arm * x.Sc) * scale
    rates = -(x.ta * vy) * iL, x.tb * vy * iL, drop_c * iu + cos_c * lean, -sin_54 * (vtheta + turn)
    return cosines, rates


def margin(model: Model, x: Shape, xp: Ordered, results: Sequence[Scalar], held: bool = True) -> Scalar:
    """Return what is positive where a state is clearly good; see `kinematics.validity` for what is not.

    Zero, negative or NaN out of reach, near to it, or near the actuation singularity.
    """
    lowest = xp.minimum(xp.minimum(x.squares[0], x.squares[1]), x.squares[2])
    found = lowest - NEAR_REACH * (model.L * model.L)
    if held:
        sine = x.arm * x.Sc  # of the angle from det J = 0, times r u
        found = xp.minimum(found, sine * sine - (NEAR_SINGULAR * (model.r * model.r)) * x.u2)
    total = sum(results[1:], results[0])
    return found + (total - total)  # NaN where a result is not finite
