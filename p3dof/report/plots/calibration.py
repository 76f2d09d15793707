"""Figures of a calibration: errors of poses before and after, and how much better parameters are known."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError
from p3dof.analysis.tolerances import MachineCalibration
from p3dof.loops import Calibration
from p3dof.report.plots.common import COLOURS, new_figure, tidy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_BARS = 24  # most parameters that are drawn: those that are known worst, compared with their tolerances
_BEFORE, _AFTER = "0.6", COLOURS[0]


def calibration_figure(
    calibration: Calibration | MachineCalibration, held_out: tuple[FloatArray, FloatArray] | None = None
) -> Figure:
    """Draw errors of measured poses before and after, and the parameters' standard deviations.

    Parameters
    ----------
    calibration : Calibration or MachineCalibration
        What `p3dof.loops.calibrate` or `p3dof.analysis.tolerances.calibrate_machine` returns; of several
        kinds of measurements the first is drawn.
    held_out : tuple of two (K, c) arrays, optional
        Errors before and after of poses that were measured and not used.

    Raises
    ------
    InputError, MissingExtraError
        If it is something else; if matplotlib is not installed.
    """
    if isinstance(calibration, MachineCalibration):
        names: tuple[str, ...] = ("y", "z", "θ")
        before, after = calibration.before, calibration.after
    elif isinstance(calibration, Calibration):
        names = calibration.measured[0].components
        before, after = calibration.before[0], calibration.after[0]
    else:
        raise InputError(f"calibration: expected a Calibration, got {shown(calibration)}")
    bars = 0.6 + 0.16 * min(len(calibration.names), MOST_BARS)  # height of their panel [inches]
    figure = new_figure((9.0, 1.5 * len(names) + 1.0 + bars))
    *panels, last = figure.subplots(len(names) + 1, 1, height_ratios=(*[1.2] * len(names), bars))
    for k, (name, panel) in enumerate(zip(names, panels, strict=True)):
        factor, unit = (1e3, "mrad") if name in ("θ", "rx", "ry", "rz") else (1e3, "mm")
        held = None if held_out is None else tuple(factor * part[:, k] for part in held_out)
        _of_component(panel, factor * before[:, k], factor * after[:, k], held, k == 0)
        more = "" if k else ", computed less measured" + ("" if held_out is None else "; shaded: held out")
        panel.set_title(f"{name} [{unit}]{more}", fontsize=9, loc="left")
    panels[-1].set_xlabel("pose")
    _of_parameters(last, calibration)
    return figure


def _of_component(
    panel: Axes, before: FloatArray, after: FloatArray, held: tuple[FloatArray, ...] | None, named: bool
) -> None:
    own = 1 + np.arange(len(before))
    later = len(before) + 1 + np.arange(0 if held is None else len(held[0]))
    first, second = (
        (before, after) if held is None else (np.append(before, held[0]), np.append(after, held[1]))
    )
    poses = np.append(own, later)
    panel.axhline(0.0, color="0.8", lw=0.8, zorder=0)
    panel.vlines(poses, np.minimum(first, 0), np.maximum(first, 0), color=_BEFORE, lw=1.2)
    panel.plot(poses, first, "o", ms=3, color=_BEFORE, label="by the design")
    panel.plot(poses, second, "o", ms=3, color=_AFTER, label="calibrated")
    if held is not None:
        panel.axvspan(len(before) + 0.5, poses[-1] + 0.5, color="0.93", lw=0, zorder=-1)
    if named:
        panel.legend(loc="lower right", bbox_to_anchor=(1, 1), frameon=False, ncols=2, fontsize=8)
    tidy(panel)


def _of_parameters(panel: Axes, found: Calibration | MachineCalibration) -> None:
    known = np.isfinite(found.tolerances)
    with np.errstate(invalid="ignore"):
        left = np.where(known, found.deviations / found.tolerances, np.nan)
    order = np.argsort(np.where(known, -left, -np.inf), kind="stable")[:MOST_BARS]
    panel.barh(np.arange(len(order)), 100 * left[order], color=_AFTER, height=0.65)
    panel.axvline(100, color="0.6", lw=0.8)
    panel.set_xlabel("standard deviation [% of the tolerance]; 100 %: measuring told nothing")
    tidy(panel)
    panel.grid(visible=False)
    panel.set_yticks(np.arange(len(order)), [found.names[i] for i in order], fontsize=8)
    panel.invert_yaxis()
    panel.set_xlim(0, 105)
