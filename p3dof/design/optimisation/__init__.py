"""Which machine would be better: variables, objectives, constraints, and the ways to optima.

- `variables`, `box`: what may change, which poses count; `constraints`, `expressions`: what must be kept.
- `measure`, `measures`: what designs are measured by, with gradients.
- `population`, `statement`, `evaluated`, `settings`: a problem, and what is computed of many designs at once.
- `epigraph`, `starts`, `evolution`, `feasibility`, `minimising`, `journal`: optima by one objective.
- `optimum`, `checking`, `tables`: what was found, and a second look at it.
- `pareto`, `nsga`, `front`: fronts of several objectives.
- `problem`: `DesignProblem`; `problem_file`, `sweeping`: problems in files, and for `p3dof.sweep`.
"""

from p3dof.design.optimisation.constraints import Constraint, relation
from p3dof.design.optimisation.epigraph import Local
from p3dof.design.optimisation.evaluated import Evaluated
from p3dof.design.optimisation.feasibility import Conflict
from p3dof.design.optimisation.measures import MEASURES
from p3dof.design.optimisation.optimum import Check, Combination, Optimum
from p3dof.design.optimisation.pareto import Front, front_tables, optimum_tables
from p3dof.design.optimisation.population import Box, FunctionMeasure, Measure, Pieces
from p3dof.design.optimisation.problem import DesignProblem, ProblemSweep, read_problem
from p3dof.design.optimisation.robust import Robust
from p3dof.design.optimisation.statement import Statement
from p3dof.design.optimisation.task_measures import Discrete, Duty

__all__ = [
    "MEASURES",
    "Box",
    "Check",
    "Combination",
    "Conflict",
    "Constraint",
    "DesignProblem",
    "Discrete",
    "Duty",
    "Evaluated",
    "Front",
    "FunctionMeasure",
    "Local",
    "Measure",
    "Optimum",
    "Pieces",
    "ProblemSweep",
    "Robust",
    "Statement",
    "front_tables",
    "optimum_tables",
    "read_problem",
    "relation",
]
