# What `import p3dof` offers, by topic; each name is imported when it is first used.

# The machine
from .manipulator import Manipulator, load
from .machine.parameters import (
    PAPER,
    SOLIDS,
    Actuators,
    Bodies,
    Body,
    Dimensions,
    Friction,
    Geometry,
    Limits,
    Parameters,
    of_solids,
    read_parameters,
    write_parameters,
)

from .machine.description import Mechanism

# What it does, and what acts on it
from .machine.motion import Curve, Motion, SmoothingFit, WrenchHistory, paper_motion
from .design.tasks import AxisLimits, FastestPlan, LimitUse, Plan, Task, Waypoint, read_task, write_task
from .design.assessment import Assessment, RatingUse, assess
from .design.balance import BestBalance, best_balance
from .design.best_path import BestPath, best_path
from .design.design_comparison import DesignComparison, DesignMeasure, compare_designs
from .design.forces_of_tasks import TaskForces, forces_of_task
from .design.fastest import fastest_plan
from .design.task_loads import reactions_of_task
from .design.sizing import size_drives

# Where it is
from .closed_form.kinematics import BodyMotion, InverseKinematics, MechanismMotion, Singularity
from .analysis.indices import Indices
from .analysis.workspace import Aspects, Box, PoseMargins, Workspace, WorkspaceMargins

# What is found
from .methods.comparison import Comparison, Opinion
from .methods import Exceedance, InverseDynamics, JointStates, Utilisation
from .analysis.energy import DriveLoads, Energy
from .analysis.load_friction import LoadFriction, LoadFrictionEffect, read_load_friction
from .analysis.reactions import (
    JointLoad,
    OpenPeak,
    Peak,
    Reactions,
    ReactionsComparison,
    Stiffness,
    read_stiffness,
)
from .methods.compiled import ForceDerivatives
from .methods.regressor import ForceRegressor

# Runs in time
from .runs import (
    PD,
    ComputedTorque,
    ControlLoop,
    Encoders,
    Feedforward,
    InitialState,
    Integration,
    Measurement,
    Noise,
    Simulation,
    Springs,
    Stop,
)

# Speed
from .closed_form.compiled import BoundInverseDynamics, MachineKernels

# Many designs at once
from .analysis.designs import DesignForces, DesignEvaluation, Designs, DesignStatus, forces_of_designs

# Better machines
from .design.optimisation import DesignProblem, Front, Optimum

# Many runs at once
from .runs.many import ManyRuns, RunHistories, simulate_many

# Machines that are not what their drawings say
from .analysis.tolerances import (
    ForceTolerance,
    LocalSensitivity,
    PoseTolerance,
    SobolIndices,
    sensitivity,
    tolerance,
)

# Sweeps of any size
from ._base.blocks import Histogram, Moments, ParetoArchive, Sweep, TopK, sweep

# Any robot with closed loops
from .loops import ClosedLoopModel, Closure, Coupling, FrameTarget, JointData, Sidecar, load_robot
from .viewer import robot_page, show_robot

# Errors
from ._base.errors import (
    AssemblyError,
    ControllerError,
    DriveError,
    DynamicsError,
    FileError,
    InputError,
    MissingExtraError,
    ModelError,
    ModelWarning,
    MotionError,
    OptimisationError,
    P3dofError,
    ParameterError,
    ReachError,
    SampleError,
    SingularityError,
    SweepError,
    TaskError,
)

# Doors, whose rooms are used by their own name: p3dof.viewer.save_video, p3dof.methods.engines.load, ...
from ._base import blocks
from . import analysis, closed_form, codegen, design, loops, machine, methods, report, runs, viewer

# The version
from ._base.version import __version__

__all__ = [
    "PAPER",
    "PD",
    "SOLIDS",
    "Actuators",
    "Aspects",
    "AssemblyError",
    "Assessment",
    "AxisLimits",
    "BestBalance",
    "BestPath",
    "Bodies",
    "Body",
    "BodyMotion",
    "BoundInverseDynamics",
    "Box",
    "ClosedLoopModel",
    "Closure",
    "Comparison",
    "ComputedTorque",
    "ControlLoop",
    "ControllerError",
    "Coupling",
    "Curve",
    "DesignComparison",
    "DesignEvaluation",
    "DesignForces",
    "DesignMeasure",
    "DesignProblem",
    "DesignStatus",
    "Designs",
    "Dimensions",
    "DriveError",
    "DriveLoads",
    "DynamicsError",
    "Encoders",
    "Energy",
    "Exceedance",
    "FastestPlan",
    "Feedforward",
    "FileError",
    "ForceDerivatives",
    "ForceRegressor",
    "ForceTolerance",
    "FrameTarget",
    "Friction",
    "Front",
    "Geometry",
    "Histogram",
    "Indices",
    "InitialState",
    "InputError",
    "Integration",
    "InverseDynamics",
    "InverseKinematics",
    "JointData",
    "JointLoad",
    "JointStates",
    "LimitUse",
    "Limits",
    "LoadFriction",
    "LoadFrictionEffect",
    "LocalSensitivity",
    "MachineKernels",
    "Manipulator",
    "ManyRuns",
    "Measurement",
    "Mechanism",
    "MechanismMotion",
    "MissingExtraError",
    "ModelError",
    "ModelWarning",
    "Moments",
    "Motion",
    "MotionError",
    "Noise",
    "OpenPeak",
    "Opinion",
    "OptimisationError",
    "Optimum",
    "P3dofError",
    "ParameterError",
    "Parameters",
    "ParetoArchive",
    "Peak",
    "Plan",
    "PoseMargins",
    "PoseTolerance",
    "RatingUse",
    "ReachError",
    "Reactions",
    "ReactionsComparison",
    "RunHistories",
    "SampleError",
    "Sidecar",
    "Simulation",
    "Singularity",
    "SingularityError",
    "SmoothingFit",
    "SobolIndices",
    "Springs",
    "Stiffness",
    "Stop",
    "Sweep",
    "SweepError",
    "Task",
    "TaskError",
    "TaskForces",
    "TopK",
    "Utilisation",
    "Waypoint",
    "Workspace",
    "WorkspaceMargins",
    "WrenchHistory",
    "__version__",
    "analysis",
    "assess",
    "best_balance",
    "best_path",
    "blocks",
    "closed_form",
    "codegen",
    "compare_designs",
    "design",
    "fastest_plan",
    "forces_of_designs",
    "forces_of_task",
    "load",
    "load_robot",
    "loops",
    "machine",
    "methods",
    "of_solids",
    "paper_motion",
    "reactions_of_task",
    "read_load_friction",
    "read_parameters",
    "read_stiffness",
    "read_task",
    "report",
    "robot_page",
    "runs",
    "sensitivity",
    "show_robot",
    "simulate_many",
    "size_drives",
    "sweep",
    "tolerance",
    "viewer",
    "write_parameters",
    "write_task",
]
