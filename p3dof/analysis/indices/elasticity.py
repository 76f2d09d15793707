"""Natural frequencies: drives and rods give way, gravity pulls along."""

from __future__ import annotations

from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, as_floats
from p3dof._base.errors import InputError
from p3dof.analysis.reactions.stiffness import RodSection
from p3dof.machine.parameters import Parameters

DRIVE = 1e7
"""Stiffness of each drive where none is given [N/m]: a guess for a ball screw of this size."""


def stiffness_of_drives(given: Any) -> FloatArray:
    """Return the stiffness of the three drives, (3,) [N/m].

    Parameters
    ----------
    given : float or array-like, shape (3,)
        Of each drive, or of all; infinite for rigid ones.

    Returns
    -------
    ndarray, shape (3,)

    Raises
    ------
    InputError
        If a number is not positive.
    """
    values = as_floats("drive_stiffness", given)
    if values.shape not in ((), (3,)) or not (values > 0).all():
        raise InputError("drive_stiffness: expected a positive number, or three [N/m]")
    return np.broadcast_to(values, (3,)).copy()


def rod_compliances(parameters: Parameters, rods: RodSection | None) -> FloatArray:
    """Return how rods give way along themselves: L / (n E A) of A, B, and the two of C (3,) [m/N].

    Parameters
    ----------
    parameters : Parameters
        The machine.
    rods : RodSection, optional
        Their section and material; None for rigid ones.

    Returns
    -------
    ndarray, shape (3,)
    """
    if rods is None:
        return np.zeros(3)
    length, bodies = parameters.geometry.L, parameters.bodies
    stiffness = np.zeros(3)
    for name, leg in (("leg_a", 0), ("leg_b", 1), ("rod_left", 2), ("rod_right", 2)):
        radius = rods.radius(length, getattr(bodies, name).mass)
        stiffness[leg] += rods.young * np.pi * radius**2 / length
    return 1 / stiffness


def frequencies(
    jacobian: FloatArray,
    mass: FloatArray,
    by_pose: FloatArray,
    iti: FloatArray,
    drives: FloatArray,
    rods: FloatArray,
) -> FloatArray:
    """Return the natural frequencies about rest, K = Jᵀ diag(k) J + K_g.

    Along its slider a rod gives way by its compliance / ITI². With drives held in place, the load of gravity
    and preload changes with the pose: K_g = Jᵀ ∂f/∂x, f the holding forces.

    Parameters
    ----------
    jacobian, mass : ndarray, shape (n, 3, 3)
        J and M.
    by_pose : ndarray, shape (n, 3, 3)
        ∂f/∂(y, z, θ) of the holding forces.
    iti : ndarray, shape (n, 3)
        Input transmission.
    drives, rods : ndarray, shape (3,)
        Stiffness of the drives [N/m], compliance of the rods [m/N].

    Returns
    -------
    ndarray, shape (n, 3)
        The lowest first [Hz]; NaN where there are none, or the machine is not stable.
    """
    k = 1 / (1 / drives + rods / iti**2)
    transposed = np.swapaxes(jacobian, -1, -2)
    K = transposed @ (k[..., None] * jacobian) + transposed @ by_pose
    K = (K + np.swapaxes(K, -1, -2)) / 2
    good = np.isfinite(K).all(axis=(-1, -2)) & np.isfinite(mass).all(axis=(-1, -2))
    found = np.full(iti.shape, np.nan)
    if good.any():
        inverse = np.linalg.inv(np.linalg.cholesky(mass[good]))
        squares = np.linalg.eigvalsh(inverse @ K[good] @ np.swapaxes(inverse, -1, -2))
        with np.errstate(invalid="ignore"):
            found[good] = np.sqrt(squares) / (2 * np.pi)
    return found
