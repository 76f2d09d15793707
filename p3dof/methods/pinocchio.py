"""Inverse dynamics by Pinocchio: the generated URDF, its loop closures, RNEA and the projection.

Only the platform's motion is given, as the target of the frame ``platform_center``; every joint is found by
closing the loops. No closed form of this mechanism is used: what agrees with `p3dof.methods.virtual_power`
agrees independently.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, Progress
from p3dof._base.errors import AssemblyError, DynamicsError, SingularityError
from p3dof._base.outputs import written
from p3dof._base.threads import Own
from p3dof.loops import ClosedLoopModel, FrameTarget, State
from p3dof.loops.batch.linear import BLOCK, FEW, BoolArray, IndexArray
from p3dof.loops.batch.states import complete_near
from p3dof.loops.batch.targets import FrameTargets
from p3dof.machine.motion.states import States
from p3dof.machine.parameters import PLATFORM, Parameters
from p3dof.methods.pinocchio_balance import JointForces
from p3dof.methods.pinocchio_gate import Gate, Verdict
from p3dof.methods.solution import JointStates, Solution

MASK = (False, True, True, False, True, False)
"""What a pose prescribes of the platform's placement: y, z and the rotation about y0."""


class PinocchioMethod:
    """Forces and equations of motion by Pinocchio; doors as `DynamicsMethod` has them.

    Parameters
    ----------
    parameters : Parameters
        The machine; only the depth of the platform at home, friction and balances are taken from them.
    loop : ClosedLoopModel
        Its model.
    """

    one = None

    def __init__(self, parameters: Parameters, loop: ClosedLoopModel) -> None:
        self._loop, self._depth = loop, parameters.geometry.h
        self._acting = JointForces(loop, parameters)
        self._gate = Gate(loop)
        self._data = Own(loop.model.createData)
        self._frame = loop.model.getFrameId(PLATFORM)

    def forces(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the actuator forces (..., 3) [N]."""
        return written(self.solve(states).forces.reshape(states.pose.shape), out)

    def solve(self, states: States, progress: Progress | None = None) -> Solution:
        """Return forces, joints and evidence at N samples; of a batch of another shape, row by row."""
        shape, rows = states.shape, states.finite().rows()
        pose, velocity, acceleration, wrench = rows.pose, rows.velocity, rows.acceleration, rows.wrench
        count = len(pose)
        joints, (forces, evidence) = (
            np.full((3, count, self._loop.model.nv), np.nan),
            np.full((2, count, 3), np.nan),
        )
        finite = np.asarray(np.isfinite(_acting_on(pose, wrench)).all(axis=1))
        verdict = self._verdict(pose, finite)
        solver = _Solver(self._loop, self._depth, self._acting, verdict)
        few = count < FEW
        size = 1 if few else BLOCK
        for start in range(0, count, size):
            if progress is not None:
                progress(start, count)
            i = verdict.try_rows(start + np.flatnonzero(finite[start : start + size]))
            if len(i):
                loads = None if wrench is None else wrench[i]
                part = solver.alone if few else solver.together
                i, *found = part(i, pose[i], velocity[i], acceleration[i], loads)
                joints[:, i], forces[i], evidence[i] = found
            if states.on_invalid == "raise" and (not few or start == count - 1):
                verdict.tell(shape, start + size >= count)
        if progress is not None:
            progress(count, count)
        gap, energy, lost = np.ascontiguousarray(evidence.T)
        return Solution(
            forces=forces,
            joints=JointStates(tuple(self._loop.model.names[1:]), *joints),
            closure_error=gap,
            energy_rate=energy,
            dissipation=lost,
            actuation=np.where(np.isfinite(forces).all(axis=1), verdict.actuation, np.nan),
        )

    def accelerate(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the acceleration (..., 3) of the platform, by constrained dynamics of all joints."""
        rows = states.finite().rows()
        pose, velocity, forces, wrench = rows.pose, rows.velocity, rows.forces, rows.wrench
        loop, result, guess = self._loop, np.full(pose.shape, np.nan), None
        finite = np.asarray(np.isfinite(_acting_on(pose, wrench)).all(axis=1))
        verdict = self._verdict(pose, finite)
        for i in verdict.try_rows(np.flatnonzero(finite)).tolist():
            try:
                state = complete_near(loop, target_of(pose[i], self._depth), velocity[i], np.zeros(3), guess)
            except AssemblyError as error:
                verdict.not_assembled({i: error})
                continue
            if not state.same_assembly:
                verdict.not_assembled({i: _left_assembly()})
                continue
            guess = state.q
            lost = self._acting.at(state.q, state.v)
            external = lost.external_with(None if wrench is None else wrench[i])
            a = loop.forward_dynamics(state.q, state.v, forces[i], external, lost.joint_forces).a
            result[i] = self._platform_acceleration(state.q, state.v, a)
        if states.on_invalid == "raise":
            verdict.tell(states.shape, True)
        return written(result.reshape(states.pose.shape), out)

    def jacobian(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return ∂(λA, λB, λC)/∂(y, z, θ), (..., 3, 3): rows of the influence matrix of the closed loops."""
        _, influence = self._assembled(states)
        return written(influence[:, self._loop.actuated_v].reshape(*states.shape, 3, 3), out)

    def mass_matrix(self, states: States, out: FloatArray | None = None) -> FloatArray:
        """Return the mass matrix in y, z, θ, (..., 3, 3).

        It is Gᵀ M G: M of the tree, by CRBA, G the influence matrix of the closed loops.
        """
        q, G = self._assembled(states)
        model, data, nv = self._loop.model, self._data.here, self._loop.model.nv
        M = np.full((len(q), nv, nv), np.nan)
        for i in np.flatnonzero(np.isfinite(q).all(axis=1)).tolist():
            M[i] = np.triu(pin.crba(model, data, q[i]))
        M += np.swapaxes(np.triu(M, 1), -1, -2)  # CRBA fills the upper half
        found = np.swapaxes(G, -1, -2) @ M @ G
        return written(((found + np.swapaxes(found, -1, -2)) / 2).reshape(*states.shape, 3, 3), out)

    def _assembled(self, states: States) -> tuple[FloatArray, FloatArray]:
        """Return configurations (N, nq) at poses, and joint speeds per unit ẏ, ż, θ̇ (N, nv, 3)."""
        loop, pose = self._loop, states.finite().rows().pose
        q = np.full((len(pose), loop.model.nq), np.nan)
        G = np.full((len(pose), loop.model.nv, 3), np.nan)
        finite, near = np.asarray(np.isfinite(pose).all(axis=1)), None
        verdict = self._verdict(pose, finite)
        for start in range(0, len(pose), BLOCK):
            i = verdict.try_rows(start + np.flatnonzero(finite[start : start + BLOCK]))
            rest = np.zeros((len(i), 3))
            found = loop.complete_batch(targets_of(pose[i], self._depth), rest, rest, near=near)
            known = np.isfinite(found.q).all(axis=1)
            errors = {int(i[k]): error for k, error in found.errors.items()}
            errors.update((int(k), _left_assembly()) for k in i[known & ~found.same_assembly])
            verdict.not_assembled(errors)
            known &= found.same_assembly
            q[i[known]], G[i[known]] = found.q[known], found.influence[known]
            near = found.q[known][-1] if known.any() else near
            if states.on_invalid == "raise":
                verdict.tell(states.shape, start + BLOCK >= len(pose))
        return q, G

    def _verdict(self, pose: FloatArray, finite: BoolArray) -> Verdict:
        return Verdict(self._gate, pose, targets_of(pose[finite], self._depth), finite)

    def _platform_acceleration(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return ÿ, z̈ and θ̈ of a motion of all joints."""
        model, data = self._loop.model, self._data.here
        pin.forwardKinematics(model, data, q, v, a)
        pin.updateFramePlacement(model, data, self._frame)
        moving = pin.getFrameClassicalAcceleration(model, data, self._frame, pin.LOCAL_WORLD_ALIGNED)
        return np.array((moving.linear[1], moving.linear[2], moving.angular[1]))


def _acting_on(pose: FloatArray, wrench: FloatArray | None) -> FloatArray:
    """Return what must be finite for a sample to be tried; all other numbers are where the pose is."""
    return pose if wrench is None else np.concatenate((pose, wrench), axis=1)


_Part: TypeAlias = tuple[IndexArray, FloatArray, FloatArray, FloatArray]
"""Samples that have forces: numbers, joints (3, n, nv), forces (n, 3), and gap, energy and losses (n, 3)."""


class _Solver:
    """Solves samples, and remembers where the last of them was."""

    def __init__(self, loop: ClosedLoopModel, depth: float, acting: JointForces, verdict: Verdict) -> None:
        self._loop, self._depth, self._acting, self._verdict = loop, depth, acting, verdict
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
            lost = self._acting.at(state.q, state.v)
            external = lost.external_with(None if wrench is None else wrench[0])
            found = loop.inverse_dynamics(state.q, state.v, state.a, external, lost.joint_forces)
        except (DynamicsError, SingularityError) as error:
            self._verdict.errors[i] = error
            return nothing
        self._near = state.q
        joints = np.array((state.q, state.v, state.a))
        evidence = (
            _gaps(loop.closure_error(state.q)),
            loop.power(*joints) + self._acting.stored_power(state.q, state.v),
            lost.power,
        )
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
        lost = self._acting.over(q, v)
        external = lost.external_with(None if wrench is None else wrench[known])
        found = loop.inverse_dynamics_batch(q, v, a, external, lost.joint_forces)
        self._verdict.errors.update((int(rows[i]), error) for i, error in found.errors.items())
        held = np.isfinite(found.tau).all(axis=1)
        joints = np.array((q[held], v[held], a[held]))
        if held.any():
            self._near = joints[0, -1]
        gaps, losses = _gaps(found.closure_error[held]), np.asarray(lost.power)[held]
        energy = loop.power_batch(*joints) + self._acting.stored_power(joints[0], joints[1])
        evidence = np.column_stack((gaps, energy, losses))
        return rows[held], joints, found.tau[held], evidence


def _left_assembly() -> AssemblyError:
    return AssemblyError("the loops close only on another assembly than that of home")


def _gaps(errors: FloatArray) -> FloatArray:
    """Return the largest gap from closure errors (..., 9)."""
    return np.asarray(np.linalg.norm(errors.reshape(*errors.shape[:-1], 3, 3), axis=-1).max(axis=-1))


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
