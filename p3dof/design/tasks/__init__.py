"""Tasks: where the platform has to go, what it bears along the path, and the motion that does it."""

from p3dof.design.tasks.files import read_task, write_task
from p3dof.design.tasks.laws import PROFILES
from p3dof.design.tasks.limits import AxisLimits
from p3dof.design.tasks.paths import Path, Waypoint
from p3dof.design.tasks.plan import Piece, Plan
from p3dof.design.tasks.smooth import FastestPlan, LimitUse
from p3dof.design.tasks.task import PATHS, Task

__all__ = [
    "PATHS",
    "PROFILES",
    "AxisLimits",
    "FastestPlan",
    "LimitUse",
    "Path",
    "Piece",
    "Plan",
    "Task",
    "Waypoint",
    "read_task",
    "write_task",
]
