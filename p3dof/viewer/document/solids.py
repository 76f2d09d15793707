"""The visible solids of any robot as a document has them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof.viewer.document.encoding import colour, encoded
from p3dof.viewer.document.trees import placement

_AS_IT_IS = 32767
"""Largest number of a mesh's corners in int16."""


def solid(
    name: str,
    joint: int,
    place: list[float],
    shape: dict[str, Any],
    rgba: Any,
    layer: str,
) -> dict[str, Any]:
    """Return a solid as a document has it.

    Parameters
    ----------
    name : str
        Its name.
    joint : int
        The joint that carries it, -1 for the world.
    place : list of float
        Where it is there: x, y, z [m], quaternion x, y, z, w.
    shape : dict
        Its form.
    rgba : array-like
        Red, green, blue and opacity, from 0 to 1.
    layer : str
        The layer that it is shown with.

    Returns
    -------
    dict
    """
    opacity = float(np.clip(np.asarray(rgba, dtype=float).ravel()[3], 0.0, 1.0))
    return {
        "name": name,
        "joint": joint,
        "placement": place,
        "shape": shape,
        "colour": colour(rgba),
        "opacity": round(opacity, 6),
        "layer": layer,
    }


def mesh(corners: FloatArray, faces: NDArray[Any], exact: bool = True) -> dict[str, Any]:
    """Return a mesh as a document has it.

    Parameters
    ----------
    corners : ndarray, shape (n, 3)
        [m]
    faces : ndarray of int, shape (m, 3)
        The corners of each triangle, counter-clockwise from outside.
    exact : bool
        Whether corners are kept in single precision; else as 16-bit shares of the mesh's size.

    Returns
    -------
    dict
    """
    index = encoded(faces, "uint16" if len(corners) <= np.iinfo(np.uint16).max else "uint32")
    if exact or not len(corners):
        return {"kind": "mesh", "positions": encoded(corners, "float32"), "indices": index}
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle, scale = (low + high) / 2, float((high - low).max()) / 2 / _AS_IT_IS or 1.0
    steps = np.rint((corners - middle) / scale).astype(int)
    shares = {"scale": scale, "offset": middle.tolist()}
    return {"kind": "mesh", "positions": encoded(steps, "int16"), **shares, "indices": index}


def shape_of(geometry: Any) -> dict[str, Any] | None:
    """Return one of Pinocchio's shapes as a document has it.

    Parameters
    ----------
    geometry : coal.CollisionGeometry
        The shape.

    Returns
    -------
    dict or None
        None for a shape that is not drawn, such as a plane without end.
    """
    kind = type(geometry).__name__
    if kind == "Box":
        return {"kind": "box", "size": [2 * float(x) for x in np.ravel(geometry.halfSide)]}
    if kind == "Sphere":
        return {"kind": "sphere", "radius": float(geometry.radius)}
    if kind in ("Cylinder", "Capsule"):
        return {
            "kind": kind.lower(),
            "radius": float(geometry.radius),
            "length": 2 * float(geometry.halfLength),
        }
    return None


def solids_of(visual_model: pin.GeometryModel) -> list[dict[str, Any]]:
    """Return the solids of a visual model, those of the world in the layer ``"frame"``.

    Parameters
    ----------
    visual_model : pin.GeometryModel
        The visual model.

    Returns
    -------
    list of dict
    """
    found = []
    for one in visual_model.geometryObjects:
        shape = shape_of(one.geometry)
        if shape is not None:
            joint = int(one.parentJoint) - 1
            layer = "frame" if joint < 0 else "machine"
            found.append(solid(one.name, joint, placement(one.placement), shape, one.meshColor, layer))
    return found
