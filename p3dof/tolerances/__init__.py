"""Machines are never what their drawings say: tolerances of forces and poses.

- `directions`: what may vary about a machine, and what moves with it.
- `forces`: forces to first order; `pose`: closures of machines whose legs differ; `draws`: machines drawn at
  random, in blocks; `tolerance`: all of it; `results`, `tables`.
"""

from p3dof.tolerances.draws import DrawnForces, DrawnPoses
from p3dof.tolerances.results import ForceTolerance, PoseTolerance
from p3dof.tolerances.tolerance import tolerance

__all__ = ["DrawnForces", "DrawnPoses", "ForceTolerance", "PoseTolerance", "tolerance"]
