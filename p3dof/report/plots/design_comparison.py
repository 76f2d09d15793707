"""The figure of designs side by side: forces and speeds of each axis, laid over each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

from p3dof._base.checks import shown
from p3dof._base.errors import InputError
from p3dof.design.design_comparison import DesignComparison
from p3dof.machine.parameters import LEGS
from p3dof.report.plots.common import new_figure, tidy

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
_LINES = ("-", "--", "-.", ":")


def comparison_figure(found: DesignComparison) -> Figure:
    """Draw the forces and speeds of A, B and C of all designs over time, those of one axis in one panel.

    Parameters
    ----------
    found : DesignComparison
        The designs.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If `found` is something else.
    MissingExtraError
        If matplotlib is not installed.
    """
    if not isinstance(found, DesignComparison):
        raise InputError(f"found: expected a DesignComparison, got {shown(found)}")
    figure = new_figure(figsize=(10.2, 7.4))
    panels = figure.subplots(3, 2, sharex=True)
    for k, one in enumerate(found.assessments):
        style = {"color": _COLOURS[k % len(_COLOURS)], "ls": _LINES[k % len(_LINES)], "lw": 1.3}
        time = one.found.time
        for leg in range(3):
            panels[leg][0].plot(time, one.found.forces[:, leg], label=one.name, **style)
            panels[leg][1].plot(time, one.found.slider_velocities[:, leg], **style)
    longest = max(float(one.found.time[-1]) for one in found.assessments)
    for leg, row in enumerate(panels):
        for axis, what in zip(row, ("force [N]", "speed [m/s]"), strict=True):
            axis.axhline(0, color="0.6", lw=0.5, zorder=0)
            axis.set_ylabel(f"{LEGS[leg]}: {what}")
            tidy(axis)
            axis.set_xlim(0, longest)
    for axis in panels[-1]:
        axis.set_xlabel("time [s]")
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper center", ncols=min(len(labels), 4), frameon=False, fontsize=9)
    return figure
