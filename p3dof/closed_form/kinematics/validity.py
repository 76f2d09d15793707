"""Which poses are reachable and which are singular: margins, and one clear error for a batch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from p3dof._base.algebra import components
from p3dof._base.checks import FloatArray
from p3dof.closed_form.paper.formulas import Configuration
from p3dof.machine.parameters import Geometry

REACH_TOLERANCE = 1e-14
"""Share of a leg's length by which it must reach farther than a pose demands."""


@dataclass(frozen=True, eq=False)
class Singularity:
    """How far poses are from the two kinds of singularity.

    Parameters
    ----------
    serial : ndarray, shape (..., 3)
        Reach margin of the legs A, B, C [m]: the leg's length less what the pose demands of it across the
        guide-ways. Zero: the leg is horizontal; negative: the pose is out of reach.
    actuation : ndarray, shape (...)
        Angle from the pose where the platform's arm P-C5 lies in the plane of leg C's rods [rad], positive on
        home's side. Zero: det J = 0, the sliders cannot hold the platform's rotation.
    determinant : ndarray, shape (...)
        det J of ∂(λA, λB, λC)/∂(y, z, θ) [m/rad]; NaN out of reach.
    """

    serial: FloatArray
    actuation: FloatArray
    determinant: FloatArray


def reach_margins(geometry: Geometry, poses: FloatArray) -> FloatArray:
    """Return by how much the legs A, B, C are longer than the poses demand across the guide-ways.

    Parameters
    ----------
    geometry : Geometry
        Lengths of the mechanism.
    poses : ndarray, shape (..., 3)
        y [m], z [m], θ [rad].

    Returns
    -------
    ndarray, shape (..., 3)
        Margins [m]; zero or less is out of reach.
    """
    y, _, theta = components(poses)
    width = geometry.R - geometry.r
    demands = (
        np.abs(width + y),
        np.abs(width - y),
        np.hypot(y, geometry.R - geometry.r * np.cos(theta)),
    )
    margins: FloatArray = geometry.L - np.stack(demands, axis=-1)
    return margins


def actuation_angle(x: Configuration) -> FloatArray:
    """Return the angle from the pose where the platform's arm lies in the plane of the rods of leg C.

    Parameters
    ----------
    x : Configuration
        Of arrays.

    Returns
    -------
    ndarray, shape (...)
        [rad]; see `Singularity`.
    """
    return np.asarray(np.arcsin(np.clip(x.cos_54, -1, 1)))


def reached(geometry: Geometry, serial: FloatArray) -> NDArray[np.bool_]:
    """Return whether every leg reaches, by more than what rounding can tell.

    Parameters
    ----------
    geometry : Geometry
        Lengths of the mechanism.
    serial : ndarray, shape (..., 3)
        Reach margins [m].

    Returns
    -------
    ndarray of bool, shape (...)
        False for NaN margins too.
    """
    inside: NDArray[np.bool_] = np.all(serial > REACH_TOLERANCE * geometry.L, axis=-1)
    return inside
