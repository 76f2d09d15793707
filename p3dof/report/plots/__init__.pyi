# What `p3dof.report.plots` offers; each name is imported when it is first used.

from .tasks import axis_forces_figure, utilisation_figure
from .identification import calibration_figure
from .common import save, save_all
from .designs import comparison_figure, designs_figure, many_runs_figure, sweep_figure
from .identification import excitation_figure
from .forces import energy_figure, forces_figure, joints_figure, reactions_figure, tracking_figure
from .identification import predicted_figure, residuals_figure
from .maps import loci_figure, map_figure, slices_figure
from .mechanism import mechanism_figure
from .designs import front_figure, optimum_figure
from .robot_run import robot_run_figure
from .tasks import balance_figure, clearance_figure, drives_figure, task_figure
from .designs import sensitivity_figure, tolerance_figure

__all__ = [
    "axis_forces_figure",
    "balance_figure",
    "calibration_figure",
    "clearance_figure",
    "comparison_figure",
    "designs_figure",
    "drives_figure",
    "energy_figure",
    "excitation_figure",
    "forces_figure",
    "front_figure",
    "joints_figure",
    "loci_figure",
    "many_runs_figure",
    "map_figure",
    "mechanism_figure",
    "optimum_figure",
    "predicted_figure",
    "reactions_figure",
    "residuals_figure",
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
