"""Inverse dynamics by Pinocchio: the generated URDF, its loop closures, RNEA and the projection.

Only the platform's motion is given, as the target of the frame ``platform_center``; every joint is found by
closing the loops. No closed form of this mechanism is used: what agrees with `p3dof.virtual_power` agrees
independently.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from p3dof.checks import FloatArray
from p3dof.closed_loop import ClosedLoopModel, FrameTarget, State
from p3dof.errors import AssemblyError, DynamicsError, SampleError, SingularityError
from p3dof.parameters import Friction
from p3dof.routes.friction import PLATFORM, FrictionForces
from p3dof.routes.results import JointStates, Solution

MASK = (False, True, True, False, True, False)
"""What a pose prescribes of the platform's placement: y, z and the rotation about y0."""


def solve(
    loop: ClosedLoopModel,
    depth: float,
    pose: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    wrench: FloatArray | None = None,
    friction: Friction | None = None,
    on_invalid: str = "raise",
    progress: Callable[[int, int], None] | None = None,
) -> Solution:
    """Return forces and joints at every sample, each sample started from the one before.

    Parameters
    ----------
    loop : ClosedLoopModel
        The mechanism.
    depth : float
        h, depth of the platform below the sliders at home [m].
    pose, velocity, acceleration : ndarray, shape (N, 3)
        Motion of the platform; rows of NaN are left out.
    wrench : ndarray, shape (N, 6), optional
        External force and moment on the platform at P [N, N m].
    friction : Friction, optional
        What the joints lose.
    on_invalid : {"raise", "nan"}
        What to do with a sample that does not assemble or that the actuators cannot hold.
    progress : callable, optional
        Called with (done, total) now and then.

    Returns
    -------
    Solution

    Raises
    ------
    SampleError
        If a sample does not assemble, or the actuators cannot hold it; the message names the sample.
    """
    count, nv = len(pose), loop.model.nv
    states = np.full((3, count, nv), np.nan)
    forces = np.full((count, 3), np.nan)
    gap, energy, dissipation = np.full((3, count), np.nan)
    resisting = FrictionForces(loop, friction)
    guess: FloatArray | None = None
    every = max(1, count // 200)
    for i in range(count):
        if progress is not None and i % every == 0:
            progress(i, count)
        if np.isfinite(pose[i]).all() and (wrench is None or np.isfinite(wrench[i]).all()):
            try:
                state = _complete(loop, target_of(pose[i], depth), velocity[i], acceleration[i], guess)
                lost = resisting.at(state.q, state.v)
                external = lost.external_with(None if wrench is None else wrench[i])
                found = loop.inverse_dynamics(state.q, state.v, state.a, external, lost.joint_forces)
            except (AssemblyError, DynamicsError, SingularityError) as error:
                if on_invalid == "raise":
                    kind = SingularityError if isinstance(error, SingularityError) else SampleError
                    raise kind(f"sample {i}: {error}", (i,)) from error
                continue
            q, v, a = states[:, i] = state.q, state.v, state.a
            guess, forces[i], dissipation[i] = q, found.tau, lost.power
            gap[i] = np.linalg.norm(loop.closure_error(q).reshape(-1, 3), axis=-1).max()
            energy[i] = loop.power(q, v, a)
    if progress is not None:
        progress(count, count)
    names = tuple(loop.model.names[1:])
    return Solution(forces, JointStates(names, *states), gap, energy, dissipation)


def accelerate(
    loop: ClosedLoopModel,
    depth: float,
    pose: FloatArray,
    velocity: FloatArray,
    forces: FloatArray,
    wrench: FloatArray | None = None,
    friction: Friction | None = None,
) -> FloatArray:
    """Return the platform's acceleration under actuator forces, by Pinocchio's constrained dynamics.

    Parameters
    ----------
    loop : ClosedLoopModel
        The mechanism.
    depth : float
        h, depth of the platform below the sliders at home [m].
    pose, velocity, forces : ndarray, shape (N, 3)
        State of the platform and actuator forces [N]; rows of NaN are left out.
    wrench : ndarray, shape (N, 6), optional
        External force and moment on the platform at P [N, N m].
    friction : Friction, optional
        What the joints lose.

    Returns
    -------
    ndarray, shape (N, 3)
        ÿ, z̈ [m/s²], θ̈ [rad/s²].
    """
    result = np.full(pose.shape, np.nan)
    data = loop.model.createData()
    frame = loop.model.getFrameId(PLATFORM)
    guess: FloatArray | None = None
    resisting = FrictionForces(loop, friction)
    for i in range(len(pose)):
        given = (pose[i], velocity[i], forces[i], *(() if wrench is None else (wrench[i],)))
        if not all(np.isfinite(row).all() for row in given):
            continue
        state = _complete(loop, target_of(pose[i], depth), velocity[i], np.zeros(3), guess)
        guess = state.q
        lost = resisting.at(state.q, state.v)
        external = lost.external_with(None if wrench is None else wrench[i])
        a = loop.forward_dynamics(state.q, state.v, forces[i], external, lost.joint_forces).a
        pin.forwardKinematics(loop.model, data, state.q, state.v, a)
        pin.updateFramePlacement(loop.model, data, frame)
        moving = pin.getFrameClassicalAcceleration(loop.model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        result[i] = moving.linear[1], moving.linear[2], moving.angular[1]
    return result


def complete(
    loop: ClosedLoopModel, depth: float, pose: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> State:
    """Return the whole tree's motion for one state of the platform, assembled from home.

    Parameters
    ----------
    loop : ClosedLoopModel
        The mechanism.
    depth : float
        h, depth of the platform below the sliders at home [m].
    pose, velocity, acceleration : ndarray, shape (3,)
        State of the platform.

    Returns
    -------
    State

    Raises
    ------
    AssemblyError
        If the pose does not assemble.
    """
    return _complete(loop, target_of(pose, depth), velocity, acceleration, None)


def target_of(pose: FloatArray, depth: float) -> FrameTarget:
    """Return the frame target of a pose: P at (0, y, z - h), turned by θ about y0.

    Parameters
    ----------
    pose : ndarray, shape (3,)
        y [m], z [m], θ [rad].
    depth : float
        h [m].

    Returns
    -------
    FrameTarget
    """
    y, z, theta = (float(value) for value in pose)
    rotation = pin.utils.rotate("y", theta)
    return FrameTarget(PLATFORM, pin.SE3(rotation, np.array([0.0, y, z - depth])), MASK)


def _complete(
    loop: ClosedLoopModel,
    target: FrameTarget,
    velocity: FloatArray,
    acceleration: FloatArray,
    guess: FloatArray | None,
) -> State:
    """Complete a state from the sample before; where that leaves the working assembly, from home."""
    if guess is not None:
        try:
            state = loop.complete(target, velocity, acceleration, guess=guess)
            if state.same_assembly:
                return state
        except AssemblyError:
            pass
    return loop.complete(target, velocity, acceleration)
