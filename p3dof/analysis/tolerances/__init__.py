"""Machines are never what their drawings say: tolerances of forces and poses, and sensitivity.

- `directions`: what may vary about a machine, and what moves with it.
- `forces`: forces to first order; `pose`: closures of machines whose legs differ, of which
  `identifiability` says what a calibration can find; `estimation`: inertial parameters from measured forces
  and the design; `draws`: machines drawn at
  random, in blocks; `tolerance`: all of it; `results`, `tables`.
- `sobol`: Sobol' indices of anything; `sensitivity`: of figures of forces, and their exact derivatives.
- `files`: what is uncertain, in a file; `tables`: of all results.
"""

from p3dof.analysis.tolerances.draws import DrawnForces, DrawnPoses
from p3dof.analysis.tolerances.estimation import ParameterEstimate, estimate_parameters, prior_deviations
from p3dof.analysis.tolerances.files import Uncertainty, read_uncertainty
from p3dof.analysis.tolerances.identifiability import Identifiability, identifiability
from p3dof.analysis.tolerances.results import ForceTolerance, PoseTolerance
from p3dof.analysis.tolerances.sensitivity import LocalSensitivity, sensitivity
from p3dof.analysis.tolerances.sobol import MatchedSamples, SobolIndices, sobol_indices
from p3dof.analysis.tolerances.tables import sensitivity_table, tolerance_tables
from p3dof.analysis.tolerances.tolerance import tolerance

__all__ = [
    "DrawnForces",
    "DrawnPoses",
    "ForceTolerance",
    "Identifiability",
    "LocalSensitivity",
    "MatchedSamples",
    "ParameterEstimate",
    "PoseTolerance",
    "SobolIndices",
    "Uncertainty",
    "estimate_parameters",
    "identifiability",
    "prior_deviations",
    "read_uncertainty",
    "sensitivity",
    "sensitivity_table",
    "sobol_indices",
    "tolerance",
    "tolerance_tables",
]
