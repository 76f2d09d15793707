"""`ClosureMarks`: the closures of a robot, each kind drawn so that it is recognised, with their numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import pinocchio as pin

from p3dof.checks import FloatArray
from p3dof.closed_loop import Closure
from p3dof.page.robots.lines import line_between, placed_at, turned_to
from p3dof.viewer.arrows import unit_along_z
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
_BESIDE, _NUMBER = 2.4, 2.0
"""How far above a closure its number stands, and how high it is, in radii of a ball."""


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
    through : bool
        Whether they are seen through what is before them.
    """

    def __init__(self, viewer: Any, closures: Iterable[Closure], size: float, through: bool = False) -> None:
        self._closures = tuple(closures)
        self._size = size
        self._pen = _Pen(size, ink(COLOUR, through))
        self._through = through
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
            self._numbers[str(i)].set_transform(placed_at(self._above(one, two, _BESIDE)))

    def tops(self, first: list[pin.SE3], second: list[pin.SE3]) -> FloatArray:
        """Return the upper ends of the numbers (N, 3), where the closures' frames are [m]."""
        ends = [self._above(*pair, _BESIDE + _NUMBER / 2) for pair in zip(first, second, strict=True)]
        return np.reshape(ends, (-1, 3))

    def _above(self, one: pin.SE3, two: pin.SE3, sizes: float) -> FloatArray:
        middle = (one.translation + two.translation) / 2
        return np.asarray(middle + np.array([0.0, 0.0, sizes * self._size]))

    def _draw(self) -> None:
        for i, closure in enumerate(self._closures):
            _DRAWN[closure.kind](self._pen, self._marks[str(i)])
            text = self._numbers[str(i)]["text"]
            write_text(text, str(i + 1), np.zeros(3), _NUMBER * self._size, self._through)


def ink(colour: Sequence[float], through: bool) -> Any:
    """Return a material of a colour, which is perhaps seen through what is before it."""
    import meshcat.geometry as mg

    if not through:
        return mg.MeshLambertMaterial(color=colour_number(colour))
    # After all that is opaque, whatever is before it.
    return mg.MeshLambertMaterial(color=colour_number(colour), transparent=True, depthTest=False)


@dataclass(frozen=True)
class _Pen:
    """Draws marks of a size with a material."""

    size: float
    ink: Any

    def cylinder(self, node: Any, length: float, radius: float, along: Sequence[float] | None = None) -> None:
        """Draw a cylinder about the middle of a node, along z or another direction; measures in sizes."""
        import meshcat.geometry as mg

        node.set_object(unit_along_z(mg.Cylinder(1.0, radius * self.size)), self.ink)
        matrix = np.eye(4)
        if along is not None:
            matrix[:3, :3] = turned_to(np.array(along))
        matrix[:3, 3] = -length * self.size / 2 * matrix[:3, 2]
        matrix[:3, 2] *= length * self.size
        node.set_transform(matrix)

    def box(self, node: Any, *edges: float) -> None:
        """Draw a box; measures in sizes."""
        import meshcat.geometry as mg

        node.set_object(mg.Box([edge * self.size for edge in edges]), self.ink)

    def ball(self, node: Any, radius: float) -> None:
        """Draw a ball; measures in sizes."""
        import meshcat.geometry as mg

        node.set_object(mg.Sphere(radius * self.size), self.ink)


def _point(pen: _Pen, node: Any) -> None:
    pen.ball(node["first/ball"], 1.0)


def _hinge(pen: _Pen, node: Any) -> None:
    pen.cylinder(node["first/pin"], 3.6, 1.0)


def _slider(pen: _Pen, node: Any) -> None:
    pen.box(node["first/bar"], 0.8, 0.8, 8.0)
    pen.box(node["first/sleeve"], 2.0, 2.0, 3.0)


def _cylindrical(pen: _Pen, node: Any) -> None:
    pen.cylinder(node["first/bar"], 8.0, 0.45)
    pen.cylinder(node["first/sleeve"], 3.0, 1.1)


def _universal(pen: _Pen, node: Any) -> None:
    pen.cylinder(node["first/x"], 4.4, 0.6, (1.0, 0.0, 0.0))
    pen.cylinder(node["second/y"], 4.4, 0.6, (0.0, 1.0, 0.0))


def _planar(pen: _Pen, node: Any) -> None:
    pen.box(node["first/plate"], 6.0, 6.0, 0.4)
    pen.ball(node["first/ball"], 0.8)


def _frame(pen: _Pen, node: Any) -> None:
    pen.box(node["first/cube"], 1.8, 1.8, 1.8)


def _distance(pen: _Pen, node: Any) -> None:
    import meshcat.geometry as mg

    node["rod"].set_object(unit_along_z(mg.Cylinder(1.0, 0.4 * pen.size)), pen.ink)
    for name in ("start", "end"):
        pen.ball(node[name], 0.8)


_DRAWN: Mapping[str, Callable[[_Pen, Any], None]] = MappingProxyType(
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
