# What `p3dof.design` offers; each name is imported when it is first used.

# Rooms
from . import (
    assessment,
    balance,
    bearings,
    design_comparison,
    drives,
    fastest,
    forces_of_tasks,
    optimisation,
    sizing,
    sweeps,
    tasks,
)

# Names
from .tasks import AxisLimits, FastestPlan, LimitUse, Plan
from .assessment import Assessment, RatingUse
from .balance import BestBalance, best_balance
from .fastest import BestPath, best_path
from .design_comparison import DesignComparison, DesignMeasure
from .forces_of_tasks import TaskForces, forces_of_task, reactions_of_task
from .fastest import fastest_plan
from .optimisation import DesignProblem, Front, Optimum

__all__ = [
    "Assessment",
    "AxisLimits",
    "BestBalance",
    "BestPath",
    "DesignComparison",
    "DesignMeasure",
    "DesignProblem",
    "FastestPlan",
    "Front",
    "LimitUse",
    "Optimum",
    "Plan",
    "RatingUse",
    "TaskForces",
    "assessment",
    "balance",
    "bearings",
    "best_balance",
    "best_path",
    "design_comparison",
    "drives",
    "fastest",
    "fastest_plan",
    "forces_of_task",
    "forces_of_tasks",
    "optimisation",
    "reactions_of_task",
    "sizing",
    "sweeps",
    "tasks",
]
