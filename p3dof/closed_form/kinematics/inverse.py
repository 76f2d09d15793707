"""Inverse kinematics on arrays: sliders, passive angles, Jacobian, singularities."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.algebra import BLOCK, components, matrix_array, vector_array
from p3dof._base.checks import FloatArray, Readable, batch_of, shown
from p3dof._base.errors import InputError
from p3dof._base.outputs import checked_parts
from p3dof._base.samples import OnInvalid
from p3dof.closed_form.kinematics.validity import (
    Placed,
    Singularity,
    actuation_angle,
    reach_margins,
    reachable,
    reached,
)
from p3dof.closed_form.paper import evidence
from p3dof.closed_form.paper.formulas import Configuration, Lengths, configuration, jacobian
from p3dof.machine.motion.states import states_of
from p3dof.machine.parameters import Geometry

JOINTS = (
    "slide_a",
    "hinge_a",
    "slide_b",
    "hinge_b",
    "slide_c",
    "hinge_c",
    "hinge_left",
    "hinge_lower",
    "hinge_platform",
    "hinge_right",
)
"""The joints of the URDF, as `joint_coordinates` names them and in its order."""


@dataclass(frozen=True, eq=False)
class InverseKinematics(Readable):
    """Sliders and passive angles at poses.

    Parameters
    ----------
    sliders : ndarray, shape (..., 3)
        λ10 of A, B, C [m].
    angles : dict of str to ndarray, shape (...)
        The paper's relative angles φ, zero at home [rad]: ``phi21_a``, ``phi21_b``, ``phi21_c``,
        ``phi32_c`` (= φ43 = φ62) and ``phi54_c``.
    """

    sliders: FloatArray
    angles: Mapping[str, FloatArray]

    @property
    def joints(self) -> dict[str, FloatArray]:
        """Every joint of the mechanism by its name in the URDF, positive about the URDF's axes [m, rad]."""
        return joint_coordinates(self.sliders, *self.angles.values())


def singularity(geometry: Geometry, pose: ArrayLike) -> Singularity:
    """Return how far poses are from being out of reach and from being actuation-singular.

    Parameters
    ----------
    geometry : Geometry
        Lengths of the mechanism.
    pose : array-like, shape (..., 3)
        y [m], z [m], θ [rad]; a row with NaN or infinity has NaN margins.

    Raises
    ------
    InputError
        If the shape does not fit.
    """
    poses = batch_of("pose", pose, 3)
    rows = poses.reshape(-1, 3)
    serial, actuation, determinant = np.empty(rows.shape), np.empty(len(rows)), np.empty(len(rows))
    for start in range(0, len(rows), BLOCK):  # what is in between would take ten times as much memory
        block = slice(start, start + BLOCK)
        serial[block], actuation[block], determinant[block] = _margins(geometry, rows[block])
    shape = poses.shape[:-1]
    return Singularity(serial.reshape(poses.shape), actuation.reshape(shape), determinant.reshape(shape))


def _margins(geometry: Geometry, rows: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the margins of poses (n, 3) from the singularities, and the determinants."""
    poses = np.where(np.isfinite(rows).all(axis=1, keepdims=True), rows, np.nan)
    serial = reach_margins(geometry, poses)
    inside = np.where(reached(geometry, serial)[..., None], poses, np.nan)
    lengths = Lengths.of(geometry)
    x = configuration(lengths, components(inside), np)
    J = jacobian(lengths, x)
    return serial, actuation_angle(x), J[2][2] * (J[0][0] - J[1][0])


def inverse_kinematics(
    geometry: Geometry, pose: ArrayLike, on_invalid: OnInvalid = "raise", out: InverseKinematics | None = None
) -> InverseKinematics:
    """Return the sliders and passive angles at poses: the closed form of (6).

    Parameters
    ----------
    geometry : Geometry
        Lengths of the mechanism.
    pose : array-like, shape (..., 3)
        y [m], z [m], θ [rad].
    on_invalid : {"raise", "nan"}
        Raise for samples out of reach, or leave NaN in their rows.
    out : InverseKinematics, optional
        An earlier result of the same shape, which is written again; NaN after an error in the poses.

    Raises
    ------
    ReachError
        If a leg does not reach, naming the leg, its margin and the sample.
    InputError
        If the shape does not fit or a number is not finite; or if `out` does not fit.
    """
    states = states_of(pose, on_invalid=on_invalid)
    if out is None:
        states, _, x = reachable(geometry, states)
        return InverseKinematics(
            vector_array(x.sliders, states.shape), paper_angles(geometry, x, states.pose[..., 2])
        )
    if not isinstance(out, InverseKinematics):
        raise InputError(f"out: expected InverseKinematics, got {shown(out)}")
    arrays = out.sliders, *out.angles.values()
    shapes = states.pose.shape, *len(out.angles) * [states.shape]
    checked_parts(arrays, ("sliders", *out.angles), shapes, states)
    try:
        found = inverse_kinematics(geometry, states.pose, on_invalid)
    except BaseException:
        for array in arrays:
            array.fill(np.nan)
        raise
    for array, values in zip(arrays, (found.sliders, *found.angles.values()), strict=True):
        array[...] = values
    return out


def inverse_jacobian(geometry: Geometry, pose: ArrayLike, on_invalid: OnInvalid = "raise") -> FloatArray:
    """Return J = ∂(λA, λB, λC)/∂(y, z, θ): slider velocities are J times the pose's velocity (14).

    Rows A, B, C; columns y, z [1] and θ [m/rad].
    """
    return jacobian_at(reachable(geometry, states_of(pose, on_invalid=on_invalid)))


def jacobian_at(placed: Placed) -> FloatArray:
    """Return `inverse_jacobian` at states that were looked at, (..., 3, 3)."""
    J = matrix_array(jacobian(placed.lengths, placed.x), placed.states.shape)
    J[np.isnan(placed.states.pose).any(axis=-1)] = np.nan
    return J


def joint_coordinates(
    sliders: FloatArray,
    phi21_a: FloatArray,
    phi21_b: FloatArray,
    phi21_c: FloatArray,
    phi32_c: FloatArray,
    phi54_c: FloatArray,
) -> dict[str, FloatArray]:
    """Name the paper's coordinates (or their rates) as the joints of the URDF, with the URDF's signs."""
    values = evidence.in_order(components(sliders), phi21_a, phi21_b, phi21_c, phi32_c, phi54_c)
    return dict(zip(JOINTS, values, strict=True))


def paper_angles(geometry: Geometry, x: Configuration, theta: FloatArray) -> dict[str, FloatArray]:
    """Return the paper's relative angles φ, zero at home, in the order of `joint_coordinates`."""
    values = evidence.paper_angles(Lengths.of(geometry), x, theta, np)
    return dict(zip(("phi21_a", "phi21_b", "phi21_c", "phi32_c", "phi54_c"), values, strict=True))
