# What `import p3dof` offers, by topic; each name is imported when it is first used.

# The machine
from .manipulator import Manipulator, load
from .parameters import (
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

from .description import Mechanism

# What it does, and what acts on it
from .motion import Curve, Motion, SmoothingFit, WrenchHistory, paper_motion
from .tasks import AxisLimits, FastestPlan, LimitUse, Plan, Task, Waypoint, read_task, write_task
from .manipulator import (
    Assessment,
    BestBalance,
    BestPath,
    DesignComparison,
    DesignMeasure,
    RatingUse,
    TaskForces,
    assess,
    best_balance,
    best_path,
    compare_designs,
    fastest_plan,
    forces_of_task,
    reactions_of_task,
    size_drives,
)

# Where it is
from .kinematics import BodyMotion, InverseKinematics, MechanismMotion, Singularity
from .indices import Indices
from .workspace import Aspects, Box, PoseMargins, Workspace, WorkspaceMargins

# What is found
from .manipulator import Comparison, Opinion
from .methods import Exceedance, InverseDynamics, JointStates, Utilisation
from .energy import DriveLoads, Energy
from .load_friction import LoadFriction, LoadFrictionEffect, read_load_friction
from .reactions import JointLoad, OpenPeak, Peak, Reactions, ReactionsComparison, Stiffness, read_stiffness
from .methods.compiled import ForceDerivatives
from .methods.regressor import ForceRegressor

# Runs in time
from .simulation import (
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
from .compiled import BoundInverseDynamics, MachineKernels

# Many designs at once
from .designs import DesignForces, DesignEvaluation, Designs, DesignStatus, forces_of_designs

# Better machines
from .optimisation import DesignProblem, Front, Optimum

# Many runs at once
from .many_runs import ManyRuns, RunHistories, simulate_many

# Machines that are not what their drawings say
from .tolerances import ForceTolerance, LocalSensitivity, PoseTolerance, SobolIndices, sensitivity, tolerance

# Sweeps of any size
from .blocks import Histogram, Moments, ParetoArchive, Sweep, TopK, sweep

# Any robot with closed loops
from .closed_loop import ClosedLoopModel, Closure, Coupling, FrameTarget, JointData, Sidecar, load_robot
from .viewer import robot_page, show_robot

# Errors
from .errors import (
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

# Rooms that are used by their own name: p3dof.viewer.save_video, p3dof.engines.load, ...
from . import (
    bearings,
    blocks,
    closed_loop,
    codegen,
    drives,
    engines,
    indices,
    load_friction,
    optimisation,
    page,
    plots,
    reactions,
    report,
    simulation,
    sweeps,
    tasks,
    tolerances,
    viewer,
    workspace,
)

# The version
from .version import __version__

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
    "assess",
    "bearings",
    "best_balance",
    "best_path",
    "blocks",
    "closed_loop",
    "codegen",
    "compare_designs",
    "drives",
    "engines",
    "fastest_plan",
    "forces_of_designs",
    "forces_of_task",
    "indices",
    "load",
    "load_friction",
    "load_robot",
    "of_solids",
    "optimisation",
    "page",
    "paper_motion",
    "plots",
    "reactions",
    "reactions_of_task",
    "read_load_friction",
    "read_parameters",
    "read_stiffness",
    "read_task",
    "report",
    "robot_page",
    "sensitivity",
    "show_robot",
    "simulate_many",
    "simulation",
    "size_drives",
    "sweep",
    "sweeps",
    "tasks",
    "tolerance",
    "tolerances",
    "viewer",
    "workspace",
    "write_parameters",
    "write_task",
]
