"""The figure of a task: its path, and pose, slider speeds, forces and perhaps jerk over time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from p3dof._base.checks import FloatArray, require, shown
from p3dof._base.errors import InputError
from p3dof._base.tables import percent
from p3dof.design.assessment import Assessment
from p3dof.design.balance import BestBalance
from p3dof.design.clearance import Clearance, CollisionModel
from p3dof.design.drives import Cycle, Sizing, SupplyLoads
from p3dof.design.drives.sizing import RPM
from p3dof.design.forces_of_tasks import TaskForces
from p3dof.design.tasks import FastestPlan
from p3dof.machine.parameters import LEGS
from p3dof.report.plots.common import COLOURS, Place, above, new_figure, tidy
from p3dof.report.plots.mechanism import FRONT, SIDE, TOP, hull

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_CARRYING, _MOST_NAMES = "#e8d9a8", 12
_TICKS = 25  # marks of the platform's rotation along the path


def task_figure(found: TaskForces, *, ax: Place = None) -> Figure:
    """Draw the path of a task with its waypoints, and pose, slider speeds and forces over time.

    The fastest plan within a jerk has a panel with that of the sliders. What is shaded is the time in which
    the platform carries something; dotted lines are the waypoints.

    `ax`: where to draw in a figure of the caller's, as of `forces_figure`.
    """
    if not isinstance(found, TaskForces):
        raise InputError(f"found: expected TaskForces, got {shown(found)}")
    plan = found.plan
    jerk = plan.limits.jerk if isinstance(plan, FastestPlan) else np.full(3, np.inf)
    with_jerk = bool(np.isfinite(jerk).any())
    figure = new_figure(figsize=(9.6, 11.6 if with_jerk else 9.6), ax=ax)
    above, *panels = figure.subplots(4 + with_jerk, 1, height_ratios=(1.5, *[1] * (3 + with_jerk)))
    _draw_path(above, found)
    _draw_pose(panels[0], found)
    _draw_legs(panels[1], found.time, found.slider_velocities, "slider speed [m/s]")
    _draw_legs(panels[2], found.time, found.forces, "force [N]")
    if with_jerk:
        _draw_jerk(panels[3], found, jerk)
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


def _draw_jerk(axis: Axes, found: TaskForces, limits: FloatArray) -> None:
    """Draw the jerk of the sliders from sample to sample, and its limits."""
    step = np.diff(found.time)
    kept = step > 1e-9 * found.plan.duration
    jerk = np.diff(found.slider_accelerations, axis=0)[kept] / step[kept, None]
    middle = ((found.time[1:] + found.time[:-1]) / 2)[kept]
    _draw_legs(axis, middle, jerk, "slider jerk [m/s³]")
    for limit in np.unique(limits[np.isfinite(limits)]):
        for side in (-limit, limit):
            axis.axhline(side, color="0.4", lw=0.8, ls="--", zorder=0)


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


_POINTS = 401
_CONTINUOUS, _PEAK = "0.80", "0.92"


def drives_figure(sizing: Sizing, cycle: Cycle, *, ax: Place = None) -> Figure:
    """Draw the torque of each motor over its speed, with its continuous and peak torque curves.

    The cycle is a closed curve; its root mean square is a dot, which must lie within the darker field. The
    curve must lie within the lighter one. With a supply, the bus voltage over the cycle stands beside them.

    `ax`: where to draw in a figure of the caller's, as of `forces_figure`.
    """
    for name, value, kind in (("sizing", sizing, Sizing), ("cycle", cycle, Cycle)):
        if not isinstance(value, kind):
            raise InputError(f"{name}: expected a {kind.__name__}, got {shown(value)}")
    loads = sizing.supply
    columns = 3 if loads is None else 4
    figure = new_figure(figsize=(3.5 * columns, 4.2), ax=ax)
    axes = [figure.add_subplot(1, columns, 1)]
    axes += [figure.add_subplot(1, columns, k, sharey=axes[0]) for k in (2, 3)]
    for leg, axis in enumerate(axes):
        axis.tick_params(labelleft=leg == 0)
        _draw(axis, sizing, cycle, leg)
        tidy(axis)
        axis.set_title(f"{LEGS[leg]}: {sizing.drives[leg].name}", fontsize=9)
        axis.set_xlabel("motor speed [rpm]")
    axes[0].set_ylabel("motor torque [N m]")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc=above(figure), ncols=5, frameon=False, fontsize=9)
    if loads is not None:
        _draw_buses(figure.add_subplot(1, columns, columns), loads)
    return figure


def _draw_buses(axis: Axes, loads: SupplyLoads) -> None:
    """Draw the voltage of each bus over the cycle, and the largest."""
    for k, bus in enumerate(loads.buses):
        axis.plot(bus.time, bus.voltage, color=COLOURS[k] if len(loads.buses) > 1 else "0.2", label=bus.name)
    axis.axhline(loads.supply.max_voltage, color="#b3261e", lw=1.2, label="largest")
    tidy(axis)
    axis.set_xlabel("time [s]")
    axis.set_ylabel("bus voltage [V]")
    axis.legend(loc="best", frameon=False, fontsize=9)


def _draw(axis: Axes, sizing: Sizing, cycle: Cycle, leg: int) -> None:
    """Draw the curves of a motor and the cycle of its axis."""
    drive, loads = sizing.drives[leg], sizing.axes[leg]
    speed = np.asarray(np.linspace(-drive.motor.max_speed, drive.motor.max_speed, _POINTS), dtype=np.float64)
    for curve, shade, label in (
        (drive.motor.peak(speed), _PEAK, "for a moment"),
        (drive.motor.continuous(speed, loads.heat_share), _CONTINUOUS, "for ever"),
    ):
        axis.fill_between(RPM * speed, -curve, curve, color=shade, lw=0, label=label)
    torque = drive.torque(cycle.force[:, leg], cycle.speed[:, leg], cycle.acceleration[:, leg])
    turning = RPM * drive.ratio * cycle.speed[:, leg]
    axis.plot(turning, torque, color=COLOURS[leg], lw=1.2, label="the cycle" if leg == 0 else None)
    axis.plot(
        [RPM * loads.rms_speed], [loads.rms_torque], "o", color="black", ms=5, label="its root mean square"
    )
    keeps = {rating.name: 1 - rating.margin for rating in loads.ratings}
    if keeps.get("peak torque", 1.0) < 1 or keeps["speed"] < 1:
        within = speed[np.abs(speed) <= keeps["speed"] * drive.motor.max_speed]
        most = keeps.get("peak torque", 1.0) * drive.motor.peak(within)
        edge = np.concatenate([most, -most[::-1], most[:1]])
        around = RPM * np.concatenate([within, within[::-1], within[:1]])
        axis.plot(around, edge, color="0.35", lw=0.8, ls=":", label="with margins")
    axis.axhline(0, color="0.6", lw=0.6)
    axis.axvline(0, color="0.6", lw=0.6)


def balance_figure(found: BestBalance, *, ax: Place = None) -> Figure:
    """Draw the actuator forces without and with a counterbalance, and their root mean squares.

    `ax`: where to draw in a figure of the caller's, as of `forces_figure`.
    """
    require("found", found, BestBalance)
    figure = new_figure(figsize=(8.4, 7.2), ax=ax)
    panels = figure.subplots(3, 1, sharex=True)
    for k, (axis, leg) in enumerate(zip(panels, LEGS, strict=True)):
        curves = (
            ("without", "0.55", "--", found.before[:, k], found.rms_before[k]),
            ("with", COLOURS[k], "-", found.after[:, k], found.rms_after[k]),
        )
        for label, colour, style, values, rms in curves:
            text = f"{label}: RMS {rms:.4g} N, peak {abs(values).max():.4g} N"
            axis.plot(found.time, values, color=colour, ls=style, lw=1.5, label=text)
        axis.axhline(0, color="0.6", lw=0.6, zorder=0)
        chosen = ", ".join(f"{name} {row[k]:.4g} {unit}" for name, unit, row in found.named_values)
        axis.set_title(f"{leg}: {chosen}", fontsize=10, loc="left")
        axis.set_ylabel("force [N]")
        axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=9)
        tidy(axis)
    panels[-1].set_xlabel("time [s]")
    return figure


_MOST, _MOST_ROWS = 10, 14
_LIMIT = "#b3261e"
_WIDEST = 1.5  # bars of larger shares end here, and tell their share
_BAR = 0.26
_CLOSE = 0.93  # labels of bars that end so near to a limit of 1 stand behind its line


def utilisation_figure(found: Assessment, *, ax: Place = None) -> Figure:
    """Draw how much of each rating the axes use, the largest first.

    `ax`: where to draw in a figure of the caller's, as of `forces_figure`.
    """
    _require(found)
    shares: dict[str, list[float]] = {}
    limits: dict[str, float] = {}
    for one in found.ratings:
        if one.part in LEGS:
            name = f"{one.name} ({one.kind})" if one.kind in ("machine", "task") else one.name
            shares.setdefault(name, [math.nan] * 3)[LEGS.index(one.part)] = one.share
            limits[name] = 1 - one.margin
        elif f"{one.name} ({one.kind})" not in shares:
            shares[f"{one.name} ({one.kind})"] = [one.share]
    names = list(shares)[:_MOST]
    figure = new_figure(figsize=(9.6, 0.9 + 0.32 * len(names)), ax=ax)
    axis = figure.subplots()
    for row, name in enumerate(names):
        for k, share in enumerate(shares[name]):
            place = row + (k - (len(shares[name]) - 1) / 2) * _BAR
            colour = COLOURS[k] if len(shares[name]) > 1 else "0.45"
            axis.barh(place, min(share, _WIDEST), height=_BAR * 0.9, color=colour)
        if limits.get(name, 1.0) < 1:
            ends = row - 1.7 * _BAR, row + 1.7 * _BAR
            axis.plot([limits[name]] * 2, ends, color=_LIMIT, lw=1.4, ls=":")
        most = float(np.nanmax(shares[name]))
        end = next((line for line in (limits.get(name, 1.0), 1.0) if 0 <= line - most < 1 - _CLOSE), most)
        axis.annotate(
            percent(most, 0),
            (min(end, _WIDEST), row),  # beside the lines of limits, not on them
            xytext=(5, 0),
            textcoords="offset points",
            va="center",
            fontsize=9,
        )
    axis.axvline(1.0, color=_LIMIT, lw=1.4)
    tidy(axis)
    top = max((min(one.share, _WIDEST) for one in found.ratings), default=1.0)
    axis.set_xlim(0, max(1.08, top + 0.12))
    axis.set_yticks(range(len(names)), names)
    axis.set_ylim(len(names) - 0.4, -0.6)
    axis.grid(visible=False, axis="y")
    axis.xaxis.set_major_formatter(lambda value, _: f"{value:.0%}")
    axis.set_xlabel("utilisation; the line is the rated value, dots are the limit with its margin")
    for k, leg in enumerate(LEGS):
        axis.barh(np.nan, np.nan, color=COLOURS[k], label=leg)
    axis.legend(loc="lower right", frameon=False, fontsize=9)
    return figure


def axis_forces_figure(found: Assessment, *, ax: Place = None) -> Figure:
    """Draw the forces at the nuts and those of the motors over the cycle, axis by axis.

    `ax`: where to draw in a figure of the caller's, as of `forces_figure`.
    """
    _require(found)
    figure = new_figure(figsize=(9.6, 6.6), ax=ax)
    panels = figure.subplots(3, 1, sharex=True)
    time, nut, motor = found.found.time, found.found.forces, found.motor_forces
    for leg, axis in enumerate(panels):
        axis.plot(time, nut[:, leg], color=COLOURS[leg], lw=1.4, label="at the nut")
        if found.drives is not None:
            axis.plot(time, motor[:, leg], color="0.2", lw=1.0, ls="--", label="of the motor")
        axis.axhline(0, color="0.6", lw=0.5, zorder=0)
        axis.set_ylabel(f"{LEGS[leg]}: force [N]")
        _mark_verdict(axis, found, named=leg == 0)
        tidy(axis)
        axis.set_xlim(float(time[0]), float(time[-1]))
        axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=9)
    panels[-1].set_xlabel("time [s]")
    return figure


def _mark_verdict(axis: Axes, found: Assessment, named: bool) -> None:
    """Mark the waypoints, perhaps with their names above the panel."""
    if not isinstance(found.found, TaskForces):
        return
    plan = found.found.plan
    few = len(plan.waypoints) <= _MOST_ROWS
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


_NEAREST = 6  # pairs of parts that have a line
_SHADES = ("#d55e00", "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
_SEEN = {FRONT: ("y0", "z0"), SIDE: ("x0", "z0"), TOP: ("y0", "-x0")}


def clearance_figure(found: Clearance, *, ax: Place = None) -> Figure:
    """Draw the least distances of the nearest parts over time, and the machine where two are nearest.

    Over a workspace the distances are bars. The machine is seen along the axis across which the distance
    shows best; the two parts that are nearest are coloured, and a line joins their nearest points.

    Parameters
    ----------
    found : Clearance
        Of `p3dof.design.clearance_of` or `clearance_over`.
    ax : Axes or SubFigure, optional
        Of a figure of the caller's: what is drawn takes this place, and is returned as a SubFigure.

    Raises
    ------
    InputError, MissingExtraError
        If it is something else; if matplotlib is not installed.
    """
    require("found", found, Clearance)
    figure = new_figure(figsize=(10.5, 5.2), ax=ax)
    left, right = figure.subplots(1, 2, width_ratios=(1.25, 1))
    if math.isnan(found.least.time):
        _draw_bars(left, found)
    else:
        _draw_distances(left, found)
    _draw_nearest(right, found)
    return figure


def _draw_bars(axis: Axes, found: Clearance) -> None:
    nearest = found.approaches[:_NEAREST]
    rows = np.arange(len(nearest))[::-1]
    axis.barh(rows, [1e3 * one.distance for one in nearest], color=_SHADES[: len(nearest)], zorder=2)
    axis.axvline(1e3 * found.required, color="0.2", ls="--", lw=1.0)
    axis.set_xlabel("least distance [mm]")
    tidy(axis)
    axis.set_yticks(rows, [one.names for one in nearest])


def _draw_distances(axis: Axes, found: Clearance) -> None:
    for one, shade in zip(found.approaches[:_NEAREST], _SHADES, strict=False):
        distances = found.distances[:, found.pairs.index(one.parts)]
        axis.plot(found.time, 1e3 * distances, color=shade, lw=1.4, label=one.names)
        axis.plot(one.time, 1e3 * one.distance, "o", color=shade, ms=4)
    axis.axhline(1e3 * found.required, color="0.2", ls="--", lw=1.0)
    axis.set_xlabel("time [s]")
    axis.set_ylabel("distance [mm]")
    axis.legend(loc="best", fontsize=8)
    tidy(axis)


def _draw_nearest(axis: Axes, found: Clearance) -> None:
    """Draw all parts at the pose where two are nearest."""
    one, mm = found.least, 1e3
    view = max(_SEEN, key=lambda each: float(np.linalg.norm(np.diff(each.project(one.points), axis=0))))
    turn = 2 * np.pi * np.arange(24) / 24
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    solids = CollisionModel(found.machine, found.surroundings).solids(one.pose)
    from_behind = sorted(solids, key=lambda s: (s[0] in one.parts, float((s[1] @ view.toward).mean())))
    for name, corners, radius in from_behind:
        outline = hull((view.project(corners)[:, None] + radius * circle).reshape(-1, 2))
        colour = _SHADES[one.parts.index(name)] if name in one.parts else "0.8"
        axis.fill(*(mm * outline.T), facecolor=colour, edgecolor="0.35", lw=0.6, alpha=0.75)
    axis.plot(*(mm * view.project(one.points).T), "-o", color="black", ms=3.5, lw=1.6)
    axis.set_axisbelow(True)
    axis.set_aspect("equal", adjustable="box")
    across, up = _SEEN[view]
    axis.set_xlabel(f"{across} [mm]")
    axis.set_ylabel(f"{up} [mm]")
    when = "" if math.isnan(one.time) else f" at t = {one.time:.4g} s"
    axis.set_title(f"{one.names}: {mm * one.distance:.4g} mm{when}", fontsize=9)
    tidy(axis)
