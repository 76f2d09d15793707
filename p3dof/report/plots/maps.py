"""Figures of a workspace: indices over (y, θ) and over slices in (y, z), loci of singularities."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from p3dof._base.checks import FloatArray, frozen_array, require
from p3dof._base.errors import InputError
from p3dof.analysis.indices import COLUMNS, check_names, columns_of
from p3dof.analysis.workspace import Workspace, aspect_range
from p3dof.machine.motion import Motion
from p3dof.machine.motion.core import require_motion
from p3dof.report.plots.common import Place, above, few_ticks, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST = 9  # most panels of a figure
_ACTUATION, _SERIAL, _PATH, _BOX = "#d55e00", "#7b3294", "black", "#0072b2"
_GOOD = {"lti": 0.7}  # levels that the field calls good
_LEVELS = 9
_LOG = 30.0  # ratio of largest by least value from which colours are logarithmic, not of shares
_SHARES = {"lti", "lci", "iti", "oti", "gie", "serial"}
_SHORT = {"lti", "lci", "iti", "oti", "gie"}
_BEYOND = 0.35  # how far beyond a workspace a locus is still shown, as a share of its height


def map_figure(
    workspace: Workspace,
    *indices: str,
    motion: Motion | None = None,
    box: bool = False,
    count: int = 161,
    ax: Place = None,
    **options: Any,
) -> Figure:
    """Draw indices over the (y, θ) of a workspace, with the loci of singularities near by.

    Parameters
    ----------
    workspace : Workspace
        Where.
    *indices : str
        Names of indices or of their columns, up to nine numbers; ``"lti"`` and ``"lci"`` without any.
    motion : Motion, optional
        Whose path to draw.
    box : bool
        Draw the largest box of all too.
    count : int
        Points of the map in each direction.
    **options
        As of `Manipulator.indices`.
    ax : Axes or SubFigure, optional
        Of a figure of the caller's: what is drawn takes this place, and is returned as a SubFigure.

    Raises
    ------
    InputError
        If an argument is something else, or there are more than nine numbers.
    MissingExtraError
        If matplotlib is not installed.
    """
    _require(workspace, motion)
    names = check_names(indices or ("lti", "lci"))
    if len(names) > _MOST:
        raise InputError(f"indices: expected at most {_MOST} numbers, got {len(names)}: {', '.join(names)}")
    across = min(len(names), 3 if len(names) > 4 else 2)
    rows = math.ceil(len(names) / across)
    figure = new_figure(figsize=(4.6 * across, 3.7 * rows + 0.3), ax=ax)
    panels = _panels(figure, rows, across, len(names))
    axes, _, found = workspace.gridded(count, **options)
    largest = workspace.largest_box() if box else None
    y, theta = 1e3 * axes[0], np.degrees(axes[1])
    for (axis, scale), name in zip(panels, names, strict=True):
        _fill(axis, scale, y, theta, found.column(name).T, name)
        _draw_loci(axis, workspace, y, theta)
        if motion is not None:
            _draw_path(axis, motion, 0, 2)
        if largest is not None:
            _draw_box(axis, largest.y, largest.theta)
        axis.set(xlabel="y [mm]", ylabel="θ [deg]", title=_title(name))
    _legend(figure, panels[0][0])
    return figure


def slices_figure(
    workspace: Workspace,
    index: str = "lti",
    *,
    theta: Sequence[float] | None = None,
    z: Sequence[float] | None = None,
    motion: Motion | None = None,
    count: int = 161,
    ax: Place = None,
    **options: Any,
) -> Figure:
    """Draw an index over slices of a workspace: (y, z) at orientations, or (y, θ) at heights.

    `ax`: where to draw in a figure of the caller's, as of `forces_figure`.
    """
    _require(workspace, motion)
    (name,) = check_names(index)[:1]
    tilt = workspace.limits.tilt
    turned = (tilt[0], 0.0, tilt[1]) if theta is None and z is None else theta
    slices = [("theta", float(v)) for v in frozen_array("theta", [] if turned is None else turned, ("N",))]
    slices += [("z", float(v)) for v in frozen_array("z", [] if z is None else z, ("N",))]
    if not 0 < len(slices) <= _MOST:
        raise InputError(f"theta, z: expected one to {_MOST} slices, got {len(slices)}")
    panels = [_slice(workspace, kind, value, name, count, options) for kind, value in slices]
    across = min(len(panels), 3)
    rows = math.ceil(len(panels) / across)
    figure = new_figure(figsize=(4.4 * across, 3.6 * rows), ax=ax)
    axes = _panels(figure, rows, across, len(panels))
    ends = _ends(np.concatenate([values.ravel() for *_, values in panels]))
    heights = [
        up for (kind, _), (_, up, _) in zip(slices, panels, strict=True) if kind == "theta" and up.size
    ]
    for (axis, scale), (kind, value), (y, up, values) in zip(axes, slices, panels, strict=True):
        _fill(axis, scale, y, up, values, name, ends)
        if motion is not None:
            _draw_path(axis, motion, 0, 1 if kind == "theta" else 2)
        axis.set_facecolor("0.97")
        if kind == "theta" and heights:
            axis.set_ylim(min(h.min() for h in heights), max(h.max() for h in heights))
        at = f"θ = {np.degrees(value):.4g}°" if kind == "theta" else f"z = {1e3 * value:g} mm"
        axis.set(xlabel="y [mm]", ylabel="z [mm]" if kind == "theta" else "θ [deg]")
        axis.set_title(f"{_title(name)} at {at}", fontsize=11)
        if not np.isfinite(values).any():
            axis.text(0.5, 0.5, "outside the workspace", transform=axis.transAxes, ha="center", color="0.4")
    return figure


def loci_figure(workspace: Workspace, motion: Motion | None = None, *, ax: Place = None) -> Figure:
    """Draw the loci of both singularities all around, home's aspect and the workspace in it.

    `ax`: where to draw in a figure of the caller's, as of `forces_figure`.
    """
    _require(workspace, motion)
    figure = new_figure(figsize=(6.4, 5.0), ax=ax)
    axis = figure.subplots()
    reach = float(workspace.sizes.reach)
    y, theta = (np.asarray(np.linspace(-end, end, 721), dtype=np.float64) for end in (reach, np.pi))
    across, turned = np.meshgrid(y, theta, indexing="ij")
    lower, upper = (end[:, None] for end in aspect_range(workspace.sizes, y))
    home = (turned > lower) & (turned < upper)
    within = np.isfinite(workspace.height(across, turned))
    shade = home.astype(float) + within
    axis.contourf(
        1e3 * y, np.degrees(theta), shade.T, levels=[0.5, 1.5, 2.5], colors=["#e6eef7", "#9cc4e4"], zorder=0
    )
    axis.plot([], [], "s", ms=9, color="#e6eef7", label="home's aspect")
    axis.plot([], [], "s", ms=9, color="#9cc4e4", label="workspace")
    _draw_loci(axis, workspace, 1.06e3 * y, np.degrees(theta))
    if motion is not None:
        _draw_path(axis, motion, 0, 2)
    axis.set(xlabel="y [mm]", ylabel="θ [deg]", yticks=range(-180, 181, 45), ylim=(-188, 188))
    axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=9)
    axis.spines[["top", "right"]].set_visible(False)
    return figure


def _require(workspace: Any, motion: Any) -> None:
    require("workspace", workspace, Workspace)
    if motion is not None:
        require_motion(motion)


def _title(name: str) -> str:
    unit = COLUMNS[name].unit_of(name).replace("^2", "²").replace("^3", "³").replace("^6", "⁶")
    first, *others = name.split("_")
    words = " ".join([first.upper() if first in _SHORT else first, *others])
    return words + ("" if unit == "1" else f" [{unit}]")


def _ends(values: FloatArray) -> tuple[float, float]:
    """Return the ends of colours: the values but for three in a hundred on each side, where poles are."""
    known = values[np.isfinite(values)]
    if not len(known):
        return 0.0, 1.0
    low, high = (float(v) for v in np.quantile(known, [0.03, 0.97]))
    return (low, high) if high - low > 1e-9 * abs(high) else (low - 0.5, high + 0.5)


def _panels(figure: Figure, rows: int, across: int, count: int) -> list[tuple[Axes, Axes]]:
    """Return panels, each with one for the scale of its colours beside it."""
    grid = figure.subplots(rows, 2 * across, squeeze=False, width_ratios=across * (1, 0.04)).ravel()
    for axis in grid[2 * count :]:
        axis.set_visible(False)
    return [(grid[2 * k], grid[2 * k + 1]) for k in range(count)]


def _fill(
    axis: Axes,
    scale: Axes,
    x: FloatArray,
    y: FloatArray,
    values: FloatArray,
    name: str,
    ends: tuple[float, float] | None = None,
) -> None:
    """Fill a panel by colours, with lines of equal values that are labelled."""
    from matplotlib.colors import LogNorm, Normalize
    from matplotlib.ticker import LogLocator, MaxNLocator

    low, high = _ends(values.ravel()) if ends is None else ends
    share = COLUMNS[name].name in _SHARES
    low = 0.0 if share else low
    logarithmic = not share and low > 0 and high / low > _LOG
    norm = LogNorm(low, high) if logarithmic else Normalize(low, high)
    shading: Any = "nearest" if x.ndim == 1 else "gouraud"
    if not np.isfinite(values).any():
        scale.set_visible(False)
        return
    mesh = axis.pcolormesh(x, y, values, norm=norm, cmap="viridis", shading=shading, rasterized=True)
    scale.figure.colorbar(mesh, cax=scale, extend="both")
    locator = LogLocator(subs=(1, 2, 5)) if logarithmic else MaxNLocator(_LEVELS)
    levels = np.asarray(locator.tick_values(low, high))
    levels = levels[(levels > low) & (levels < high)]
    good = _GOOD.get(COLUMNS[name].name)
    if np.isfinite(values).sum() > 3 and min(values.shape) > 1:
        others = levels if good is None else levels[np.abs(levels - good) > 1e-9]
        if len(others):
            lines = axis.contour(x, y, values, levels=others, colors="white", linewidths=0.7)
            if x.ndim == 1:  # over slices in z they stand upright, and leave no room
                axis.clabel(lines, fontsize=7, fmt="%g")
        if good is not None and np.nanmin(values) < good < np.nanmax(values):
            lines = axis.contour(x, y, values, levels=[good], colors="black", linewidths=1.3)
            axis.clabel(lines, fontsize=8, fmt="%g")
    few_ticks(axis)


def _draw_loci(axis: Axes, workspace: Workspace, y: FloatArray, theta: FloatArray) -> None:
    """Draw the loci in what a panel shows, and a little around it."""
    (left, right), (low, high) = ((float(v.min()), float(v.max())) for v in (y, theta))
    beyond = low - _BEYOND * (high - low), high + _BEYOND * (high - low)
    ends, told = [low, high], set()
    for name, curve in workspace.loci().items():
        kind = name.split()[0]
        colour, dashes, words = {
            "actuation": (_ACTUATION, "-", "det J = 0"),
            "serial": (_SERIAL, "--", "leg horizontal"),
        }[kind]
        across, up = 1e3 * curve[:, 0], np.degrees(curve[:, 1])
        seen = (across >= left) & (across <= right) & (up >= beyond[0]) & (up <= beyond[1])
        upright = name in ("serial a", "serial b")
        if not seen.any() and not upright:
            continue
        ends += [] if upright else [float(up[seen].min()), float(up[seen].max())]
        label = None if kind in told else words
        told.add(kind)
        axis.plot(across, up, color=colour, ls=dashes, lw=1.6, label=label, zorder=3)
    for scale, least, most in ((axis.set_xlim, left, right), (axis.set_ylim, min(ends), max(ends))):
        room = 0.06 * (most - least)
        scale(least - room, most + room)


def _draw_path(axis: Axes, motion: Motion, across: int, up: int) -> None:
    factor = np.array([1e3, 1e3, 180 / np.pi])
    path = motion.pose * factor
    axis.plot(path[:, across], path[:, up], color="white", lw=3.2, zorder=4, solid_capstyle="round")
    axis.plot(path[:, across], path[:, up], color=_PATH, lw=1.6, zorder=5, label="path")
    axis.plot(*path[0, [across, up]], "o", ms=5, mfc="white", mec=_PATH, zorder=6)


def _draw_box(axis: Axes, y: tuple[float, float], theta: tuple[float, float]) -> None:
    left, right = (1e3 * v for v in y)
    low, high = (math.degrees(v) for v in theta)
    corners = [left, right, right, left, left], [low, low, high, high, low]
    axis.plot(*corners, color=_BOX, lw=1.6, ls="-.", zorder=4, label="largest box")


def _legend(figure: Figure, axis: Axes) -> None:
    handles, labels = axis.get_legend_handles_labels()
    figure.legend(handles, labels, loc=above(figure), ncols=4, frameon=False, fontsize=9)


def _slice(
    workspace: Workspace, kind: str, value: float, name: str, count: int, options: dict[str, Any]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return y [mm], the ends of z [mm] or θ [deg], and values of a slice; a grid of quadrilaterals for z."""
    points = workspace.points
    y = np.linspace(points.y.min(), points.y.max(), count)
    if kind == "theta":
        across, turned = np.broadcast_arrays(y, value)
        least, most = workspace.z_range(across, turned)
        inside, up = np.isfinite(least), 1e3 * np.stack([least, most])
    else:
        turned_axis = np.linspace(points.theta.min(), points.theta.max(), count)
        across, turned = np.meshgrid(y, turned_axis, indexing="ij")
        least, most = workspace.z_range(across, turned)
        inside = (least <= value) & (value <= most)
        up = np.degrees(turned_axis)
    poses = np.stack([across, 0 * across, turned], axis=-1)
    found = workspace.indices(poses, **options)
    values = np.where(inside, columns_of(found, (name,))[name], np.nan)
    if kind == "theta":
        return _between(1e3 * y, up, values)
    return 1e3 * y, np.asarray(up), values.T


def _between(
    y: FloatArray, ends: FloatArray, values: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a slice as a strip of quadrilaterals from its first to its last y; gaps have no values."""
    known = np.flatnonzero(np.isfinite(values))
    if not len(known):
        return np.empty((2, 0)), np.empty((2, 0)), np.empty((2, 0))
    strip = slice(known[0], known[-1] + 1)
    up = np.stack([np.interp(y[strip], y[known], row[known]) for row in ends])
    return np.tile(y[strip], (2, 1)), up, np.tile(values[strip], (2, 1))
