"""What users give for states of motion, as arrays of one shape: checked, or with NaN in invalid rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from p3dof.algebra import components
from p3dof.checks import FloatArray, batch_of
from p3dof.errors import InputError
from p3dof.kinematics.validity import (
    ACTUATION_TOLERANCE,
    OnInvalid,
    actuation_angle,
    check_policy,
    raise_not_finite,
    raise_out_of_reach,
    raise_singular,
    reach_margins,
    reached,
)
from p3dof.paper.formulas import Lengths, configuration
from p3dof.parameters import Geometry, Parameters


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
        raise_out_of_reach(geometry, poses, reach_margins(geometry, poses))
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
    poses = reachable_poses(geometry, pose, on_invalid)
    speeds, rates = batch_of("velocity", velocity, 3), batch_of("acceleration", acceleration, 3)
    if on_invalid == "raise":
        raise_not_finite("velocity", speeds)
        raise_not_finite("acceleration", rates)
    try:
        poses, speeds, rates = np.broadcast_arrays(poses, speeds, rates)
    except ValueError as error:
        shapes = f"{poses.shape}, {speeds.shape} and {rates.shape}"
        raise InputError(
            f"pose, velocity, acceleration: expected shapes that fit each other, got {shapes}"
        ) from error
    if on_invalid == "nan":
        states = np.stack((poses, speeds, rates))  # (3, ..., 3)
        valid = np.asarray(np.isfinite(states).all(axis=(0, -1)))[..., None]
        poses, speeds, rates = np.where(valid, states, np.nan)
    return poses, speeds, rates


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


def wrench_like(wrench: ArrayLike | None, shape: tuple[int, ...], on_invalid: OnInvalid) -> FloatArray:
    """Return the external wrench for every sample of a batch.

    Parameters
    ----------
    wrench : array-like, shape (..., 6), or None
        What the user gave; None is no wrench.
    shape : tuple of int
        Leading shape of the batch.
    on_invalid : {"raise", "nan"}
        Raise for numbers that are not finite, or let them through as NaN.

    Returns
    -------
    ndarray, shape (*shape, 6)

    Raises
    ------
    InputError
        If the shape does not fit the batch, or a number is not finite.
    """
    array = batch_of("wrench", np.zeros(6) if wrench is None else wrench, 6)
    if on_invalid == "raise":
        raise_not_finite("wrench", array)
    array = np.where(np.isfinite(array).all(axis=-1, keepdims=True), array, np.nan)
    try:
        return np.broadcast_to(array, (*shape, 6))
    except ValueError as error:
        raise InputError(f"wrench: expected shape {(*shape, 6)} or (6,), got {array.shape}") from error
