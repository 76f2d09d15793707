# What `p3dof.design` offers; each name is imported when it is first used.

# Rooms
from . import (
    assessment,
    balance,
    bearings,
    clearance,
    design_comparison,
    drives,
    fastest,
    forces_of_tasks,
    optimisation,
    sizing,
    sweeps,
    tasks,
    vibration,
)

# Names
from .tasks import AxisLimits, FastestPlan, LimitUse, Plan
from .assessment import Assessment, RatingUse
from .balance import BestBalance, best_balance
from .fastest import BestPath, best_path
from .clearance import (
    Approach,
    Clearance,
    CollisionShape,
    Surroundings,
    clearance_of,
    clearance_over,
    read_surroundings,
)
from .design_comparison import DesignComparison, DesignMeasure
from .forces_of_tasks import TaskForces, forces_of_task, reactions_of_task
from .fastest import drive_limits, fastest_plan
from .optimisation import DesignProblem, Front, Optimum
from .vibration import (
    MotorReferences,
    Shaper,
    motor_references,
    residual_energies,
    residual_vibration,
    shaped,
    shaper,
    shapers_of,
)

__all__ = [
    "Approach",
    "Assessment",
    "AxisLimits",
    "BestBalance",
    "BestPath",
    "Clearance",
    "CollisionShape",
    "DesignComparison",
    "DesignMeasure",
    "DesignProblem",
    "FastestPlan",
    "Front",
    "LimitUse",
    "MotorReferences",
    "Optimum",
    "Plan",
    "RatingUse",
    "Shaper",
    "Surroundings",
    "TaskForces",
    "assessment",
    "balance",
    "bearings",
    "best_balance",
    "best_path",
    "clearance",
    "clearance_of",
    "clearance_over",
    "design_comparison",
    "drive_limits",
    "drives",
    "fastest",
    "fastest_plan",
    "forces_of_task",
    "forces_of_tasks",
    "motor_references",
    "optimisation",
    "reactions_of_task",
    "read_surroundings",
    "residual_energies",
    "residual_vibration",
    "shaped",
    "shaper",
    "shapers_of",
    "sizing",
    "sweeps",
    "tasks",
    "vibration",
]
