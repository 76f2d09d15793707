"""What stands still around the machine: background, camera, floor grid, axes, guide-ways and letters."""

from __future__ import annotations

from typing import Any

import numpy as np

from p3dof.viewer.document.measures import above
from p3dof.viewer.document.room import Room
from p3dof.viewer.stage import draw_floor, write_text


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
