"""Friction of the joints as formulas, on numbers, arrays or symbols: resistances, and the power they take.

Neither Pinocchio nor the description is used: the rates of all joints follow from the platform's, by (14).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from p3dof._base.algebra import U1, U2, U3, ZERO, Namespace, Scalar, Vector, plus, times
from p3dof._base.checks import FloatArray
from p3dof.closed_form.paper.formulas import (
    Configuration,
    Lengths,
    Rates,
    configuration,
    jacobian,
    platform_velocity,
    velocities,
)
from p3dof.machine.parameters import Actuators, Friction
from p3dof.machine.parameters.body import numbers


class Losses(NamedTuple):
    """Friction of the joints: viscous and Coulomb coefficients by joint, and the rate that smooths them."""

    joints: Mapping[str, tuple[Scalar, Scalar]]
    smoothing: Scalar


NO_LOSSES = Losses({}, 1)


def losses_of(friction: Friction) -> Losses:
    """Return the coefficients of the joints that have friction; zeros become structural ones."""
    joints = {
        name: (friction.viscous.get(name, 0), friction.coulomb.get(name, 0)) for name in friction.joints
    }
    return Losses(joints, friction.smoothing)


def lost_power(lengths: Lengths, x: Configuration, velocity: Vector, losses: Losses, xp: Namespace) -> Scalar:
    """Return the power that friction takes at a velocity [W]; zero or more."""
    rates = joint_rates(velocities(lengths, x, velocity), velocity)
    return power_against(resistance(lengths, x, velocity, losses, xp), rates)


def generalized_losses(
    lengths: Lengths, pose: Vector, velocity: Vector, losses: Losses, xp: Namespace
) -> Vector:
    """Return the forces of y, z and θ that friction takes; arguments as `actuator_forces` [N, N, N m]."""
    x = configuration(lengths, pose, xp)
    resisting = resistance(lengths, x, velocity, losses, xp)
    y, z, theta = (
        power_against(resisting, joint_rates(velocities(lengths, x, unit), unit)) for unit in (U1, U2, U3)
    )
    return y, z, theta


def joint_rates(w: Rates, velocity: Vector) -> dict[str, tuple[Scalar, ...]]:
    """Return rates [m/s or rad/s] by axes of joints that can have friction, up to signs, as in `Friction`."""
    return {
        "slide_a": (w.sliders[0],),
        "slide_b": (w.sliders[1],),
        "slide_c": (w.sliders[2],),
        "hinge_a": (w.w21a,),
        "hinge_b": (w.w21b,),
        "hinge_c": (w.w21c,),
        "hinge_left": (w.w32c,),
        "hinge_right": (w.w32c,),
        "hinge_lower": (w.w32c,),
        "hinge_platform": (w.w54c,),
        # Leg A turns about x0 only and the platform about y0 only: the two axes of the universal joint.
        "universal_a": (w.w21a, velocity[2]),
        "universal_b": (w.w21b, velocity[2]),
        "hinge_lower_right": (w.w32c,),
    }


def resistance(
    lengths: Lengths, x: Configuration, velocity: Vector, losses: Losses, xp: Namespace
) -> dict[str, list[Scalar]]:
    """Return each joint's friction against the rates of `joint_rates` [N or N m], at a platform velocity."""
    if not losses.joints:
        return {}
    rates = joint_rates(velocities(lengths, x, velocity), velocity)
    found = {}
    for name, (viscous, coulomb) in losses.joints.items():
        forces = [times(viscous, rate) for rate in rates[name]]
        if type(coulomb) is not int:
            smooth = [times(coulomb, xp.tanh(rate / losses.smoothing)) for rate in rates[name]]
            forces = [plus(force, more) for force, more in zip(forces, smooth, strict=True)]
        found[name] = forces
    return found


def power_against(resisting: Mapping[str, list[Scalar]], rates: Mapping[str, tuple[Scalar, ...]]) -> Scalar:
    """Return the power against resistances at rates of the joints, which may be virtual [W]."""
    total: Scalar = 0
    for name, forces in resisting.items():
        for force, rate in zip(forces, rates[name], strict=True):
            total = plus(total, times(force, rate))
    return total


def forces_against(
    lengths: Lengths,
    x: Configuration,
    velocity: Vector,
    limits: Mapping[str, tuple[Scalar, ...]],
    smoothing: Scalar,
    xp: Namespace,
) -> tuple[Vector, Scalar]:
    """Return what actuators need against Coulomb friction, by virtual powers, and its power."""
    rates = joint_rates(velocities(lengths, x, velocity), velocity)
    resisting = {
        name: [times(limit, xp.tanh(rate / smoothing)) for limit, rate in zip(each, rates[name], strict=True)]
        for name, each in limits.items()
    }
    J = jacobian(lengths, x)
    forces = []
    for unit in (U1, U2, U3):
        moving = platform_velocity(J, unit)
        forces.append(power_against(resisting, joint_rates(velocities(lengths, x, moving), moving)))
    return (forces[0], forces[1], forces[2]), power_against(resisting, rates)


class Actuation(NamedTuple):
    """Reflected inertia [kg], balance at home [N] and its stiffness [N/m] at the sliders A, B, C."""

    inertia: Vector
    balance: Vector
    stiffness: Vector

    @property
    def resting(self) -> Actuation:
        """The inertia alone."""
        return Actuation(self.inertia, ZERO, ZERO)

    def force(self, leg: int, position: Scalar, acceleration: Scalar) -> Scalar:
        """Return what an actuator gives beside the force at its nut [N]."""
        held = plus(times(self.stiffness[leg], position), -self.balance[leg])
        return plus(times(self.inertia[leg], acceleration), held)


NO_ACTUATION = Actuation(ZERO, ZERO, ZERO)


def actuation_of(actuators: Actuators, gravity: FloatArray) -> Actuation:
    """Return the numbers of the sliders; zeros become structural ones."""
    rows = actuators.inertia, actuators.balance_at_home(gravity), actuators.stiffness
    inertia, balance, stiffness = (numbers(row) for row in rows)
    return Actuation(inertia, balance, stiffness)
