"""The solids of any robot as a document has them, meshes within a budget of triangles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from p3dof.viewer.document.drawable import Drawable
from p3dof.viewer.document.robots.meshes import Skin
from p3dof.viewer.document.robots.triangles import Triangles, reduced, triangles_of, whole
from p3dof.viewer.document.solids import mesh, shape_of, solid
from p3dof.viewer.document.trees import placement

BUDGET = 60_000
"""Triangles of a document, about a megabyte in a page."""
_LEAST = 60
"""No mesh gets fewer triangles."""
_COLOURS = 6
"""A mesh of more colours is drawn in their mean."""


def robot_solids(figure: Drawable, budget: int = BUDGET) -> tuple[list[dict[str, Any]], list[str]]:
    """Return the solids of a robot, and what is to be said of them.

    Parameters
    ----------
    figure : Drawable
        Its solids, such as a `RobotFigure`, whose meshes are `skins` in the place of boxes.
    budget : int
        Most triangles of all meshes together.

    Returns
    -------
    list of dict
        In the layers ``"shapes"`` and ``"sticks"``.
    list of str
        Notes: what is drawn with fewer triangles, and what is left out.
    """
    skins: Mapping[str, Skin] = getattr(figure, "skins", {})
    sticks: frozenset[str] = getattr(figure, "sticks", frozenset())
    found: list[dict[str, Any]] = []
    meshes: list[tuple[dict[str, Any], Triangles]] = []
    left_out = 0
    for name, one in _named(figure.visual_model):
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


def _named(visual_model: pin.GeometryModel) -> list[tuple[str, Any]]:
    """Return the solids with names that no other has."""
    found, seen = [], dict[str, int]()
    for one in visual_model.geometryObjects:
        seen[one.name] = count = seen.get(one.name, 0) + 1
        found.append((one.name if count == 1 else f"{one.name} #{count}", one))
    return found


def _parts(skin: Skin) -> list[tuple[Triangles, tuple[float, ...]]]:
    """Return the triangles of a skin by colour."""
    colours, which = np.unique(np.round(skin.colours * 255), axis=0, return_inverse=True)
    which = which.reshape(-1)
    if len(colours) > _COLOURS:
        colours, which = colours.mean(axis=0, keepdims=True), np.zeros_like(which)
    found = []
    for i, colour in enumerate(colours):
        corners = skin.corners[which == i].reshape(-1, 3)
        part = whole(Triangles(corners, np.arange(len(corners)).reshape(-1, 3)))
        found.append((part, (*(float(x) / 255 for x in colour), 1.0)))
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
