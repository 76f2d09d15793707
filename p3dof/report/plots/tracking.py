"""The figure of runs that follow a motion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from p3dof._base.errors import InputError
from p3dof.machine.parameters import LEGS
from p3dof.report.plots.common import new_figure, tidy
from p3dof.runs import Simulation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = ("#d55e00", "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
_POSE = ("y [mm]", "z [mm]", "θ [mrad]")
_DEPTH = 1e-3
"""How far a logarithmic axis of errors goes below the least of the peaks; what is below leaves the axis."""


def tracking_figure(runs: Mapping[str, Simulation]) -> Figure:
    """Draw poses, tracking errors and forces of runs that follow the same motion.

    Parameters
    ----------
    runs : mapping of str to Simulation
        The runs by the names of their controllers; up to six.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If there are no runs or more than six, or one had nothing to follow.
    MissingExtraError
        If matplotlib is not installed.
    """
    if not 1 <= len(runs) <= len(_COLOURS):
        raise InputError(f"runs: expected one to {len(_COLOURS)}, got {len(runs)}")
    errors = {name: 1e3 * np.abs(run.error) for name, run in runs.items()}
    figure = new_figure(figsize=(10.5, 7.2))
    axes = figure.subplots(3, 3, sharex=True, height_ratios=(1, 1.2, 1))
    longest = max(runs.values(), key=lambda run: float(run.time[-1]))
    assert longest.reference is not None  # noqa: S101 - or there would be no error
    for k in range(3):
        pose, error, force = axes[:, k]
        pose.plot(longest.time, 1e3 * longest.reference[:, k], color="0.75", lw=4, label="reference")
        for colour, (name, run) in zip(_COLOURS, runs.items(), strict=False):
            pose.plot(run.time, 1e3 * run.pose[:, k], color=colour, lw=1.1, label=name)
            error.semilogy(run.time, errors[name][:, k], color=colour, lw=1.1)
            force.plot(run.time, run.forces[:, k], color=colour, lw=1.1)
            if run.stop is not None:
                pose.plot(run.time[-1], 1e3 * run.pose[-1, k], "x", color=colour)
        peaks = [peak for each in errors.values() if (peak := each[:, k].max()) > 0]
        if peaks:
            error.set_ylim(bottom=_DEPTH * min(peaks))
        pose.set_ylabel(_POSE[k])
        error.set_ylabel(f"error of {_POSE[k]}")
        force.set_ylabel(f"force of {LEGS[k]} [N]")
        force.set_xlabel("time [s]")
    for axis in axes.ravel():
        tidy(axis)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper center", ncols=len(labels), frameon=False, fontsize=9)
    return figure
