"""A sheet of views at one scale, with dimensions and labels that keep out of each other's way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from p3dof._base.checks import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Rectangle: TypeAlias = tuple[float, float, float, float]
"""Left, bottom, width and height [in]."""

_WIDEST, _HIGHEST = 12.0, 8.6
"""What the sheet may measure [in]: a page across."""

_MARGIN, _HEAD = 0.62, 0.3
"""Room around a view for labels and dimensions, and for its title [in]."""

_PANEL = 3.2
"""Least width of the column with the notes [in]."""

_FONT = 10.5

_ANGLES = np.linspace(0, 2 * np.pi, 24, endpoint=False)
_WAYS = np.tile(np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)]), (3, 1))
_AWAY = np.repeat([0.0, 5.0, 11.0], len(_ANGLES))[:, None]
"""Where a label may stand: directions from its point, and how much farther than it must [points]."""

_SHORTEST = 8.0
"""Shortest length that gets a dimension line [points]."""


class Sheet:
    """Front and side view side by side, the top view below the front, the oblique one at the right.

    Parameters
    ----------
    front, side, top, oblique : ndarray, shape (2, 2)
        Lowest and highest corner of what each shows [m].

    Attributes
    ----------
    size : tuple of float
        Width and height [in].
    places : tuple of Rectangle
        Of the views, as shares of the size; without their margins.
    panel : Rectangle
        Where there is room for notes, likewise.
    extents : tuple of ndarray
        As given.
    """

    def __init__(self, front: FloatArray, side: FloatArray, top: FloatArray, oblique: FloatArray) -> None:
        self.extents = (front, side, top, oblique)
        (fw, fh), (sw, _), (_, th), (ow, oh) = (np.ptp(extent, axis=0) for extent in self.extents)
        room = 2 * _MARGIN
        wide, high = _WIDEST - 3 * room, _HIGHEST - 2 * (room + _HEAD)
        self.scale = float(min(wide / (fw + sw + ow), high / (fh + th)))  # inches a metre
        s = self.scale
        column = max(s * sw + room, _PANEL)
        rows = s * th + room + _HEAD, s * fh + room + _HEAD
        largest = min((sum(rows) - room - _HEAD) / oh, 1.5 * s)
        width = s * fw + room + column + largest * ow + room
        self.size = (width, sum(rows))
        middle = sum(rows) / 2 - (largest * oh + _HEAD) / 2
        self.scales = (s, s, s, largest)
        boxes = (
            (_MARGIN, rows[0] + _MARGIN, s * fw, s * fh),
            (s * fw + room + _MARGIN, rows[0] + _MARGIN, s * sw, s * fh),
            (_MARGIN, _MARGIN, s * fw, s * th),
            (s * fw + room + column + _MARGIN, middle, largest * ow, largest * oh),
        )
        self.places = tuple(self._share(box) for box in boxes)
        self.panel = self._share((s * fw + room + 0.1, 0.15, column - 0.2, rows[0] - _HEAD))
        self._taken: dict[Axes, list[FloatArray]] = {}
        self._written: dict[Axes, list[tuple[FloatArray, FloatArray]]] = {}

    def _share(self, box: Rectangle) -> Rectangle:
        (left, bottom, width, height), (w, h) = box, self.size
        return left / w, bottom / h, width / w, height / h

    def new_axis(self, figure: Figure, place: Rectangle) -> Axes:
        """Return empty axes for a view: no frame, no ticks, one unit of the page a metre."""
        extent = self.extents[self.places.index(place)]
        axis = figure.add_axes(place)
        axis.set(xlim=extent[:, 0], ylim=extent[:, 1])
        axis.set_autoscale_on(False)
        axis.set_axis_off()
        self._taken[axis], self._written[axis] = [], []
        return axis

    @property
    def above(self) -> float:
        """How far above a view its title is [points]."""
        return 72 * _MARGIN

    def arrow(self, axis: Axes, start: FloatArray, end: FloatArray, text: str) -> None:
        """Draw an arrow [m] with a text beside its tip."""
        _draw_arrow(axis, start, end, arrowstyle="-|>,head_width=0.2,head_length=0.45", lw=1.3, color="0.1")
        self._taken[axis].append(between(start, end, 60))
        along = (end - start) / np.linalg.norm(end - start)
        self.write_beside(axis, end, 0.4 * along + np.array([-along[1], along[0]]), text)

    def write_beside(self, axis: Axes, place: FloatArray, way: FloatArray, text: str) -> None:
        """Write a short text a little away from a point [m]."""
        middle = place + 9 * way / np.linalg.norm(way) / self._points(axis)
        _write(axis, middle, text, size=10)
        self._written[axis].append((self._points(axis) * middle, np.array([7.0, 7.0])))

    @staticmethod
    def dense(outline: FloatArray) -> FloatArray:
        """Return more points on the edges of a polygon, shape (10 n, 2)."""
        shares = np.linspace(0, 1, 10, endpoint=False)[:, None, None]
        return np.asarray((outline + shares * (np.roll(outline, -1, axis=0) - outline)).reshape(-1, 2))

    def dimension(
        self,
        axis: Axes,
        start: Any,
        end: Any,
        offset: float,
        name: str,
        length: float,
        origins: tuple[Any, Any] | None = None,
    ) -> None:
        """Draw a dimension line beside a length, unless it is too short for one.

        Parameters
        ----------
        axis : matplotlib.axes.Axes
            The view.
        start, end : array-like, shape (2,)
            The ends of the length [m].
        offset : float
            How far to the left of the way from start to end the line is [points].
        name : str
            What the length is called, in TeX.
        length : float
            The length [m].
        origins : tuple of array-like, optional
            Where the thin lines to its ends begin; at start and end by default.
        """
        a, b = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
        points = self._points(axis) * float(np.linalg.norm(b - a))
        if points < _SHORTEST:
            return
        along = (b - a) / np.linalg.norm(b - a)
        aside = np.array([-along[1], along[0]])
        shift = aside * offset / self._points(axis)
        thin: dict[str, Any] = {"color": "0.45", "lw": 0.6, "zorder": 6, "clip_on": False}
        for origin, tip in zip(origins or (a, b), (a + shift, b + shift), strict=True):
            axis.plot(*np.transpose([origin, tip + 0.15 * shift]), **thin)
        style = "<|-|>,head_width=0.13,head_length=0.35"
        _draw_arrow(axis, a + shift, b + shift, arrowstyle=style, lw=0.8, color="0.25")
        angle = 90 - (90 - np.degrees(np.arctan2(along[1], along[0]))) % 180
        words = f"${name}$ = {1e3 * length:.1f}".removesuffix(".0")
        middle = (a + b) / 2 + shift
        short = points < 6 * len(words)
        if short:  # the text does not fit between the arrows
            middle = middle + np.sign(offset) * aside * 9 / self._points(axis)
        pad = None if short else {"facecolor": "white", "edgecolor": "none", "pad": 1}
        _write(axis, middle, words, size=10, rotation=float(angle), rotation_mode="anchor", bbox=pad)
        reach = 3.0 * len(words) * np.abs(along) + 6.0 * np.abs(aside)
        self._written[axis].append((self._points(axis) * middle, reach))
        self._taken[axis].append(between(a + shift, b + shift, 30))

    def labels(
        self, axis: Axes, texts: Mapping[tuple[float, float], str], obstacles: Sequence[FloatArray]
    ) -> None:
        """Write texts beside points, where they cover least.

        Parameters
        ----------
        axis : matplotlib.axes.Axes
            The view.
        texts : mapping of tuple of float to str
            The texts by their points [m].
        obstacles : sequence of ndarray, shape (n, 2)
            Points on lines that should stay free [m].
        """
        unit = self._points(axis)
        lines = unit * np.concatenate([*obstacles, *self._taken[axis]])
        marks = unit * np.array(list(texts))
        boxes = self._written[axis]
        for text, mark in zip(texts.values(), marks, strict=True):
            half = np.array([3.3 * len(text.replace("$", "").replace("_", "")) + 1, 6.5])
            middles = mark + _WAYS * (7 + _AWAY) + np.sign(np.round(_WAYS, 6)) * half * np.abs(_WAYS)
            costs = 0.6 * _AWAY[:, 0] + self._covered(middles, half, lines, 1.0)
            costs += self._covered(middles, half + 4, marks, 8.0)
            nearer = _distances(marks, middles) < np.linalg.norm(mark - middles, axis=-1)[:, None]
            costs += 20.0 * nearer.any(axis=-1)  # the label would seem to belong to another point
            for one, size in boxes:
                costs += 60.0 * np.all(np.abs(one - middles) < size + half, axis=-1)
            best = middles[int(np.argmax(costs < costs.min() + 1e-9))]
            boxes.append((best, half))
            _write(axis, best / unit, text)

    def _points(self, axis: Axes) -> float:
        """Return the scale of a view [points/m]."""
        return 72 * self.scales[list(self._taken).index(axis)]

    @staticmethod
    def _covered(middles: FloatArray, half: FloatArray, points: FloatArray, weight: float) -> FloatArray:
        """Return the weight of the points under a label at each of its places."""
        near = np.abs(points[:, 0] - middles[:, None, 0]) < half[0]
        near &= np.abs(points[:, 1] - middles[:, None, 1]) < half[1]
        return np.asarray(weight * near.sum(axis=-1))


def _distances(points: FloatArray, places: FloatArray) -> FloatArray:
    """Return how far each point is from each place, shape (places, points)."""
    return np.asarray(np.linalg.norm(points - places[:, None], axis=-1))


def between(start: FloatArray, end: FloatArray, count: int) -> FloatArray:
    """Return evenly spaced points between two, shape (count, 2)."""
    return np.asarray(np.linspace(start, end, count), dtype=np.float64)


def _draw_arrow(axis: Axes, start: FloatArray, end: FloatArray, **style: Any) -> None:
    tip, foot = (float(end[0]), float(end[1])), (float(start[0]), float(start[1]))
    arrow = {"shrinkA": 0, "shrinkB": 0, **style}
    axis.annotate("", tip, foot, arrowprops=arrow, annotation_clip=False, zorder=6)


def _write(axis: Axes, place: FloatArray, words: str, size: float = _FONT, **style: Any) -> None:
    """Write around a point, with a white edge against the lines behind."""
    from matplotlib.patheffects import withStroke

    halo = [withStroke(linewidth=2.5, foreground="white")]
    style |= {"ha": "center", "va": "center", "fontsize": size, "path_effects": halo}
    axis.text(float(place[0]), float(place[1]), words, zorder=7, clip_on=False, **style)
