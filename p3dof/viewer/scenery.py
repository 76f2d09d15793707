"""What stands still around the machine: background, camera, floor grid, axes, guide-ways and letters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from p3dof.checks import FloatArray
from p3dof.description.shapes import LEG_A, LEG_B, LEG_C
from p3dof.parameters import LEGS as ACTUATORS
from p3dof.parameters import Dimensions, Parameters
from p3dof.viewer.stage import above, draw_floor, enlargement, mesh_of, write_text

LEGS = tuple(leg.lower() for leg in ACTUATORS)
COLOURS = {"a": LEG_A.rgba, "b": LEG_B.rgba, "c": LEG_C.rgba}
"""Red, green, blue and opacity of what belongs to a leg."""


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
