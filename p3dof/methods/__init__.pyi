# What `p3dof.methods` offers; each name is imported when it is first used.

# Rooms
from . import engines

# Names
from .registry import DEFAULT_METHOD, METHODS, Machine, Method, Methods, check_method
from .results import InverseDynamics, evidence_table, forces_table, limits_table, with_evidence
from .solution import CoulombLimits, JointStates, Solution, without_crossings
from .utilisation import Exceedance, Utilisation, exceedances_of, utilisations
from .registry import DynamicsMethod
from .comparison import Opinion
from .compiled import ForceDerivatives
from .regressor import ForceRegressor

__all__ = [
    "DEFAULT_METHOD",
    "METHODS",
    "CoulombLimits",
    "DynamicsMethod",
    "Exceedance",
    "ForceDerivatives",
    "ForceRegressor",
    "InverseDynamics",
    "JointStates",
    "Machine",
    "Method",
    "Methods",
    "Opinion",
    "Solution",
    "Utilisation",
    "check_method",
    "engines",
    "evidence_table",
    "exceedances_of",
    "forces_table",
    "limits_table",
    "utilisations",
    "with_evidence",
    "without_crossings",
]
