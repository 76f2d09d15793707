# What `p3dof.machine` offers; each name is imported when it is first used.

# Rooms
from . import description, motion, parameters

# Names
from .parameters import Actuators, Bodies, Body, Dimensions, Friction, Geometry, Limits
from .description import Mechanism
from .motion import Curve, SmoothingFit

__all__ = [
    "Actuators",
    "Bodies",
    "Body",
    "Curve",
    "Dimensions",
    "Friction",
    "Geometry",
    "Limits",
    "Mechanism",
    "SmoothingFit",
    "description",
    "motion",
    "parameters",
]
