"""Figures of many designs, of runs, of optimisation, tolerances and sensitivities."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from p3dof._base.blocks import Counts, Histogram, ParetoArchive, Reduction, Rows, Sweep
from p3dof._base.checks import FloatArray, require, shown
from p3dof._base.errors import InputError
from p3dof.analysis.designs import DesignForces, Designs
from p3dof.analysis.designs.columns import QUANTITIES, column_of
from p3dof.analysis.tolerances import ForceTolerance, LocalSensitivity, PoseTolerance, SobolIndices
from p3dof.design.design_comparison import DesignComparison
from p3dof.design.optimisation import Front, Optimum
from p3dof.machine.parameters import LEGS
from p3dof.report.plots.common import COLOURS, Place, above, new_figure, tidy
from p3dof.runs.many import ManyRuns

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_SHOWN = 1000  # designs whose single forces are drawn

_MOST = 5_000  # designs that are drawn of more: each is a point


def designs_figure(designs: Designs, found: DesignForces, x: str, y: str, *, ax: Place = None) -> Figure:
    """Draw the largest force of each design over two of its columns, and the forces in their order.

    Crosses are designs that cannot perform the motion. Of more than 5,000 designs, some are drawn.

    Parameters
    ----------
    designs : Designs
        The machines.
    found : DesignForces
        What they need.
    x, y : str
        Two of the columns; a unit in brackets is that of the axis.
    ax : Axes or SubFigure, optional
        Of a figure of the caller's: what is drawn takes this place, and is returned as a SubFigure.

    Raises
    ------
    InputError, MissingExtraError
        If a column is missing, or the results are those of other designs; if matplotlib is not installed.
    """
    if len(found) != len(designs):
        raise InputError(f"found: expected results of {len(designs)} designs, got {len(found)}")
    places = []
    for header in (x, y):
        column = column_of(header)
        if column.name not in designs.columns:
            raise InputError(f"x, y: expected columns of the designs, got {shown(header)}")
        label = header if "[" in header else f"{header} [{QUANTITIES[column.name].unit}]"
        places.append((label, designs.columns[column.name] * column.divide / column.multiply))
    figure = new_figure(figsize=(9.6, 4.2), ax=ax)
    left, scale, right = figure.subplots(1, 3, width_ratios=(1.4, 0.05, 1.2))
    chosen = np.unique(np.linspace(0, len(designs) - 1, min(_MOST, len(designs))).astype(int))
    worst = found.peak_force.max(axis=1)
    good, bad = chosen[found.feasible[chosen]], chosen[~found.feasible[chosen]]
    (x_label, across), (y_label, up) = places
    left.plot(across[bad], up[bad], "x", color="0.7", ms=3, label="cannot perform the motion")
    points = left.scatter(across[good], up[good], c=worst[good], s=9, cmap="viridis", lw=0, rasterized=True)
    figure.colorbar(points, cax=scale)
    left.set(xlabel=x_label, ylabel=y_label, title="largest force [N]")
    if len(bad):
        left.legend(loc="best", fontsize=9)
    order = np.argsort(worst[found.feasible], kind="stable")
    for leg, colour, values in zip(LEGS, COLOURS, found.peak_force[found.feasible][order].T, strict=True):
        step = max(1, len(order) // _SHOWN)
        right.plot(np.arange(0, len(order), step), values[::step], ".", ms=2, color=colour, label=leg)
    right.plot(np.arange(len(order)), worst[found.feasible][order], color="black", lw=1, label="largest")
    right.set(xlabel="designs, sorted", ylabel="peak force [N]")
    right.legend(frameon=False, fontsize=9)
    tidy(right)
    return figure


_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
_LINES = ("-", "--", "-.", ":")


def comparison_figure(found: DesignComparison, *, ax: Place = None) -> Figure:
    """Draw the forces and speeds of A, B and C of all designs over time, those of one axis in one panel.

    `ax`: where to draw in a figure of the caller's, as of `forces_figure`.
    """
    require("found", found, DesignComparison)
    figure = new_figure(figsize=(10.2, 7.4), ax=ax)
    panels = figure.subplots(3, 2, sharex=True)
    for k, one in enumerate(found.assessments):
        style = {"color": _COLOURS[k % len(_COLOURS)], "ls": _LINES[k % len(_LINES)], "lw": 1.3}
        time = one.found.time
        for leg in range(3):
            panels[leg][0].plot(time, one.found.forces[:, leg], label=one.name, **style)
            panels[leg][1].plot(time, one.found.slider_velocities[:, leg], **style)
    longest = max(float(one.found.time[-1]) for one in found.assessments)
    for leg, row in enumerate(panels):
        for axis, what in zip(row, ("force [N]", "speed [m/s]"), strict=True):
            axis.axhline(0, color="0.6", lw=0.5, zorder=0)
            axis.set_ylabel(f"{LEGS[leg]}: {what}")
            tidy(axis)
            axis.set_xlim(0, longest)
    for axis in panels[-1]:
        axis.set_xlabel("time [s]")
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc=above(figure), ncols=min(len(labels), 4), frameon=False, fontsize=9)
    return figure


_AXES = ("y [mm]", "z [mm]", "θ [mrad]")


def many_runs_figure(runs: ManyRuns, *, ax: Place = None) -> Figure:
    """Draw how the largest errors and forces of the finished runs are distributed, with their 95 % quantiles.

    Parameters
    ----------
    runs : ManyRuns
        The runs.
    ax : Axes or SubFigure, optional
        Of a figure of the caller's: what is drawn takes this place, and is returned as a SubFigure.

    Raises
    ------
    InputError, MissingExtraError
        If no run was finished; if matplotlib is not installed.
    """
    good = runs.finished
    if not good.any():
        raise InputError("runs: expected one that was finished, there is none")
    figure = new_figure(figsize=(10.5, 5.4), ax=ax)
    axes = figure.subplots(2, 3)
    for k, name in enumerate(_AXES):
        _histogram(axes[0, k], 1e3 * runs.peak_error[good, k], f"largest error of {name}")
        _histogram(axes[1, k], runs.peak_force[good, k], f"largest force of {LEGS[k]} [N]")
    axes[0, 0].set_ylabel("runs")
    axes[1, 0].set_ylabel("runs")
    axes[0, 0].legend(loc="upper left", frameon=False, fontsize=8)
    return figure


def _histogram(axis: Any, values: FloatArray, label: str) -> None:
    from matplotlib.ticker import MaxNLocator

    finite = values[np.isfinite(values)]
    axis.hist(finite, bins=40, color="#0072b2")
    if len(finite):
        axis.axvline(np.quantile(finite, 0.95), color="#d55e00", lw=1.2, label="95 % below")
    axis.set_xlabel(label)
    axis.yaxis.set_major_locator(MaxNLocator(integer=True))
    axis.set_axisbelow(True)
    tidy(axis)


MOST = 12  # most panels


def require_panels(reductions: Iterable[Reduction]) -> list[Histogram | ParetoArchive]:
    """Return the reductions that `sweep_figure` draws; raise `InputError` if there is none."""
    found = [
        item
        for item in reductions
        if isinstance(item, Histogram) or (isinstance(item, ParetoArchive) and len(item.objectives) > 1)
    ]
    if not found:
        raise InputError("sweep: expected a Histogram or a ParetoArchive of two columns among its reductions")
    return found


def sweep_figure(sweep: Sweep, *, ax: Place = None) -> Figure:
    """Draw histograms, and Pareto fronts of two or more columns over the first two of them.

    Parameters
    ----------
    sweep : Sweep
        Complete or not; of the first twelve such reductions each has a panel.
    ax : Axes or SubFigure, optional
        Of a figure of the caller's: what is drawn takes this place, and is returned as a SubFigure.

    Raises
    ------
    InputError, MissingExtraError
        If `sweep` is something else, or has none of both; if matplotlib is not installed.
    """
    require("sweep", sweep, Sweep)
    chosen = require_panels(sweep.manifest.reductions)[:MOST]
    panels = [(reduction, sweep.reductions[reduction.name]) for reduction in chosen]
    across = min(2, len(panels))
    rows = math.ceil(len(panels) / across)
    figure = new_figure(figsize=(4.8 * across, 3.4 * rows), ax=ax)
    axes = figure.subplots(rows, across, squeeze=False).ravel()
    for axis, (reduction, found) in zip(axes, panels, strict=False):
        if isinstance(reduction, ParetoArchive):
            _draw_front(axis, reduction, found, sweep.manifest.with_unit)
        else:
            _draw_counts(axis, found, sweep.manifest.with_unit)
        tidy(axis)
        axis.set_axisbelow(True)
    for axis in axes[len(panels) :]:
        axis.set_visible(False)
    return figure


def _draw_counts(axis: Axes, found: Counts, named: Callable[[str], str]) -> None:
    from matplotlib.ticker import MaxNLocator

    axis.stairs(found.counts, found.edges, fill=True, color=COLOURS[0], alpha=0.85)
    axis.set_xlabel(named(found.column))
    axis.set_ylabel("items")
    axis.yaxis.set_major_locator(MaxNLocator(integer=True))
    outside = {"below": found.below, "above": found.above, "without a number": found.invalid}
    told = ", ".join(f"{count} {name}" for name, count in outside.items() if count)
    axis.set_title(f"{found.counts.sum()} items" + (f"; {told}" if told else ""), fontsize=9, loc="left")


def _draw_front(axis: Axes, reduction: ParetoArchive, found: Rows, named: Callable[[str], str]) -> None:
    (x, along), (y, up), *others = reduction.objectives.items()
    axis.plot(found.columns[x], found.columns[y], marker="o", ms=3.5, ls="none", color=COLOURS[1])
    words = {"min": "small", "max": "large"}
    axis.set_xlabel(f"{named(x)} ({words[along]} is good)")
    axis.set_ylabel(f"{named(y)} ({words[up]} is good)")
    more = f", and {', '.join(name for name, _ in others)}" if others else ""
    axis.set_title(f"Pareto front: {len(found)} items{more}", fontsize=9, loc="left")


_START: dict[str, Any] = {"marker": "D", "ms": 6, "ls": "none", "color": "0.15", "label": "start"}


def optimum_figure(optimum: Optimum, *, ax: Place = None) -> Figure:
    """Draw how the objective depends on each variable at an optimum and at the start, and all margins.

    `ax`: where to draw in a figure of the caller's, as of `forces_figure`.
    """
    require("optimum", optimum, Optimum)
    rows = max(len(optimum.design), len(optimum.problem.constraints))
    figure = new_figure(figsize=(9.6, 1.6 + 0.34 * rows), ax=ax)
    left, right = figure.subplots(1, 2)
    _draw_sensitivity(left, optimum)
    _draw_margins(right, optimum)
    return figure


def _draw_sensitivity(axis: Axes, optimum: Optimum) -> None:
    """Bars: change of the objective in percent where a variable grows by one percent."""
    problem, measure = optimum.problem, optimum.problem.objectives[0]
    places = np.arange(len(optimum.design), dtype=np.float64)
    designs = [("optimum", COLOURS[0], -0.2, optimum.design, optimum.value)]
    value = float(optimum.start.objectives[0, 0])
    if np.isfinite(value) and value:
        designs.append(("start", "0.6", 0.2, problem.start, value))
    for label, colour, shift, design, worth in designs:
        share = problem.gradient(design)[measure.name] * design / abs(worth)
        axis.barh(places + shift, share, height=0.36, color=colour, label=label)
    axis.set_yticks(places, problem.variables.labels)
    axis.invert_yaxis()
    axis.axvline(0, color="0.3", lw=0.8)
    axis.set_xlabel(f"{measure.name}: change [%] for 1 % of the variable")
    axis.legend(frameon=False, fontsize=8)
    _tidy_bars(axis)


def _draw_margins(axis: Axes, optimum: Optimum) -> None:
    """Bars: margins of constraints as shares of their bounds; binding ones have none."""
    items = optimum.problem.constraints
    scales = np.array([item.scale for item in items])
    places = np.arange(len(items), dtype=np.float64)
    for label, colour, shift, found in (
        ("optimum", COLOURS[0], -0.2, optimum.found),
        ("start", "0.6", 0.2, optimum.start),
    ):
        axis.barh(places + shift, 100 * found.margins[0] / scales, height=0.36, color=colour, label=label)
    binding = optimum.binding
    axis.set_yticks(places, [item.name + ("  ◂ binding" if item.name in binding else "") for item in items])
    axis.invert_yaxis()
    axis.axvline(0, color="0.3", lw=0.8)
    axis.set_xlabel("margin [% of the bound]")
    _tidy_bars(axis)


def _tidy_bars(axis: Axes) -> None:
    axis.grid(axis="x", color="0.9", lw=0.6)
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)
    axis.tick_params(axis="y", length=0)


def front_figure(front: Front, *, ax: Place = None) -> Figure:
    """Draw a Pareto front with the start, and all variables and objectives in parallel coordinates.

    Parameters
    ----------
    front : Front
        Of `DesignProblem.pareto`; of three objectives or more, the first two have the upper panel, the third
        its colours.
    ax : Axes or SubFigure, optional
        Of a figure of the caller's: what is drawn takes this place, and is returned as a SubFigure.

    Raises
    ------
    InputError, MissingExtraError
        If `front` is something else; if matplotlib is not installed.
    """
    require("front", front, Front)
    figure = new_figure(figsize=(8.4, 7.2), ax=ax)
    upper, lower = figure.subplots(2, 1)
    _draw_pareto_front(figure, upper, front)
    _draw_parallel(lower, front)
    return figure


def _draw_pareto_front(figure: Figure, axis: Axes, front: Front) -> None:
    first, second, *others = front.problem.objectives
    values, start = front.objectives, front.start.objectives[0]
    if len(front.unpolished):
        axis.plot(
            front.unpolished[:, 1], front.unpolished[:, 0], ".", ms=4, color="0.7", label="before polishing"
        )
    if others:
        third = others[0]
        drawn = axis.scatter(values[:, 1], values[:, 0], c=values[:, 2], cmap="viridis", s=22, label="front")
        figure.colorbar(drawn, ax=axis, label=_named(third.name, third.unit))
    else:
        axis.plot(values[:, 1], values[:, 0], "o-", ms=3.5, lw=1, color=COLOURS[0], label="Pareto front")
    if np.isfinite(start[:2]).all():
        axis.plot(start[1], start[0], **_START)
    for name, measure in (("x", second), ("y", first)):
        good = "left" if name == "x" else "down"
        worse = "right" if name == "x" else "up"
        side = good if measure.better == "small" else worse
        getattr(axis, f"set_{name}label")(f"{_named(measure.name, measure.unit)}  (better: {side})")
    axis.legend(frameon=False, fontsize=8)
    tidy(axis)
    axis.margins(x=0.03)


def _draw_parallel(axis: Axes, front: Front) -> None:
    """Lines from axis to axis; those of objectives are turned so that better is down."""
    problem = front.problem
    names = [_named(*pair) for pair in zip(problem.variables.labels, problem.variables.units, strict=True)]
    names += [_named(measure.name, measure.unit) for measure in problem.objectives]
    flipped = [False] * len(problem.variables) + [m.better == "large" for m in problem.objectives]
    values = np.column_stack([front.designs, front.objectives])
    start = np.concatenate([problem.start, front.start.objectives[0]])
    low = np.fmin(values.min(axis=0), start)
    high = np.fmax(values.max(axis=0), start)
    places = np.arange(len(names))
    colours = _shades(front.objectives[:, 0])
    for row, colour in zip(values, colours, strict=True):
        axis.plot(places, _heights(row, low, high, flipped), color=colour, lw=0.9, alpha=0.8)
    if np.isfinite(start).all():
        axis.plot(places, _heights(start, low, high, flipped), color="0.1", lw=1.6, ls="--", marker="D", ms=4)
    for place, (bottom, top, turned) in enumerate(zip(low, high, flipped, strict=True)):
        axis.plot((place, place), (0, 1), color="0.75", lw=0.8, zorder=0)
        axis.text(place, -0.12, names[place], ha="center", va="top", fontsize=9)
        ends = (top, bottom) if turned else (bottom, top)
        for height, value, side in ((-0.03, ends[0], "top"), (1.03, ends[1], "bottom")):
            axis.text(place, height, f"{value:.4g}", ha="center", va=side, fontsize=8, color="0.3")
    axis.set_xticks([])
    axis.set_yticks([])
    axis.set_ylim(-0.22, 1.12)
    axis.set_xlim(-0.4, len(names) - 0.6)
    axis.spines[:].set_visible(False)
    first = problem.objectives[0].name
    axis.set_title(
        f"of objectives, down is better; darker: better {first}; dashed: start",
        fontsize=9,
        loc="left",
        pad=20,
    )


def _heights(row: FloatArray, low: FloatArray, high: FloatArray, flipped: list[bool]) -> FloatArray:
    share = (row - low) / np.where(high > low, high - low, 1.0)
    return np.where(flipped, 1 - share, share)


def _shades(values: FloatArray) -> list[tuple[float, float, float, float]]:
    from matplotlib import colormaps

    share = (values - values.min()) / max(float(np.ptp(values)), 1e-300)
    return [colormaps["viridis"](0.9 * float(s)) for s in share]


def _named(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


MOST_BARS = 15  # most bars of a panel: the longest ones

_POSE_AXES = (("y", 1e6, "µm"), ("z", 1e6, "µm"), ("θ", 1e3, "mrad"))


def tolerance_figure(tolerance: ForceTolerance | PoseTolerance, *, ax: Place = None) -> Figure:
    """Draw how uncertain forces or a pose are, and which parameters it comes from.

    Parameters
    ----------
    tolerance : ForceTolerance or PoseTolerance
        What `p3dof.tolerance` returns; of several poses the first is drawn.
    ax : Axes or SubFigure, optional
        Of a figure of the caller's: what is drawn takes this place, and is returned as a SubFigure.

    Raises
    ------
    InputError, MissingExtraError
        If it is something else; if matplotlib is not installed.
    """
    if isinstance(tolerance, ForceTolerance):
        return _of_forces(tolerance, ax)
    if isinstance(tolerance, PoseTolerance):
        return _of_pose(tolerance, ax)
    raise InputError(f"tolerance: expected a ForceTolerance or PoseTolerance, got {shown(tolerance)}")


def sensitivity_figure(sensitivity: SobolIndices | LocalSensitivity, *, ax: Place = None) -> Figure:
    """Draw which parameters a figure of the forces depends on, and by Sobol' indices its spread.

    Parameters
    ----------
    sensitivity : SobolIndices or LocalSensitivity
        What `p3dof.sensitivity` returns.
    ax : Axes or SubFigure, optional
        Of a figure of the caller's: what is drawn takes this place, and is returned as a SubFigure.

    Raises
    ------
    InputError, MissingExtraError
        As `tolerance_figure`.
    """
    if isinstance(sensitivity, SobolIndices):
        return _of_indices(sensitivity, ax)
    if isinstance(sensitivity, LocalSensitivity):
        return _of_derivatives(sensitivity, ax)
    raise InputError(f"sensitivity: expected SobolIndices or LocalSensitivity, got {shown(sensitivity)}")


def _of_forces(found: ForceTolerance, ax: Place) -> Figure:
    figure = new_figure((10.0, 6.6), ax=ax)
    (forces, shares), (sizes, spread) = figure.subplots(2, 2, width_ratios=(3, 2))
    for k, leg in enumerate("ABC"):
        forces.plot(found.time, found.forces[:, k], color=COLOURS[k], lw=1.2, label=leg)
        low, high = found.forces[:, k] - found.worst[:, k], found.forces[:, k] + found.worst[:, k]
        forces.fill_between(found.time, low, high, color=COLOURS[k], alpha=0.15, lw=0)
        forces.fill_between(found.time, found.low[:, k], found.high[:, k], color=COLOURS[k], alpha=0.4, lw=0)
        sizes.plot(found.time, found.deviation[:, k], color=COLOURS[k], lw=1.4, label=leg)
    forces.set_ylabel("force [N]")
    forces.set_title(
        f"dark: 95 % of machines; light: worst case ({found.worst_sigma:g} σ)", fontsize=9, loc="left"
    )
    forces.legend(loc="best", frameon=False, ncols=3)
    sizes.set_ylabel("standard deviation of the force [N]")
    sizes.set_xlabel("time [s]")
    sizes.set_ylim(bottom=0)
    _bars(shares, found.names, 100 * found.shares[3])
    shares.set_xlabel("share of the variance of the peak [%]")
    _peaks(spread, found)
    for axis in (forces, sizes):
        tidy(axis)
    return figure


def _peaks(axis: Axes, found: ForceTolerance) -> None:
    """Draw how the peak is spread: machines drawn, and what the first order says."""
    center, size = float(found.peak[3]), float(np.linalg.norm(found.peak_gradient[3] * found.sigma))
    x = np.linspace(center - 4 * size, center + 4 * size, 200)
    normal = np.exp(-(((x - center) / size) ** 2) / 2) / (size * np.sqrt(2 * np.pi))
    if found.peaks is not None:
        good = found.peaks[np.isfinite(found.peaks[:, 3]), 3]
        label = f"{len(good)} machines sampled"
        axis.hist(good, _bins(len(good)), density=True, color=COLOURS[0], alpha=0.6, label=label)
    axis.plot(x, normal, color="0.25", lw=1.2, label="first order")
    axis.axvline(center, color="0.25", lw=1, ls=":", label=f"nominal {center:.5g} N")
    high = float(found.peak_high[3])
    axis.axvline(high, color=COLOURS[1], lw=1.4, ls="--", label=f"95 % below {high:.5g} N")
    axis.set_xlabel("largest force of the motion [N]")
    _without_heights(axis)


def _of_pose(found: PoseTolerance, ax: Place) -> Figure:
    figure = new_figure((10.0, 6.2), ax=ax)
    axes = figure.subplots(2, 3)
    first = (0,) * (found.pose.ndim - 1)
    for k, (name, scale, unit) in enumerate(_POSE_AXES):
        top, below = axes[0, k], axes[1, k]
        _bars(top, found.names, 100 * found.shares[first][k])
        top.set_xlabel(f"share of the variance of {name} [%]")
        size, high = scale * float(found.deviation[first][k]), scale * float(found.high[first][k])
        errors = (
            None if found.errors is None else scale * found.errors.reshape(len(found.errors), -1, 3)[:, 0, k]
        )
        _errors(below, size, high, errors, unit)
        below.set_xlabel(f"error of {name} [{unit}]")
    y, z, theta = found.pose[first]
    figure.suptitle(f"y = {y:g} m, z = {z:g} m, θ = {np.degrees(theta):.4g}°", fontsize=10)
    return figure


def _errors(axis: Axes, size: float, high: float, errors: FloatArray | None, unit: str) -> None:
    if errors is not None:
        good = errors[np.isfinite(errors)]
        axis.hist(good, _bins(len(good)), density=True, color=COLOURS[0], alpha=0.6)
    if size > 0:
        x = np.linspace(-4 * size, 4 * size, 200)
        axis.plot(x, np.exp(-((x / size) ** 2) / 2) / (size * np.sqrt(2 * np.pi)), color="0.25", lw=1.2)
    for bound in (-high, high):
        axis.axvline(bound, color=COLOURS[1], lw=1.4, ls="--")
    axis.set_title(f"σ = {size:.4g}, 95 % within {high:.4g} {unit}", fontsize=9, loc="left")
    _without_heights(axis, legend=False)


def _of_indices(found: SobolIndices, ax: Place) -> Figure:
    figure = new_figure((9.6, 0.35 * min(len(found.names), MOST_BARS) + 3.0), ax=ax)
    bars, spread = figure.subplots(1, 2, width_ratios=(3, 2))
    order = np.argsort(found.total)[-MOST_BARS:]
    places = np.arange(len(order))
    style: dict[str, Any] = {"height": 0.38, "error_kw": {"lw": 1, "capsize": 2, "ecolor": "0.25"}}
    total, first = found.total[order], found.first[order]
    bars.barh(
        places - 0.2,
        total,
        xerr=found.total_error[order],
        color=COLOURS[1],
        label="ST: with interactions",
        **style,
    )
    bars.barh(
        places + 0.2, first, xerr=found.first_error[order], color=COLOURS[0], label="S1: alone", **style
    )
    _named_tolerance(bars, [found.names[i] for i in order])
    bars.set_xlabel(f"share of the variance of {_short(found.result)}")
    bars.set_xlim(left=0)
    bars.legend(loc="lower right", frameon=False)
    spread.hist(found.values, _bins(len(found.values)), density=True, color=COLOURS[0], alpha=0.6)
    spread.axvline(found.mean, color="0.25", lw=1, ls=":", label=f"mean {found.mean:.5g}")
    for bound, label in ((found.low, f"95 %: {found.low:.5g} to {found.high:.5g}"), (found.high, None)):
        spread.axvline(bound, color=COLOURS[1], lw=1.4, ls="--", label=label)
    spread.set_xlabel(f"{_short(found.result)} [{found.unit}]" if found.unit else _short(found.result))
    _without_heights(spread)
    return figure


def _of_derivatives(found: LocalSensitivity, ax: Place) -> Figure:
    figure = new_figure((7.6, 0.3 * min(len(found.names), MOST_BARS) + 1.6), ax=ax)
    axis = figure.subplots()
    order = np.argsort(np.abs(found.normalised))[-MOST_BARS:]
    places, sizes = np.arange(len(order)), found.normalised[order]
    axis.barh(places, sizes, color=[COLOURS[1] if size > 0 else COLOURS[0] for size in sizes], height=0.7)
    axis.axvline(0, color="0.25", lw=0.8)
    _named_tolerance(axis, [found.names[i] for i in order])
    axis.set_xlabel(f"change of {_short(found.result)} [%] when the parameter increases by 1 %")
    axis.set_title(f"{_short(found.result)} = {found.value:.6g} {found.unit}", fontsize=9, loc="left")
    return figure


def _bars(axis: Axes, names: tuple[str, ...], values: FloatArray) -> None:
    order = np.argsort(values)[-MOST_BARS:]
    axis.barh(np.arange(len(order)), values[order], color=COLOURS[0], height=0.7)
    _named_tolerance(axis, [names[i] for i in order])
    axis.set_xlim(0, 1.18 * max(float(values.max()), 1e-9))
    for place, value in enumerate(values[order]):
        axis.annotate(f" {value:.3g}", (float(value), place), va="center", fontsize=8)


def _named_tolerance(axis: Axes, names: list[str]) -> None:
    """Give each bar its name."""
    tidy(axis)
    axis.set_axisbelow(True)
    axis.set_yticks(range(len(names)), [_short(name) for name in names])
    axis.grid(visible=False, axis="y")


def _without_heights(axis: Axes, legend: bool = True) -> None:
    """Leave the heights of a density away, which say nothing; put the legend above it."""
    tidy(axis)
    axis.set_axisbelow(True)
    axis.set_yticks([])
    axis.set_ylim(bottom=0)
    if legend:
        axis.set_ylim(top=1.5 * axis.get_ylim()[1])
        axis.legend(loc="upper left", fontsize=8, framealpha=1, edgecolor="none")


def _bins(count: int) -> int:
    return int(np.clip(np.sqrt(count) / 1.5, 8, 60))


def _short(name: str) -> str:
    """Return a name of a parameter without what goes without saying."""
    return (
        name.removeprefix("geometry.").removeprefix("bodies.").removeprefix("dimensions.").replace("_", " ")
    )
