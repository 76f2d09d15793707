"""A robot drawn in MeshCat: its solids, what it stands on and is seen by, arrows and texts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, as_floats
from p3dof._base.errors import InputError

_USUAL = (0.25, 1.5)
"""Sizes of machines that are drawn as they are [m]: MeshCat's lights and near plane are made for metres."""


def enlargement(half: float) -> float:
    """Return by how much something is drawn larger than it is: 1 unless its half size is far from a metre."""
    return 1.0 if _USUAL[0] < half < _USUAL[1] else 0.6 / half


def above(points: FloatArray, height: float) -> FloatArray:
    """Return points, shape (..., 3), so much higher [m]."""
    return np.asarray(points + np.array([0.0, 0.0, height]))


TOP, BOTTOM = (1.0, 1.0, 1.0), (0.86, 0.89, 0.92)
"""Colours of the background."""
ASPECT = 4 / 3
"""Width of what the camera surely sees, in heights; a page draws it smaller where the window is narrower."""
ZOOM = 2.4
"""Of MeshCat's camera, which sees 75° without: a longer lens distorts less."""
VIEW = (0.85, -0.45, 0.36)
"""Direction from the machine to the eye in the fixed frame: from the front, the right and above."""
FILLED = 0.94
"""How much of the picture is filled."""


def set_stage(
    viewer: Any, points: FloatArray, scale: float, middle: tuple[float, float] = (0.0, 0.0)
) -> None:
    """Set background and camera, and move the scene so that the camera just sees all points (N, 3) [m].

    It looks at a vertical axis through the point `middle` of the floor.
    """
    viewer["/Background"].set_property("top_color", list(TOP))
    viewer["/Background"].set_property("bottom_color", list(BOTTOM))
    viewer["/Grid"].set_property("visible", False)
    viewer["/Axes"].set_property("visible", False)
    height, distance, width = _view(points - np.array([*middle, 0.0]))
    matrix = np.diag((scale, scale, scale, 1.0))
    matrix[:3, 3] = -scale * np.array([*middle, height])
    viewer.set_transform(matrix)
    x, y, z = _towards_eye() * distance * scale
    camera = viewer["/Cameras/default/rotated/<object>"]
    camera.set_property("picture_width", width)  # fit.js knows it
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


def _view(points: FloatArray) -> tuple[float, float, float]:
    """Return how high the camera looks, and from how far, so that it just sees all points (N, 3).

    And how wide a picture must be to show them, in its heights.
    """
    heights = np.linspace(points[:, 2].min(), points[:, 2].max(), 201)
    seen = points - heights[:, None, None] * [0.0, 0.0, 1.0]  # (201, N, 3)
    eye, right = _towards_eye(), sideways()
    up = np.cross(eye, right)
    sight = FILLED * math.tan(math.radians(75 / 2)) / ZOOM  # half the height that is seen at a distance of 1
    spread = np.maximum(np.abs(seen @ up), np.abs(seen @ right) / ASPECT) / sight
    distances = (seen @ eye + spread).max(axis=1)
    best = int(distances.argmin())
    distance = float(distances[best])
    across = np.abs(seen[best] @ right) / (distance - seen[best] @ eye)
    return float(heights[best]), distance, float(across.max() / sight)


def draw_floor(node: Any, half: float, bottom: float) -> None:
    """Draw a square grid around what stands on it; lines through the origin are darker."""
    power = 10.0 ** math.floor(math.log10(half / 4))
    mesh = power * max(step for step in (1, 2, 5) if step * power <= half / 4)
    count = math.ceil(2.2 * half / mesh)
    places = mesh * np.arange(-count, count + 1)
    ends = places[[0, -1]]
    along_y = np.stack(np.broadcast_arrays(places[:, None], ends, bottom), axis=-1)
    along_x = np.stack(np.broadcast_arrays(ends, places[:, None], bottom), axis=-1)
    node["grid"].set_object(_lines(np.concatenate((along_x, along_y)).reshape(-1, 3), 0xC3CBD3))
    cross = np.array([[ends[0], 0.0, 0.0], [ends[1], 0.0, 0.0], [0.0, ends[0], 0.0], [0.0, ends[1], 0.0]])
    node["middle"].set_object(_lines(above(cross, bottom + 1e-3 * mesh), 0x8D99A6))


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
                "depthTest": True,
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


def colour_number(rgba: Sequence[float]) -> int:
    """Return a colour as MeshCat's materials take it."""
    red, green, blue = (round(255 * part) for part in rgba[:3])
    return 65536 * red + 256 * green + blue


HEAD = 4.0
"""Length of a head, in radii of the shaft."""
HEAD_RADIUS = 2.4
"""Radius of a head, in radii of the shaft."""
HEADS = ("head", "second_head")
"""What the heads are called; that of a torque has two."""
_FLAT = 1e-6
"""Least scale of a shaft: a page cannot take a transform without an inverse apart."""
_ALONG_Z = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.5], [0.0, 0.0, 0.0, 1.0]])
"""Turns MeshCat's cylinders, along y about their middle, along z from 0 to 1."""


def draw_arrow(node: Any, radius: float, material: Any, heads: int = 1) -> None:
    """Put an arrow along +z into a node of the scene; its length comes from `set_length`."""
    import meshcat.geometry as mg

    cones = [mg.Cylinder(1.0, radiusTop=0.0, radiusBottom=HEAD_RADIUS * radius) for _ in range(heads)]
    for name, cylinder in (("shaft", mg.Cylinder(1.0, radius)), *zip(HEADS, cones, strict=False)):
        cylinder.intrinsic_transform = lambda: _ALONG_Z.T  # MeshCat writes rows, its page reads columns
        node[name].set_object(cylinder, material)


def set_length(node: Any, length: float, radius: float, heads: int = 1) -> None:
    """Make an arrow so long; it points to -z when the length is negative, and vanishes at zero."""
    node.set_property("visible", bool(abs(length) > _FLAT))  # False for NaN
    if not abs(length) > _FLAT:
        return
    head = np.copysign(min(abs(length) / heads, HEAD * radius), length)
    shaft = length - heads * head
    node["shaft"].set_transform(_stretched(shaft if abs(shaft) > _FLAT else np.copysign(_FLAT, length)))
    for i, name in enumerate(HEADS[:heads]):  # the tip's first
        node[name].set_transform(_stretched(head, length - (i + 1) * head))


def _stretched(scale: float, start: float = 0.0) -> FloatArray:
    matrix = np.diag((1.0, 1.0, scale, 1.0))
    matrix[2, 3] = start
    return matrix


def placed(place: FloatArray) -> FloatArray:
    """Return a place (3,) as a matrix."""
    matrix = np.eye(4)
    matrix[:3, 3] = place
    return matrix


def number(value: float) -> str:
    """Return a number in four digits or a few more, with a power of ten where it is very large or small."""
    return f"{value:.0f}" if 1e3 <= value < 1e6 else f"{value:.4g}"


def round_below(value: float) -> float:
    """Return 1, 2 or 5 times a power of ten, at most a positive value."""
    power = 10.0 ** math.floor(math.log10(value))
    return max((step * power for step in (1, 2, 5) if step * power <= value), default=power)


LEGEND = 0x4A545E
"""Colour of the arrows that show the scale of the others."""


def draw_legend(
    node: Any, largest: float, metres: float, unit: str, radius: float, letter: float, heads: int = 1
) -> None:
    """Draw a grey arrow for a round value, which is written over it, where the largest is so long [m]."""
    import meshcat.geometry as mg

    value = round_below(largest)
    length = metres * value / largest
    draw_arrow(node["arrow"], radius, mg.MeshLambertMaterial(color=LEGEND), heads)
    set_length(node["arrow"], length, radius, heads)
    write_text(
        node["text"], f"{number(value)} {unit}", above(np.zeros(3), length + 0.5 * letter), 1.4 * letter
    )


def legend_ends(place: FloatArray, metres: float, letter: float) -> list[FloatArray]:
    """Return what a legend at a place (3,) reaches, if its arrow is the longest."""
    text = above(place, metres + 1.5 * letter)
    return [place, text, text + letter * sideways(), text - letter * sideways()]


def draw_path(node: Any, points: ArrayLike, colour: int) -> None:
    """Draw the path of a point (N, 3), seen through what is before it; it replaces the one before."""
    import meshcat.geometry as mg

    path = as_floats("points", points)
    if path.ndim != 2 or path.shape[1] != 3:
        raise InputError(f"points: expected shape (N, 3), got {path.shape}")
    steps = np.stack((path[:-1], path[1:]), axis=1)  # (N-1, 2, 3)
    steps = steps[np.isfinite(steps).all(axis=(1, 2))]
    line = mg.PointsGeometry(steps.reshape(-1, 3).T.astype(np.float32))
    node.delete()
    if len(steps):
        node.set_object(mg.LineSegments(line, mg.LineBasicMaterial(color=colour, depthTest=False)))


ROOT = "p3dof"
"""Name of the robot under MeshCat's root, ``/meshcat``."""
