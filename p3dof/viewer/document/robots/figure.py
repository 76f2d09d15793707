"""`RobotFigure`: the solids that a robot is drawn as: the shapes of its own file, and rods and balls."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from p3dof._base.errors import FileError, MissingExtraError, ModelError
from p3dof.loops import ClosedLoopModel
from p3dof.loops.robots import file_of
from p3dof.viewer.document.robots.meshes import MeshFiles, Skin
from p3dof.viewer.document.robots.sticks import StickFigure, shapes_library
from p3dof.viewer.document.robots.visuals import Visual, folder_of, visuals_of

_PLAIN = (0.62, 0.66, 0.70, 1.0)
"""Colour of a shape that has none."""
_THIN = 1e-9
"""Least edge of a box around a mesh [m]."""
_COLLECTION = "example-robot-data"


class RobotFigure:
    """A robot as the shapes of its own file, and as rods and balls, to choose from.

    Meshes are opened only inside of the folder of the file and of `package_dirs`. What is missing or refused
    is told in `notes`, and the rods are shown.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    source : str or path-like, optional
        What it was read from: the path of its URDF or MJCF, the text, or its name. Without, there are rods
        only.
    package_dirs : iterable of path-like
        Folders that hold the packages of ``package://name/...``, or are one of this name.

    Attributes
    ----------
    model, visual_model
        The tree and all solids.
    sticks : frozenset of str
        Names of the rods and balls.
    skins : dict of str to Skin
        Triangles of the meshes, about the middle of the boxes that stand for them among the solids.
    usual : dict of str to bool
        Whether rods are to be seen at first.
    notes : tuple of str
        What is not shown and why, one line each.

    Raises
    ------
    ModelError
        If the file is malformed.
    InputError
        If one of `package_dirs` is no folder.
    MissingExtraError
        If coal, which holds the shapes, is not installed.
    """

    def __init__(
        self,
        loop: ClosedLoopModel,
        source: str | os.PathLike[str] | None = None,
        package_dirs: Iterable[str | os.PathLike[str]] = (),
    ) -> None:
        figure = StickFigure(loop)
        self.model, self.visual_model, self.sticks = figure.model, figure.visual_model, figure.sticks
        self.skins: dict[str, Skin] = {}
        self.notes: tuple[str, ...] = ()
        count = 0
        if source is not None:
            file = file_of(source)
            named = file is not None and file != os.fspath(source)
            dirs = [*package_dirs, *(_collection(file) if named and file else [])]
            count = self._add_all(source if file is None else file, dirs)
        self.usual = {"sticks": not count or bool(self.notes)}

    def _add_all(self, source: str | os.PathLike[str], package_dirs: Iterable[str | os.PathLike[str]]) -> int:
        """Add the shapes of a file; return how many."""
        files = MeshFiles(folder_of(source), package_dirs)
        try:
            visuals, left_out = visuals_of(self.model, source)
        except MissingExtraError as error:
            self.notes = (f"rods are drawn: {error}",)
            return 0
        count = 0
        for number, visual in enumerate(visuals):
            why = self._tried(f"shape_{number}_{self.model.names[visual.joint]}", visual, files)
            left_out += [why] if why else []
            count += not why
        self.notes = tuple(_told(left_out))
        return count

    def _tried(self, name: str, visual: Visual, files: MeshFiles) -> str:
        """Add a shape; return why it cannot be."""
        try:
            self._add(name.replace("/", "_"), visual, files)
        except (FileError, ModelError, MissingExtraError) as error:
            return str(error)
        return ""

    def _add(self, name: str, visual: Visual, files: MeshFiles) -> None:
        place, colour = visual.placement, visual.colour
        if visual.kind == "mesh":
            skin = files.read(visual.mesh, colour)
            skin = Skin(skin.corners * np.array(visual.size), skin.colours)
            low, high = skin.box
            middle = (low + high) / 2
            place = place * pin.SE3(np.eye(3), middle)
            self.skins[name] = Skin(skin.corners - middle, skin.colours)
            solid: Any = shapes_library().Box(*np.maximum(high - low, _THIN).tolist())
        else:
            solid = _primitive(visual)
        geometry = pin.GeometryObject(name, visual.joint, place, solid)
        geometry.meshColor = np.array(_PLAIN if colour is None else colour)
        self.visual_model.addGeometryObject(geometry)


def _primitive(visual: Visual) -> Any:
    coal = shapes_library()
    if min(visual.size) <= 0:
        raise ModelError(f"a {visual.kind} without size")
    kinds = {
        "box": coal.Box,
        "cylinder": coal.Cylinder,
        "sphere": coal.Sphere,
        "capsule": coal.Capsule,
        "ellipsoid": coal.Ellipsoid,
    }
    return kinds[visual.kind](*visual.size)


def _told(left_out: list[str]) -> list[str]:
    """Return one line for all shapes that are left out."""
    distinct = list(dict.fromkeys(left_out))
    if not distinct:
        return []
    more = f", and {len(distinct) - 1} more" if len(distinct) > 1 else ""
    count = f"{len(left_out)} shapes are" if len(left_out) > 1 else "1 shape is"
    return [f"{count} not shown: {distinct[0]}{more}"]


def _collection(file: str) -> list[Path]:
    """Return the folder of example-robot-data that has a file: its robots name their meshes from there."""
    return [parent for parent in Path(file).resolve().parents if parent.name == _COLLECTION][:1]
