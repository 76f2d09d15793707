"""Frames of closed-loop robots that are to be somewhere else, and p3dof's own configuration there."""

import numpy as np
import pinocchio as pin
from gallery import gallery

import p3dof

ROBOTS = {
    "five-bar": (lambda: gallery("five_bar"), "left_tip"),
    "delta": (lambda: gallery("delta"), "platform"),
    "stewart": (lambda: gallery("stewart"), "platform"),
    "paper": (lambda: p3dof.load().loop, "platform"),
}


def reaching(name):
    """Return a robot, a frame, where it shall be, and the configuration there."""
    make, frame = ROBOTS[name]
    robot, rng = make(), np.random.default_rng(0)
    home = robot.assemble().q
    moved = motors(robot, home) + 0.04 * rng.normal(size=len(robot.actuated))
    there = robot.assemble(moved, guess=home).q
    return robot, frame, placed(robot, frame, there), there


def out_of_reach():
    """Return a robot, a frame, and a place where it cannot be."""
    robot = gallery("stewart")
    goal = placed(robot, "platform", robot.assemble().q)
    return robot, "platform", pin.SE3(goal.rotation, goal.translation + np.array([0.3, 0.0, 1.0]))


def placed(robot, frame, q):
    """Return the placement of a frame."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    return data.oMf[robot.model.getFrameId(frame)].copy()


def apart(robot, frame, q, goal):
    """Return how far a frame is from its goal [m, rad]."""
    return np.abs(pin.log(goal.actInv(placed(robot, frame, q))).vector).max()


def motors(robot, q):
    """Return the values of the actuated joints."""
    return q[[robot.model.joints[robot.model.getJointId(name)].idx_q for name in robot.actuated]]
