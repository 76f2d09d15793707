"""What limits of speed and force allow the platform: polytopes, not ellipsoids, since limits are boxes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray

SIGNS = np.array([[a, b, c] for a in (-1.0, 1.0) for b in (-1.0, 1.0) for c in (-1.0, 1.0)])
"""The corners of a box, (8, 3)."""


def lone_velocities(jacobian: FloatArray, speed: float) -> FloatArray:
    """Return the largest velocity along each coordinate alone.

    Parameters
    ----------
    jacobian : ndarray, shape (n, 3, 3)
        ∂(λA, λB, λC)/∂(y, z, θ).
    speed : float
        Largest slider speed [m/s].

    Returns
    -------
    ndarray, shape (n, 3)
        speed / max_i |J_ik| [m/s, m/s, rad/s].
    """
    found: FloatArray = speed / np.abs(jacobian).max(axis=-2)
    return found


def lone_ranges(held: FloatArray, columns: FloatArray, force: float) -> FloatArray:
    """Return the range of each coordinate's load alone that forces within their limit allow.

    The forces are held + column · load.

    Parameters
    ----------
    held : ndarray, shape (n, 3)
        Forces without the load [N].
    columns : ndarray, shape (n, 3, 3)
        What the loads add: rows are actuators, columns coordinates.
    force : float
        Largest force [N].

    Returns
    -------
    ndarray, shape (n, 6)
        Least loads of the three coordinates, then the largest; NaN where the machine cannot be held.
    """
    size, lean = np.abs(columns), np.sign(columns) * held[..., None]
    with np.errstate(divide="ignore"):  # an actuator that a load does not concern has room without end
        up, down = ((force - lean) / size).min(axis=-2), ((force + lean) / size).min(axis=-2)
    ends = np.concatenate([-down, up], axis=-1)
    return np.where(_holdable(held, force)[..., None], ends, np.nan)


def ball(held: FloatArray, columns: FloatArray, force: float) -> FloatArray:
    """Return the radius of the largest ball of loads that forces within their limit allow.

    Parameters
    ----------
    held, columns : ndarray, shape (n, 3) and (n, 3, 3)
        As of `lone_ranges`, in coordinates of one unit.
    force : float
        Largest force [N].

    Returns
    -------
    ndarray, shape (n,)
        min_i (force - |held_i|) / ‖row_i‖; NaN where the machine cannot be held.
    """
    radius = ((force - np.abs(held)) / np.linalg.norm(columns, axis=-1)).min(axis=-1)
    return np.where(_holdable(held, force), radius, np.nan)


def _holdable(held: FloatArray, force: float) -> NDArray[np.bool_]:
    return np.asarray((np.abs(held) <= force).all(axis=-1))
