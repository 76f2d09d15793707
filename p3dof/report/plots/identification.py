"""Figures of an identification: predicted and measured forces, and residuals over what may explain them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from p3dof._base.checks import require
from p3dof.loops.identification.identifying import Identification
from p3dof.loops.identification.validation import Validation
from p3dof.report.plots.common import COLOURS, new_figure, tidy

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DESIGN, _FOUND = "0.6", COLOURS[0]
_MOST = 3000  # points of a panel


class _Shown:
    """What is drawn: held-out data where there are any, else those that were identified from."""

    def __init__(self, found: Identification | Validation) -> None:
        if isinstance(found, Validation):
            identification, self.data = found.identification, found.data
            self.residuals, self.design = found.residuals, found.design_residuals
        else:
            require("found", found, Identification)
            identification, self.data = found, found.data
            measured = self.data.forces - self.data.rows.known
            self.design = measured - self.data.rows.columns @ found.forces.design
            self.residuals = measured - self.data.rows.columns @ found.parameters - found.offsets
        self.forces = identification.forces
        self.some = np.unique(np.linspace(0, len(self.data) - 1, min(len(self.data), _MOST)).astype(int))


def residuals_figure(found: Identification | Validation) -> Figure:
    """Draw residuals over time, position and velocity, a row for each actuator.

    Of the identified robot in colour, of the design in grey. A slope or a step over the velocity is friction
    that the model lacks, a wave over the position an eccentric or a cogging torque, a trend over time warmth.

    Parameters
    ----------
    found : Identification or Validation
        What was found; residuals of held-out data where there are any.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    InputError, MissingExtraError
        If `found` is something else; if matplotlib is not installed.
    """
    shown = _Shown(found)
    m, states, some = len(shown.forces.actuators), shown.data.states, shown.some
    figure = new_figure(figsize=(11.0, 2.3 * m + 0.6))
    axes = figure.subplots(m, 3, squeeze=False, sharey="row")
    size = 2.0 if len(some) > 600 else 4.0
    for i, (row, name) in enumerate(zip(axes, shown.forces.actuators, strict=True)):
        unit, force = shown.forces.position_units[i], shown.forces.force_units[i]
        over = (
            (shown.data.time, "time [s]"),
            (states.positions[:, i], f"position [{unit}]"),
            (states.velocities[:, i], f"velocity [{unit}/s]"),
        )
        for axis, (x, label) in zip(row, over, strict=True):
            axis.plot(x[some], shown.design[some, i], ".", ms=size, color=_DESIGN, label="design")
            axis.plot(x[some], shown.residuals[some, i], ".", ms=size, color=_FOUND, label="identified")
            axis.axhline(0.0, color="0.3", lw=0.6)
            tidy(axis)
            axis.set_xlabel(label if i == m - 1 or unit != shown.forces.position_units[-1] else "")
        row[0].set_ylabel(f"{name}\n[{force}]")
    axes[0, 0].legend(loc="upper right", markerscale=2, frameon=True, fontsize="small")
    return figure


def predicted_figure(found: Identification | Validation) -> Figure:
    """Draw measured forces over time, and those that design and identified robot predict.

    Parameters
    ----------
    found : Identification or Validation
        What was found; held-out data where there are any.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    InputError, MissingExtraError
        If `found` is something else; if matplotlib is not installed.
    """
    shown = _Shown(found)
    m, time, measured = len(shown.forces.actuators), shown.data.time, shown.data.forces
    figure = new_figure(figsize=(11.0, 1.9 * m + 0.6))
    axes = figure.subplots(m, 1, squeeze=False, sharex=True)[:, 0]
    for i, (axis, name) in enumerate(zip(axes, shown.forces.actuators, strict=True)):
        axis.plot(time, measured[:, i], color="0.1", lw=2.2, label="measured")
        axis.plot(time, (measured - shown.design)[:, i], color="#d55e00", lw=1.1, ls="--", label="design")
        axis.plot(time, (measured - shown.residuals)[:, i], color="#56b4e9", lw=1.1, label="identified")
        axis.set_ylabel(f"{name}\n[{shown.forces.force_units[i]}]")
        tidy(axis)
    axes[-1].set_xlabel("time [s]")
    axes[0].legend(loc="upper right", ncols=3, fontsize="small")
    return figure
