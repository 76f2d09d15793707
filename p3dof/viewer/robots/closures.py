"""`ClosureMarks`: the closures of a robot, each kind drawn so that it is recognised, with their numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
import pinocchio as pin

from p3dof.checks import FloatArray
from p3dof.closed_loop import Closure
from p3dof.viewer.arrows import unit_along_z
from p3dof.viewer.robots.lines import line_between, placed_at, turned_to
from p3dof.viewer.stage import colour_number, write_text

COLOUR = (0.42, 0.16, 0.62)
"""Of closures and of the forces in them."""
WORDS: Mapping[str, str] = MappingProxyType(
    {
        "3d": "point",
        "6d": "frame",
        "hinge": "hinge",
        "slider": "slider",
        "universal": "universal joint",
        "cylindrical": "cylindrical joint",
        "planar": "planar joint",
        "distance": "rod",
    }
)
"""What each kind is called in a page."""
MOST_NUMBERS = 16
"""So many closures at most have their numbers beside them unless they are asked for."""


class ClosureMarks:
    """The closures of one robot: what they are drawn as, and where.

    A point is a ball, a hinge a short cylinder along its axis, a slider a bar in a sleeve, a cylindrical
    joint a rod in a sleeve, a universal joint a cross, a planar joint a plate, a frame a cube, and a distance
    a thin rod from frame to frame.

    Parameters
    ----------
    viewer : meshcat.Visualizer
        The root of what is drawn.
    closures : iterable of Closure
        The closures.
    size : float
        Radius of a ball [m].
    """

    def __init__(self, viewer: Any, closures: Iterable[Closure], size: float) -> None:
        self._closures = tuple(closures)
        self._size = size
        self._marks, self._numbers = viewer["closures"], viewer["closure_numbers"]
        self._draw()

    def place(self, first: list[pin.SE3], second: list[pin.SE3]) -> None:
        """Show the closures where their first and second frames are."""
        for i, (closure, one, two) in enumerate(zip(self._closures, first, second, strict=True)):
            node = self._marks[str(i)]
            if closure.kind == "distance":
                node["rod"].set_transform(line_between(one.translation, two.translation))
                node["end"].set_transform(placed_at(two.translation))
                node["start"].set_transform(placed_at(one.translation))
            else:
                node["first"].set_transform(np.array(one.homogeneous))
            if closure.kind == "universal":
                node["second"].set_transform(np.array(two.homogeneous))
            middle = (one.translation + two.translation) / 2
            above = middle + np.array([0.0, 0.0, 2.4 * self._size])
            self._numbers[str(i)].set_transform(placed_at(above))

    def _draw(self) -> None:
        for i, closure in enumerate(self._closures):
            _DRAWN[closure.kind](self._marks[str(i)], self._size)
            text = self._numbers[str(i)]["text"]
            write_text(text, str(i + 1), np.zeros(3), 2.0 * self._size)


def _ink() -> Any:
    import meshcat.geometry as mg

    return mg.MeshLambertMaterial(color=colour_number(COLOUR))


def _cylinder(node: Any, length: float, radius: float, turn: FloatArray | None = None) -> None:
    """Draw a cylinder about the middle of a node, along z or along the third of some axes (3, 3)."""
    import meshcat.geometry as mg

    node.set_object(unit_along_z(mg.Cylinder(1.0, radius)), _ink())
    matrix = np.eye(4)
    if turn is not None:
        matrix[:3, :3] = turn
    matrix[:3, 3] = -length / 2 * matrix[:3, 2]
    matrix[:3, 2] *= length
    node.set_transform(matrix)


def _box(node: Any, x: float, y: float, z: float) -> None:
    import meshcat.geometry as mg

    node.set_object(mg.Box([x, y, z]), _ink())


def _ball(node: Any, radius: float) -> None:
    import meshcat.geometry as mg

    node.set_object(mg.Sphere(radius), _ink())


def _point(node: Any, size: float) -> None:
    _ball(node["first/ball"], size)


def _hinge(node: Any, size: float) -> None:
    _cylinder(node["first/pin"], 3.6 * size, size)


def _slider(node: Any, size: float) -> None:
    _box(node["first/bar"], 0.8 * size, 0.8 * size, 8.0 * size)
    _box(node["first/sleeve"], 2.0 * size, 2.0 * size, 3.0 * size)


def _cylindrical(node: Any, size: float) -> None:
    _cylinder(node["first/bar"], 8.0 * size, 0.45 * size)
    _cylinder(node["first/sleeve"], 3.0 * size, 1.1 * size)


def _universal(node: Any, size: float) -> None:
    _cylinder(node["first/x"], 4.4 * size, 0.6 * size, turned_to(np.array([1.0, 0.0, 0.0])))
    _cylinder(node["second/y"], 4.4 * size, 0.6 * size, turned_to(np.array([0.0, 1.0, 0.0])))


def _planar(node: Any, size: float) -> None:
    _box(node["first/plate"], 6.0 * size, 6.0 * size, 0.4 * size)
    _ball(node["first/ball"], 0.8 * size)


def _frame(node: Any, size: float) -> None:
    _box(node["first/cube"], 1.8 * size, 1.8 * size, 1.8 * size)


def _distance(node: Any, size: float) -> None:
    import meshcat.geometry as mg

    node["rod"].set_object(unit_along_z(mg.Cylinder(1.0, 0.4 * size)), _ink())
    for name in ("start", "end"):
        _ball(node[name], 0.8 * size)


_DRAWN: Mapping[str, Callable[[Any, float], None]] = MappingProxyType(
    {
        "3d": _point,
        "6d": _frame,
        "hinge": _hinge,
        "slider": _slider,
        "universal": _universal,
        "cylindrical": _cylindrical,
        "planar": _planar,
        "distance": _distance,
    }
)
