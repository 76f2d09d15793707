"""The two ways from the platform's motion to the forces, over samples, with one kind of result."""

import lazy_loader

from p3dof.methods.coulomb import CoulombLimits
from p3dof.methods.crossings import without_crossings
from p3dof.methods.evidence import with_evidence
from p3dof.methods.exceedances import Exceedance, exceedances_of
from p3dof.methods.registry import DEFAULT_METHOD, METHODS, Machine, Method, Methods, check_method
from p3dof.methods.results import InverseDynamics
from p3dof.methods.solution import JointStates, Solution
from p3dof.methods.tables import evidence_table, forces_table, limits_table
from p3dof.methods.utilisation import Utilisation, utilisations
from p3dof.methods.way import DynamicsMethod

__getattr__ = lazy_loader.attach(__name__, ["engines"])[0]

__all__ = [
    "DEFAULT_METHOD",
    "METHODS",
    "CoulombLimits",
    "DynamicsMethod",
    "Exceedance",
    "InverseDynamics",
    "JointStates",
    "Machine",
    "Method",
    "Methods",
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
