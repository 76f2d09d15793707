"""The figures of an assessment: how much of the ratings is used, and forces of nuts and motors over time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from p3dof._base.checks import require
from p3dof._base.tables import percent
from p3dof.design.assessment import Assessment
from p3dof.design.forces_of_tasks import TaskForces
from p3dof.machine.parameters import LEGS
from p3dof.report.plots.common import COLOURS, new_figure, tidy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST, _MOST_NAMES = 10, 14
_WIDEST = 1.5  # bars of larger shares end here, and tell their share
_BAR = 0.26
_CLOSE = 0.93  # labels of bars that end from here to the limit stand behind its line


def utilisation_figure(found: Assessment) -> Figure:
    """Draw how much of each rating the axes use, the largest first."""
    _require(found)
    shares: dict[str, list[float]] = {}
    for one in found.ratings:
        if one.part in LEGS:
            name = f"{one.name} ({one.kind})" if one.kind in ("machine", "task") else one.name
            shares.setdefault(name, [math.nan] * 3)[LEGS.index(one.part)] = one.share
        elif f"{one.name} ({one.kind})" not in shares:
            shares[f"{one.name} ({one.kind})"] = [one.share]
    names = list(shares)[:_MOST]
    figure = new_figure(figsize=(9.6, 0.9 + 0.32 * len(names)))
    axis = figure.subplots()
    for row, name in enumerate(names):
        for k, share in enumerate(shares[name]):
            place = row + (k - (len(shares[name]) - 1) / 2) * _BAR
            colour = COLOURS[k] if len(shares[name]) > 1 else "0.45"
            axis.barh(place, min(share, _WIDEST), height=_BAR * 0.9, color=colour)
        most = float(np.nanmax(shares[name]))
        axis.annotate(
            percent(most, 0),
            (
                1.0 if _CLOSE < most < 1 else min(most, _WIDEST),
                row,
            ),  # beside the line of the limit, not on it
            xytext=(5, 0),
            textcoords="offset points",
            va="center",
            fontsize=9,
        )
    axis.axvline(1.0, color="#b3261e", lw=1.4)
    tidy(axis)
    top = max((min(one.share, _WIDEST) for one in found.ratings), default=1.0)
    axis.set_xlim(0, max(1.08, top + 0.12))
    axis.set_yticks(range(len(names)), names)
    axis.set_ylim(len(names) - 0.4, -0.6)
    axis.grid(visible=False, axis="y")
    axis.xaxis.set_major_formatter(lambda value, _: f"{value:.0%}")
    axis.set_xlabel("utilisation; the line is the limit")
    for k, leg in enumerate(LEGS):
        axis.barh(np.nan, np.nan, color=COLOURS[k], label=leg)
    axis.legend(loc="lower right", frameon=False, fontsize=9)
    return figure


def axis_forces_figure(found: Assessment) -> Figure:
    """Draw the forces at the nuts and those of the motors over the cycle, axis by axis."""
    _require(found)
    figure = new_figure(figsize=(9.6, 6.6))
    panels = figure.subplots(3, 1, sharex=True)
    time, nut, motor = found.found.time, found.found.forces, found.motor_forces
    for leg, axis in enumerate(panels):
        axis.plot(time, nut[:, leg], color=COLOURS[leg], lw=1.4, label="at the nut")
        if found.drives is not None:
            axis.plot(time, motor[:, leg], color="0.2", lw=1.0, ls="--", label="of the motor")
        axis.axhline(0, color="0.6", lw=0.5, zorder=0)
        axis.set_ylabel(f"{LEGS[leg]}: force [N]")
        _mark(axis, found, named=leg == 0)
        tidy(axis)
        axis.set_xlim(float(time[0]), float(time[-1]))
        axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=9)
    panels[-1].set_xlabel("time [s]")
    return figure


def _mark(axis: Axes, found: Assessment, named: bool) -> None:
    """Mark the waypoints, perhaps with their names above the panel."""
    if not isinstance(found.found, TaskForces):
        return
    plan = found.found.plan
    few = len(plan.waypoints) <= _MOST_NAMES
    last, close = -np.inf, 0.05 * plan.duration
    for name, time in zip(plan.waypoints, plan.times, strict=True):
        above = 3 if time - last > close else 12  # names of waypoints that follow soon stand higher
        last = time if above == 3 else -np.inf
        axis.axvline(float(time), color="0.5", lw=0.6, ls=":", zorder=0)
        if named and few:
            axis.annotate(
                name,
                (float(time), 1.0),
                xycoords=("data", "axes fraction"),
                xytext=(0, above),
                textcoords="offset points",
                ha="center",
                fontsize=8,
                color="0.3",
            )


def _require(found: Assessment) -> None:
    require("found", found, Assessment)
