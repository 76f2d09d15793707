"""The facade: `Manipulator` puts parameters, description and both dynamics behind a few calls."""

from p3dof.manipulator.balance import BalanceKind, BestBalance, balance_table, best_balance
from p3dof.manipulator.comparison import Comparison, Opinion
from p3dof.manipulator.facade import Manipulator, load
from p3dof.manipulator.fastest import fastest_plan
from p3dof.manipulator.sizing import size_drives
from p3dof.manipulator.tables import agreement_table, opinions_table
from p3dof.manipulator.tasks import TaskForces, forces_of_task
from p3dof.methods import Exceedance, InverseDynamics, JointStates
from p3dof.methods.registry import METHODS, Method

__all__ = [
    "METHODS",
    "BalanceKind",
    "BestBalance",
    "Comparison",
    "Exceedance",
    "InverseDynamics",
    "JointStates",
    "Manipulator",
    "Method",
    "Opinion",
    "TaskForces",
    "agreement_table",
    "balance_table",
    "best_balance",
    "fastest_plan",
    "forces_of_task",
    "load",
    "opinions_table",
    "size_drives",
]
