"""The facade: `Manipulator` puts parameters, description and both dynamics behind a few calls."""

from p3dof.manipulator.assessment import Assessment, RatingUse, assess
from p3dof.manipulator.assessment_tables import assumptions, loads_table, needs_table, uses_table
from p3dof.manipulator.balance import BalanceKind, BestBalance, balance_table, best_balance
from p3dof.manipulator.best_path import BestPath, best_path, best_path_table
from p3dof.manipulator.comparison import Comparison, Opinion
from p3dof.manipulator.design_comparison import (
    DesignComparison,
    DesignMeasure,
    compare_designs,
    comparison_table,
    verdicts_table,
)
from p3dof.manipulator.facade import Manipulator, load
from p3dof.manipulator.fastest import fastest_plan
from p3dof.manipulator.sizing import size_drives
from p3dof.manipulator.tables import agreement_table, opinions_table
from p3dof.manipulator.task_loads import reactions_of_task
from p3dof.manipulator.tasks import TaskForces, forces_of_task
from p3dof.methods import Exceedance, InverseDynamics, JointStates
from p3dof.methods.registry import METHODS, Method

__all__ = [
    "METHODS",
    "Assessment",
    "BalanceKind",
    "BestBalance",
    "BestPath",
    "Comparison",
    "DesignComparison",
    "DesignMeasure",
    "Exceedance",
    "InverseDynamics",
    "JointStates",
    "Manipulator",
    "Method",
    "Opinion",
    "RatingUse",
    "TaskForces",
    "agreement_table",
    "assess",
    "assumptions",
    "balance_table",
    "best_balance",
    "best_path",
    "best_path_table",
    "compare_designs",
    "comparison_table",
    "fastest_plan",
    "forces_of_task",
    "load",
    "loads_table",
    "needs_table",
    "opinions_table",
    "reactions_of_task",
    "size_drives",
    "uses_table",
    "verdicts_table",
]
