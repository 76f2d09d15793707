"""The paper's inverse dynamics: the virtual powers of all bodies give the actuator forces, (16)-(18).

The virtual velocities are those of (14) for one slider moving at unit speed while the others rest. Every body
is general: any mass centre and inertia, massive cross-bars, rods that differ. `actuator_forces` is the
formula, on numbers, arrays or symbols; `p3dof.methods.virtual_power` serves arrays with it, with checks.
Neither Pinocchio nor the description is used: they share only the parameters with this module.

References
----------
Staicu et al., "Dynamics of a three-degrees-of-freedom spatial parallel manipulator", (14)-(18), corrected
where it is misprinted (see the notebook "The paper, equation by equation").
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from p3dof._base.algebra import (
    U1,
    U2,
    U3,
    ZERO,
    Matrix,
    Namespace,
    Scalar,
    Vector,
    add,
    apply,
    apply_transposed,
    congruent,
    cross,
    dot,
    matrix_sum,
    plus,
    scale,
    steiner,
    subtract,
)
from p3dof.closed_form.paper import formulas, friction
from p3dof.closed_form.paper.recursion import Frame, body_axes, frames, rigid_acceleration
from p3dof.machine.parameters.body import Inertial


class Wrench(NamedTuple):
    """An external force and moment on the platform at P, in the axes of the fixed frame [N, N m]."""

    force: Vector
    moment: Vector


class _Load(NamedTuple):
    """F_k and M_k of (18): what inertia and loads ask of the joint A_k, in the axes of T_k."""

    force: Vector
    moment: Vector


NO_WRENCH = Wrench(ZERO, ZERO)
SLIDERS = ("slider_a", "slider_b", "slider_c")


def actuator_forces(
    lengths: formulas.Lengths,
    bodies: Mapping[str, Inertial],
    gravity: Vector,
    pose: Vector,
    velocity: Vector,
    acceleration: Vector,
    xp: Namespace,
    wrench: Wrench = NO_WRENCH,
    losses: friction.Losses = friction.NO_LOSSES,
    actuation: friction.Actuation = friction.NO_ACTUATION,
) -> Vector:
    """Return the actuator forces (16)-(18), on numbers, arrays or symbols; nothing is checked.

    f10 of A, B, C [N].
    """
    motion = pose, velocity, acceleration
    x, load = _loads(lengths, bodies, gravity, motion, xp, wrench, actuation)
    J = formulas.jacobian(lengths, x)
    resisting = friction.resistance(lengths, x, velocity, losses, xp)
    forces = []
    for slider, unit in zip(SLIDERS, (U1, U2, U3), strict=True):
        moving = formulas.platform_velocity(J, unit)
        w = formulas.velocities(lengths, x, moving)
        force = load[slider].force[2] + _passive_power(load, w)
        forces.append(plus(force, friction.power_against(resisting, friction.joint_rates(w, moving))))
    return (forces[0], forces[1], forces[2])


def generalized_forces(
    lengths: formulas.Lengths,
    bodies: Mapping[str, Inertial],
    gravity: Vector,
    pose: Vector,
    velocity: Vector,
    acceleration: Vector,
    xp: Namespace,
    wrench: Wrench = NO_WRENCH,
    losses: friction.Losses = friction.NO_LOSSES,
    actuation: friction.Actuation = friction.NO_ACTUATION,
) -> Vector:
    """Return the forces of y, z and θ that the motion takes: the virtual powers of unit platform velocities.

    They are Jᵀ times the actuator forces, and stay finite where those do not; arguments as `actuator_forces`.
    """
    motion = pose, velocity, acceleration
    x, load = _loads(lengths, bodies, gravity, motion, xp, wrench, actuation)
    resisting = friction.resistance(lengths, x, velocity, losses, xp)
    powers = []
    for unit in (U1, U2, U3):
        w = formulas.velocities(lengths, x, unit)
        sliders = sum(w.sliders[k] * load[slider].force[2] for k, slider in enumerate(SLIDERS))
        power = sliders + _passive_power(load, w)
        powers.append(plus(power, friction.power_against(resisting, friction.joint_rates(w, unit))))
    return (powers[0], powers[1], powers[2])


def _loads(
    lengths: formulas.Lengths,
    bodies: Mapping[str, Inertial],
    gravity: Vector,
    motion: tuple[Vector, Vector, Vector],
    xp: Namespace,
    wrench: Wrench,
    actuation: friction.Actuation,
) -> tuple[formulas.Configuration, dict[str, _Load]]:
    """Return where the mechanism is, and F_k and M_k of every body; of sliders with what drives them."""
    pose, velocity, acceleration = motion
    x = formulas.configuration(lengths, pose, xp)
    v = formulas.velocities(lengths, x, velocity)
    a = formulas.accelerations(lengths, x, v, velocity, acceleration)
    T = frames(lengths, x, v, a)
    axes = body_axes(lengths)
    own = {name: _own_load(T[name], bodies[name], axes[name], gravity) for name in T}
    own["platform"] = _with_wrench(own["platform"], T["platform"], wrench, (lengths.r, 0, 0))
    load = _accumulate(T, own)
    for k, slider in enumerate(SLIDERS):
        more = actuation.force(k, x.sliders[k], a.sliders[k])
        load[slider] = load[slider]._replace(force=add(load[slider].force, (0, 0, more)))
    return x, load


def _own_load(frame: Frame, body: Inertial, axes: tuple[Matrix, Vector], gravity: Vector) -> _Load:
    """Return F_k0 and M_k0 of (18): inertia less weight of one body, about its joint A_k."""
    to_frame, origin = axes
    m = body.mass
    com = add(origin, apply(to_frame, body.com))  # r_k^C in T_k
    J = matrix_sum(congruent(to_frame, body.inertia), steiner(m, com))  # Ĵ_k about A_k
    weight = scale(m, apply(frame.a0, gravity))  # f_k*
    rigid = rigid_acceleration(frame, com)
    force = subtract(scale(m, add(frame.acceleration, rigid)), weight)
    moment = add(
        scale(m, cross(com, frame.acceleration)),
        apply(J, frame.epsilon),
        cross(frame.omega, apply(J, frame.omega)),
        scale(-1, cross(com, weight)),  # m_k*
    )
    return _Load(force, moment)


def _with_wrench(load: _Load, frame: Frame, wrench: Wrench, r: Vector) -> _Load:
    """Take the external wrench at P, which is at r in T_5, off the platform's load."""
    force = apply(frame.a0, wrench.force)
    moment = add(apply(frame.a0, wrench.moment), cross(r, force))
    return _Load(subtract(load.force, force), subtract(load.moment, moment))


def _accumulate(T: Mapping[str, Frame], own: Mapping[str, _Load]) -> dict[str, _Load]:
    """Return F_k and M_k of (18): each body with all that it carries; T6 branches off at T2 of leg C."""
    chains = (
        ("leg_a", "slider_a"),
        ("leg_b", "slider_b"),
        ("platform", "crossbar_lower"),
        ("crossbar_lower", "rod_left"),
        ("rod_left", "crossbar_upper"),
        ("rod_right", "crossbar_upper"),
        ("crossbar_upper", "slider_c"),
    )
    load = dict(own)
    for outer, inner in chains:
        frame = T[outer]
        force = apply_transposed(frame.a, load[outer].force)  # a_{k+1,k}ᵀ F_{k+1}
        moment = add(apply_transposed(frame.a, load[outer].moment), cross(frame.r, force))
        load[inner] = _Load(add(load[inner].force, force), add(load[inner].moment, moment))
    return load


def _passive_power(load: Mapping[str, _Load], w: formulas.Rates) -> Scalar:
    """Return the brackets of (17) but F_1: the virtual powers of all passive joints."""
    virtual = {
        "leg_a": w.w21a,
        "leg_b": w.w21b,
        "crossbar_upper": w.w21c,
        "rod_left": w.w32c,
        "crossbar_lower": w.w32c,  # ω43 = ω32
        "platform": w.w54c,
        "rod_right": w.w32c,  # ω62 = ω32
    }
    return sum(rate * dot(U3, load[name].moment) for name, rate in virtual.items())
