# What `p3dof.closed_form` offers; each name is imported when it is first used.

# Rooms
from . import compiled, kinematics, paper

# Names
from .kinematics import BodyMotion, InverseKinematics, MechanismMotion, Singularity
from .compiled import BoundInverseDynamics, MachineKernels

__all__ = [
    "BodyMotion",
    "BoundInverseDynamics",
    "InverseKinematics",
    "MachineKernels",
    "MechanismMotion",
    "Singularity",
    "compiled",
    "kinematics",
    "paper",
]
