"""The figure of a task: its path, and pose, slider speeds and forces over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from p3dof.checks import FloatArray, shown
from p3dof.errors import InputError
from p3dof.manipulator.tasks import TaskForces
from p3dof.parameters import LEGS
from p3dof.plots.common import COLOURS, new_figure, tidy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_CARRYING, _MOST_NAMES = "#e8d9a8", 12
_TICKS = 25
"""Marks of the platform's rotation along the path."""


def task_figure(found: TaskForces) -> Figure:
    """Draw the path of a task with its waypoints, and pose, slider speeds and forces over time.

    What is shaded is the time in which the platform carries something; dotted lines are the waypoints.

    Parameters
    ----------
    found : TaskForces
        The forces over the task.

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
    if not isinstance(found, TaskForces):
        raise InputError(f"found: expected TaskForces, got {shown(found)}")
    figure = new_figure(figsize=(9.6, 9.6))
    above, *panels = figure.subplots(4, 1, height_ratios=(1.5, 1, 1, 1))
    _draw_path(above, found)
    _draw_pose(panels[0], found)
    _draw_legs(panels[1], found.time, found.slider_velocities, "slider speed [m/s]")
    _draw_legs(panels[2], found.time, found.forces, "force [N]")
    for axis in panels:
        _mark(axis, found)
        tidy(axis)
        axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=9)
    panels[-1].set_xlabel("time [s]")
    return figure


def _draw_path(axis: Axes, found: TaskForces) -> None:
    """Draw P in the plane of y and z, with marks along the platform."""
    motion, times = found.plan.motion, found.plan.times
    y, z, theta = motion.pose.T
    mm = 1e3
    span = max(np.ptp(y), np.ptp(z), 1e-3)
    way = np.append(0, np.cumsum(np.hypot(np.diff(y), np.diff(z))))
    marks = np.searchsorted(way, np.linspace(0, way[-1], _TICKS)).clip(max=len(way) - 1)
    along, up = np.cos(theta), -np.sin(theta)
    for k in np.unique(marks):
        ends = 0.05 * span * np.array([-1, 1])
        axis.plot(mm * (y[k] + ends * along[k]), mm * (z[k] + ends * up[k]), color="0.6", lw=1.2, zorder=1)
    axis.plot(mm * y, mm * z, color="0.2", lw=1.6, zorder=2)
    seen: dict[tuple[float, float], list[str]] = {}
    for name, row in zip(found.plan.waypoints, np.searchsorted(motion.time, times), strict=True):
        spot = round(mm * y[row], 3), round(mm * z[row], 3)
        names = seen.setdefault(spot, [])
        if name not in names:
            names.append(name)
    for k, (spot, names) in enumerate(seen.items()):
        axis.plot(*spot, "o", color="0.2", ms=4, zorder=3)
        if k < _MOST_NAMES:
            above = spot[1] >= mm * (z.min() + z.max()) / 2
            axis.annotate(
                ", ".join(names),
                spot,
                xytext=(0, 7 if above else -7),
                textcoords="offset points",
                ha="center",
                va="bottom" if above else "top",
                fontsize=9,
            )
    axis.set_aspect("equal", adjustable="datalim")
    axis.margins(0.18)
    axis.set_xlabel("y [mm]")
    axis.set_ylabel("z [mm]")
    axis.set_title("path of P, and how the platform lies", fontsize=10)
    tidy(axis)


def _draw_pose(axis: Axes, found: TaskForces) -> None:
    motion = found.plan.motion
    columns = ("y [mm]", 1e3), ("z [mm]", 1e3), ("θ [deg]", 180 / np.pi)
    for k, (label, unit) in enumerate(columns):
        axis.plot(motion.time, unit * motion.pose[:, k], color=str(0.15 + 0.25 * k), lw=1.4, label=label)
        axis.lines[-1].set_linestyle(("-", "--", "-.")[k])
    axis.set_ylabel("pose")


def _draw_legs(axis: Axes, time: FloatArray, values: FloatArray, label: str) -> None:
    for leg, name in enumerate(LEGS):
        axis.plot(time, values[:, leg], color=COLOURS[leg], lw=1.2, label=name)
    axis.axhline(0, color="0.6", lw=0.5, zorder=0)
    axis.set_ylabel(label)


def _mark(axis: Axes, found: TaskForces) -> None:
    """Shade where something is carried, and mark the waypoints."""
    told = False
    for piece in found.plan.pieces:
        if piece.payload is not None:
            label = None if told else "carries"
            axis.axvspan(*piece.motion.time[[0, -1]], color=_CARRYING, lw=0, alpha=0.5, zorder=0, label=label)
            told = True
    for time in found.plan.times:
        axis.axvline(time, color="0.5", lw=0.6, ls=":", zorder=0)
    axis.set_xlim(0, found.plan.duration)
