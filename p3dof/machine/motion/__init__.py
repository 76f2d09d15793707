"""Motions of the platform: time, pose, velocity, acceleration, by formula, by spline or from a file."""

from p3dof.machine.motion.core import Motion
from p3dof.machine.motion.curve import Curve
from p3dof.machine.motion.paper import paper_motion
from p3dof.machine.motion.smoothing import SmoothingFit
from p3dof.machine.motion.states import States, states_of, states_over
from p3dof.machine.motion.tables import motion_table
from p3dof.machine.motion.wrenches import Load, WrenchHistory, WrenchOverTime

__all__ = [
    "Curve",
    "Load",
    "Motion",
    "SmoothingFit",
    "States",
    "WrenchHistory",
    "WrenchOverTime",
    "motion_table",
    "paper_motion",
    "states_of",
    "states_over",
]
