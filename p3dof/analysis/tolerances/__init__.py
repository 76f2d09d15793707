"""Machines are never what their drawings say: tolerances of forces and poses, and sensitivity.

- `directions`: what may vary about a machine, and what moves with it.
- `forces`: forces to first order; `pose`: closures of machines whose legs differ, of which
  `calibration` finds lengths of each leg and encoder offsets from measured poses, and where to measure;
  `draws`: machines drawn at random, in blocks; `tolerance`: all of it; `results`, `tables`.
- `sobol`: Sobol' indices of anything; `sensitivity`: of figures of forces, and their exact derivatives.
- `files`: what is uncertain, in a file; `tables`: of all results.
"""

from p3dof.analysis.tolerances.calibration import (
    Identifiability,
    MachineCalibration,
    calibrate_machine,
    identifiability,
    machine_calibration_tables,
    plan_machine,
)
from p3dof.analysis.tolerances.draws import DrawnForces, DrawnPoses
from p3dof.analysis.tolerances.pose import ForceTolerance, PoseTolerance
from p3dof.analysis.tolerances.sensitivity import (
    LocalSensitivity,
    MatchedSamples,
    SobolIndices,
    sensitivity,
    sobol_indices,
)
from p3dof.analysis.tolerances.tolerance import (
    Uncertainty,
    read_uncertainty,
    sensitivity_table,
    tolerance,
    tolerance_tables,
)

__all__ = [
    "DrawnForces",
    "DrawnPoses",
    "ForceTolerance",
    "Identifiability",
    "LocalSensitivity",
    "MachineCalibration",
    "MatchedSamples",
    "PoseTolerance",
    "SobolIndices",
    "Uncertainty",
    "calibrate_machine",
    "identifiability",
    "machine_calibration_tables",
    "plan_machine",
    "read_uncertainty",
    "sensitivity",
    "sensitivity_table",
    "sobol_indices",
    "tolerance",
    "tolerance_tables",
]
