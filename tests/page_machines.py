"""Machines and states that the page's WebAssembly is held against, and what Pinocchio has there."""

from dataclasses import dataclass, replace

import numpy as np
from machines import random_states

import p3dof
from p3dof.closed_form import kinematics
from p3dof.closed_form.kinematics.inverse import JOINTS
from p3dof.machine.parameters import PASSIVE

FRICTION = p3dof.machine.Friction(
    viscous={"slide_a": 40.0, "slide_c": 25.0, PASSIVE[0]: 0.3}, coulomb={"slide_b": 12.0, PASSIVE[-1]: 0.4}
)
OTHER = p3dof.machine.Geometry(r=0.08, R=0.31, L=0.55, b=0.06)
PAYLOAD = p3dof.machine.Body(2.5, [0.03, -0.02, 0.05], np.diag([0.02, 0.03, 0.01]))
ACTUATORS = p3dof.machine.Actuators(
    armature={"sliders": 14.8},
    counterbalance={"slide_a": 48.0, "slide_b": 52.0},
    spring={"slide_b": -495.0, "slide_c": 300.0},
    counterweight={"slide_c": 4.9},
)
MACHINES = {
    "paper": p3dof.PAPER,
    "friction": replace(p3dof.SOLIDS, friction=FRICTION),
    "lengths": p3dof.of_solids(OTHER),
    "payload": p3dof.PAPER.carrying(PAYLOAD),
    "actuators": replace(p3dof.SOLIDS, actuators=ACTUATORS),
}
"""The paper's; solids with viscous and Coulomb friction; other lengths; a payload; armature and balance."""
COUNTS = {"paper": 1001, "friction": 2000, "lengths": 2000, "payload": 2000, "actuators": 1000}
"""How many states of each: of the paper's machine its motion, of the others random ones."""


@dataclass(frozen=True)
class Known:
    """States, and what they come to; NaN out of reach."""

    pose: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    wrench: np.ndarray
    forces: np.ndarray
    joints: np.ndarray
    jacobian: np.ndarray
    mass: np.ndarray


def known(name):
    """Return states of a machine, one in ten of the random ones out of reach, by Pinocchio."""
    parameters = MACHINES[name]
    robot = p3dof.Manipulator(parameters)
    if name == "paper":
        motion = p3dof.paper_motion(samples=COUNTS[name])
        rows = motion.pose, motion.velocity, motion.acceleration, np.zeros((len(motion), 6))
    else:
        states = random_states(parameters, 1, COUNTS[name], drop=0.25, angle=0.2, side=1)
        pose = states.pose.copy()
        pose[::10, 0] += 3 * parameters.geometry.L
        rows = pose, states.velocity, states.acceleration, states.wrench
    pose, velocity, acceleration, wrench = rows
    nan = {"on_invalid": "nan"}
    found = kinematics.inverse_kinematics(parameters.geometry, pose, **nan).joints
    return Known(
        *rows,
        forces=robot.forces(pose, velocity, acceleration, wrench=wrench, method="pinocchio", **nan),
        joints=np.stack([found[joint] for joint in JOINTS], axis=-1),
        jacobian=robot.jacobian(pose, method="pinocchio", **nan).reshape(-1, 9),
        mass=robot.mass_matrix(pose, method="pinocchio", **nan).reshape(-1, 9),
    )
