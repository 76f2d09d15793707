"""What every reader of the committed files must find: Pinocchio's numbers for the same files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin

import p3dof
from p3dof import description
from p3dof.parameters import PAPER

FILES = Path(__file__).parents[2] / "urdf"
URDF = FILES / "p3dof.urdf"
MECHANISM = description.with_masses(description.describe(PAPER))
LINKS = {link.name: link for link in MECHANISM.links}
MOVING = {joint.name: joint for joint in MECHANISM.moving}
GRAVITY = np.array(PAPER.gravity)


def random_joints(seed: int, share: float = 0.9) -> dict[str, float]:
    """Joint values of the open tree within `share` of their limits, by joint name."""
    rng = np.random.default_rng(seed)
    return {
        name: float(share * rng.uniform(joint.limits.lower, joint.limits.upper))
        for name, joint in MOVING.items()
    }


def mimicking_joints(seed: int) -> dict[str, float]:
    """Joint values that also keep the parallelogram together, for readers that honour <mimic>."""
    q = random_joints(seed)
    for name, joint in MOVING.items():
        if joint.mimic is not None:
            q[name] = joint.mimic.multiplier * q[joint.mimic.joint]
    return q


def placements(q: dict[str, float], urdf: Path = URDF) -> dict[str, np.ndarray]:
    """4 × 4 placement of every link in base_link, by Pinocchio, at joint values by name."""
    model = pin.buildModelFromUrdf(str(urdf))
    data = model.createData()
    values = np.array([q[name] for name in model.names[1:]])
    pin.framesForwardKinematics(model, data, values)
    return {name: data.oMf[model.getFrameId(name, pin.FrameType.BODY)].homogeneous for name in LINKS}


def closed_states(samples: int = 11) -> p3dof.InverseDynamics:
    """The paper's motion with joints (names, q, v, a) and forces, by the paper's method."""
    return p3dof.load().inverse_dynamics(p3dof.paper_motion(samples), "virtual-power")
