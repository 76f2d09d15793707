"""Motions of the platform: time, pose, velocity, acceleration, by formula, by spline or from a file."""

from p3dof._base.time_series.smoothing import SmoothingFit
from p3dof._base.time_series.wrenches import Load, WrenchHistory, WrenchOverTime
from p3dof.machine.motion.core import Motion, motion_table, paper_motion
from p3dof.machine.motion.curve import Curve
from p3dof.machine.motion.states import States, states_of, states_over

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
