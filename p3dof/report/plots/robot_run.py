"""The figure of a run of any robot: joints, forces, energy, gaps of the loops."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from p3dof._base.checks import require
from p3dof.loops.tables import is_slide
from p3dof.report.plots.common import Place, new_figure, tidy
from p3dof.runs import RobotRun

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f7f7f", "#8c564b")
_MOST = 8  # most joints of a kind that are drawn: no more colours can be told apart
_LEAST = 1e-17  # gaps below are drawn here: a logarithmic axis has no zero [m or rad]
_UNITS = {False: ("rad", "N m"), True: ("m", "N")}


def robot_run_figure(run: RobotRun, *, ax: Place = None) -> Figure:
    """Draw joints and forces of a run of any robot, its energy, and the gaps of its loops.

    Of the actuated joints, or of all hinges and slides of a robot that has none, the first eight of each
    kind. What a controller followed is grey and wide; events are vertical lines.

    Parameters
    ----------
    run : RobotRun
        The run.
    ax : Axes or SubFigure, optional
        Of a figure of the caller's: what is drawn takes this place, and is returned as a SubFigure.

    Returns
    -------
    matplotlib.figure.Figure
        A row of values and forces for hinges, one for slides, where there are such; below them energy and
        gap.

    Raises
    ------
    InputError, MissingExtraError
        If `run` is something else; if matplotlib is not installed.
    """
    require("run", run, RobotRun)
    groups = _groups(run)
    figure = new_figure(figsize=(11.0, 3.0 * (len(groups) + 1)), ax=ax)
    axes = figure.subplots(len(groups) + 1, 2, sharex=True)
    for (values, forces), (slides, names) in zip(axes, groups, strict=False):
        _draw_joints(values, forces, run, slides, names)
    _draw_energy(axes[-1, 0], run)
    _draw_gap(axes[-1, 1], run)
    for axis in axes.ravel():
        for event in run.events:
            axis.axvline(event.time, color="0.6", lw=0.8, ls=(0, (1, 1.5)), zorder=0)
        if run.stop is not None:
            axis.axvline(run.stop.time, color="#d62728", lw=1.0, zorder=0)
        tidy(axis)
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    if run.stop is not None:
        figure.suptitle(f"ended by {run.stop}", fontsize=9, color="#d62728")
    return figure


def _groups(run: RobotRun) -> list[tuple[bool, list[str]]]:
    """Return which joints are drawn: whether they are slides, and their names."""
    model = run.loop.model
    single = [str(model.names[i]) for i in range(1, model.njoints) if model.nvs[i] == 1]
    names = list(run.loop.actuated) or single
    kinds = {name: is_slide(run.loop, model.getJointId(name)) for name in names}
    found = [(slides, [name for name in names if kinds[name] == slides][:_MOST]) for slides in (False, True)]
    return [(slides, some) for slides, some in found if some]


def _draw_joints(values: Axes, forces: Axes, run: RobotRun, slides: bool, names: list[str]) -> None:
    unit, force = _UNITS[slides]
    actuated = list(run.loop.actuated)
    for colour, name in zip(_COLOURS, names, strict=False):
        line = run.values(name)
        if name in actuated:
            at = actuated.index(name)
            if run.error is not None:
                values.plot(run.time, line + run.error[:, at], color="0.75", lw=4)
            forces.plot(run.time, run.forces[:, at], color=colour, lw=1.3)
        values.plot(run.time, line, color=colour, lw=1.3, label=name)
    values.set_ylabel(f"joints [{unit}]")
    if actuated:
        forces.set_ylabel(f"forces [{force}]")
    else:
        forces.set_visible(False)
    beside = values if not actuated else forces
    handles, labels = values.get_legend_handles_labels()
    beside.legend(handles, labels, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=9)


def _draw_energy(axis: Axes, run: RobotRun) -> None:
    found = run.loop.body_energies(run.q, run.v)
    kinetic, potential = found.kinetic.sum(axis=1), found.potential.sum(axis=1)
    lines = {"kinetic": (kinetic, "#e69f00"), "of weight": (potential - potential[0], "#56b4e9")}
    if np.any(found.springs):
        lines["of springs"] = (found.springs, "#009e73")
    lines["all"] = (run.energy - run.energy[0] + kinetic[0] + found.springs.ravel()[0], "0.1")
    for name, (values, colour) in lines.items():
        axis.plot(run.time, values, color=colour, lw=1.3, label=name)
    axis.set_ylabel("energy [J]")
    axis.legend(loc="best", frameon=False, fontsize=9)


def _draw_gap(axis: Axes, run: RobotRun) -> None:
    axis.semilogy(run.time, np.maximum(run.gap, _LEAST), color="#0072b2", lw=1.1)
    axis.set_ylabel("largest gap [m or rad]")
