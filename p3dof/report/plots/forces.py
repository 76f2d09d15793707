"""The figure of the actuator forces over a motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from p3dof._base.errors import InputError
from p3dof.machine.parameters import LEGS
from p3dof.methods import InverseDynamics
from p3dof.report.plots.common import COLOURS, GAP, GAP_STYLE, line, new_figure, shade_gaps, tidy

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

_STYLES: tuple[dict[str, Any], ...] = ({"lw": 3.0, "alpha": 0.35}, {"lw": 1.2})
_NAMES = {
    "pinocchio": "Pinocchio (URDF, closures, RNEA)",
    "virtual-power": "virtual power (paper)",
    "compiled": "virtual power, reduced and compiled",
}


def forces_figure(results: Sequence[InverseDynamics]) -> Figure:
    """Draw the three actuator forces over the motion (the paper's Figs. 3-5), and two results' difference.

    Parameters
    ----------
    results : sequence of InverseDynamics
        One result, or two of the same motion by different methods or with different friction; invalid samples
        are hatched gaps.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If there are not one or two results, or two of different motions.
    MissingExtraError
        If matplotlib is not installed.
    """
    if len(results) not in {1, 2}:
        raise InputError(f"results: expected one or two, got {len(results)}")
    if len(results) == 2 and not np.array_equal(results[0].time, results[1].time):
        raise InputError("results: expected two results of the same motion, got different times")
    rows = len(results)
    figure = new_figure(figsize=(10.5, 3.1 if rows == 1 else 4.8))
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    valid = np.all([result.valid for result in results], axis=0)
    axes = figure.subplots(rows, 3, sharex=True, squeeze=False, height_ratios=(3, 1.4)[:rows])
    for leg, name in enumerate(LEGS):
        top = axes[0, leg]
        for result, style in zip(results, _STYLES[-rows:], strict=True):
            line(top, result.time, result.forces[:, leg], result.valid, color=COLOURS[leg], **style)
        top.set_title(f"actuator {name}", fontsize=10, y=1.0)
        top.set_ylabel("force [N]")
        if rows == 2:
            difference = results[0].forces[:, leg] - results[1].forces[:, leg]
            line(axes[1, leg], results[0].time, difference, valid, color=COLOURS[leg], lw=0.7)
            axes[1, leg].axhline(0, color="0.6", lw=0.5, zorder=0)
            axes[1, leg].set_ylabel("difference [N]")
            axes[1, leg].ticklabel_format(axis="y", style="sci", scilimits=(0, 0))
        axes[-1, leg].set_xlabel("time [s]")
    handles: list[Artist] = [Line2D([], [], color="0.3", **style) for style in _STYLES[-rows:]]
    labels = [_label(result) for result in results]
    if not valid.all():
        handles.append(Patch(**GAP_STYLE))
        labels.append(GAP)
    figure.legend(handles, labels, loc="upper center", ncols=3, frameon=False, fontsize=9)
    for axis in axes.ravel():
        shade_gaps(axis, results[0].time, valid)
        tidy(axis)
    return figure


def _label(result: InverseDynamics) -> str:
    """Return how a result is called."""
    name = _NAMES.get(result.method, result.method)
    return name if result.coulomb is None else f"{name}, with friction by load"
