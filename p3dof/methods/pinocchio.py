"""Inverse dynamics by Pinocchio: the generated URDF, its loop closures, RNEA and the projection.

Only the platform's motion is given, as the target of the frame ``platform_center``; every joint is found by
closing the loops. No closed form of this mechanism is used: what agrees with `p3dof.methods.virtual_power`
agrees independently.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import pinocchio as pin

from p3dof.checks import FloatArray, Progress
from p3dof.closed_loop import ClosedLoopModel, FrameTarget, State
from p3dof.closed_loop.batch.linear import BLOCK, FEW, IndexArray
from p3dof.closed_loop.batch.states import complete_near
from p3dof.closed_loop.batch.targets import FrameTargets
from p3dof.errors import AssemblyError, DynamicsError, SingularityError
from p3dof.methods.pinocchio_friction import FrictionForces
from p3dof.methods.pinocchio_gate import Gate, Verdict
from p3dof.methods.results import JointStates, Solution
from p3dof.parameters import PLATFORM, Friction

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
    progress: Progress | None = None,
    shape: tuple[int, ...] | None = None,
) -> Solution:
    """Return forces and joints at every sample.

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
    shape : tuple of int, optional
        The leading shape of what the user gave, for errors; (N,) by default.

    Returns
    -------
    Solution

    Raises
    ------
    ReachError, SingularityError, SampleError
        If a sample does not assemble, or the actuators cannot hold it; the message names the sample.
    """
    count, nv = len(pose), loop.model.nv
    states, (forces, evidence) = np.full((3, count, nv), np.nan), np.full((2, count, 3), np.nan)
    given = pose if wrench is None else np.concatenate((pose, wrench), axis=1)
    finite = np.asarray(np.isfinite(given).all(axis=1))
    verdict = Verdict(Gate(loop), pose, targets_of(pose[finite], depth), finite)
    solver = _Solver(loop, depth, FrictionForces(loop, friction), verdict)
    few = count < FEW
    size = 1 if few else BLOCK
    for start in range(0, count, size):
        if progress is not None:
            progress(start, count)
        rows = verdict.try_rows(start + np.flatnonzero(finite[start : start + size]))
        if len(rows):
            loads = None if wrench is None else wrench[rows]
            part = solver.alone if few else solver.together
            rows, *found = part(rows, pose[rows], velocity[rows], acceleration[rows], loads)
            states[:, rows], forces[rows], evidence[rows] = found
        if on_invalid == "raise" and (not few or start == count - 1):
            verdict.tell((count,) if shape is None else shape, start + size >= count)
    if progress is not None:
        progress(count, count)
    names = tuple(loop.model.names[1:])
    actuation = np.where(np.isfinite(forces).all(axis=1), verdict.actuation, np.nan)
    gap, energy, lost = np.ascontiguousarray(evidence.T)
    return Solution(forces, JointStates(names, *states), gap, energy, lost, actuation)


_Part: TypeAlias = tuple[IndexArray, FloatArray, FloatArray, FloatArray]
"""Samples that have forces: numbers, joints (3, n, nv), forces (n, 3), and gap, energy and losses (n, 3)."""


class _Solver:
    """Solves samples, and remembers where the last of them was."""

    def __init__(
        self, loop: ClosedLoopModel, depth: float, friction: FrictionForces, verdict: Verdict
    ) -> None:
        self._loop, self._depth, self._friction, self._verdict = loop, depth, friction, verdict
        self._near: FloatArray | None = None

    def alone(
        self,
        rows: IndexArray,
        pose: FloatArray,
        velocity: FloatArray,
        acceleration: FloatArray,
        wrench: FloatArray | None,
    ) -> _Part:
        """Solve one sample."""
        loop, target, i = self._loop, target_of(pose[0], self._depth), int(rows[0])
        nothing = rows[:0], np.zeros((3, 0, loop.model.nv)), *np.zeros((2, 0, 3))
        try:
            state = complete_near(loop, target, velocity[0], acceleration[0], self._near)
        except AssemblyError as error:
            self._verdict.not_assembled({i: error})
            return nothing
        if not state.same_assembly:
            self._verdict.not_assembled({i: _left_assembly()})
            return nothing
        if not self._verdict.hold(rows, state.q[None], state.influence[None, loop.actuated_v])[0]:
            return nothing
        try:
            lost = self._friction.at(state.q, state.v)
            external = lost.external_with(None if wrench is None else wrench[0])
            found = loop.inverse_dynamics(state.q, state.v, state.a, external, lost.joint_forces)
        except (DynamicsError, SingularityError) as error:
            self._verdict.errors[i] = error
            return nothing
        self._near = state.q
        joints = np.array((state.q, state.v, state.a))
        evidence = _gaps(loop.closure_error(state.q)), loop.power(*joints), lost.power
        return rows, joints[:, None], found.tau[None], np.array([evidence])

    def together(
        self,
        rows: IndexArray,
        pose: FloatArray,
        velocity: FloatArray,
        acceleration: FloatArray,
        wrench: FloatArray | None,
    ) -> _Part:
        """Solve many samples at once."""
        loop, targets = self._loop, targets_of(pose, self._depth)
        motion = loop.complete_batch(targets, velocity, acceleration, near=self._near)
        errors = {int(rows[i]): error for i, error in motion.errors.items()}
        known = np.isfinite(motion.q).all(axis=1)
        errors.update((int(i), _left_assembly()) for i in rows[known & ~motion.same_assembly])
        self._verdict.not_assembled(errors)
        known &= motion.same_assembly
        known[known] = self._verdict.hold(rows[known], motion.q[known], motion.inverse_jacobian[known])
        rows, q, v, a = rows[known], motion.q[known], motion.v[known], motion.a[known]
        lost = self._friction.over(q, v)
        external = lost.external_with(None if wrench is None else wrench[known])
        found = loop.inverse_dynamics_batch(q, v, a, external, lost.joint_forces)
        self._verdict.errors.update((int(rows[i]), error) for i, error in found.errors.items())
        held = np.isfinite(found.tau).all(axis=1)
        joints = np.array((q[held], v[held], a[held]))
        if held.any():
            self._near = joints[0, -1]
        gaps, losses = _gaps(found.closure_error[held]), np.asarray(lost.power)[held]
        evidence = np.column_stack((gaps, loop.power_batch(*joints), losses))
        return rows[held], joints, found.tau[held], evidence


def _left_assembly() -> AssemblyError:
    return AssemblyError("the loops close only on another assembly than that of home")


def _gaps(errors: FloatArray) -> FloatArray:
    """Return the largest gap from closure errors (..., 9)."""
    return np.asarray(np.linalg.norm(errors.reshape(*errors.shape[:-1], 3, 3), axis=-1).max(axis=-1))


def accelerate(
    loop: ClosedLoopModel,
    depth: float,
    pose: FloatArray,
    velocity: FloatArray,
    forces: FloatArray,
    wrench: FloatArray | None = None,
    friction: Friction | None = None,
    on_invalid: str = "raise",
    shape: tuple[int, ...] | None = None,
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
    on_invalid, shape
        As for `solve`; a pose that the actuators cannot hold has an acceleration.

    Returns
    -------
    ndarray, shape (N, 3)
        ÿ, z̈ [m/s²], θ̈ [rad/s²].

    Raises
    ------
    ReachError, SampleError
        If a sample does not assemble; the message names it.
    """
    result = np.full(pose.shape, np.nan)
    data = loop.model.createData()
    frame = loop.model.getFrameId(PLATFORM)
    guess: FloatArray | None = None
    resisting = FrictionForces(loop, friction)
    given = np.concatenate((pose, velocity, forces, *(() if wrench is None else (wrench,))), axis=1)
    finite = np.asarray(np.isfinite(given).all(axis=1))
    verdict = Verdict(Gate(loop), pose, targets_of(pose[finite], depth), finite)
    for i in verdict.try_rows(np.flatnonzero(finite)).tolist():
        try:
            state = complete_near(loop, target_of(pose[i], depth), velocity[i], np.zeros(3), guess)
        except AssemblyError as error:
            verdict.not_assembled({i: error})
            continue
        if not state.same_assembly:
            verdict.not_assembled({i: _left_assembly()})
            continue
        guess = state.q
        lost = resisting.at(state.q, state.v)
        external = lost.external_with(None if wrench is None else wrench[i])
        a = loop.forward_dynamics(state.q, state.v, forces[i], external, lost.joint_forces).a
        pin.forwardKinematics(loop.model, data, state.q, state.v, a)
        pin.updateFramePlacement(loop.model, data, frame)
        moving = pin.getFrameClassicalAcceleration(loop.model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        result[i] = moving.linear[1], moving.linear[2], moving.angular[1]
    if on_invalid == "raise":
        verdict.tell((len(pose),) if shape is None else shape, True)
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
    return loop.complete(target_of(pose, depth), velocity, acceleration)


def targets_of(pose: FloatArray, depth: float) -> FrameTargets:
    """Return the frame targets of poses: P at (0, y, z - h), turned by θ about y0.

    Parameters
    ----------
    pose : ndarray, shape (N, 3)
        y [m], z [m], θ [rad].
    depth : float
        h [m].

    Returns
    -------
    FrameTargets
    """
    y, z, theta = pose.T
    c, s, none, one = np.cos(theta), np.sin(theta), np.zeros(len(pose)), np.ones(len(pose))
    rotations = np.column_stack((c, none, s, none, one, none, -s, none, c)).reshape(-1, 3, 3)
    return FrameTargets(PLATFORM, np.column_stack((none, y, z - depth)), rotations, MASK)


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
