"""The figure of many runs: how errors and forces are distributed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import InputError
from p3dof.machine.parameters import LEGS
from p3dof.report.plots.common import new_figure, tidy
from p3dof.runs.many import ManyRuns

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_AXES = ("y [mm]", "z [mm]", "θ [mrad]")


def many_runs_figure(runs: ManyRuns) -> Figure:
    """Draw how the largest errors and forces of the finished runs are distributed, with their 95 % quantiles.

    Parameters
    ----------
    runs : ManyRuns
        The runs.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If no run was finished.
    MissingExtraError
        If matplotlib is not installed.
    """
    good = runs.finished
    if not good.any():
        raise InputError("runs: expected one that was finished, there is none")
    figure = new_figure(figsize=(10.5, 5.4))
    axes = figure.subplots(2, 3)
    for k, name in enumerate(_AXES):
        _histogram(axes[0, k], 1e3 * runs.peak_error[good, k], f"largest error of {name}")
        _histogram(axes[1, k], runs.peak_force[good, k], f"largest force of {LEGS[k]} [N]")
    axes[0, 0].set_ylabel("runs")
    axes[1, 0].set_ylabel("runs")
    axes[0, 0].legend(loc="upper left", frameon=False, fontsize=8)
    return figure


def _histogram(axis: Any, values: FloatArray, label: str) -> None:
    from matplotlib.ticker import MaxNLocator

    finite = values[np.isfinite(values)]
    axis.hist(finite, bins=40, color="#0072b2")
    if len(finite):
        axis.axvline(np.quantile(finite, 0.95), color="#d55e00", lw=1.2, label="95 % below")
    axis.set_xlabel(label)
    axis.yaxis.set_major_locator(MaxNLocator(integer=True))
    axis.set_axisbelow(True)
    tidy(axis)
