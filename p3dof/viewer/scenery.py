"""What stands still around the machine: background, camera, floor grid, axes, guide-ways and letters."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from p3dof.checks import FloatArray
from p3dof.description.shapes import LEG_A, LEG_B, LEG_C
from p3dof.parameters import LEGS as ACTUATORS
from p3dof.parameters import Dimensions, Parameters

LEGS = tuple(leg.lower() for leg in ACTUATORS)
COLOURS = {"a": LEG_A.rgba, "b": LEG_B.rgba, "c": LEG_C.rgba}
"""Red, green, blue and opacity of what belongs to a leg."""
TOP, BOTTOM = (1.0, 1.0, 1.0), (0.86, 0.89, 0.92)
"""Colours of the background."""
ASPECT = 4 / 3
"""Width of what the camera surely sees, in heights; a page draws it smaller where the window is narrower."""
ZOOM = 2.4
"""Of MeshCat's camera, which sees 75° without: a longer lens distorts less."""
VIEW = (0.85, -0.45, 0.36)
"""Direction from the machine to the eye in the fixed frame: from the front, the right and above."""
_FILLED = 0.94
"""How much of the picture is filled."""
_USUAL = (0.25, 1.5)
"""Sizes of machines that are drawn as they are [m]: MeshCat's lights and near plane are made for metres."""


@dataclass(frozen=True)
class Room:
    """Measures of the surroundings of a machine [m].

    Parameters
    ----------
    size : Dimensions
        Sizes of its solids.
    radius : float
        Distance of the guide-ways from the middle.
    bottom, top : float
        Heights of the floor and of the letters over the frame.
    travel : tuple of float
        Lowest and highest slider position.
    """

    size: Dimensions
    radius: float
    bottom: float
    top: float
    travel: tuple[float, float]

    @classmethod
    def around(cls, parameters: Parameters) -> Room:
        """Measure the surroundings of a machine."""
        geometry, size = parameters.geometry, Dimensions.scaled(parameters.geometry)
        low, high = parameters.limits.travel
        bottom = low - geometry.h - geometry.r
        return cls(size, geometry.R, bottom, high + 2.6 * size.slider_edge, (low, high))

    @property
    def corners(self) -> FloatArray:
        """What the camera must see of the machine, shape (N, 3)."""
        feet = [above(0.6 * pivot, self.bottom) for pivot in self.pivots.values()]
        heads = [above(pivot, self.top + self.letter / 2) for pivot in self.pivots.values()]
        return np.stack((*feet, *heads))

    @property
    def letter(self) -> float:
        """Height of the letters of the legs."""
        return max(self.size.slider_edge, 0.08 * self.half)

    @property
    def half(self) -> float:
        """Half the height of the machine, more or less."""
        return max((self.top - self.bottom) / 2, 1.3 * self.radius)

    @property
    def scale(self) -> float:
        """By how much the machine is drawn larger than it is: 1 unless it is far from a metre."""
        return enlargement(self.half)

    @property
    def pivots(self) -> dict[str, FloatArray]:
        """Where the sliders' axes stand, by leg."""
        R = self.radius
        return {
            "a": np.array([0.0, -R, 0.0]),
            "b": np.array([0.0, R, 0.0]),
            "c": np.array([-R, 0.0, 0.0]),
        }

    @property
    def mesh(self) -> float:
        """Distance between the lines of the floor."""
        return mesh_of(self.half)


def enlargement(half: float) -> float:
    """Return by how much something is drawn larger than it is: 1 unless its half size is far from a metre."""
    return 1.0 if _USUAL[0] < half < _USUAL[1] else 0.6 / half


def mesh_of(half: float) -> float:
    """Return the distance between the lines of a floor: 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(half / 4))
    return power * max(step for step in (1, 2, 5) if step * power <= half / 4)


def set_stage(
    viewer: Any, points: FloatArray, scale: float, middle: tuple[float, float] = (0.0, 0.0)
) -> None:
    """Set background and camera, and move the scene so that the camera looks at what is drawn.

    Parameters
    ----------
    viewer : meshcat.Visualizer
        The root of what is drawn.
    points : ndarray, shape (N, 3)
        What must be in the picture [m].
    scale : float
        By how much it is drawn larger than it is.
    middle : tuple of float
        x and y of what the camera looks at [m].
    """
    viewer["/Background"].set_property("top_color", list(TOP))
    viewer["/Background"].set_property("bottom_color", list(BOTTOM))
    viewer["/Grid"].set_property("visible", False)
    viewer["/Axes"].set_property("visible", False)
    height, distance = _view(points - np.array([*middle, 0.0]))
    shift = np.diag((scale, scale, scale, 1.0))
    shift[:3, 3] = -scale * np.array([*middle, height])
    viewer.set_transform(shift)
    x, y, z = _towards_eye() * distance * scale
    camera = viewer["/Cameras/default/rotated/<object>"]
    camera.set_property("zoom", ZOOM)
    camera.set_property("near", 0.1)  # precise depths: solids that touch do not flicker
    camera.set_property("far", 20.0)
    camera.set_property("position", [float(x), float(z), float(-y)])  # the page's second axis points up


def sideways() -> FloatArray:
    """Return the direction that is to the right in the picture, shape (3,)."""
    x, y, _ = VIEW
    return np.array([-y, x, 0.0]) / math.hypot(x, y)


def _towards_eye() -> FloatArray:
    return np.asarray(np.array(VIEW) / np.linalg.norm(VIEW))


def _view(points: FloatArray) -> tuple[float, float]:
    """Return how high over O the camera looks, and from how far, so that it just sees all points (N, 3)."""
    eye, right = _towards_eye(), sideways()
    up = np.cross(eye, right)
    sight = _FILLED * math.tan(math.radians(75 / 2)) / ZOOM  # half the height that is seen at a distance of 1
    heights = np.linspace(points[:, 2].min(), points[:, 2].max(), 201)
    seen = points - heights[:, None, None] * [0.0, 0.0, 1.0]  # (201, N, 3)
    spread = np.maximum(np.abs(seen @ up), np.abs(seen @ right) / ASPECT) / sight
    distances = (seen @ eye + spread).max(axis=1)
    best = int(distances.argmin())
    return float(heights[best]), float(distances[best])


def draw_scenery(viewer: Any, room: Room) -> None:
    """Draw floor, axes of the fixed frame, guide-ways and the letters of the legs.

    Parameters
    ----------
    viewer : meshcat.Visualizer
        The node to draw into.
    room : Room
        Its measures.
    """
    draw_floor(viewer["floor"], room.half, room.bottom)
    _draw_axes(viewer["axes"], room)
    _draw_guides(viewer["guides"], room)


def above(points: FloatArray, height: float) -> FloatArray:
    """Return points, shape (..., 3), so much higher [m]."""
    return np.asarray(points + np.array([0.0, 0.0, height]))


def draw_floor(node: Any, half: float, bottom: float) -> None:
    """Draw a square grid, its middle lines darker.

    Parameters
    ----------
    node : meshcat.Visualizer
        The node to draw into.
    half : float
        Half the size of what stands on it [m].
    bottom : float
        Its height [m].
    """
    mesh = mesh_of(half)
    count = math.ceil(2.2 * half / mesh)
    edge = count * mesh
    lines = np.arange(-count, count + 1) * mesh
    ends = np.array([-edge, edge])
    along_y = np.stack(np.broadcast_arrays(lines[:, None], ends, bottom), axis=-1)
    along_x = along_y[..., [1, 0, 2]]
    fine = np.concatenate((along_x, along_y)).reshape(-1, 3)
    node["grid"].set_object(_lines(fine, 0xC3CBD3))
    cross = np.array([[-edge, 0.0, 0.0], [edge, 0.0, 0.0], [0.0, -edge, 0.0], [0.0, edge, 0.0]])
    node["middle"].set_object(_lines(above(cross, bottom + 1e-3 * mesh), 0x8D99A6))


def _draw_axes(node: Any, room: Room) -> None:
    """Draw the axes of the fixed frame from its origin O, with their names."""
    import meshcat.geometry as mg

    from p3dof.viewer.arrows import draw_arrow, set_length

    radius, length = 0.25 * room.size.rod_radius, 0.35 * room.radius
    for i, (name, colour) in enumerate(zip("xyz", (0xB22222, 0x2E7D32, 0x1F4E9E), strict=True)):
        turned = np.eye(4)
        turned[:3, :3] = np.roll(np.eye(3), 2 - i, axis=1)  # z along the axis
        node[name].set_transform(turned)
        draw_arrow(node[name], radius, mg.MeshLambertMaterial(color=colour))
        set_length(node[name], length, radius)
        write_text(node[f"{name}_name"], f"{name}0", turned[:3, 2] * 1.25 * length, 0.25 * length)


def _draw_guides(node: Any, room: Room) -> None:
    """Draw the axes of the sliders as thin rods over their travel, and the letters of the legs."""
    import meshcat.geometry as mg

    low, high = room.travel
    edge = room.size.slider_edge
    bottom, top = low - 0.7 * edge, high + edge
    for leg, pivot in room.pivots.items():
        matrix = np.eye(4)
        matrix[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
        matrix[:3, 3] = above(pivot, (bottom + top) / 2)
        rod = mg.Cylinder(top - bottom, 0.35 * room.size.rod_radius)
        node[leg].set_object(rod, mg.MeshLambertMaterial(color=0x5F6B76))
        node[leg].set_transform(matrix)
        write_text(
            node[f"{leg}_name"], leg.upper(), above(pivot, room.top - edge + room.letter / 2), room.letter
        )


def _lines(points: FloatArray, colour: int) -> Any:
    import meshcat.geometry as mg

    return mg.LineSegments(mg.PointsGeometry(points.T.astype(np.float32)), mg.LineBasicMaterial(color=colour))


def write_text(node: Any, text: str, place: FloatArray, height: float) -> None:
    """Write a text that always faces the eye."""
    import meshcat.geometry as mg

    class Letter(mg.Object):  # type: ignore[misc]
        _type = "Sprite"

        def lower(self) -> dict[str, Any]:
            texture = {
                "uuid": f"{self.uuid}-text",
                "type": "_text",
                "text": text,
                "font_size": 150,
                "font_face": "sans-serif",
            }
            material = {
                "uuid": f"{self.uuid}-ink",
                "type": "SpriteMaterial",
                "map": texture["uuid"],
                "transparent": True,
            }
            sprite = {"uuid": self.uuid, "type": "Sprite", "material": material["uuid"]}
            return {
                "metadata": {"version": 4.5, "type": "Object"},
                "geometries": [],
                "textures": [texture],
                "materials": [material],
                "object": sprite,
            }

    node.set_object(Letter(None, None))
    matrix = np.diag((height * 256 / 150,) * 3 + (1.0,))
    matrix[:3, 3] = place
    node.set_transform(matrix)
