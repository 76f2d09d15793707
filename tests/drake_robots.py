"""Robots of the gallery in Drake, which reads their URDF itself; point closures are added to it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from p3dof.loops import ClosedLoopModel

GRAVITY = [0.0, 0.0, -9.81]


@dataclass(frozen=True)
class InDrake:
    """A robot in both: `plant` is Drake's."""

    loop: ClosedLoopModel
    plant: Any

    def joints(self):
        """Each joint's places in Pinocchio's q, and the joint in Drake; for a floating one the body."""
        model = self.loop.model
        for i in range(1, model.njoints):
            at = slice(model.idx_qs[i], model.idx_qs[i] + model.nqs[i])
            if model.nqs[i] == 7:
                body = next(f for f in model.frames if f.parentJoint == i and f.type == pin.FrameType.BODY)
                yield at, self.plant.GetBodyByName(body.name), True
            else:
                yield at, self.plant.GetJointByName(model.names[i]), False

    def positions(self, q: np.ndarray) -> np.ndarray:
        found = np.zeros(self.plant.num_positions())
        for at, there, floating in self.joints():
            value = q[at]
            if floating:
                start = there.floating_positions_start()
                found[start : start + 7] = value[[6, 3, 4, 5, 0, 1, 2]]
            else:
                found[there.position_start()] = (
                    value[0] if len(value) == 1 else np.arctan2(value[1], value[0])
                )
        return found

    def from_positions(self, positions: np.ndarray) -> np.ndarray:
        q = np.zeros(self.loop.model.nq)
        for at, there, floating in self.joints():
            if floating:
                start = there.floating_positions_start()
                q[at] = positions[start : start + 7][[4, 5, 6, 1, 2, 3, 0]]
                continue
            value = positions[there.position_start()]
            q[at] = (np.cos(value), np.sin(value)) if at.stop - at.start == 2 else value
        return pin.normalize(self.loop.model, q)


def in_drake(loop: ClosedLoopModel, file: Path, step: float) -> InDrake:
    """Return a robot as Drake reads its URDF, with the point closures and springs of its sidecar.

    Drake keeps closures in discrete plants only, by its solver SAP.
    """
    pytest.importorskip("pydrake", reason="drake not installed: pip install 'p3dof[engines]'")
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import PrismaticSpring, RevoluteSpring

    plant = MultibodyPlant(step)
    Parser(plant).AddModels(str(file))
    ground = loop.model.frames[1].name
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(ground))
    plant.mutable_gravity_field().set_gravity_vector(GRAVITY)
    for closure in loop.sidecar.closures:
        assert closure.kind == "3d"
        one, two = (plant.GetBodyByName(name) for name in (closure.frame1, closure.frame2))
        plant.AddBallConstraint(one, np.zeros(3), two, np.zeros(3))
    assert not loop.sidecar.couplings
    for given in loop.sidecar.joint_data:
        joint = plant.GetJointByName(given.joint)
        spring = PrismaticSpring if joint.type_name() == "prismatic" else RevoluteSpring
        plant.AddForceElement(spring(joint, given.rest, given.stiffness))
        assert not given.damping
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        unlimited = np.full(joint.num_positions(), np.inf)
        joint.set_position_limits(-unlimited, unlimited)  # Drake would enforce them
    plant.Finalize()
    return InDrake(loop, plant)
