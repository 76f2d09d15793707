"""Where the panels of a figure go: there is room for ticks, labels, titles and legends, measured once."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.axis import Axis, YAxis
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.layout_engine import LayoutEngine
from matplotlib.text import Text

from p3dof._base.checks import FloatArray

_BORDER, _GAP, _PAD = 0.05, 0.12, 4.0
"""Around the figure and between panels [in], and between ticks and labels [points]."""


@dataclass
class Room:
    """What is needed on the sides of a panel [in]."""

    left: float = 0.6  # for all that belongs to it
    right: float = 0.2
    bottom: float = 0.25
    top: float = 0.25
    ticks: dict[str, float] = field(default_factory=dict)
    """For ticks and their labels alone, by side: names of axes stand behind them."""


class Panels(LayoutEngine):
    """Puts the panels of one grid into a figure, names of axes aligned by columns.

    The constrained layout of matplotlib measures every panel several times each time that a figure is drawn.
    """

    _adjust_compatible = False
    _colorbar_gridspec = True

    def execute(self, fig: Figure) -> None:
        """Place the panels."""
        panels = [axis for axis in fig.axes if axis.get_subplotspec() is not None]
        if not panels:
            return
        renderer = RendererAgg(16, 16, fig.dpi)  # type: ignore[no-untyped-call]
        head = _head(fig, renderer)
        _place(fig, panels, [Room() for _ in panels], head)  # near enough to know the ticks
        rooms = [_room_of(axis, renderer) for axis in panels]
        _place(fig, panels, rooms, head)
        rooms = [_room_of(axis, renderer) for axis in panels]  # in its new size a panel may have other ticks
        _place(fig, panels, rooms, head)
        _name_axes(fig, panels, rooms)


def _head(fig: Figure, renderer: Any) -> float:
    """Put the figure's own title and legends at its top, and return their height [in]."""
    height = 0.0
    for text in fig.texts:
        text.set_y(1 - _BORDER / fig.get_figheight())
        text.set_verticalalignment("top")
        height += text.get_window_extent(renderer).height / fig.dpi + _GAP / 2
    for legend in fig.legends:
        height += legend.get_window_extent(renderer).height / fig.dpi + _GAP / 2
    return height


def _room_of(axis: Axes, renderer: Any) -> Room:
    """Measure what stands around a panel."""
    dpi, box = renderer.dpi, axis.get_window_extent(renderer)
    room = Room(0.0, 0.0, 0.0, 0.0)
    outside = [child for child in axis.get_children() if isinstance(child, Text) and _is_title(child)]
    legend = axis.get_legend()
    for artist in (*outside, *([] if legend is None else [legend])):
        extent = artist.get_window_extent(renderer)
        room.left = max(room.left, (box.x0 - extent.x0) / dpi)
        room.right = max(room.right, (extent.x1 - box.x1) / dpi)
        room.top = max(room.top, (extent.y1 - box.y1) / dpi)
    if axis.axison:
        _add_ticks(room, axis, renderer)
    return room


def _add_ticks(room: Room, axis: Axes, renderer: Any) -> None:
    """Add the ticks of a panel and the names of its axes."""
    sizes = np.array([axis.get_window_extent(renderer).width, axis.get_window_extent(renderer).height])
    wide = float(sizes[0]) / renderer.dpi
    labels = _Labels(axis.yaxis, renderer)
    side = "right" if labels.shown("right", False) else "left"
    if labels.widths:
        room.ticks[side] = labels.away + max(labels.widths)
        room.top = max(room.top, labels.height / 2, 1.5 * labels.height if labels.offset else 0.0)
        room.bottom = max(room.bottom, labels.height / 2)
    named = _thickness(axis.yaxis.label, renderer)
    room.left = max(room.left, room.ticks.get("left", 0.0) + named)
    room.right = max(room.right, room.ticks.get("right", 0.0))
    labels = _Labels(axis.xaxis, renderer)
    if labels.widths and labels.shown("bottom", True):
        room.ticks["bottom"] = labels.away + labels.height
        room.right = max(room.right, labels.widths[-1] / 2 - (1 - labels.places[-1]) * wide)
    below = room.ticks.get("bottom", 0.0) + _thickness(axis.xaxis.label, renderer)
    room.bottom = max(room.bottom, below)


class _Labels:
    """The labels of an axis' ticks, without drawing any."""

    def __init__(self, axis: Axis, renderer: Any) -> None:
        self._settings = axis.get_tick_params()
        direction = "ytick" if isinstance(axis, YAxis) else "xtick"
        size = self._settings.get("labelsize", rcParams[f"{direction}.labelsize"])
        font = FontProperties(size=size)
        self.height = font.get_size_in_points() / 72
        self.away = (rcParams[f"{direction}.major.size"] + rcParams[f"{direction}.major.pad"]) / 72
        low, high = sorted(axis.get_view_interval())
        places = (
            [place for place in axis.get_majorticklocs() if low <= place <= high]
            if axis.get_visible()
            else []
        )
        self.places = [(place - low) / (high - low) for place in places]
        formatter = axis.get_major_formatter()
        texts = formatter.format_ticks(places)
        self.widths = [
            renderer.get_text_width_height_descent(text, font, "$" in text)[0] / renderer.dpi
            for text in texts
        ]
        self.offset: str = formatter.get_offset()

    def shown(self, side: str, default: bool) -> bool:
        """Whether the labels stand on a side."""
        return bool(self._settings.get(f"label{side}", default))


def _is_title(text: Text) -> bool:
    return bool(text.get_text()) and text.get_position()[1] >= 1


def _thickness(label: Text, renderer: Any) -> float:
    """Return the room for the name of an axis with its distance from the ticks [in]."""
    if not label.get_text():
        return 0.0
    extent = label.get_window_extent(renderer)
    return min(float(extent.width), float(extent.height)) / float(renderer.dpi) + _PAD / 72


def _place(fig: Figure, panels: list[Axes], rooms: list[Room], head: float) -> None:
    """Set the panels' positions: what is left beside all rooms is shared as their grid says."""
    grid = panels[0].get_subplotspec().get_gridspec()  # type: ignore[union-attr]  # they have one
    rows, columns = grid.get_geometry()
    before, after = np.zeros(columns), np.zeros(columns)
    above, below = np.zeros(rows), np.zeros(rows)
    for axis, room in zip(panels, rooms, strict=True):
        row, column = _cell(axis)
        before[column], after[column] = max(before[column], room.left), max(after[column], room.right)
        above[row], below[row] = max(above[row], room.top), max(below[row], room.bottom)
    wide, high = fig.get_size_inches()
    above[0] += head
    left, width = _shares(wide, before, after, grid.get_width_ratios())
    top, height = _shares(high, above, below, grid.get_height_ratios())
    for axis in panels:
        row, column = _cell(axis)
        bottom = high - top[row] - height[row]
        axis.set_position((left[column] / wide, bottom / high, width[column] / wide, height[row] / high))
        axis.set_in_layout(True)  # also in a notebook, which cuts the figure to what is in it


def _cell(axis: Axes) -> tuple[int, int]:
    place = axis.get_subplotspec()
    assert place is not None  # noqa: S101 - others are left out
    return place.rowspan.start, place.colspan.start


def _shares(
    whole: float, before: FloatArray, after: FloatArray, ratios: Any
) -> tuple[FloatArray, FloatArray]:
    """Return where panels begin along one direction, and how long they are [in]."""
    weights = np.asarray(ratios, dtype=float)
    free = whole - 2 * _BORDER - _GAP * (len(weights) - 1) - float(before.sum() + after.sum())
    lengths = max(free, 0.1 * whole) * weights / weights.sum()
    used = np.concatenate([[0.0], np.cumsum(before + lengths + after + _GAP)[:-1]])
    return _BORDER + used + before, lengths


def _name_axes(fig: Figure, panels: list[Axes], rooms: list[Room]) -> None:
    """Put the names of axes behind their ticks, for good: no drawing looks for their places again."""
    widest: dict[int, float] = {}
    for axis, room in zip(panels, rooms, strict=True):
        _, column = _cell(axis)
        widest[column] = max(widest.get(column, 0.0), room.ticks.get("left", 0.0))
    for axis, room in zip(panels, rooms, strict=True):
        wide, high = fig.get_size_inches() * [axis.get_position().width, axis.get_position().height]
        axis.yaxis.set_label_coords(-(widest[_cell(axis)[1]] + _PAD / 72) / wide, 0.5)
        axis.xaxis.set_label_coords(0.5, -(room.ticks.get("bottom", 0.0) + _PAD / 72) / high)
