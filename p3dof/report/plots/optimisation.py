"""Figures of better machines: an optimum and what it depends on, Pareto fronts, parallel coordinates."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from p3dof._base.checks import FloatArray, require
from p3dof.design.optimisation import Front, Optimum
from p3dof.report.plots.common import COLOURS, new_figure, tidy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_START: dict[str, Any] = {"marker": "D", "ms": 6, "ls": "none", "color": "0.15", "label": "start"}


def optimum_figure(optimum: Optimum) -> Figure:
    """Draw how the objective depends on each variable at an optimum and at the start, and all margins."""
    require("optimum", optimum, Optimum)
    rows = max(len(optimum.design), len(optimum.problem.constraints))
    figure = new_figure(figsize=(9.6, 1.6 + 0.34 * rows))
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


def front_figure(front: Front) -> Figure:
    """Draw a Pareto front with the start, and all variables and objectives in parallel coordinates.

    Parameters
    ----------
    front : Front
        Of `DesignProblem.pareto`; of three objectives or more, the first two have the upper panel, the third
        its colours.

    Raises
    ------
    InputError, MissingExtraError
        If `front` is something else; if matplotlib is not installed.
    """
    require("front", front, Front)
    figure = new_figure(figsize=(8.4, 7.2))
    upper, lower = figure.subplots(2, 1)
    _draw_front(figure, upper, front)
    _draw_parallel(lower, front)
    return figure


def _draw_front(figure: Figure, axis: Axes, front: Front) -> None:
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
