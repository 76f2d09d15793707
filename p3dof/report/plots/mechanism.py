"""The drawing of the mechanism: front, side and top at one scale, and an oblique view."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, frozen_array, require
from p3dof.analysis.reactions import JOINTS
from p3dof.machine.description import Box, Cylinder, Link, Mechanism, Solid, Sphere
from p3dof.machine.motion import Motion
from p3dof.machine.motion.core import require_motion
from p3dof.machine.parameters import PLATFORM
from p3dof.manipulator import Manipulator
from p3dof.report.plots.common import new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Rectangle: TypeAlias = tuple[float, float, float, float]  # left, bottom, width and height [in]

_WIDEST, _HIGHEST = 12.0, 8.6  # what the sheet may measure [in]: a page across

_MARGIN, _HEAD = 0.62, 0.3  # room around a view for labels and dimensions, and for its title [in]

_PANEL = 3.2  # least width of the column with the notes [in]

_FONT = 10.5

_ANGLES = np.linspace(0, 2 * np.pi, 24, endpoint=False)
_WAYS = np.tile(np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)]), (3, 1))
_AWAY = np.repeat([0.0, 5.0, 11.0], len(_ANGLES))[:, None]
"""Where a label may stand: directions from its point, and how much farther than it must [points]."""

_SHORTEST = 8.0  # shortest length that gets a dimension line [points]


class Sheet:
    """Front and side view side by side, the top view below the front, the oblique one at the right."""

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
        """Draw a dimension line beside a length, unless it is too short for one."""
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
        """Write texts beside points, where they cover least."""
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
    """Write around a point, on a veil over the lines behind."""
    style = {"bbox": _VEIL} | {name: value for name, value in style.items() if value is not None}
    style |= {"ha": "center", "va": "center", "fontsize": size}
    axis.text(float(place[0]), float(place[1]), words, zorder=7, clip_on=False, **style)


_VEIL = {"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "boxstyle": "round,pad=0.05"}
"""Behind what is written: an outline of each letter would be drawn as long as all else."""

_LIGHT = np.array([0.25, 0.35, 0.9])
"""Where the light comes from, as seen by the viewer: shares of right, up and toward him."""

_ROUND = 36  # corners of the polygon that stands for a circle


@dataclass(frozen=True, eq=False)
class View:
    """A parallel projection."""

    name: str  # what it is called
    right: FloatArray
    """(3,): perpendicular unit vectors of the page, in the fixed frame; right × up points to the viewer."""
    up: FloatArray

    @classmethod
    def oblique(cls, name: str, azimuth: float, elevation: float) -> View:
        """Return the view from an azimuth (from +x0 toward +y0) and an elevation [rad]."""
        c, s = np.cos(azimuth), np.sin(azimuth)
        right = np.array([-s, c, 0.0])
        toward = np.array([np.cos(elevation) * c, np.cos(elevation) * s, np.sin(elevation)])
        return cls(name, right, np.cross(toward, right))

    @property
    def toward(self) -> FloatArray:
        """Unit vector to the viewer, shape (3,)."""
        return np.asarray(np.cross(self.right, self.up), dtype=np.float64)

    def project(self, points: FloatArray) -> FloatArray:
        """Return points of the fixed frame, (..., 3), on the page, (..., 2) [m]."""
        return np.asarray(points @ np.stack([self.right, self.up], axis=-1))


@dataclass(frozen=True, eq=False)
class Prism:
    """A solid with two equal parallel faces: a box, a bar or the platform."""

    outline: FloatArray  # (n, 2): convex, counter-clockwise, in its own x and y [m]
    thickness: float  # along its own z, half of it on each side [m]
    position: FloatArray  # (3,): its middle and its axes, in the fixed frame
    rotation: FloatArray
    rgb: tuple[float, float, float]  # its colour

    @property
    def caps(self) -> FloatArray:
        """Corners of the two faces, the upper one first, shape (2, n, 3) [m]."""
        flat = np.column_stack([self.outline, np.zeros(len(self.outline))])
        half = np.array([0.0, 0.0, self.thickness / 2])
        return np.stack([self.position + (flat + side * half) @ self.rotation.T for side in (1, -1)])

    @property
    def edged(self) -> bool:
        """Whether its sides meet at edges that can be seen."""
        return len(self.outline) <= 4

    def silhouette(self, view: View) -> FloatArray:
        """Return its outline on the page, shape (k, 2) [m]."""
        return hull(view.project(self.caps).reshape(-1, 2))

    def faces(self, view: View) -> list[tuple[FloatArray, tuple[float, float, float]]]:
        """Return the polygons [m] that the viewer sees, with red, green and blue in his light."""
        upper, lower = self.caps
        sides = np.roll(self.outline, -1, axis=0) - self.outline
        normals = np.column_stack([sides[:, 1], -sides[:, 0], np.zeros(len(sides))])
        normals = normals / np.linalg.norm(normals, axis=-1, keepdims=True) @ self.rotation.T
        quads = np.stack([upper, lower, np.roll(lower, -1, axis=0), np.roll(upper, -1, axis=0)], axis=1)
        axis = self.rotation[:, 2]
        polygons = [(upper, axis), (lower, -axis), *zip(quads, normals, strict=True)]
        seen = [(corners, normal) for corners, normal in polygons if normal @ view.toward > 1e-6]
        return [(view.project(corners), _lit(self.rgb, normal, view)) for corners, normal in seen]


@dataclass(frozen=True, eq=False)
class Ball:
    """A ball: its middle in the fixed frame, its radius [m] and its colour."""

    position: FloatArray
    radius: float
    rgb: tuple[float, float, float]

    edged = False

    def silhouette(self, view: View) -> FloatArray:
        """Return its outline on the page, shape (n, 2) [m]."""
        return np.asarray(view.project(self.position) + _circle(self.radius))

    def faces(self, view: View) -> list[tuple[FloatArray, tuple[float, float, float]]]:
        """Return what the viewer sees: a disc, see `Prism.faces`."""
        return [(self.silhouette(view), _lit(self.rgb, view.toward, view))]


def link_frames(
    mechanism: Mechanism, joints: Mapping[str, float]
) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Return position (3,) [m] and rotation (3, 3) of every link in the root's frame, from the joints'."""
    frames: dict[str, tuple[FloatArray, FloatArray]] = {mechanism.links[0].name: (np.zeros(3), np.eye(3))}
    for joint in mechanism.joints:
        position, rotation = frames[joint.parent]
        position = position + rotation @ joint.placement.position
        rotation = rotation @ joint.placement.rotation
        if joint.axis is not None and joint.kind == "prismatic":
            position = position + rotation @ joint.axis * joints[joint.name]
        elif joint.axis is not None:
            rotation = rotation @ _turn(joint.axis, joints[joint.name])
        frames[joint.child] = (position, rotation)
    return frames


def solids_of(link: Link, position: FloatArray, rotation: FloatArray) -> list[Prism | Ball]:
    """Return the visible solids of a link that stands somewhere; the platform's slabs as the one plate."""
    if link.name == "platform":
        return [_plate(link.visuals, position, rotation)]
    return [_placed(solid, position, rotation) for solid in link.visuals]


def hull(points: FloatArray) -> FloatArray:
    """Return the convex hull of points, counter-clockwise (Andrew's monotone chain)."""
    ordered = sorted(set(map(tuple, np.round(points, 12).tolist())))

    def half(candidates: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
        chain: list[tuple[float, float]] = []
        for x, y in candidates:
            while len(chain) > 1:
                (x0, y0), (x1, y1) = chain[-2:]
                if (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > 0:
                    break
                chain.pop()
            chain.append((x, y))
        return chain[:-1]

    return np.array(half(ordered) + half(reversed(ordered)))


def _placed(solid: Solid, position: FloatArray, rotation: FloatArray) -> Prism | Ball:
    where = position + rotation @ solid.placement.position
    red, green, blue, _ = solid.colour.rgba
    if isinstance(solid.shape, Sphere):
        return Ball(where, solid.shape.radius, (red, green, blue))
    outline, thickness = _outline(solid.shape)
    return Prism(outline, thickness, where, rotation @ solid.placement.rotation, (red, green, blue))


def _plate(slabs: tuple[Solid, ...], position: FloatArray, rotation: FloatArray) -> Prism:
    """Return the convex plate that slabs of equal thickness in one plane make."""
    corners, thickness = [], 0.0
    for slab in slabs:
        if not isinstance(slab.shape, Sphere):
            outline, thickness = _outline(slab.shape)
            corners.append(outline @ slab.placement.rotation[:2, :2].T + slab.placement.position[:2])
    red, green, blue, _ = slabs[0].colour.rgba
    return Prism(hull(np.concatenate(corners)), thickness, position, rotation, (red, green, blue))


def _outline(shape: Box | Cylinder) -> tuple[FloatArray, float]:
    """Return the face of a solid across its own z, and its length along it."""
    if isinstance(shape, Cylinder):
        return _circle(shape.radius), shape.length
    x, y, z = shape.size
    return np.array([[-x, -y], [x, -y], [x, y], [-x, y]]) / 2, z


def _circle(radius: float) -> FloatArray:
    angles = np.linspace(0, 2 * np.pi, _ROUND, endpoint=False)
    return np.asarray(radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1))


def _turn(axis: FloatArray, angle: float) -> FloatArray:
    """Return the rotation about a unit vector (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


def _lit(rgb: tuple[float, float, float], normal: FloatArray, view: View) -> tuple[float, float, float]:
    """Return the colour of a face in the viewer's light, pale enough for print to show lines on it."""
    light = _LIGHT @ np.stack([view.right, view.up, view.toward]) / np.linalg.norm(_LIGHT)
    share = 0.55 + 0.45 * max(0.0, float(normal @ light))
    red, green, blue = (1 - 0.8 * (1 - share * part) for part in rgb)
    return red, green, blue


_X, _Y, _Z = np.eye(3)
FRONT, SIDE, TOP = View("front", _Y, _Z), View("side", _X, _Z), View("top", _Y, -_X)
OBLIQUE = View.oblique("oblique", np.radians(-38), np.radians(20))
VIEWS = {
    FRONT: "front, seen from $+x_0$",
    SIDE: "side, seen from $-y_0$",
    TOP: "top, seen from $+z_0$",
    OBLIQUE: "oblique",
}
"""The views in the order of the figure's axes, with their titles."""


def _frames(*names: str) -> dict[str, str]:
    """Return where joints are drawn, by their labels as formulas: at the origins of these frames."""
    return {f"{joint.label[0]}_{joint.label[1:]}": joint.frame for joint in JOINTS if joint.name in names}


UNIVERSAL = _frames("loop_a", "loop_b")
SLIDES = _frames(*(joint.name for joint in JOINTS if joint.axis == "z"))
HINGES = _frames(
    *(joint.name for joint in JOINTS if joint.axis == "y" and joint.name not in ("loop_a", "loop_b"))
)

_TRIANGLE, _PARALLELOGRAM = ("A_3", "B_3", "C_5", "A_3"), ("C_3", "C_4", "C_7", "C_6", "C_3")
_LINES = (("A_2", "A_3"), ("B_2", "B_3"), *pairwise(_TRIANGLE), *pairwise(_PARALLELOGRAM))
_TRACE = "#aa3377"


@dataclass(frozen=True, eq=False)
class Scene:
    """The mechanism at a pose."""

    solids: list[tuple[bool, Prism | Ball]]  # all visible solids, and whether they belong to the base
    points: dict[str, FloatArray]  # (3,): the joints by the paper's names, and P [m]
    trace: FloatArray  # (N, 3): where P passes [m]; empty without a motion


def mechanism_figure(
    robot: Manipulator,
    pose: ArrayLike = (0.0, 0.0, 0.0),
    motion: Motion | None = None,
    dimensions: bool = True,
) -> Figure:
    """Draw the mechanism by `VIEWS` [m], from front, side and top at one scale, and at an angle.

    The joints have the labels of `p3dof.analysis.reactions.JOINTS`: the paper's names, but for C7, which the
    paper does not name. Guides and their beams are drawn behind everything else, so that they hide
    nothing.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    pose : array-like, shape (3,)
        Of the platform: (y, z, θ) [m, m, rad].
    motion : Motion, optional
        Draw the path of P over this motion too.
    dimensions : bool
        Whether to draw dimensions [mm].

    Raises
    ------
    ReachError
        If the pose is out of reach.
    InputError, MissingExtraError
        If an argument does not fit; if matplotlib is not installed.
    """
    require("robot", robot, Manipulator)
    if motion is not None:
        require_motion(motion)
    pose = frozen_array("pose", pose, (3,))
    scene = _scene(robot, pose, motion)
    sheet = Sheet(*(_extent(scene, view) for view in VIEWS))
    figure = new_figure(sheet.size)
    figure.set_layout_engine("none")
    for (view, title), place in zip(VIEWS.items(), sheet.places, strict=True):
        axis = sheet.new_axis(figure, place)
        axis.set_title(title, fontsize=11, loc="left", pad=sheet.above)
        _draw(axis, scene, view)
        _draw_axes(axis, sheet, scene, view)
    panel = figure.add_axes(sheet.panel)
    panel.set_axis_off()
    _write_notes(panel, robot, pose, len(scene.trace) > 0)
    if dimensions:
        _dimension_all(figure, sheet, robot, scene)
    for axis, view in zip(figure.axes, VIEWS, strict=False):
        _label(axis, sheet, scene, view)
    return figure


def _scene(robot: Manipulator, pose: FloatArray, motion: Motion | None) -> Scene:
    joints = {name: float(value) for name, value in robot.inverse_kinematics(pose).joints.items()}
    mechanism = robot.mechanism
    frames = link_frames(mechanism, joints)
    solids = [
        (link is mechanism.links[0], solid)
        for link in mechanism.links
        if link.visuals
        for solid in solids_of(link, *frames[link.name])
    ]
    named = {**SLIDES, **HINGES, **UNIVERSAL, "P": PLATFORM}
    points = {name: frames[link][0] for name, link in named.items()}
    trace: FloatArray = np.zeros((0, 3))
    if motion is not None:
        y, z = motion.pose[:, 0], motion.pose[:, 1] - robot.parameters.geometry.h
        trace = np.column_stack([np.zeros(len(motion)), y, z])
    return Scene(solids, points, trace)


def _extent(scene: Scene, view: View) -> FloatArray:
    """Return the lowest and highest corner of what a view shows, shape (2, 2) [m]."""
    corners = [solid.silhouette(view) for _, solid in scene.solids] + [view.project(scene.trace)]
    everything = np.concatenate(corners)
    return np.stack([everything.min(axis=0), everything.max(axis=0)])


def _draw(axis: Axes, scene: Scene, view: View) -> None:
    """Draw solids from back to front, then what must be seen: triangle, path, joints, axes."""
    from matplotlib.collections import PolyCollection

    depth = [(not base, float(solid.position @ view.toward)) for base, solid in scene.solids]
    for rank, index in enumerate(sorted(range(len(depth)), key=depth.__getitem__)):
        base, solid = scene.solids[index]
        line: dict[str, Any] = {"edgecolors": "0.55" if base else "0.2", "linewidths": 0.5 if base else 0.7}
        corners, colours = zip(*solid.faces(view), strict=True)
        seams: dict[str, Any] = line if solid.edged else {"edgecolors": colours, "linewidths": 0.4}
        outline = [solid.silhouette(view)]
        axis.add_collection(
            PolyCollection(corners, facecolors=colours, zorder=1 + 0.01 * rank, clip_on=False, **seams)
        )
        axis.add_collection(
            PolyCollection(outline, facecolors="none", zorder=1.005 + 0.01 * rank, clip_on=False, **line)
        )
    points = {name: view.project(point) for name, point in scene.points.items()}
    for corners, dashes in ((_TRIANGLE, "-"), (_PARALLELOGRAM, "--")):
        axis.plot(*np.transpose([points[name] for name in corners]), color="0.1", lw=1.1, ls=dashes, zorder=4)
    if len(scene.trace):
        path = view.project(scene.trace)
        axis.plot(*path.T, color=_TRACE, lw=1.6, zorder=4.5, gid=f"{view.name}-trace", clip_on=False)
        axis.plot(*path[-1], "D", color=_TRACE, ms=4.5, mec="white", mew=0.6, zorder=4.6, clip_on=False)
    symbols: dict[str, dict[str, Any]] = {
        **{name: {"marker": "o", "ms": 6.5} for name in HINGES},
        **{name: {"marker": "X", "ms": 8.5} for name in UNIVERSAL},
        "P": {"marker": "P", "ms": 7.5, "mfc": "0.1", "mec": "white", "mew": 0.8},
    }
    for name, symbol in symbols.items():
        style = {"mfc": "white", "mec": "0.1", "mew": 1.1, **symbol}
        axis.plot(*points[name], ls="", zorder=5, gid=f"{view.name}-{name}", clip_on=False, **style)


def _draw_axes(axis: Axes, sheet: Sheet, scene: Scene, view: View) -> None:
    """Draw the fixed frame at O: arrows on the page, a dot or a cross for the axis across it."""
    length = 0.32 * float(np.abs(scene.points["A_1"][1]))
    for name, direction in zip("xyz", np.eye(3), strict=True):
        tip = length * view.project(direction)
        if np.linalg.norm(tip) > 0.05 * length:
            sheet.arrow(axis, np.zeros(2), tip, f"${name}_0$")
        else:
            ahead = bool(direction @ view.toward > 0)
            axis.plot(0, 0, "o", ms=8, mfc="white", mec="0.1", mew=1.2, zorder=6.1)
            axis.plot(0, 0, "." if ahead else "x", ms=5, color="0.1", zorder=6.2)
            sheet.write_beside(axis, np.zeros(2), np.array([-1.0, -1.0]), f"${name}_0$")


def _dimension_all(figure: Figure, sheet: Sheet, robot: Manipulator, scene: Scene) -> None:
    """Draw the lengths that a view shows as they are, at any pose."""
    geometry = robot.parameters.geometry
    front, side, top = figure.axes[:3]
    a, b = (FRONT.project(scene.points[name]) for name in ("A_3", "B_3"))
    (_, low), (_, high) = sheet.extents[0]
    sheet.dimension(front, (-geometry.R, high), (geometry.R, high), 16, "2R", 2 * geometry.R)
    sheet.dimension(front, (a[0], low), (b[0], low), -28, "2r", 2 * geometry.r, (a, b))
    sheet.dimension(front, b, FRONT.project(scene.points["B_2"]), -26, "L", geometry.L)
    c, c5, p = (SIDE.project(scene.points[name]) for name in ("C_1", "C_5", "P"))
    right = sheet.extents[1][1, 0]
    sheet.dimension(side, (c[0], low), (0.0, low), -28, "R", geometry.R, (c, (0.0, 0.0)))
    sheet.dimension(side, c5, p, 28, "r", geometry.r)
    sheet.dimension(side, (right, p[1]), (right, 0.0), -14, "h-z", -p[1], (p, (0.0, 0.0)))
    c3, c6 = (TOP.project(scene.points[name]) for name in ("C_3", "C_6"))
    sheet.dimension(top, c6, c3, 30, "2b", 2 * geometry.b)


def _write_notes(panel: Axes, robot: Manipulator, pose: FloatArray, path: bool) -> None:
    """Explain the symbols, and say where the mechanism stands."""
    y, z, theta = pose
    sliders = robot.inverse_kinematics(pose).sliders
    marks = [("o", "hinge"), ("X", "universal joint"), ("P", "P, middle of $A_3B_3$")]
    rows = [(marker, words) for marker, words in marks]
    rows += [("D", "path of P, and where it ends")] if path else []
    panel.set(xlim=(0, 1), ylim=(0, 1))
    height = 0.93
    for marker, words in rows:
        colours = {"P": ("0.1", "white"), "D": (_TRACE, "white")}.get(marker, ("white", "0.1"))
        panel.plot(0.03, height, marker, ms=7, mfc=colours[0], mec=colours[1], mew=1, clip_on=False)
        panel.text(0.09, height, words, fontsize=10, va="center")
        height -= 0.085
    height -= 0.04
    lines = [
        f"$y$ = {_millimetres(y)}, $z$ = {_millimetres(z)} mm, $\\theta$ = {np.degrees(theta) + 0.0:.3g}°",
        "sliders at " + ", ".join(_millimetres(value) for value in sliders) + " mm (A, B, C)",
        "lengths in mm; front, side and top at one scale",
    ]
    for line in lines:
        panel.text(0.0, height, line, fontsize=10, va="center")
        height -= 0.085


def _millimetres(length: float) -> str:
    return f"{1e3 * length + 0.0:.1f}".removesuffix(".0")


def _label(axis: Axes, sheet: Sheet, scene: Scene, view: View) -> None:
    """Name the joints; those that are seen at one place share a label."""
    places: dict[tuple[float, float], list[str]] = {}
    size = float(np.linalg.norm(np.ptp(np.array(list(scene.points.values())), axis=0)))
    for name in (*SLIDES, *HINGES, *UNIVERSAL, "P"):
        where = view.project(scene.points[name])
        near = [place for place in places if np.linalg.norm(where - place) < 0.008 * size]
        places.setdefault(near[0] if near else (float(where[0]), float(where[1])), []).append(name)
    obstacles: list[FloatArray] = [
        between(view.project(scene.points[one]), view.project(scene.points[other]), 40)
        for one, other in _LINES
    ]
    obstacles += [sheet.dense(solid.silhouette(view)) for base, solid in scene.solids if not base]
    names = {place: ", ".join(f"${name}$" for name in sorted(found)) for place, found in places.items()}
    sheet.labels(axis, names, obstacles)
