"""The machine in the few numbers that its dynamics need: bodies folded, with lengths and gravity."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from p3dof._base.algebra import Matrix, Scalar, Vector, add, matrix_sum, plus, scale, steiner, times
from p3dof.closed_form.paper.formulas import Lengths
from p3dof.machine.parameters import SLIDES, Parameters
from p3dof.machine.parameters.body import Inertial, inertials, numbers

SYMMETRIC_ZEROS = ("d_a", "d_b", "e", "k2", "k3", "n0", "n1", "h1", "h2", "h3")
"""What is zero for bodies that are symmetric as the paper's are."""

SMALLER_ZEROS = ("gx", "gy", *SYMMETRIC_ZEROS, "spring_a", "spring_b", "spring_c")
"""Numbers of a `Model` that are zero where the smaller kernels serve: no springs at the sliders either."""


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


class Actuated(NamedTuple):
    """What motors, screws and counterbalances add at the sliders, numbers or symbols."""

    armature_a: Scalar = 0  # [kg] that moves with the slider and that gravity does not act on
    armature_b: Scalar = 0
    armature_c: Scalar = 0
    balance_a: Scalar = 0  # [N] force of the counterbalance along z0 at home
    balance_b: Scalar = 0
    balance_c: Scalar = 0
    spring_a: Scalar = 0  # [N/m] by which that falls as the slider rises
    spring_b: Scalar = 0
    spring_c: Scalar = 0


class Model(NamedTuple):
    """All that the reduced formulas need of a machine: lengths, gravity, folded bodies, and its actuators."""

    r: Scalar
    R: Scalar
    L: Scalar
    gx: Scalar
    gy: Scalar
    gz: Scalar
    bodies: Reduced
    actuators: Actuated = Actuated()

    @property
    def numbers(self) -> tuple[Scalar, ...]:
        """The 36 numbers in a row."""
        return (*self[:6], *self.bodies, *self.actuators)

    @classmethod
    def of_numbers(cls, row: tuple[Scalar, ...]) -> Model:
        """Return the model of 36 numbers in a row."""
        r, R, L, gx, gy, gz, *others = row
        count = len(Reduced._fields)
        return cls(r, R, L, gx, gy, gz, Reduced(*others[:count]), Actuated(*others[count:]))


def fold(lengths: Lengths, bodies: Mapping[str, Inertial]) -> Reduced:
    """Fold all bodies into the base inertial parameters, on numbers or symbols."""
    return fold_moments(lengths, {name: moments_of(body) for name, body in bodies.items()})


def fold_moments(lengths: Lengths, bodies: Mapping[str, Moments]) -> Reduced:
    """Fold all bodies, given by their moments, in which the result is linear."""
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
    """Return the numbers of a machine; exact zeros become structural ones and cost nothing."""
    lengths = Lengths.of(parameters.geometry)
    folded = Reduced(*(value or 0 for value in fold(lengths, inertials(parameters.bodies))))
    gravity, actuators = numbers(parameters.gravity), parameters.actuators
    rows = ([of.get(slide, 0) for slide in SLIDES] for of in actuators.mappings)
    actuated = Actuated(*(value or 0 for value in fold_actuators(rows, gravity[2])))
    return Model(lengths.r, lengths.R, lengths.L, *gravity, folded, actuated)


def fold_actuators(rows: Iterable[Sequence[Scalar]], gz: Scalar) -> Actuated:
    """Return what the forces see of motors, screws and counterbalances, on numbers or symbols."""
    armature, counterbalance, spring, counterweight = rows
    inertia = (plus(j, m) for j, m in zip(armature, counterweight, strict=True))
    balance = (plus(f, -times(m, gz)) for f, m in zip(counterbalance, counterweight, strict=True))
    return Actuated(*inertia, *balance, *spring)


def moments_of(body: Inertial) -> Moments:
    """Return the moments of a body about the origin of its axes, on numbers, arrays or symbols."""
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
