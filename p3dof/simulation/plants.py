"""The machine as a system of ordinary differential equations: in y, z, θ, or in all joints with closures."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof import kinematics
from p3dof.checks import FloatArray, frozen_array
from p3dof.closed_loop import ClosedLoopModel
from p3dof.errors import DynamicsError, InputError
from p3dof.methods import JointStates, pinocchio
from p3dof.methods.pinocchio_friction import FrictionForces
from p3dof.motion.wrenches import WRENCH_ROWS
from p3dof.parameters import PLATFORM, SLIDES, Parameters
from p3dof.simulation.equations import CompiledEquations, Equations

_NOWHERE = (ValueError, ArithmeticError)
"""What the closed forms raise out of reach."""


class Plant(Protocol):
    """A machine that moves under forces."""

    def rate(self, state: FloatArray, forces: FloatArray, wrench: FloatArray) -> FloatArray:
        """Return the derivative of the state; NaN where there is none."""

    def sliders(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return slider positions [m] and velocities [m/s], (3,) each."""

    def pose(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return pose and velocity of the platform, (3,) each."""

    def drops(self, state: FloatArray) -> FloatArray | None:
        """Return by how much of its length each leg hangs down (3,), if the pose does not tell."""

    def acceleration(self, state: FloatArray, rate: FloatArray) -> FloatArray:
        """Return the acceleration of the pose (3,), given the derivative of the state."""

    def joints(self, states: FloatArray, rates: FloatArray) -> tuple[JointStates, FloatArray]:
        """Return every joint and the largest gap of the loops (N,) [m], for states (N, n)."""


class MinimalPlant:
    """The equations of motion in y, z, θ; the loops are closed by construction.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    equations : Equations or CompiledEquations
        Its equations for one sample at a time.
    """

    def __init__(self, parameters: Parameters, equations: Equations | CompiledEquations) -> None:
        self._parameters = parameters
        self._equations = equations

    def state(self, pose: FloatArray, velocity: FloatArray) -> FloatArray:
        """Return the state (6,) of a pose and its velocity."""
        return np.concatenate([pose, velocity])

    def rate(self, state: FloatArray, forces: FloatArray, wrench: FloatArray) -> FloatArray:
        """Return the derivative of the state; NaN where there is none."""
        acting = [wrench[row] for row in WRENCH_ROWS]
        derivative = np.empty(6)
        derivative[:3] = state[3:]
        try:
            derivative[3:] = self._equations.acceleration(*state.tolist(), *forces.tolist(), *acting)
        except _NOWHERE:
            derivative[:] = np.nan
        return derivative

    def sliders(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return slider positions [m] and velocities [m/s], (3,) each."""
        found = self._equations.sliders(*state.tolist())
        return np.array(found[:3]), np.array(found[3:])

    def pose(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return pose and velocity of the platform, (3,) each."""
        return state[:3], state[3:]

    def drops(self, state: FloatArray) -> FloatArray | None:  # noqa: ARG002 - as the other
        """Return None: the pose tells, since no leg can get beyond the horizontal."""
        return None

    def acceleration(self, state: FloatArray, rate: FloatArray) -> FloatArray:  # noqa: ARG002 - as the other
        """Return the acceleration of the pose (3,), given the derivative of the state."""
        return rate[3:]

    def joints(self, states: FloatArray, rates: FloatArray) -> tuple[JointStates, FloatArray]:
        """Return every joint and the largest gap of the loops (N,) [m], for states (N, 6)."""
        geometry = self._parameters.geometry
        motion = kinematics.mechanism_motion(geometry, states[:, :3], states[:, 3:], rates[:, 3:], "nan")
        names = tuple(motion.position)
        found = JointStates.from_mappings(names, motion.position, motion.velocity, motion.acceleration)
        return found, kinematics.closure_error(geometry, motion)


class ConstrainedPlant:
    """All joints of the tree, held together by its loop closures, which are stabilised.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    loop : ClosedLoopModel
        Its model; the workspaces of a copy are used.
    stabilisation : float
        β of Baumgarte's stabilisation [1/s].
    """

    def __init__(self, parameters: Parameters, loop: ClosedLoopModel, stabilisation: float) -> None:
        self.loop = loop.copy()
        self._depth = parameters.geometry.h
        self._beta = stabilisation
        self._friction = FrictionForces(self.loop, parameters.friction)
        self._data = self.loop.model.createData()
        self._frame = self.loop.model.getFrameId(PLATFORM)
        names = [str(name) for name in self.loop.model.names[1:]]
        self._names = tuple(names)
        self._slides = [names.index(name) for name in SLIDES]
        self._nv = int(self.loop.model.nv)
        self._turns = [names.index(name) for name in ("hinge_c", "hinge_platform")]
        self._legs = [names.index(name) + 1 for name in ("hinge_a", "hinge_b", "hinge_left")]

    def state(self, pose: FloatArray, velocity: FloatArray) -> FloatArray:
        """Return the state (20,) of a pose and its velocity."""
        found = pinocchio.complete(self.loop, self._depth, pose, velocity, np.zeros(3))
        return np.concatenate([found.q, found.v])

    def checked_state(self, q: ArrayLike, v: ArrayLike, tolerance: float) -> FloatArray:
        """Return the state (20,) of joint positions and velocities.

        Raises
        ------
        InputError
            If the loops are open, or the velocity opens them, by more than the tolerance; with the gap.
        """
        q = frozen_array("q", q, (self._nv,))
        v = frozen_array("v", v, (self._nv,))
        gap = float(np.abs(self.loop.closure_error(q)).max())
        opening = float(np.abs(self.loop.closure_jacobian(q) @ v).max())
        if gap > tolerance:
            raise InputError(
                f"q: the loops are open by {gap:.3g} m, expected at most {tolerance:g} m; "
                "robot.loop.assemble(None, guess=q) closes them"
            )
        if opening > tolerance * max(1.0, float(np.abs(v).max())):
            raise InputError(f"v: opens the loops at {opening:.3g} m/s, expected at most {tolerance:g} m/s")
        return np.concatenate([q, v])

    def rate(self, state: FloatArray, forces: FloatArray, wrench: FloatArray) -> FloatArray:
        """Return the derivative of the state; NaN where there is none."""
        if not np.isfinite(state).all():
            return np.full(2 * self._nv, np.nan)
        q, v = state[: self._nv], state[self._nv :]
        lost = self._friction.at(q, v)
        external = lost.external_with(wrench if wrench.any() else None)
        try:
            found = self.loop.forward_dynamics(q, v, forces, external, lost.joint_forces, self._beta)
        except (InputError, DynamicsError):  # the trial step of an integrator that went too far
            return np.full(2 * self._nv, np.nan)
        return np.concatenate([v, found.a])

    def sliders(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return slider positions [m] and velocities [m/s], (3,) each."""
        return state[self._slides], state[self._nv :][self._slides]

    def pose(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return pose and velocity of the platform, (3,) each."""
        model, data = self.loop.model, self._data
        pin.forwardKinematics(model, data, state[: self._nv], state[self._nv :])
        place = pin.updateFramePlacement(model, data, self._frame)
        moving = pin.getFrameVelocity(model, data, self._frame, pin.LOCAL_WORLD_ALIGNED)
        _, y, z = place.translation
        turned = np.arctan2(place.rotation[0, 2], place.rotation[0, 0])
        turned += 2 * np.pi * np.round((state[self._turns].sum() - turned) / (2 * np.pi))  # whole turns
        velocity = np.array([moving.linear[1], moving.linear[2], moving.angular[1]])
        return np.array([y, z + self._depth, turned]), velocity

    def drops(self, state: FloatArray) -> FloatArray:
        """Return by how much of its length each leg hangs down (3,): of leg C, in the plane across y0."""
        pin.forwardKinematics(self.loop.model, self._data, state[: self._nv])
        a, b, c = (self._data.oMi[joint].rotation[:, 0] for joint in self._legs)
        return np.array([-a[2], -b[2], -c[2] / np.hypot(c[0], c[2])])

    def acceleration(self, state: FloatArray, rate: FloatArray) -> FloatArray:
        """Return the acceleration of the pose (3,), given the derivative of the state."""
        model, data = self.loop.model, self._data
        pin.forwardKinematics(model, data, state[: self._nv], state[self._nv :], rate[self._nv :])
        pin.updateFramePlacement(model, data, self._frame)
        moving = pin.getFrameClassicalAcceleration(model, data, self._frame, pin.LOCAL_WORLD_ALIGNED)
        return np.array([moving.linear[1], moving.linear[2], moving.angular[1]])

    def joints(self, states: FloatArray, rates: FloatArray) -> tuple[JointStates, FloatArray]:
        """Return every joint and the largest gap of the loops (N,) [m], for states (N, 20)."""
        gaps = [
            np.linalg.norm(self.loop.closure_error(q).reshape(-1, 3), axis=-1).max()
            for q in states[:, : self._nv]
        ]
        q, v = np.split(states, 2, axis=1)
        return JointStates(self._names, q, v, rates[:, self._nv :]), np.array(gaps)
