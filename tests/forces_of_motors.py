"""Forces of closed-loop robots by the motion of the motors, and the Jacobian, for libraries of gradients."""

import numpy as np
from gallery import gallery

import p3dof

ROBOTS = {"five-bar": lambda: gallery("five_bar"), "paper": lambda: p3dof.load().loop}


def motions(robot, count):
    """Return positions, velocities and accelerations of the motors, one motion a row."""
    rng, n = np.random.default_rng(0), len(robot.actuated)
    home = robot.assemble().q[robot.actuated_v]
    parts = (0.03, home), (0.5, 0.0), (1.0, 0.0)
    return np.hstack([about + size * rng.normal(size=(count, n)) for size, about in parts])


def exact(robot, x):
    """Return forces and their Jacobian by the robot's own, uncompiled method."""
    state = robot.complete(*np.split(x, 3))
    by = robot.inverse_dynamics_derivatives(state.q, state.v, state.a)
    parts = (by.tau.by_coordinates, by.tau.by_speeds, by.tau.by_accelerations)
    return by.dynamics.tau, np.hstack(parts)
