"""Energy and momentum of the bodies at states of motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from p3dof.checks import FloatArray, shown
from p3dof.errors import InputError
from p3dof.kinematics import mechanism_motion
from p3dof.parameters import LINKS, Parameters
from p3dof.samples import OnInvalid


@dataclass(frozen=True, eq=False)
class Quantities:
    """What the states of motion of a batch amount to; rows of NaN where they are invalid.

    Parameters
    ----------
    sliders : ndarray, shape (..., 3)
        Slider positions A, B, C [m].
    kinetic, potential : ndarray, shape (..., 10)
        Energies of each body [J].
    momentum, angular_momentum : ndarray, shape (..., 3)
        Of all bodies together, the angular one about O, in fixed axes [N s, N m s].
    """

    sliders: FloatArray
    kinetic: FloatArray
    potential: FloatArray
    momentum: FloatArray
    angular_momentum: FloatArray


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
    return Quantities(moving.sliders, kinetic, potential, linear, angular)


def kinetic_energy(
    parameters: Parameters, pose: ArrayLike, velocity: ArrayLike, on_invalid: OnInvalid = "raise"
) -> FloatArray:
    """Return the kinetic energy of each body.

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
    ndarray, shape (..., 10)
        In the order of `LINKS` [J].

    Raises
    ------
    ReachError, InputError
        Naming leg, margin and sample.
    """
    return quantities(parameters, pose, velocity, on_invalid).kinetic


def potential_energy(parameters: Parameters, pose: ArrayLike, on_invalid: OnInvalid = "raise") -> FloatArray:
    """Return the potential energy of each body, zero where its mass centre is at the origin O.

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
    ndarray, shape (..., 10)
        In the order of `LINKS` [J].

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
