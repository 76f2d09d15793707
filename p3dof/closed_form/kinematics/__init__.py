"""Closed-form kinematics of the mechanism, batched: sliders, poses, Jacobian, every joint and body.

Neither Pinocchio nor the description is used here: what agrees with them agrees independently.
"""

from p3dof.closed_form.kinematics.bodies import (
    BodyMotion,
    MechanismMotion,
    closure_error,
    mechanism_motion,
    motion_at,
)
from p3dof.closed_form.kinematics.forward import forward_kinematics
from p3dof.closed_form.kinematics.inverse import (
    JOINTS,
    InverseKinematics,
    inverse_jacobian,
    inverse_kinematics,
    jacobian_at,
    joint_coordinates,
    singularity,
)
from p3dof.closed_form.kinematics.validity import Placed, Singularity, holdable, reachable, reachable_poses

__all__ = [
    "JOINTS",
    "BodyMotion",
    "InverseKinematics",
    "MechanismMotion",
    "Placed",
    "Singularity",
    "closure_error",
    "forward_kinematics",
    "holdable",
    "inverse_jacobian",
    "inverse_kinematics",
    "jacobian_at",
    "joint_coordinates",
    "mechanism_motion",
    "motion_at",
    "reachable",
    "reachable_poses",
    "singularity",
]
