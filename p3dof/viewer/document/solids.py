"""The solids of any robot as a document has them, meshes within a budget; and the space that they take."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof.viewer.document.encoding import colour, decoded, encoded, some_of
from p3dof.viewer.document.figure import Drawable
from p3dof.viewer.document.meshes import Skin
from p3dof.viewer.document.trees import placement

_AS_IT_IS = 32767
"""Largest number of a mesh's corners in int16."""


def solid(
    name: str, joint: int, place: list[float], shape: dict[str, Any], rgba: Any, layer: str
) -> dict[str, Any]:
    """Return a solid as a document has it."""
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
    """Return a mesh as a document has it."""
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
    """Return the solids of a visual model, those of the world in the layer ``"frame"``."""
    found = []
    for one in visual_model.geometryObjects:
        shape = shape_of(one.geometry)
        if shape is not None:
            joint = int(one.parentJoint) - 1
            layer = "frame" if joint < 0 else "machine"
            found.append(solid(one.name, joint, placement(one.placement), shape, one.meshColor, layer))
    return found


_UP = 12
"""How many corners a round shape has along its axis."""
_TRIES = 40


class Triangles(NamedTuple):
    """A mesh."""

    corners: FloatArray  # (n, 3): [m]
    faces: NDArray[np.int_]  # (m, 3): counter-clockwise from outside


def triangles_of(geometry: Any) -> Triangles | None:
    """Return the triangles of a shape that is no box, sphere, cylinder or capsule.

    None for what has none, such as a plane without end.
    """
    kind = type(geometry).__name__
    if kind.startswith("BVHModel"):
        count = int(geometry.num_tris)
        indices = (geometry.tri_indices(i) for i in range(count))
        faces = np.array([(one[0], one[1], one[2]) for one in indices], dtype=int).reshape(-1, 3)
        return Triangles(np.array(geometry.vertices(), dtype=float).reshape(-1, 3), faces)
    if kind.startswith("Convex"):
        polygons = (geometry.polygons(i) for i in range(int(geometry.num_polygons)))
        faces = np.array([(one[0], one[1], one[2]) for one in polygons], dtype=int).reshape(-1, 3)
        return Triangles(np.array(geometry.points(), dtype=float).reshape(-1, 3), faces)
    if kind == "Ellipsoid":
        inner = [(math.sin(a), -math.cos(a)) for a in np.linspace(0.0, math.pi, _UP + 1)[1:-1]]
        ball = _turned([(0.0, -1.0), *inner, (0.0, 1.0)])
        return Triangles(ball.corners * np.ravel(geometry.radii), ball.faces)
    if kind == "Cone":
        radius, half = float(geometry.radius), float(geometry.halfLength)
        return _turned([(0.0, -half), (radius, -half), (0.0, half)])
    return None


def _turned(profile: list[tuple[float, float]]) -> Triangles:
    """Return the body that a profile of (radius, height), from below to above, makes around z."""
    surface = turned([(r, z, 0.0, 0.0) for r, z in profile])
    return whole(Triangles(surface.corners, surface.faces))


def whole(mesh: Triangles) -> Triangles:
    """Return a mesh with each corner once, and without triangles that have no area."""
    corners, places = np.unique(mesh.corners, axis=0, return_inverse=True)
    return _without_flat(corners, places.reshape(-1)[mesh.faces])


def _without_flat(corners: FloatArray, faces: NDArray[np.int_]) -> Triangles:
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    used, places = np.unique(faces, return_inverse=True)
    return Triangles(corners[used], places.reshape(-1, 3))


def reduced(mesh: Triangles, most: int) -> Triangles:
    """Return a mesh with at most so many triangles: corners that are near each other become one.

    With the finest of the grids tried whose cells have one corner each.
    """
    if len(mesh.faces) <= most:
        return mesh
    size = float(np.ptp(mesh.corners, axis=0).max())
    fine, coarse = 1e-4 * size, size
    best = Triangles(np.zeros((0, 3)), np.zeros((0, 3), dtype=int))
    for _ in range(_TRIES):
        cell = math.sqrt(fine * coarse)
        found = _clustered(mesh, cell)
        if len(found.faces) <= most:
            best, coarse = found, cell
        else:
            fine = cell
        if coarse < 1.02 * fine:
            break
    return best


def _clustered(mesh: Triangles, cell: float) -> Triangles:
    """Return a mesh whose corners in a cell of a grid are one, in their mean."""
    places = np.floor(mesh.corners / cell).astype(np.int64)
    _, which, counts = np.unique(places, axis=0, return_inverse=True, return_counts=True)
    which = which.reshape(-1)
    sums = [np.bincount(which, weights=column, minlength=len(counts)) for column in mesh.corners.T]
    found = _without_flat(np.column_stack(sums) / counts[:, None], which[mesh.faces])
    _, once = np.unique(np.sort(found.faces, axis=1), axis=0, return_index=True)
    return Triangles(found.corners, found.faces[np.sort(once)])


BUDGET = 60_000
"""Triangles of a document, about a megabyte in a page."""
_LEAST = 60
"""No mesh gets fewer triangles."""
_COLOURS = 6
"""A mesh of more colours is drawn in their mean."""


def robot_solids(figure: Drawable, budget: int = BUDGET) -> tuple[list[dict[str, Any]], list[str]]:
    """Return the solids of a robot, and what is to be said of them."""
    skins: Mapping[str, Skin] = getattr(figure, "skins", {})
    sticks: frozenset[str] = getattr(figure, "sticks", frozenset())
    found: list[dict[str, Any]] = []
    meshes: list[tuple[dict[str, Any], Triangles]] = []
    left_out = 0
    for name, one in named(figure.visual_model):
        rgba, layer = one.meshColor, "sticks" if one.name in sticks else "shapes"
        common = (int(one.parentJoint) - 1, placement(one.placement))
        if one.name in skins:
            for i, (part, colour) in enumerate(_parts(skins[one.name])):
                entry = solid(name if not i else f"{name} {i + 1}", *common, {}, colour, layer)
                meshes.append((entry, part))
                found.append(entry)
            continue
        shape = shape_of(one.geometry)
        entry = solid(name, *common, shape or {}, rgba, layer)
        triangles = triangles_of(one.geometry) if shape is None else None
        if triangles is not None:
            meshes.append((entry, triangles))
        if shape is None and (triangles is None or not len(triangles.faces)):
            left_out += 1
            continue
        found.append(entry)
    notes = [f"{left_out} shapes without an end are not shown"] if left_out else []
    return found, notes + _fill(meshes, budget)


def named(visual_model: pin.GeometryModel) -> list[tuple[str, Any]]:
    """Return the solids with names that no other has."""
    found, seen = [], dict[str, int]()
    for one in visual_model.geometryObjects:
        seen[one.name] = count = seen.get(one.name, 0) + 1
        found.append((one.name if count == 1 else f"{one.name} #{count}", one))
    return found


def drawn_meshes(figure: Drawable) -> dict[str, list[tuple[Triangles, tuple[float, ...]]]]:
    """Return the meshes of a robot's file by the names of their solids, by colour, within the budget."""
    skins: Mapping[str, Skin] = getattr(figure, "skins", {})
    parts = {name: _parts(skin) for name, skin in skins.items()}
    total = sum(len(mesh.faces) for found in parts.values() for mesh, _ in found)
    share = min(1.0, BUDGET / max(total, 1))
    return {
        name: [(reduced(mesh, max(_LEAST, int(share * len(mesh.faces)))), rgb) for mesh, rgb in found]
        for name, found in parts.items()
    }


def _parts(skin: Skin) -> list[tuple[Triangles, tuple[float, ...]]]:
    """Return the triangles of a skin by colour."""
    colours, which = np.unique(np.round(skin.colours * 255), axis=0, return_inverse=True)
    which = which.reshape(-1)
    if len(colours) > _COLOURS:
        colours, which = colours.mean(axis=0, keepdims=True), np.zeros_like(which)
    found = []
    for i, rgb in enumerate(colours):
        corners = skin.corners[which == i].reshape(-1, 3)
        part = whole(Triangles(corners, np.arange(len(corners)).reshape(-1, 3)))
        found.append((part, (*(float(x) / 255 for x in rgb), 1.0)))
    return found


def _fill(meshes: list[tuple[dict[str, Any], Triangles]], budget: int) -> list[str]:
    """Put the triangles into their solids; return notes."""
    total = sum(len(triangles.faces) for _, triangles in meshes)
    share, drawn = min(1.0, budget / total) if total else 1.0, 0
    for entry, triangles in meshes:
        few = reduced(triangles, max(_LEAST, int(share * len(triangles.faces))))
        entry["shape"] = mesh(few.corners, few.faces, exact=False)
        drawn += len(few.faces)
    if share == 1.0:
        return []
    return [f"The meshes are drawn with {drawn:,} of their {total:,} triangles, to keep the page small."]


_LOOKED_AT = 60
"""At so many configurations at most it is looked how much room a robot takes."""


def corners_of(solid: pin.GeometryObject) -> FloatArray:
    """Return the corners (8, 3) of the box around a solid, in its own axes [m]."""
    solid.geometry.computeLocalAABB()
    box = solid.geometry.aabb_local
    ends = np.array([box.min_, box.max_])
    return np.array(list(product(*ends.T)))


def room_of(model: pin.Model, visual_model: pin.GeometryModel, q: FloatArray) -> FloatArray:
    """Return points that hold all solids, or the joints of a robot without, along a motion.

    [m]; the origin if there is nothing.
    """
    data, points = model.createData(), [np.zeros((0, 3))]
    boxes = [(one, corners_of(one)) for one in visual_model.geometryObjects]
    for row in q[some_of(len(q), _LOOKED_AT)]:
        if not np.isfinite(row).all():
            continue
        pin.forwardKinematics(model, data, row)
        if not boxes:
            points.append(np.array([place.translation for place in data.oMi]))
        for solid, box in boxes:
            place = data.oMi[solid.parentJoint] * solid.placement
            points.append(box @ place.rotation.T + place.translation)
    found = np.concatenate(points)
    return found[np.isfinite(found).all(axis=1)] if len(found) else np.zeros((1, 3))


AROUND = 24
"""Corners around a round shape."""
_ARC = 6
"""Rings of a quarter of a circle."""


class Surface(NamedTuple):
    """A surface of triangles."""

    corners: FloatArray  # (n, 3): [m]
    normals: FloatArray | None  # (n, 3): at the corners; None where faces are flat
    faces: NDArray[np.int_]  # (m, 3): counter-clockwise from outside


def surface_of(shape: Mapping[str, Any]) -> Surface:
    """Return the surface of a shape of a document."""
    kind = shape["kind"]
    if kind == "box":
        return _box(np.asarray(shape["size"], dtype=float) / 2)
    if kind == "mesh":
        corners = decoded(shape["positions"]).astype(float)
        if "scale" in shape:
            corners = corners * shape["scale"] + np.asarray(shape["offset"])
        return Surface(corners, None, decoded(shape["indices"]).astype(int))
    radius, half = float(shape["radius"]), float(shape.get("length", 0.0)) / 2
    if kind == "cylinder":
        below, above = (0.0, -1.0), (0.0, 1.0)
        side = ((radius, -half, 1.0, 0.0), (radius, half, 1.0, 0.0))
        lid, bottom = (
            ((radius, half, *above), (0.0, half, *above)),
            ((0.0, -half, *below), (radius, -half, *below)),
        )
        return turned([*bottom, *side, *lid])
    angles = np.linspace(-math.pi / 2, math.pi / 2, 2 * _ARC + 1)
    rings = [(math.cos(a), math.sin(a)) for a in angles]
    rings[0], rings[-1] = (0.0, -1.0), (0.0, 1.0)
    middle = _ARC if half == 0.0 else _ARC + 1  # the equator of a capsule is there twice
    lower = [(radius * c, radius * s - half, c, s) for c, s in rings[:middle]]
    return turned([*lower, *((radius * c, radius * s + half, c, s) for c, s in rings[_ARC:])])


def turned(profile: Sequence[tuple[float, float, float, float]], around: int = AROUND) -> Surface:
    """Return the surface that a profile makes around z; without triangles that have no area."""
    angles = 2 * np.pi * np.arange(around) / around
    cos, sin, one = np.cos(angles), np.sin(angles), np.ones(around)
    corners = np.concatenate([np.column_stack((r * cos, r * sin, z * one)) for r, z, _, _ in profile])
    normals = np.concatenate([np.column_stack((r * cos, r * sin, z * one)) for _, _, r, z in profile])
    i = np.arange(around)
    j = (i + 1) % around
    faces: list[NDArray[np.int_]] = [np.zeros((0, 3), dtype=int)]
    for k, (low, high) in enumerate(pairwise(profile)):
        here, there = k * around, (k + 1) * around
        if low[:2] == high[:2]:
            continue
        if low[0] > 0:
            faces.append(np.column_stack((here + i, here + j, there + j)))
        if high[0] > 0:
            faces.append(np.column_stack((here + i, there + j, there + i)))
    return Surface(corners, normals, np.concatenate(faces))


def _box(half: FloatArray) -> Surface:
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
    return Surface(signs * half, None, np.array(faces))
