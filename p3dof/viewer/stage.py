"""What any scene stands on and is seen by: background, camera, floor, texts, and how numbers are written."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof.viewer.document.measures import above, mesh_of

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


@dataclass(frozen=True, eq=False)
class Sight:
    """What the camera looks at.

    Parameters
    ----------
    centre : ndarray, shape (3,)
        What is in the middle of the picture [m].
    distance : float
        How far from it the camera is [m].
    scale : float
        By how much all is drawn larger than it is.
    filled : float
        How much of the picture is filled.
    """

    centre: FloatArray
    distance: float
    scale: float
    filled: float

    def share(self, points: FloatArray) -> float:
        """Return how large points (N, 3) can be drawn so that all are in sight, in the scale; at most 1."""
        needed = float(_distances(points - self.centre, self.filled).max(initial=0.0))
        return min(1.0, self.distance / needed) if needed > 0 else 1.0

    def transform(self, share: float = 1.0) -> FloatArray:
        """Return the matrix that brings what is looked at to where the camera looks, drawn at some share."""
        matrix = np.diag((*(share * self.scale,) * 3, 1.0))
        matrix[:3, 3] = -share * self.scale * self.centre
        return matrix


def set_stage(
    viewer: Any,
    points: FloatArray,
    scale: float,
    middle: tuple[float, float] = (0.0, 0.0),
    filled: float = FILLED,
) -> Sight:
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
    filled : float
        How much of the picture is filled.

    Returns
    -------
    Sight
        Where the camera looks, and from how far.
    """
    viewer["/Background"].set_property("top_color", list(TOP))
    viewer["/Background"].set_property("bottom_color", list(BOTTOM))
    viewer["/Grid"].set_property("visible", False)
    viewer["/Axes"].set_property("visible", False)
    height, distance = _view(points - np.array([*middle, 0.0]), filled)
    sight = Sight(np.array([*middle, height]), distance, scale, filled)
    viewer.set_transform(sight.transform())
    x, y, z = _towards_eye() * distance * scale
    camera = viewer["/Cameras/default/rotated/<object>"]
    camera.set_property("zoom", ZOOM)
    camera.set_property("near", 0.1)  # precise depths: solids that touch do not flicker
    camera.set_property("far", 20.0)
    camera.set_property("position", [float(x), float(z), float(-y)])  # the page's second axis points up
    return sight


def sideways() -> FloatArray:
    """Return the direction that is to the right in the picture, shape (3,)."""
    x, y, _ = VIEW
    return np.array([-y, x, 0.0]) / math.hypot(x, y)


def _towards_eye() -> FloatArray:
    return np.asarray(np.array(VIEW) / np.linalg.norm(VIEW))


def _view(points: FloatArray, filled: float) -> tuple[float, float]:
    """Return how high over O the camera looks, and from how far, so that it just sees all points (N, 3)."""
    heights = np.linspace(points[:, 2].min(), points[:, 2].max(), 201)
    seen = points - heights[:, None, None] * [0.0, 0.0, 1.0]  # (201, N, 3)
    distances = _distances(seen, filled).max(axis=1)
    best = int(distances.argmin())
    return float(heights[best]), float(distances[best])


def _distances(seen: FloatArray, filled: float) -> FloatArray:
    """Return from how far the camera just sees points (..., 3), given from what it looks at; (...)."""
    eye, right = _towards_eye(), sideways()
    up = np.cross(eye, right)
    sight = filled * math.tan(math.radians(75 / 2)) / ZOOM  # half the height that is seen at a distance of 1
    spread = np.maximum(np.abs(seen @ up), np.abs(seen @ right) / ASPECT) / sight
    return np.asarray(seen @ eye + spread)


def draw_floor(node: Any, half: float, bottom: float, middle: tuple[float, float] = (0.0, 0.0)) -> None:
    """Draw a square grid around what stands on it; lines through the origin are darker.

    Parameters
    ----------
    node : meshcat.Visualizer
        The node to draw into.
    half : float
        Half the size of what stands on it [m].
    bottom : float
        Its height [m].
    middle : tuple of float
        x and y about which it is [m].
    """
    mesh = mesh_of(half)
    count = math.ceil(2.2 * half / mesh)
    x, y = (mesh * (np.arange(-count, count + 1) + round(centre / mesh)) for centre in middle)
    along_y = np.stack(np.broadcast_arrays(x[:, None], y[[0, -1]], bottom), axis=-1)
    along_x = np.stack(np.broadcast_arrays(x[[0, -1]], y[:, None], bottom), axis=-1)
    fine = np.concatenate((along_x, along_y)).reshape(-1, 3)
    node["grid"].set_object(_lines(fine, 0xC3CBD3))
    cross = np.array([[x[0], 0.0, 0.0], [x[-1], 0.0, 0.0], [0.0, y[0], 0.0], [0.0, y[-1], 0.0]])
    node["middle"].set_object(_lines(above(cross, bottom + 1e-3 * mesh), 0x8D99A6))


def _lines(points: FloatArray, colour: int) -> Any:
    import meshcat.geometry as mg

    return mg.LineSegments(mg.PointsGeometry(points.T.astype(np.float32)), mg.LineBasicMaterial(color=colour))


def write_text(node: Any, text: str, place: FloatArray, height: float, through: bool = False) -> None:
    """Write a text that always faces the eye, and is perhaps seen through what is before it."""
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
                "depthTest": not through,
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


def number(newtons: float) -> str:
    """Return a force in four digits or a few more, with a power of ten where it is very large or small."""
    return f"{newtons:.0f}" if 1e3 <= newtons < 1e6 else f"{newtons:.4g}"
