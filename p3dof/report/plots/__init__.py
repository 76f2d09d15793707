"""Figures; they need the extra ``plot`` (matplotlib), which is imported when one is drawn."""

from p3dof.report.plots.assessment import axis_forces_figure, utilisation_figure
from p3dof.report.plots.balance import balance_figure
from p3dof.report.plots.common import save, save_all
from p3dof.report.plots.design_comparison import comparison_figure
from p3dof.report.plots.designs import designs_figure
from p3dof.report.plots.drives import drives_figure
from p3dof.report.plots.energy import energy_figure
from p3dof.report.plots.forces import forces_figure
from p3dof.report.plots.joints import joints_figure
from p3dof.report.plots.many_runs import many_runs_figure
from p3dof.report.plots.maps import loci_figure, map_figure, slices_figure
from p3dof.report.plots.mechanism import mechanism_figure
from p3dof.report.plots.optimisation import front_figure, optimum_figure
from p3dof.report.plots.reactions import reactions_figure
from p3dof.report.plots.robot_run import robot_run_figure
from p3dof.report.plots.sweep import sweep_figure
from p3dof.report.plots.tasks import task_figure
from p3dof.report.plots.tolerances import sensitivity_figure, tolerance_figure
from p3dof.report.plots.tracking import tracking_figure

__all__ = [
    "axis_forces_figure",
    "balance_figure",
    "comparison_figure",
    "designs_figure",
    "drives_figure",
    "energy_figure",
    "forces_figure",
    "front_figure",
    "joints_figure",
    "loci_figure",
    "many_runs_figure",
    "map_figure",
    "mechanism_figure",
    "optimum_figure",
    "reactions_figure",
    "robot_run_figure",
    "save",
    "save_all",
    "sensitivity_figure",
    "slices_figure",
    "sweep_figure",
    "task_figure",
    "tolerance_figure",
    "tracking_figure",
    "utilisation_figure",
]
