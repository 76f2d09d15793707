"""Force arrows: a shaft and a cone that are scaled, so that a page can animate them; moments have two."""

from __future__ import annotations

from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray

HEAD = 4.0
"""Length of a head, in radii of the shaft."""
HEAD_RADIUS = 2.4
"""Radius of a head, in radii of the shaft."""
_FLAT = 1e-6
"""Least scale of a shaft: a page cannot take a transform without an inverse apart."""
_SECOND = 0.7
"""How far behind the first head a second one is, in heads."""

_ALONG_Z = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.5], [0.0, 0.0, 0.0, 1.0]])
"""Turns MeshCat's cylinders, along y about their middle, along z from 0 to 1."""


def draw_arrow(node: Any, radius: float, material: Any, double: bool = False) -> None:
    """Put an arrow along +z into a node of the scene; its length comes from `set_length`.

    Parameters
    ----------
    node : meshcat.Visualizer
        Where it starts.
    radius : float
        Of its shaft [m].
    material : meshcat.geometry.Material
        Its colour.
    double : bool
        Whether it has two heads, as a moment has.
    """
    import meshcat.geometry as mg

    node["shaft"].set_object(unit_along_z(mg.Cylinder(1.0, radius)), material)
    for name in ("head", "second") if double else ("head",):
        cone = mg.Cylinder(1.0, radiusTop=0.0, radiusBottom=HEAD_RADIUS * radius)
        node[name].set_object(unit_along_z(cone), material)


def set_length(node: Any, length: float, radius: float, double: bool = False) -> None:
    """Make an arrow so long; it points to -z when the length is negative, and vanishes at zero.

    Parameters
    ----------
    node : meshcat.Visualizer
        That of `draw_arrow`.
    length : float
        From its start to its tip [m]; NaN hides it.
    radius : float
        Of its shaft [m].
    double : bool
        As for `draw_arrow`.
    """
    node.set_property("visible", bool(abs(length) > _FLAT))  # False for NaN
    if not abs(length) > _FLAT:
        return
    head = np.copysign(min(abs(length), HEAD * radius), length)
    shaft = length - head
    node["shaft"].set_transform(_stretched(shaft if abs(shaft) > _FLAT else np.copysign(_FLAT, length)))
    node["head"].set_transform(_stretched(head, shaft))
    if double:
        back = np.copysign(max(abs(shaft) - _SECOND * abs(head), 0.0), length)
        node["second"].set_transform(_stretched(head, back))


def unit_along_z(cylinder: Any) -> Any:
    """Return a cylinder of MeshCat of height 1, turned along z, from 0 to 1."""
    cylinder.intrinsic_transform = lambda: _ALONG_Z.T  # MeshCat writes rows, its page reads columns
    return cylinder


def _stretched(scale: float, start: float = 0.0) -> FloatArray:
    matrix = np.diag((1.0, 1.0, scale, 1.0))
    matrix[2, 3] = start
    return matrix
