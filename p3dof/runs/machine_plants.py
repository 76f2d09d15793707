"""The manipulator as a plant: in y, z, θ, or in all joints with closures; and its limits along a run."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof.closed_form import kinematics
from p3dof.loops import ClosedLoopModel
from p3dof.machine.motion.wrenches import WRENCH_ROWS
from p3dof.machine.parameters import PLATFORM, Parameters
from p3dof.methods import JointStates, pinocchio
from p3dof.methods.pinocchio_balance import JointForces
from p3dof.runs.equations import CompiledEquations, Equations
from p3dof.runs.limits import Limiter
from p3dof.runs.margins import Stop
from p3dof.runs.plants import ConstrainedPlant, Plant

_NOWHERE = (ValueError, ArithmeticError)
"""What the closed forms raise out of reach."""


class MachinePlant(Plant, Protocol):
    """The manipulator that moves under forces: a plant with a platform."""

    def state(self, pose: FloatArray, velocity: FloatArray) -> FloatArray:
        """Return the state of a pose and its velocity."""

    def pose(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return pose and velocity of the platform, (3,) each."""

    def drops(self, state: FloatArray) -> FloatArray | None:
        """Return by how much of its length each leg hangs down (3,), if the pose does not tell."""

    def acceleration(self, state: FloatArray, rate: FloatArray) -> FloatArray:
        """Return the acceleration of the pose (3,), given the derivative of the state."""

    def joints(self, states: FloatArray, rates: FloatArray) -> tuple[JointStates, FloatArray]:
        """Return every joint and the largest gap of the loops (N,) [m], for states (N, n)."""


class MachineMargins:
    """The margins of the manipulator's limits, for the states of a plant.

    Parameters
    ----------
    plant : MachinePlant
        What tells the pose of a state.
    limiter : Limiter
        What tells the margins of a pose.
    """

    def __init__(self, plant: MachinePlant, limiter: Limiter) -> None:
        self._plant, self._limiter = plant, limiter

    def __call__(self, time: float, state: FloatArray) -> FloatArray:  # noqa: ARG002 - they stay as they are
        """Return the margins of a state, shape (12,)."""
        return self._limiter(self._plant.pose(state)[0], self._plant.drops(state))

    def trend(self, time: float, state: FloatArray, ahead: float) -> tuple[FloatArray, FloatArray]:  # noqa: ARG002
        """Return the margins of a state, and those a short time ahead at its present velocity."""
        pose, velocity = self._plant.pose(state)
        drops = self._plant.drops(state)
        return self._limiter(pose, drops), self._limiter(pose + ahead * velocity, drops)

    def stop(self, index: int, time: float) -> Stop:
        """Return why a run ends at a margin."""
        return self._limiter.stop(index, time)


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

    def actuated(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return slider positions [m] and velocities [m/s], (3,) each."""
        found = self._equations.sliders(*state[:6].tolist())
        return np.array(found[:3]), np.array(found[3:])

    def pose(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return pose and velocity of the platform, (3,) each."""
        return state[:3], state[3:6]

    def drops(self, state: FloatArray) -> FloatArray | None:  # noqa: ARG002 - as the other
        """Return None: the pose tells, since no leg can get beyond the horizontal."""
        return None

    def acceleration(self, state: FloatArray, rate: FloatArray) -> FloatArray:  # noqa: ARG002 - as the other
        """Return the acceleration of the pose (3,), given the derivative of the state."""
        return rate[3:6]

    def joints(self, states: FloatArray, rates: FloatArray) -> tuple[JointStates, FloatArray]:
        """Return every joint and the largest gap of the loops (N,) [m], for states (N, 6)."""
        geometry = self._parameters.geometry
        motion = kinematics.mechanism_motion(geometry, states[:, :3], states[:, 3:6], rates[:, 3:6], "nan")
        names = tuple(motion.position)
        found = JointStates.from_mappings(names, motion.position, motion.velocity, motion.acceleration)
        return found, kinematics.closure_error(geometry, motion)


class MachineJoints(ConstrainedPlant):
    """All joints of the manipulator's tree, held together by its loop closures, with friction and balances.

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
        super().__init__(loop, stabilisation, (PLATFORM,), JointForces(loop, parameters).at)
        self._depth = parameters.geometry.h
        self._data = self.loop.model.createData()
        self._frame = self.loop.model.getFrameId(PLATFORM)
        names = list(self.names)
        self._turns = [names.index(name) for name in ("hinge_c", "hinge_platform")]
        self._legs = [names.index(name) + 1 for name in ("hinge_a", "hinge_b", "hinge_left")]

    def state(self, pose: FloatArray, velocity: FloatArray) -> FloatArray:
        """Return the state (20,) of a pose and its velocity."""
        found = pinocchio.complete(self.loop, self._depth, pose, velocity, np.zeros(3))
        return np.concatenate([found.q, found.v])

    def pose(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return pose and velocity of the platform, (3,) each."""
        model, data = self.loop.model, self._data
        pin.forwardKinematics(model, data, *self.split(state))
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
        pin.forwardKinematics(model, data, *self.split(state), rate[self._nv : 2 * self._nv])
        pin.updateFramePlacement(model, data, self._frame)
        moving = pin.getFrameClassicalAcceleration(model, data, self._frame, pin.LOCAL_WORLD_ALIGNED)
        return np.array([moving.linear[1], moving.linear[2], moving.angular[1]])

    def joints(self, states: FloatArray, rates: FloatArray) -> tuple[JointStates, FloatArray]:
        """Return every joint and the largest gap of the loops (N,) [m], for states (N, 20)."""
        q, v, a, gap = self.motion(states, rates)
        return JointStates(self.names, q, v, a), gap
