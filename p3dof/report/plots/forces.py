"""The figure of the actuator forces over a motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from p3dof._base.checks import FloatArray, require, shown
from p3dof._base.errors import InputError
from p3dof.analysis.energy import Energy
from p3dof.analysis.reactions import JOINTS, AnyReactions
from p3dof.machine.parameters import LEGS
from p3dof.methods import InverseDynamics
from p3dof.report.plots.common import (
    COLOURS,
    GAP,
    GAP_STYLE,
    Place,
    above,
    few_ticks,
    line,
    new_figure,
    shade_gaps,
    tidy,
)
from p3dof.runs import Simulation

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STYLES: tuple[dict[str, Any], ...] = ({"lw": 3.0, "alpha": 0.35}, {"lw": 1.2})
_NAMES = {
    "pinocchio": "Pinocchio (URDF, closures, RNEA)",
    "virtual-power": "virtual power (paper)",
    "compiled": "virtual power, reduced and compiled",
}


def forces_figure(results: Sequence[InverseDynamics], *, ax: Place = None) -> Figure:
    """Draw the three actuator forces over the motion (the paper's Figs. 3-5), and two results' difference.

    Parameters
    ----------
    results : sequence of InverseDynamics
        One result, or two of the same motion by different methods or with different friction; invalid samples
        are hatched gaps.
    ax : Axes or SubFigure, optional
        Of a figure of the caller's: what is drawn takes this place, and is returned as a SubFigure.

    Raises
    ------
    InputError, MissingExtraError
        If there are not one or two results, or two of different motions; if matplotlib is not installed.
    """
    if len(results) not in {1, 2}:
        raise InputError(f"results: expected one or two, got {len(results)}")
    if len(results) == 2 and not np.array_equal(results[0].time, results[1].time):
        raise InputError("results: expected two results of the same motion, got different times")
    rows = len(results)
    figure = new_figure(figsize=(10.5, 3.1 if rows == 1 else 4.8), ax=ax)
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
    figure.legend(handles, labels, loc=above(figure), ncols=3, frameon=False, fontsize=9)
    for axis in axes.ravel():
        shade_gaps(axis, results[0].time, valid)
        tidy(axis)
    return figure


def _label(result: InverseDynamics) -> str:
    """Return how a result is called."""
    name = _NAMES.get(result.method, result.method)
    return name if result.coulomb is None else f"{name}, with load-dependent friction"


_WIDE: dict[str, Any] = {"lw": 3.2, "alpha": 0.4}
_DASHED: dict[str, Any] = {"lw": 1.3, "ls": (0, (4, 2))}
_COLUMNS: tuple[tuple[str, str, dict[str, dict[str, Any]]], ...] = (
    ("sliders", "m", {f"slide_{leg}": {"color": colour} for leg, colour in zip("abc", COLOURS, strict=True)}),
    (
        "hinges at the sliders",
        "rad",
        {f"hinge_{leg}": {"color": colour} for leg, colour in zip("abc", COLOURS, strict=True)},
    ),
    ("platform", "rad", {"hinge_platform": {"color": "#cc79a7"}}),
    (
        "parallelogram",
        "rad",
        {
            "hinge_left": {"color": COLOURS[2], **_WIDE},
            "hinge_right": {"color": "0.1", **_DASHED},
            "hinge_lower": {"color": "#e69f00"},
        },
    ),
)
"""The columns of panels: title, unit, and the joints with their lines."""

_ROWS = (("position", "q", ""), ("velocity", "v", "/s"), ("acceleration", "a", "/s²"))


def joints_figure(result: InverseDynamics, *, ax: Place = None) -> Figure:
    """Draw position, velocity and acceleration of the sliders and of the passive joints over the motion.

    Parameters
    ----------
    result : InverseDynamics
        The joints by either method; invalid samples are hatched gaps.
    ax : Axes or SubFigure, optional
        Of a figure of the caller's: what is drawn takes this place, and is returned as a SubFigure.

    Returns
    -------
    matplotlib.figure.Figure
        Rows of positions, velocities, accelerations; columns of sliders, hinges at the sliders, hinge of the
        platform, hinges of the parallelogram.

    Raises
    ------
    InputError, MissingExtraError
        If `result` is something else, or none of its samples is valid; if matplotlib is not installed.
    """
    if not isinstance(result, InverseDynamics):
        raise InputError(f"result: expected InverseDynamics, got {shown(result)}")
    if not result.valid.any():
        raise InputError("result: expected at least one valid sample, got none")
    figure = new_figure(figsize=(12.0, 7.2), ax=ax)
    axes = figure.subplots(len(_ROWS), len(_COLUMNS), sharex=True)
    for column, (title, unit, lines) in zip(axes.T, _COLUMNS, strict=True):
        for axis, (quantity, field, rate) in zip(column, _ROWS, strict=True):
            values = getattr(result.joints, field)
            for name, style in lines.items():
                drawn = values[:, result.joints.names.index(name)]
                line(axis, result.time, drawn, result.valid, label=name, **style)
            shade_gaps(axis, result.time, result.valid)
            axis.axhline(0, color="0.6", lw=0.6, zorder=0)
            axis.set_ylabel(f"{quantity} [{unit}{rate}]")
            tidy(axis)
        column[-1].set_xlabel("time [s]")
        column[0].legend(
            title=title,
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            alignment="left",
            frameon=False,
            fontsize=9,
            title_fontsize=10,
        )
    return figure


GROUPS = {
    "platform": ("#0072b2", ("platform",)),
    "legs A, B": ("#56b4e9", ("leg_a", "leg_b")),
    "rods of leg C": ("#009e73", ("rod_left", "rod_right")),
    "sliders": ("#e69f00", ("slider_a", "slider_b", "slider_c")),
    "cross-bars": ("#cc79a7", ("crossbar_upper", "crossbar_lower")),
    "motors, screws": ("#999999", ("actuator_a", "actuator_b", "actuator_c")),
}
"""What the figure calls the bodies, with colours that differ for colour-blind readers."""

_CORNERS = 250
"""About how many there are on the edge of a layer: two points of the page each, below the line of the sum."""

_FLAT = 1e-9  # share of the potential energy below which a whole panel is rounding, and drawn flat

_BLACK, _GREY = "0.1", "0.6"
_DASHES, _DOTTED = (0, (4, 2)), (0, (1, 1.2))


def energy_figure(energy: Energy, *, ax: Place = None) -> Figure:
    """Draw the change of the energy with the work done, the kinetic energy by bodies, and the power.

    Stretches of invalid samples are hatched; the work restarts behind them, from the energy there. Bodies
    that never have kinetic energy are left out.

    Parameters
    ----------
    energy : Energy
        What `p3dof.analysis.energy.energy_of` found.
    ax : Axes or SubFigure, optional
        Of a figure of the caller's: what is drawn takes this place, and is returned as a SubFigure.

    Raises
    ------
    InputError, MissingExtraError
        If `energy` is something else, or none of its samples is valid; if matplotlib is not installed.
    """
    require("energy", energy, Energy)
    if not energy.valid.any():
        raise InputError("energy: expected at least one valid sample, got none")
    figure = new_figure(figsize=(9.6, 8.4), ax=ax)
    panels = figure.subplots(3, 1, sharex=True, height_ratios=(1.2, 1, 1.1))
    for axis, draw in zip(panels, (_draw_balance, _draw_bodies, _draw_power), strict=True):
        draw(axis, energy)
        _keep_flat(axis, energy)
        shade_gaps(axis, energy.time, energy.valid)
        tidy(axis)
        axis.set_axisbelow(True)
        axis.legend(
            loc="upper left",
            bbox_to_anchor=(1.0, 1.0),
            frameon=False,
            fontsize=9,
            reverse=draw is _draw_bodies,
        )
    panels[-1].set_xlabel("time [s]")
    return figure


def _draw_balance(axis: Axes, energy: Energy) -> None:
    first = int(np.argmax(energy.valid))
    parts = {"kinetic T": energy.kinetic_total, "potential V": energy.potential_total, "T + V": energy.total}
    styles: tuple[dict[str, Any], ...]
    styles = ({"color": "#d55e00"}, {"color": "#0072b2"}, {"color": _BLACK, "lw": 4, "alpha": 0.3})
    for (label, values), style in zip(parts.items(), styles, strict=True):
        _line(axis, energy, values - values[first], label=label, **style)
    acting = [("work of actuators", energy.power), ("and wrench", energy.wrench_power)]
    acting += [("less friction", energy.dissipated_power)]
    label = "\n".join(words for words, power in acting if power.ndim > 1 or _acts(power))
    work = energy.total - energy.balance - energy.total[first]  # from the first sample of each run
    _line(axis, energy, work, label=label, color=_BLACK, ls=_DASHES)
    axis.axhline(0, color=_GREY, lw=0.6, zorder=0)
    axis.set_title(
        "Energy since the first sample, and the work done on the mechanism", fontsize=10, loc="left", y=1.0
    )
    axis.set_ylabel("change of energy [J]")


def _draw_bodies(axis: Axes, energy: Energy) -> None:
    columns = {
        name: [energy.bodies.index(body) for body in bodies if body in energy.bodies]
        for name, (_, bodies) in GROUPS.items()
    }
    layers = {name: energy.kinetic[:, index].sum(axis=-1) for name, index in columns.items()}
    layers = {name: layer for name, layer in layers.items() if _acts(layer, _rounding(energy))}
    if layers:
        colours = [GROUPS[name][0] for name in layers]
        last = len(energy.time) - 1
        step = max(1, last // _CORNERS) if energy.valid.all() else 1
        some = np.append(np.arange(0, last, step), last)
        axis.stackplot(
            energy.time[some],
            [layer[some] for layer in layers.values()],
            labels=list(layers),
            colors=colours,
            lw=0,
            alpha=0.85,
        )
    _line(axis, energy, energy.kinetic_total, label="all bodies", color=_BLACK, lw=1, clip_on=False)
    axis.set_title("Kinetic energy, one layer a group of bodies", fontsize=10, loc="left", y=1.0)
    axis.set_ylabel("kinetic energy [J]")
    axis.set_ylim(bottom=0)


def _draw_power(axis: Axes, energy: Energy) -> None:
    for leg, name in enumerate(LEGS):
        _line(axis, energy, energy.power[:, leg], label=f"actuator {name}", color=COLOURS[leg])
    if _acts(energy.wrench_power):
        _line(axis, energy, energy.wrench_power, label="wrench", color="#e69f00", ls=_DASHES)
    if _acts(energy.dissipated_power):
        _line(axis, energy, -energy.dissipated_power, label="friction", color="#cc79a7", ls=_DOTTED)
    axis.axhline(0, color=_GREY, lw=0.6, zorder=0)
    axis.set_title("Power given to the mechanism (below zero: taken from it)", fontsize=10, loc="left", y=1.0)
    axis.set_ylabel("power [W]")


def _line(axis: Axes, energy: Energy, values: FloatArray, **style: Any) -> None:
    line(axis, energy.time, values, energy.valid, **style)


def _acts(values: FloatArray, floor: float = 0.0) -> bool:
    return bool(np.any(np.abs(np.nan_to_num(values)) > floor))


def _rounding(energy: Energy) -> float:
    """Return what is too small to be shown [J, W]."""
    return _FLAT * (float(np.abs(energy.potential[energy.valid]).max()) or 1.0)


def _keep_flat(axis: Axes, energy: Energy) -> None:
    """Show what hardly changes as a straight line instead of a blow-up of its rounding."""
    if not any(_acts(np.asarray(line.get_ydata()), _rounding(energy)) for line in axis.lines):
        axis.set_ylim(0 if axis.get_ylim()[0] == 0 else -1, 1)


_KINDS = (("forces", "force [N]", COLOURS[0]), ("moments", "moment [N m]", COLOURS[1]))
_WAY_ROWS = (
    ("slide_a", "hinge_a", "loop_a"),
    ("slide_b", "hinge_b", "loop_b"),
    ("slide_c", "hinge_c", "hinge_left", "hinge_right"),
    ("hinge_lower", "hinge_platform", "loop_c"),
)
"""The panels: leg A, leg B, leg C from its slider to the platform."""

_LABELS = {joint.name: joint.label for joint in JOINTS}
_WAY_STYLES: Mapping[str, Mapping[str, Any]] = {
    "elastic": {"ls": "-", "lw": 1.2},
    "paper": {"ls": (0, (4, 2)), "lw": 0.8},
    "points": {"ls": (0, (1, 1.2)), "lw": 0.8},
}
"""Of open loads, by the way they are found: solid, dashes and dots."""

_NOTHING = 1e-9  # moments that are rounding, of a joint that bears none [N m]


def reactions_figure(result: AnyReactions, *, ax: Place = None) -> Figure:
    """Draw the resultant force and moment in every joint over the motion.

    `ax`: where to draw in a figure of the caller's, as of `forces_figure`.
    """
    figure = new_figure(figsize=(10.5, 8.0), ax=ax)
    axes = figure.subplots(len(_WAY_ROWS), 4, sharex=True)
    for row, names in zip(axes, _WAY_ROWS, strict=True):
        for axis in row[len(names) :]:
            axis.set_axis_off()
        for axis, name in zip(row, names, strict=False):
            axis.set_title(f"{name} ({_LABELS[name]})", fontsize=9, y=1.0)
            for side, (kind, _, colour) in zip((axis, axis.twinx()), _KINDS, strict=True):
                _draw(side, result, name, kind, colour)
            shade_gaps(axis, result.time, result.valid)
            axis.grid(color="0.9", lw=0.6)
            axis.tick_params(axis="x", labelsize=7)
    for axis in (*axes[-1, :3], axes[-2, 3]):
        axis.tick_params(labelbottom=True)
        axis.set_xlabel("time [s]", fontsize=8)
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Artist] = [Line2D([], [], lw=1.2, color=colour, label=label) for _, label, colour in _KINDS]
    solid = "determined, or elastic joints" if result.rests_on_stiffness else "determined"
    handles.append(Line2D([], [], lw=1.2, color="0.3", label=solid))
    ideal = [way for way in result.ways if way != "elastic"]
    handles += [
        Line2D([], [], color="0.3", label=f"open, joints as {way!r}", **_WAY_STYLES[way]) for way in ideal
    ]
    if not result.possible:
        handles.append(Patch(**GAP_STYLE, label=GAP))
    axes[0, 3].legend(handles=handles, loc="center", frameon=False, fontsize=9)
    note = "Rigid bodies do not determine\nthese loads: dashes and dots are\none of many, and no bounds."
    axes[1, 3].text(0.5, 0.5, note, fontsize=9, ha="center", va="center", transform=axes[1, 3].transAxes)
    figure.suptitle("resultants in the joints", fontsize=10)
    return figure


def _draw(axis: Axes, result: AnyReactions, name: str, kind: str, colour: str) -> None:
    """Draw the size of a joint's force or moment against its own scale, in its colour."""
    each = {one.way: one[name] for one in result.each}
    determined = all(getattr(one, f"determined_{kind}")[result.valid].all() for one in each.values())
    sizes = {name: np.linalg.norm(getattr(one, kind), axis=-1) for name, one in each.items()}
    if determined:  # the same in all
        sizes = {"": next(iter(sizes.values()))}
    axis.spines["top"].set_visible(False)
    axis.margins(x=0.01)
    largest = max(np.nanmax(size, initial=0.0) for size in sizes.values())
    if kind == "moments" and largest <= _NOTHING:
        axis.set_yticks([])
        axis.spines["right"].set_visible(False)
        return
    for way, size in sizes.items():
        line(
            axis,
            result.time,
            size,
            result.valid,
            color=colour,
            **_WAY_STYLES.get(way, _WAY_STYLES["elastic"]),
        )
    axis.set_ylim(0, 1.05 * largest or 1.0)
    few_ticks(axis)
    axis.tick_params(axis="y", labelsize=7, colors=colour)


_RUN_COLOURS = ("#d55e00", "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
_POSE = ("y [mm]", "z [mm]", "θ [mrad]")
_DEPTH = 1e-3  # how far a logarithmic axis of errors goes below the least of the peaks


def tracking_figure(runs: Mapping[str, Simulation], *, ax: Place = None) -> Figure:
    """Draw poses, tracking errors and forces of runs that follow the same motion.

    `ax`: where to draw in a figure of the caller's, as of `forces_figure`.
    """
    if not 1 <= len(runs) <= len(_RUN_COLOURS):
        raise InputError(f"runs: expected one to {len(_RUN_COLOURS)}, got {len(runs)}")
    errors = {name: 1e3 * np.abs(run.error) for name, run in runs.items()}
    figure = new_figure(figsize=(10.5, 7.2), ax=ax)
    axes = figure.subplots(3, 3, sharex=True, height_ratios=(1, 1.2, 1))
    longest = max(runs.values(), key=lambda run: float(run.time[-1]))
    assert longest.reference is not None  # noqa: S101 - or there would be no error
    for k in range(3):
        pose, error, force = axes[:, k]
        pose.plot(longest.time, 1e3 * longest.reference[:, k], color="0.75", lw=4, label="reference")
        for colour, (name, run) in zip(_RUN_COLOURS, runs.items(), strict=False):
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
    figure.legend(handles, labels, loc=above(figure), ncols=len(labels), frameon=False, fontsize=9)
    return figure
