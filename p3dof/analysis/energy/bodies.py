"""Energy and momentum of the bodies at states of motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError
from p3dof._base.samples import OnInvalid
from p3dof.closed_form.kinematics import MechanismMotion, mechanism_motion
from p3dof.machine.parameters import LINKS, Parameters


@dataclass(frozen=True, eq=False)
class Quantities:
    """What the states of motion of a batch amount to; rows of NaN where they are invalid.

    Parameters
    ----------
    sliders : ndarray, shape (..., 3)
        Slider positions A, B, C [m].
    kinetic, potential : ndarray, shape (..., 10) or (..., 13)
        Energies of each of `bodies_of` the machine [J].
    momentum, angular_momentum : ndarray, shape (..., 3)
        Of all bodies together, the angular one about O, in fixed axes [N s, N m s].
    """

    sliders: FloatArray
    kinetic: FloatArray
    potential: FloatArray
    momentum: FloatArray
    angular_momentum: FloatArray


ACTUATORS = ("actuator_a", "actuator_b", "actuator_c")
"""What the energies of motors, screws and balances are called."""


def bodies_of(parameters: Parameters) -> tuple[str, ...]:
    """Return what has energy: the ten bodies, and the three actuators where there are any.

    Parameters
    ----------
    parameters : Parameters
        The machine.

    Returns
    -------
    tuple of str
    """
    return (*LINKS, *ACTUATORS) if parameters.actuators else LINKS


def quantities(
    parameters: Parameters, pose: ArrayLike, velocity: ArrayLike, on_invalid: OnInvalid
) -> Quantities:
    """Return energies and momenta at states of motion.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    pose, velocity : array-like, shape (..., 3)
        Of (y, z, θ) [m, m, rad] and per second; leading shapes broadcast.
    on_invalid : {"raise", "nan"}
        Raise for samples out of reach or not finite, or leave NaN in their rows.

    Returns
    -------
    Quantities

    Raises
    ------
    ReachError, InputError
        Naming leg, margin and sample.
    """
    if not isinstance(parameters, Parameters):
        raise InputError(f"parameters: expected Parameters, got {shown(parameters)}")
    moving = mechanism_motion(parameters.geometry, pose, velocity, np.zeros(3), on_invalid)
    shape = moving.sliders.shape[:-1]
    kinetic, potential = np.zeros((*shape, len(LINKS))), np.zeros((*shape, len(LINKS)))
    linear, angular = np.zeros((*shape, 3)), np.zeros((*shape, 3))
    for k, (name, body) in enumerate(parameters.bodies.items()):
        motion = moving.bodies[name]
        c, v, _ = motion.at(body.com)
        omega = np.einsum("...ji,...j->...i", motion.rotation, motion.omega)  # in the axes of the body
        spin = np.einsum("ij,...j->...i", body.inertia, omega)
        kinetic[..., k] = (body.mass * np.sum(v * v, axis=-1) + np.sum(omega * spin, axis=-1)) / 2
        potential[..., k] -= body.mass * np.sum(c * parameters.gravity, axis=-1)
        linear += body.mass * v
        angular += body.mass * np.cross(c, v) + np.einsum("...ij,...j->...i", motion.rotation, spin)
    if parameters.actuators:
        own, stored = _of_actuators(parameters, moving)
        kinetic = np.concatenate([kinetic, own], axis=-1)
        potential = np.concatenate([potential, stored], axis=-1)
    return Quantities(moving.sliders, kinetic, potential, linear, angular)


def _of_actuators(parameters: Parameters, moving: MechanismMotion) -> tuple[FloatArray, FloatArray]:
    """Return kinetic and potential energy of motors, screws and balances, the latter zero at home."""
    actuators, position = parameters.actuators, moving.sliders
    home = actuators.balance_at_home(parameters.gravity)
    kinetic: FloatArray = actuators.inertia * moving.slider_velocities**2 / 2
    return kinetic, position * (actuators.stiffness * position / 2 - home)


def kinetic_energy(
    parameters: Parameters, pose: ArrayLike, velocity: ArrayLike, on_invalid: OnInvalid = "raise"
) -> FloatArray:
    """Return the kinetic energy of each body, and of the actuators where the machine has any.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    pose, velocity : array-like, shape (..., 3)
        Of (y, z, θ) [m, m, rad] and per second; leading shapes broadcast.
    on_invalid : {"raise", "nan"}
        Raise for samples out of reach or not finite, or leave NaN in their rows.

    Returns
    -------
    ndarray, shape (..., 10) or (..., 13)
        In the order of `bodies_of` the machine [J].

    Raises
    ------
    ReachError, InputError
        Naming leg, margin and sample.
    """
    return quantities(parameters, pose, velocity, on_invalid).kinetic


def potential_energy(parameters: Parameters, pose: ArrayLike, on_invalid: OnInvalid = "raise") -> FloatArray:
    """Return the potential energy of each body, zero where its mass centre is at the origin O.

    That of the actuators, where the machine has any, is stored in their balances, and zero at home.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    pose : array-like, shape (..., 3)
        y [m], z [m], θ [rad].
    on_invalid : {"raise", "nan"}
        Raise for samples out of reach or not finite, or leave NaN in their rows.

    Returns
    -------
    ndarray, shape (..., 10) or (..., 13)
        In the order of `bodies_of` the machine [J].

    Raises
    ------
    ReachError, InputError
        Naming leg, margin and sample.
    """
    return quantities(parameters, pose, np.zeros(3), on_invalid).potential


def momentum(
    parameters: Parameters, pose: ArrayLike, velocity: ArrayLike, on_invalid: OnInvalid = "raise"
) -> tuple[FloatArray, FloatArray]:
    """Return the momentum of all bodies together, and their angular momentum about the origin O.

    Motors, screws and counterweights, whose axes and places are not known, are left out.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    pose, velocity : array-like, shape (..., 3)
        Of (y, z, θ) [m, m, rad] and per second; leading shapes broadcast.
    on_invalid : {"raise", "nan"}
        Raise for samples out of reach or not finite, or leave NaN in their rows.

    Returns
    -------
    linear, angular : ndarray, shape (..., 3)
        In fixed axes [N s, N m s].

    Raises
    ------
    ReachError, InputError
        Naming leg, margin and sample.
    """
    found = quantities(parameters, pose, velocity, on_invalid)
    return found.momentum, found.angular_momentum
