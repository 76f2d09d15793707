"""Friction of the joints on the shape of the mechanism: nine rates, into which all thirteen joints fold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from p3dof._base.algebra import Namespace, Scalar, Vector, dot, plus, times
from p3dof.closed_form.compiled.reduced.shapes import Shape, roots_of_u
from p3dof.machine.parameters import PASSIVE, SLIDES, Friction

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
    """Return the coefficients of a machine in the order of `FRICTION`.

    Parameters
    ----------
    friction : Friction
        What the joints lose.

    Returns
    -------
    list of float
    """
    found = [*folded(friction.viscous), *folded(friction.coulomb), 1 / friction.smoothing]
    return [float(number) for number in found]


def folded(coefficients: Mapping[str, Scalar]) -> list[Scalar]:
    """Return the coefficients of joints as those of the nine rates.

    Parameters
    ----------
    coefficients : mapping of str to number or symbol
        By joint; zero where not given.

    Returns
    -------
    list
    """
    found: list[Scalar] = []
    for joints in TOGETHER:
        total: Scalar = 0
        for joint in joints:
            total = plus(total, coefficients.get(joint, 0))
        found.append(total)
    return found


def gradients(x: Shape, y: Scalar, xp: Namespace) -> list[Vector]:
    """Return how the nine rates follow from ẏ, ż, θ̇, up to their signs, which friction does not see.

    Parameters
    ----------
    x : Shape
        Where the mechanism is.
    y : number or symbol
        Of the pose [m].
    xp : Namespace
        Where sqrt comes from.

    Returns
    -------
    list of tuple
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
    """Return the forces of y, z, θ that friction takes: `closed_form.paper.friction.generalized_losses`.

    Parameters
    ----------
    x : Shape
        Where the mechanism is.
    y : number or symbol
        Of the pose [m].
    velocity : tuple
        ẏ, ż, θ̇ [m/s, m/s, rad/s].
    coefficients : tuple
        Viscous and Coulomb coefficients of the nine rates, and one over the rate that smooths.
    xp : Namespace
        Where sqrt and tanh come from.

    Returns
    -------
    tuple
        [N, N, N m].
    """
    viscous, coulomb, steepness = coefficients
    total: list[Scalar] = [0, 0, 0]
    for gradient, linear, dry in zip(gradients(x, y, xp), viscous, coulomb, strict=True):
        rate = dot(gradient, velocity)
        force = plus(times(linear, rate), times(dry, xp.tanh(rate * steepness)))
        total = [plus(sum_, times(entry, force)) for sum_, entry in zip(total, gradient, strict=True)]
    return total[0], total[1], total[2]
