"""The closed forms of the mechanism, on components: numbers, arrays or symbols.

Only ``+ - * /`` and the namespace's ``sqrt``, ``sin``, ``cos`` are used, and direction cosines instead of
angles; nothing is checked here: outside its reach a leg has no real solution.

Symbols of the paper
--------------------
===============  =========================================  ==================================================
paper            here                                       meaning
===============  =========================================  ==================================================
λ10^A, B, C      ``sliders``                                slider positions [m]
φ21^A + α        ``sin_a, cos_a`` (and B)                   leg from the vertical
φ21^C + α = β    ``sin_c, cos_c``                           plane of the parallelogram from the vertical
φ32^C = φ62^C    ``sin_rod, cos_rod``                       rods in the plane of the parallelogram
φ54^C + α = θ+β  ``sin_54, cos_54``                         platform to the lower cross-bar
v10, ω21, ...    `Rates`                                    relative velocities (or accelerations)
===============  =========================================  ==================================================
"""

from __future__ import annotations

from typing import NamedTuple

from p3dof._base.algebra import Matrix, Namespace, Scalar, Vector
from p3dof.machine.parameters import Geometry


class Lengths(NamedTuple):
    """Lengths of the mechanism [m], numbers or symbols; see `p3dof.machine.Geometry`."""

    r: Scalar
    R: Scalar
    L: Scalar
    b: Scalar
    h: Scalar

    @classmethod
    def of(cls, geometry: Geometry) -> Lengths:
        """Return the numbers of a geometry."""
        return cls(geometry.r, geometry.R, geometry.L, geometry.b, geometry.h)


class Configuration(NamedTuple):
    """Slider positions [m] and the sines and cosines of every angle, for one pose."""

    sliders: Vector
    sin_a: Scalar
    cos_a: Scalar
    sin_b: Scalar
    cos_b: Scalar
    sin_c: Scalar
    cos_c: Scalar
    sin_rod: Scalar
    cos_rod: Scalar
    sin_theta: Scalar
    cos_theta: Scalar

    @property
    def sin_54(self) -> Scalar:
        """sin(φ54 + α) = sin(θ + β)."""
        return self.sin_theta * self.cos_c + self.cos_theta * self.sin_c

    @property
    def cos_54(self) -> Scalar:
        """cos(φ54 + α) = cos(θ + β); zero where the mechanism is actuation-singular."""
        return self.cos_theta * self.cos_c - self.sin_theta * self.sin_c


class Rates(NamedTuple):
    """Relative velocities of the paper's (14), or relative accelerations of its (15)."""

    sliders: Vector
    w21a: Scalar
    w21b: Scalar
    w21c: Scalar
    w32c: Scalar
    w54c: Scalar


def configuration(lengths: Lengths, pose: Vector, xp: Namespace) -> Configuration:
    """Solve the loop closures (6) for the sliders and all angles, platform below the sliders."""
    r, R, L, _, h = lengths
    y, z, theta = pose
    sin_theta, cos_theta = xp.sin(theta), xp.cos(theta)
    wa, wb, wc = R - r + y, R - r - y, R - r * cos_theta  # horizontal extents of the legs
    Sa = xp.sqrt((L - wa) * (L + wa))  # drops of the legs
    Sb = xp.sqrt((L - wb) * (L + wb))
    u = xp.sqrt((L - y) * (L + y))  # length of the rods in the plane x, z
    Sc = xp.sqrt((u - wc) * (u + wc))
    p = z - h
    return Configuration(
        sliders=(p + Sa, p + Sb, p + r * sin_theta + Sc),
        sin_a=wa / L,
        cos_a=Sa / L,
        sin_b=wb / L,
        cos_b=Sb / L,
        sin_c=wc / u,
        cos_c=Sc / u,
        sin_rod=y / L,
        cos_rod=u / L,
        sin_theta=sin_theta,
        cos_theta=cos_theta,
    )


def velocities(lengths: Lengths, x: Configuration, velocity: Vector) -> Rates:
    """Solve the conditions of connectivity (14) for slider [m/s] and relative angular velocities [rad/s]."""
    r, L = lengths.r, lengths.L
    dy, dz, dtheta = velocity
    w21a = dy / (L * x.cos_a)
    w21b = -dy / (L * x.cos_b)
    w32c = dy / (L * x.cos_rod)
    u, du = L * x.cos_rod, -L * x.sin_rod * w32c
    w21c = (r * x.sin_theta * dtheta - du * x.sin_c) / (u * x.cos_c)
    return Rates(
        sliders=(
            dz - L * x.sin_a * w21a,
            dz - L * x.sin_b * w21b,
            dz + r * x.cos_theta * dtheta + du * x.cos_c - u * x.sin_c * w21c,
        ),
        w21a=w21a,
        w21b=w21b,
        w21c=w21c,
        w32c=w32c,
        w54c=w21c + dtheta,
    )


def accelerations(
    lengths: Lengths, x: Configuration, rates: Rates, velocity: Vector, acceleration: Vector
) -> Rates:
    """Solve the conditions (15) for slider [m/s²] and relative angular accelerations [rad/s²]."""
    r, L = lengths.r, lengths.L
    dtheta = velocity[2]
    ddy, ddz, ddtheta = acceleration
    w21a, w21b, w21c, w32c = rates.w21a, rates.w21b, rates.w21c, rates.w32c
    e21a = (ddy / L + x.sin_a * w21a * w21a) / x.cos_a
    e21b = (-ddy / L + x.sin_b * w21b * w21b) / x.cos_b
    e32c = (ddy / L + x.sin_rod * w32c * w32c) / x.cos_rod
    u, du = L * x.cos_rod, -L * x.sin_rod * w32c
    ddu = -L * (x.sin_rod * e32c + x.cos_rod * w32c * w32c)
    ddwc = r * (x.cos_theta * dtheta * dtheta + x.sin_theta * ddtheta)
    e21c = (ddwc - ddu * x.sin_c - 2 * du * x.cos_c * w21c + u * x.sin_c * w21c * w21c) / (u * x.cos_c)
    return Rates(
        sliders=(
            ddz - L * (x.sin_a * e21a + x.cos_a * w21a * w21a),
            ddz - L * (x.sin_b * e21b + x.cos_b * w21b * w21b),
            ddz
            + r * (x.cos_theta * ddtheta - x.sin_theta * dtheta * dtheta)
            + ddu * x.cos_c
            - 2 * du * x.sin_c * w21c
            - u * (x.sin_c * e21c + x.cos_c * w21c * w21c),
        ),
        w21a=e21a,
        w21b=e21b,
        w21c=e21c,
        w32c=e32c,
        w54c=e21c + ddtheta,
    )


def jacobian(lengths: Lengths, x: Configuration) -> Matrix:
    """Return J = ∂(λA, λB, λC)/∂(y, z, θ), from (14); 3 × 3 [m/m, m/m, m/rad]."""
    arm = lengths.r * x.cos_54 / x.cos_c
    return (
        (-x.sin_a / x.cos_a, 1, 0),
        (x.sin_b / x.cos_b, 1, 0),
        (-x.sin_rod / (x.cos_rod * x.cos_c), 1, arm),
    )


def platform_velocity(J: Matrix, sliders: Vector) -> Vector:
    """Solve J ẋ = λ̇ for the velocity of the pose, written out; ẏ, ż, θ̇."""
    dy = (sliders[0] - sliders[1]) / (J[0][0] - J[1][0])
    dz = sliders[0] - J[0][0] * dy
    return dy, dz, (sliders[2] - dz - J[2][0] * dy) / J[2][2]
