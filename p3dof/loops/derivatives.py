"""What `ClosedLoopModel` returns as derivatives of its dynamics by independent coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof.loops.hybrid_results import HybridDynamics
from p3dof.loops.results import ForwardDynamics, InverseDynamics


@dataclass(frozen=True, eq=False)
class ByMotion:
    """Derivatives by coordinates, their speeds and their accelerations, (size, n) each."""

    by_coordinates: FloatArray
    by_speeds: FloatArray
    by_accelerations: FloatArray


@dataclass(frozen=True, eq=False)
class ByPrescription:
    """Derivatives by coordinates and speeds, (size, n), and by the prescribed accelerations, (size, k)."""

    by_coordinates: FloatArray
    by_speeds: FloatArray
    by_prescribed: FloatArray


@dataclass(frozen=True, eq=False)
class ByForces:
    """Derivatives by coordinates and speeds, (size, n), and by the actuators' forces, (size, m)."""

    by_coordinates: FloatArray
    by_speeds: FloatArray
    by_forces: FloatArray


@dataclass(frozen=True, eq=False)
class Kinematics:
    """How the motion of the tree changes with independent coordinates.

    Parameters
    ----------
    coordinates : tuple of str
        Names of the coordinates: joints, or single freedoms of joints that have several, such as ``base[2]``.
        A displacement of those is one along the velocity, `pinocchio.integrate`.
    motion : (nv, n) array
        N: derivative of the configuration, as a tangent vector, by the coordinates, and of v by their speeds.
    v_by_coordinates : (nv, n) array
        Derivative of the velocity by the coordinates, their speeds being kept.
    """

    coordinates: tuple[str, ...]
    motion: FloatArray
    v_by_coordinates: FloatArray


@dataclass(frozen=True, eq=False)
class InverseDynamicsDerivatives(Kinematics):
    """Derivatives of the actuators' forces by the motion, on the constraint manifold; exact.

    Parameters
    ----------
    coordinates, motion, v_by_coordinates
        As in `Kinematics`.
    dynamics : InverseDynamics
        The forces at the motion.
    tau : ByMotion
        Of the actuators' forces (m); of the smallest ones, where they are not unique.
    a : ByMotion
        Of the acceleration of the tree (nv).
    lambda_ : ByMotion
        Of the multipliers (rows); NaN where they are not unique.
    """

    dynamics: InverseDynamics
    tau: ByMotion
    a: ByMotion
    lambda_: ByMotion


@dataclass(frozen=True, eq=False)
class HybridDynamicsDerivatives(Kinematics):
    """Derivatives of forces and motion by the state and the prescribed accelerations; exact.

    Parameters
    ----------
    coordinates, motion, v_by_coordinates
        As in `Kinematics`.
    dynamics : HybridDynamics
        Forces and motion.
    tau : ByPrescription
        Of the actuators' forces (m); of the smallest ones, where they are not unique.
    a : ByPrescription
        Of the acceleration of the tree (nv).
    lambda_ : ByPrescription
        Of the multipliers (rows); NaN where they are not unique.
    """

    dynamics: HybridDynamics
    tau: ByPrescription
    a: ByPrescription
    lambda_: ByPrescription


@dataclass(frozen=True, eq=False)
class ForwardDynamicsDerivatives(Kinematics):
    """Derivatives of the acceleration by the state and the actuators' forces; exact.

    Parameters
    ----------
    coordinates, motion, v_by_coordinates
        As in `Kinematics`.
    dynamics : ForwardDynamics
        The acceleration.
    accelerations : ByForces
        Of the accelerations of the coordinates (n).
    a : ByForces
        Of the acceleration of the tree (nv).
    lambda_ : ByForces
        Of the multipliers (rows); NaN where they are not unique.
    """

    dynamics: ForwardDynamics
    accelerations: ByForces
    a: ByForces
    lambda_: ByForces


def parts(values: FloatArray, n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return columns (size, 2 n + k) as those by coordinates, by speeds, and by the rest; read-only."""
    values.setflags(write=False)
    return values[:, :n], values[:, n : 2 * n], values[:, 2 * n :]


def where_unique(values: FloatArray, unique: NDArray[np.bool_]) -> FloatArray:
    """Return rows, NaN where they are not unique."""
    return np.where(unique[:, None], values, np.nan)
