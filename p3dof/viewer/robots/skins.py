"""Meshes in the picture: triangles with flat faces, in the place of the boxes that stand for them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from p3dof.page.robots.meshes import Skin
from p3dof.viewer.stage import colour_number


def draw_skins(node_of: Callable[[str], Any], skins: Mapping[str, Skin]) -> None:
    """Draw meshes.

    Parameters
    ----------
    node_of : callable
        Returns the node of a solid by its name.
    skins : mapping of str to Skin
        The triangles, by name of the solid.
    """
    import meshcat.geometry as mg

    for name, skin in skins.items():
        corners = skin.corners.reshape(-1, 3).astype(np.float32)
        faces = np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)
        first = skin.colours[0]
        if np.all(skin.colours == first):
            geometry = mg.TriangularMeshGeometry(corners, faces)
            material = mg.MeshLambertMaterial(color=colour_number(first))
        else:
            colours = np.repeat(skin.colours, 3, axis=0).astype(np.float32)
            geometry = mg.TriangularMeshGeometry(corners, faces, color=colours)
            material = mg.MeshLambertMaterial(vertexColors=True)
        node_of(name).set_object(geometry, material)
