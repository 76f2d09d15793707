# What `p3dof.analysis` offers; each name is imported when it is first used.

# Rooms
from . import designs, energy, indices, load_friction, reactions, sampling, tolerances, workspace

# Names
from .workspace import Aspects, Box, PoseMargins, WorkspaceMargins
from .energy import DriveLoads
from .load_friction import LoadFriction, LoadFrictionEffect, read_load_friction
from .reactions import JointLoad, OpenPeak, Peak, ReactionsComparison, Stiffness, read_stiffness
from .designs import DesignEvaluation, DesignForces, DesignStatus, Designs, forces_of_designs
from .identification import MachineForces
from .tolerances import ForceTolerance, LocalSensitivity, PoseTolerance, SobolIndices

__all__ = [
    "Aspects",
    "Box",
    "DesignEvaluation",
    "DesignForces",
    "DesignStatus",
    "Designs",
    "DriveLoads",
    "ForceTolerance",
    "JointLoad",
    "LoadFriction",
    "LoadFrictionEffect",
    "LocalSensitivity",
    "MachineForces",
    "OpenPeak",
    "Peak",
    "PoseMargins",
    "PoseTolerance",
    "ReactionsComparison",
    "SobolIndices",
    "Stiffness",
    "WorkspaceMargins",
    "designs",
    "energy",
    "forces_of_designs",
    "indices",
    "load_friction",
    "reactions",
    "read_load_friction",
    "read_stiffness",
    "sampling",
    "tolerances",
    "workspace",
]
