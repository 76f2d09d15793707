# What `import p3dof` offers, by topic; each name is imported when it is first used.

# The machine
from .manipulator import Manipulator, load
from .parameters import (
    PAPER,
    SOLIDS,
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

# What it does, and what acts on it
from .motion import Motion, WrenchHistory, paper_motion

# What is found
from .manipulator import Comparison
from .methods import InverseDynamics
from .energy import Energy
from .reactions import Reactions, ReactionsComparison
from .methods.compiled import ForceDerivatives
from .methods.regressor import ForceRegressor

# Runs in time
from .simulation import (
    PD,
    ComputedTorque,
    ControlLoop,
    Feedforward,
    InitialState,
    Integration,
    Measurement,
    Noise,
    Simulation,
    Springs,
)

# Speed
from .compiled import MachineKernels

# Any robot with closed loops
from .closed_loop import ClosedLoopModel, FrameTarget, Sidecar

# Errors
from .errors import (
    AssemblyError,
    ControllerError,
    DynamicsError,
    FileError,
    InputError,
    MissingExtraError,
    ModelError,
    ModelWarning,
    MotionError,
    P3dofError,
    ParameterError,
    ReachError,
    SampleError,
    SingularityError,
)

# Rooms that are used by their own name: p3dof.viewer.save_animation, p3dof.engines.load, ...
from . import closed_loop, codegen, engines, plots, report, simulation, viewer

# The version
from .version import __version__

__all__ = [
    "PAPER",
    "PD",
    "SOLIDS",
    "AssemblyError",
    "Bodies",
    "Body",
    "ClosedLoopModel",
    "Comparison",
    "ComputedTorque",
    "ControlLoop",
    "ControllerError",
    "Dimensions",
    "DynamicsError",
    "Energy",
    "Feedforward",
    "FileError",
    "ForceDerivatives",
    "ForceRegressor",
    "FrameTarget",
    "Friction",
    "Geometry",
    "InitialState",
    "InputError",
    "Integration",
    "InverseDynamics",
    "Limits",
    "MachineKernels",
    "Manipulator",
    "Measurement",
    "MissingExtraError",
    "ModelError",
    "ModelWarning",
    "Motion",
    "MotionError",
    "Noise",
    "P3dofError",
    "ParameterError",
    "Parameters",
    "ReachError",
    "Reactions",
    "ReactionsComparison",
    "SampleError",
    "Sidecar",
    "Simulation",
    "SingularityError",
    "Springs",
    "WrenchHistory",
    "__version__",
    "closed_loop",
    "codegen",
    "engines",
    "load",
    "of_solids",
    "paper_motion",
    "plots",
    "read_parameters",
    "report",
    "simulation",
    "viewer",
    "write_parameters",
]
