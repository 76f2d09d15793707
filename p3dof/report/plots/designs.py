"""The figure of many designs: the largest force of each over two of its columns."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from p3dof._base.checks import shown
from p3dof._base.errors import InputError
from p3dof.analysis.designs import DesignForces, Designs
from p3dof.analysis.designs.names import QUANTITIES, column_of
from p3dof.machine.parameters import LEGS
from p3dof.report.plots.common import COLOURS, new_figure, tidy

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SHOWN = 1000
"""Designs whose single forces are drawn."""

_MOST = 5_000
"""Designs that are drawn of more: each is a point."""


def designs_figure(designs: Designs, found: DesignForces, x: str, y: str) -> Figure:
    """Draw the largest force of each design over two of its columns, and the forces in their order.

    Crosses are designs that cannot make the motion. Of more than 5,000 designs, evenly chosen ones are drawn.

    Parameters
    ----------
    designs : Designs
        The machines.
    found : DesignForces
        What they need.
    x, y : str
        Two of the columns; a unit in brackets is that of the axis.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If a column is missing, or the results are those of other designs.
    MissingExtraError
        If matplotlib is not installed.
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
    figure = new_figure(figsize=(9.6, 4.2))
    left, scale, right = figure.subplots(1, 3, width_ratios=(1.4, 0.05, 1.2))
    chosen = np.unique(np.linspace(0, len(designs) - 1, min(_MOST, len(designs))).astype(int))
    worst = found.peak_force.max(axis=1)
    good, bad = chosen[found.feasible[chosen]], chosen[~found.feasible[chosen]]
    (x_label, across), (y_label, up) = places
    left.plot(across[bad], up[bad], "x", color="0.7", ms=3, label="cannot make the motion")
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
    right.set(xlabel="designs, the best first", ylabel="peak force [N]")
    right.legend(frameon=False, fontsize=9)
    tidy(right)
    return figure
