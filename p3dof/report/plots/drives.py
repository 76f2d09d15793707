"""The figure of drives: torque over speed of each motor, within its curves."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from p3dof._base.checks import shown
from p3dof._base.errors import InputError
from p3dof.design.drives import Cycle, Sizing
from p3dof.machine.parameters import LEGS
from p3dof.report.plots.common import COLOURS, new_figure, tidy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_RPM = 30 / math.pi
_POINTS = 401
_CONTINUOUS, _PEAK = "0.80", "0.92"


def drives_figure(sizing: Sizing, cycle: Cycle) -> Figure:
    """Draw the torque of each motor over its speed, with what it can do for ever and for a moment.

    The cycle is a closed curve; its root mean square is a dot, which must lie within the darker field. The
    curve must lie within the lighter one.

    Parameters
    ----------
    sizing : Sizing
        Of three drives.
    cycle : Cycle
        What they were sized for: `p3dof.design.drives.cycle_of`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If an argument is something else.
    MissingExtraError
        If matplotlib is not installed.
    """
    for name, value, kind in (("sizing", sizing, Sizing), ("cycle", cycle, Cycle)):
        if not isinstance(value, kind):
            raise InputError(f"{name}: expected a {kind.__name__}, got {shown(value)}")
    figure = new_figure(figsize=(10.5, 4.2))
    axes = figure.subplots(1, 3, sharey=True)
    for leg, axis in enumerate(axes):
        _draw(axis, sizing, cycle, leg)
        tidy(axis)
        axis.set_title(f"{LEGS[leg]}: {sizing.drives[leg].name}", fontsize=9)
        axis.set_xlabel("motor speed [rpm]")
    axes[0].set_ylabel("motor torque [N m]")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper center", ncols=4, frameon=False, fontsize=9)
    return figure


def _draw(axis: Axes, sizing: Sizing, cycle: Cycle, leg: int) -> None:
    """Draw the curves of a motor and the cycle of its axis."""
    drive, loads = sizing.drives[leg], sizing.axes[leg]
    speed = np.asarray(np.linspace(-drive.motor.max_speed, drive.motor.max_speed, _POINTS), dtype=np.float64)
    for curve, shade, label in (
        (drive.motor.peak(speed), _PEAK, "for a moment"),
        (drive.motor.continuous(speed), _CONTINUOUS, "for ever"),
    ):
        axis.fill_between(_RPM * speed, -curve, curve, color=shade, lw=0, label=label)
    torque = drive.torque(cycle.force[:, leg], cycle.speed[:, leg], cycle.acceleration[:, leg])
    turning = _RPM * drive.ratio * cycle.speed[:, leg]
    axis.plot(turning, torque, color=COLOURS[leg], lw=1.2, label="the cycle" if leg == 0 else None)
    axis.plot(
        [_RPM * loads.rms_speed], [loads.rms_torque], "o", color="black", ms=5, label="its root mean square"
    )
    axis.axhline(0, color="0.6", lw=0.6)
    axis.axvline(0, color="0.6", lw=0.6)
