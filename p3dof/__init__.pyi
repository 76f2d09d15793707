# What `import p3dof` offers, by topic; each name is imported when it is first used.

# The machine
from .manipulator import Manipulator, load
from .machine.parameters import PAPER, SOLIDS, Parameters, of_solids, read_parameters, write_parameters

# Motion, loads, tasks and drives
from .machine.motion import Motion, paper_motion
from ._base.time_series.wrenches import WrenchHistory
from .design.tasks import Task, Waypoint, read_task, write_task
from .design.assessment import assess
from .design.design_comparison import compare_designs
from .design.sizing import size_drives

# Workspace and performance indices
from .analysis.indices import Indices
from .analysis.workspace import Workspace

# Results
from .methods.comparison import Comparison
from .methods import InverseDynamics
from .analysis.energy import Energy
from .analysis.reactions import Reactions

# Simulation
from .runs import Simulation

# Tolerances and sensitivity
from .analysis.tolerances import sensitivity, tolerance

# Large sweeps
from ._base.blocks import sweep

# Any closed-loop robot
from .loops import ClosedLoopModel, Closure, Coupling, FrameTarget, JointData, Sidecar, load_robot
from .viewer import robot_page, show_robot

# Errors
from ._base.errors import FileError, InputError, ModelError, P3dofError

# Modules, whose names are used with their prefix: p3dof.viewer.save_video, p3dof.methods.engines.load, ...
from ._base import blocks, errors, model_files
from . import analysis, closed_form, codegen, design, loops, machine, methods, report, runs, viewer

# The version
from ._base.version import __version__

__all__ = [
    "PAPER",
    "SOLIDS",
    "ClosedLoopModel",
    "Closure",
    "Comparison",
    "Coupling",
    "Energy",
    "FileError",
    "FrameTarget",
    "Indices",
    "InputError",
    "InverseDynamics",
    "JointData",
    "Manipulator",
    "ModelError",
    "Motion",
    "P3dofError",
    "Parameters",
    "Reactions",
    "Sidecar",
    "Simulation",
    "Task",
    "Waypoint",
    "Workspace",
    "WrenchHistory",
    "__version__",
    "analysis",
    "assess",
    "blocks",
    "closed_form",
    "codegen",
    "compare_designs",
    "design",
    "errors",
    "load",
    "load_robot",
    "loops",
    "machine",
    "methods",
    "model_files",
    "of_solids",
    "paper_motion",
    "read_parameters",
    "read_task",
    "report",
    "robot_page",
    "runs",
    "sensitivity",
    "show_robot",
    "size_drives",
    "sweep",
    "tolerance",
    "viewer",
    "write_parameters",
    "write_task",
]
