"""What users give for states of motion, as arrays of one shape: checked, or with NaN in invalid rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from p3dof.algebra import components
from p3dof.checks import FloatArray, batch_of
from p3dof.errors import InputError
from p3dof.kinematics.validity import actuation_angle, reach_margins, reached
from p3dof.paper.formulas import Lengths, configuration
from p3dof.parameters import Geometry, Parameters
from p3dof.samples import (
    ACTUATION_TOLERANCE,
    OnInvalid,
    check_policy,
    finite_states,
    raise_not_finite,
    raise_out_of_reach,
    raise_singular,
)


def reachable_poses(geometry: Geometry, pose: ArrayLike, on_invalid: OnInvalid) -> FloatArray:
    """Return poses as an array whose invalid rows are NaN, or raise for them.

    Parameters
    ----------
    geometry : Geometry
        Lengths of the mechanism.
    pose : array-like, shape (..., 3)
        The poses.
    on_invalid : {"raise", "nan"}
        What to do with samples that are not finite or out of reach.

    Returns
    -------
    ndarray, shape (..., 3)

    Raises
    ------
    ReachError, InputError
        As `inverse_kinematics`.
    """
    check_policy(on_invalid)
    poses = batch_of("pose", pose, 3)
    if on_invalid == "raise":
        raise_not_finite("pose", poses)
        margins = reach_margins(geometry, poses)
        raise_out_of_reach(poses, ~reached(geometry, margins), margins)
        return poses
    poses = np.where(np.isfinite(poses).all(axis=-1, keepdims=True), poses, np.nan)
    inside = reached(geometry, reach_margins(geometry, poses))
    return np.where(inside[..., None], poses, np.nan)


def reachable_states(
    geometry: Geometry,
    pose: ArrayLike,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    on_invalid: OnInvalid,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return pose, velocity and acceleration with one shape; invalid rows are NaN in all three, or raise.

    Parameters
    ----------
    geometry : Geometry
        Lengths of the mechanism.
    pose, velocity, acceleration : array-like, shape (..., 3)
        What the user gave.
    on_invalid : {"raise", "nan"}
        What to do with samples that are not finite or out of reach.

    Returns
    -------
    pose, velocity, acceleration : ndarray, shape (..., 3)

    Raises
    ------
    ReachError, InputError
        As `inverse_kinematics`; also when the shapes do not broadcast.
    """
    poses, speeds, rates = finite_states(pose, velocity, acceleration, on_invalid)
    poses = reachable_poses(geometry, poses, on_invalid)
    inside = np.isfinite(poses)
    return poses, np.where(inside, speeds, np.nan), np.where(inside, rates, np.nan)


def holdable_states(
    parameters: Parameters,
    pose: ArrayLike,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    on_invalid: OnInvalid,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return states with one shape, checked for reach and for the actuation singularity.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    pose, velocity, acceleration : array-like, shape (..., 3)
        What the user gave.
    on_invalid : {"raise", "nan"}
        What to do with invalid samples.

    Returns
    -------
    pose, velocity, acceleration : ndarray, shape (..., 3)
        Invalid rows are NaN in all three.

    Raises
    ------
    ReachError, SingularityError, InputError
        Naming the first bad sample and how many there are.
    """
    states = reachable_states(parameters.geometry, pose, velocity, acceleration, on_invalid)
    x = configuration(Lengths.of(parameters.geometry), components(states[0]), np)
    actuation = actuation_angle(x)
    singular = np.abs(actuation) < ACTUATION_TOLERANCE
    if on_invalid == "raise":
        raise_singular(states[0], singular, actuation)
        return states
    poses, speeds, rates = np.where(singular[..., None], np.nan, np.stack(states))
    return poses, speeds, rates


def forced_states(
    parameters: Parameters,
    pose: ArrayLike,
    velocity: ArrayLike,
    forces: ArrayLike,
    on_invalid: OnInvalid,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return states and actuator forces with one shape; invalid rows are NaN in one of them, or raise.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    pose, velocity, forces : array-like, shape (..., 3)
        What the user gave.
    on_invalid : {"raise", "nan"}
        What to do with samples that are not finite or out of reach.

    Returns
    -------
    pose, velocity, forces : ndarray, shape (..., 3)

    Raises
    ------
    ReachError, InputError
        As `inverse_kinematics`; also when the shapes do not broadcast.
    """
    given = batch_of("forces", forces, 3)
    if on_invalid == "raise":
        raise_not_finite("forces", given)
    states = reachable_states(parameters.geometry, pose, velocity, np.zeros(3), on_invalid)
    try:
        poses, speeds, given = np.broadcast_arrays(states[0], states[1], given)
    except ValueError as error:
        raise InputError(
            f"forces: expected a shape that fits {states[0].shape}, got {given.shape}"
        ) from error
    return poses, speeds, given
