"""The drawing of the mechanism: front, side and top at one scale, and an oblique view."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, frozen_array, shown
from p3dof._base.errors import InputError
from p3dof.analysis.reactions import JOINTS
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import PLATFORM
from p3dof.manipulator import Manipulator
from p3dof.report.plots.common import new_figure
from p3dof.report.plots.sheet import Sheet, between
from p3dof.report.plots.views import Ball, Prism, View, link_frames, solids_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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
    """The mechanism at a pose.

    Parameters
    ----------
    solids : list of (bool, Prism or Ball)
        All visible solids, and whether they belong to the base.
    points : dict of str to ndarray, shape (3,)
        The joints by the paper's names, and P [m].
    trace : ndarray, shape (N, 3)
        Where P passes [m]; empty without a motion.
    """

    solids: list[tuple[bool, Prism | Ball]]
    points: dict[str, FloatArray]
    trace: FloatArray


def mechanism_figure(
    robot: Manipulator,
    pose: ArrayLike = (0.0, 0.0, 0.0),
    motion: Motion | None = None,
    dimensions: bool = True,
) -> Figure:
    """Draw the mechanism from the front, the side and the top at one scale, and at an angle.

    The joints have the labels of `p3dof.analysis.reactions.JOINTS`: the paper's names, but for C7, which the
    paper does not name. Guide-ways and their beams are drawn behind everything else, so that they hide
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

    Returns
    -------
    matplotlib.figure.Figure
        Its first four axes are those of `VIEWS`, in metres.

    Raises
    ------
    ReachError
        If the pose is out of reach.
    InputError
        If an argument does not fit.
    MissingExtraError
        If matplotlib is not installed.
    """
    if not isinstance(robot, Manipulator):
        raise InputError(f"robot: expected a Manipulator, got {shown(robot)}")
    if motion is not None and not isinstance(motion, Motion):
        raise InputError(f"motion: expected a Motion, got {shown(motion)}")
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
