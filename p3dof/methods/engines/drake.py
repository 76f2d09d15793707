"""Drake: the URDF with its ball constraints, in joint coordinates."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray
from p3dof._base.errors import InputError
from p3dof.machine.description import Mechanism
from p3dof.machine.description.urdf_text import drake
from p3dof.machine.parameters import PAPER, PLATFORM, Parameters
from p3dof.methods.engines.base import Engine, FinalState, FrameMotion, Sample, bare_mechanism, library

_STEP = 1e-3
"""Time step of the plant that never moves [s]: Drake keeps ball constraints in discrete plants only."""


@dataclass(frozen=True, eq=False)
class _Frame:
    """A frame with its Jacobian: velocity J v and acceleration J a + bias, linear parts first."""

    position: FloatArray
    rotation: FloatArray
    J: FloatArray
    bias: FloatArray


class DrakeEngine(Engine):
    """A machine in Drake.

    Its inverse dynamics is that of the open tree; the loops enter by the Jacobians of the two points that
    each of them joins.
    """

    name = "drake"
    module = "pydrake"

    def __init__(self, parameters: Parameters = PAPER) -> None:
        super().__init__(parameters)
        self._tree = library("pydrake.multibody.tree", self.name)
        self._plant = self._built(_STEP)
        self._context = self._plant.CreateDefaultContext()
        joints = [self._plant.GetJointByName(name) for name in self.joints]
        self._q_at = [joint.position_start() for joint in joints]
        self._v_at = [joint.velocity_start() for joint in joints]

    def _described(self) -> Mechanism:
        return bare_mechanism(self.parameters)

    def _built(self, step: float, springs: bool = False) -> Any:
        """Return a plant, its root welded to the world; with the springs of balances, if it is to move."""
        plant = library("pydrake.multibody.plant", self.name).MultibodyPlant(step)
        parser = library("pydrake.multibody.parsing", self.name).Parser(plant)
        parser.AddModelsFromString(drake(self._mechanism.bare()), "urdf")
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(self._mechanism.links[0].name))
        plant.mutable_gravity_field().set_gravity_vector(self.parameters.gravity)
        for joint in self._mechanism.moving if springs else ():
            if joint.stiffness:
                spring = self._tree.PrismaticSpring(plant.GetJointByName(joint.name), 0.0, joint.stiffness)
                plant.AddForceElement(spring)
        plant.Finalize()
        return plant

    def _sample(self, q: FloatArray, v: FloatArray, a: FloatArray, wrench: FloatArray) -> Sample:
        plant, context = self._plant, self._context
        plant.SetPositions(context, _scattered(q, self._q_at))
        plant.SetVelocities(context, _scattered(v, self._v_at))
        gravity = self._tree.MultibodyForces(plant)
        plant.CalcForceElementsContribution(context, gravity)
        balance = [
            joint.force - joint.stiffness * x for joint, x in zip(self._mechanism.moving, q, strict=True)
        ]
        gravity.mutable_generalized_forces()[:] += _scattered(np.array(balance), self._v_at)
        load = plant.CalcInverseDynamics(context, _scattered(a, self._v_at), gravity)[self._v_at]
        pairs = [
            (self._frame(closure.frame1), self._frame(closure.frame2)) for closure in self._mechanism.closures
        ]
        J = np.vstack([(one.J - other.J)[:3] for one, other in pairs])
        bias = np.concatenate([(one.bias - other.bias)[:3] for one, other in pairs])
        gap = np.concatenate([one.position - other.position for one, other in pairs])
        platform = self._frame(PLATFORM)
        actuated = [self.joints.index(name) for name in self._mechanism.actuated]
        return Sample(
            load - platform.J.T @ wrench,
            np.eye(len(q))[:, actuated],
            J,
            gap,
            J @ v,
            J @ a + bias,
            FrameMotion(platform.position, platform.rotation, platform.J @ v, platform.J @ a + platform.bias),
        )

    def _frame(self, name: str) -> _Frame:
        plant, context, world = self._plant, self._context, self._plant.world_frame()
        frame = plant.GetFrameByName(name)
        place = frame.CalcPoseInWorld(context)
        given = (context, self._tree.JacobianWrtVariable.kV, frame, np.zeros(3), world, world)
        J = plant.CalcJacobianSpatialVelocity(*given)[:, self._v_at]
        bias = plant.CalcBiasSpatialAcceleration(*given)
        return _Frame(
            place.translation(),
            place.rotation().matrix(),
            np.vstack([J[3:], J[:3]]),
            np.concatenate([bias.translational(), bias.rotational()]),
        )

    def simulate(self, duration: float, step: float, pose: ArrayLike, forces: ArrayLike) -> FinalState:
        """Move the machine from rest under constant forces; see `Engine.simulate`.

        With Drake's discrete solver for ball constraints, SAP, of first order in the step.
        """
        _, q, forces = self._start(duration, step, pose, forces)
        if any(joint.stiffness < 0 for joint in self._mechanism.moving):
            raise InputError("parameters: drake has no springs of negative stiffness")
        plant = self._built(step, springs=True)
        simulator = library("pydrake.systems.analysis", self.name).Simulator(plant)
        context = simulator.get_mutable_context()
        plant.SetPositions(context, _scattered(q, self._q_at))
        plant.get_actuation_input_port().FixValue(context, forces)
        pushes = _scattered(np.array([joint.force for joint in self._mechanism.moving]), self._v_at)
        plant.get_applied_generalized_force_input_port().FixValue(context, pushes)
        simulator.Initialize()
        begin = time.perf_counter()
        simulator.AdvanceTo(duration)
        seconds = time.perf_counter() - begin
        return self._final(duration, step, plant.GetPositions(context)[self._q_at], seconds)


def _scattered(values: FloatArray, where: list[int]) -> FloatArray:
    """Put values where Drake has them."""
    result = np.empty(len(where))
    result[where] = values
    return result
