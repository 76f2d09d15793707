"""The figure of a sweep: how figures are spread, and which machines no other one beats."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from p3dof._base.blocks import Counts, Histogram, ParetoArchive, Reduction, Rows, Sweep
from p3dof._base.checks import shown
from p3dof._base.errors import InputError
from p3dof.report.plots.common import COLOURS, new_figure, tidy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST = 12
"""Most panels."""


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


def sweep_figure(sweep: Sweep) -> Figure:
    """Draw histograms, and Pareto fronts of two or more columns over the first two of them.

    Parameters
    ----------
    sweep : Sweep
        Complete or not; of the first twelve such reductions each has a panel.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If `sweep` is something else, or has none of both.
    MissingExtraError
        If matplotlib is not installed.
    """
    if not isinstance(sweep, Sweep):
        raise InputError(f"sweep: expected a Sweep, got {shown(sweep)}")
    chosen = require_panels(sweep.manifest.reductions)[:MOST]
    panels = [(reduction, sweep.reductions[reduction.name]) for reduction in chosen]
    across = min(2, len(panels))
    rows = math.ceil(len(panels) / across)
    figure = new_figure(figsize=(4.8 * across, 3.4 * rows))
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
