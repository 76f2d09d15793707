"""What a robot is drawn as: the shapes of its own file, and rods and balls from joint to joint."""

from __future__ import annotations

import os
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof._base.errors import FileError, MissingExtraError, ModelError
from p3dof.loops import ClosedLoopModel
from p3dof.loops.robots import file_of
from p3dof.viewer.document.meshes import MeshFiles, Skin, Visual, folder_of, visuals_of


class Drawable(Protocol):
    """A robot that can be drawn: a tree, and solids on its bodies."""

    @property
    def model(self) -> Any:
        """The tree, a `pinocchio.Model`."""

    @property
    def visual_model(self) -> Any:
        """Its visible solids, a `pinocchio.GeometryModel`."""


THICK = 0.016
"""Radius of a rod, as a share of the largest distance in the robot."""
_COLOURS = (
    (0.42, 0.50, 0.60, 1.0),
    (0.66, 0.58, 0.45, 1.0),
    (0.50, 0.60, 0.52, 1.0),
    (0.60, 0.53, 0.60, 1.0),
)
_BALL = (0.25, 0.27, 0.30, 1.0)
GROUND = (0.72, 0.74, 0.77, 1.0)
_FLOATING = ("JointModelFreeFlyer", "JointModelPlanar", "JointModelTranslation")
"""Joints that fix nothing to the ground."""


class StickFigure:
    """A robot as rods and balls: its tree, and these for solids."""

    def __init__(self, loop: ClosedLoopModel) -> None:
        self.model = loop.model
        self.visual_model = pin.GeometryModel()
        ends = _ends(loop)
        lengths = [float(np.linalg.norm(point)) for joint in ends if joint for point in ends[joint]]
        self.radius = THICK * max([length for length in lengths if length > 0], default=0.1)
        for joint, points in ends.items():
            self._draw(joint, points)
        self.sticks = frozenset(str(solid.name) for solid in self.visual_model.geometryObjects)

    def _draw(self, joint: int, points: list[FloatArray]) -> None:
        coal, radius, name = shapes_library(), self.radius, self.model.names[joint]
        if joint:
            self._add(f"{name}_ball_0", joint, coal.Sphere(1.6 * radius), pin.SE3.Identity(), _BALL)
        colour = _COLOURS[joint % len(_COLOURS)] if joint else GROUND
        pairs = [(np.zeros(3), point) for point in points] if joint else _around(points)
        for number, (start, end) in enumerate(pairs):
            length = float(np.linalg.norm(end - start))
            if length > radius:
                place = pin.SE3(_turned_to((end - start) / length), (start + end) / 2)
                self._add(f"{name}_rod_{number}", joint, coal.Cylinder(radius, length), place, colour)

    def _add(self, name: str, joint: int, shape: Any, place: pin.SE3, colour: tuple[float, ...]) -> None:
        solid = pin.GeometryObject(name, joint, place, shape)
        solid.meshColor = np.array(colour)
        self.visual_model.addGeometryObject(solid)


def shapes_library() -> Any:
    """Return coal."""
    try:
        import coal
    except ImportError as error:
        raise MissingExtraError("shapes need coal: pip install 'p3dof[viz]'") from error
    return coal


def _ends(loop: ClosedLoopModel) -> dict[int, list[FloatArray]]:
    """Return, for every joint, where rods from it end, in its own axes; for the ground, what it carries."""
    model = loop.model
    ends: dict[int, list[FloatArray]] = {i: [] for i in range(model.njoints)}
    for i in range(1, model.njoints):
        if model.joints[i].shortname() not in _FLOATING:
            ends[int(model.parents[i])].append(np.array(model.jointPlacements[i].translation))
    closing = {name for c in loop.sidecar.closures for name in (c.frame1, c.frame2)}
    for frame in model.frames:
        if frame.name in closing:
            ends[int(frame.parentJoint)].append(np.array(frame.placement.translation))
    for i in range(1, model.njoints):
        if not any(np.linalg.norm(point) > 0 for point in ends[i]):  # a last link: to its mass centre, twice
            ends[i].append(2.0 * np.array(model.inertias[i].lever))
    return ends


def _around(points: list[FloatArray]) -> list[tuple[FloatArray, FloatArray]]:
    """Return the pairs of points that a ring through all of them joins; a chain where they are in a line."""
    if len(points) < 2:
        return []
    cloud = np.array(points)
    cloud = cloud[np.sort(np.unique(cloud.round(9), axis=0, return_index=True)[1])]
    from_middle = cloud - cloud.mean(axis=0)
    _, sizes, axes = np.linalg.svd(from_middle, full_matrices=False)
    flat = from_middle @ axes[:2].T if len(cloud) > 1 else from_middle[:, :2]
    if len(cloud) < 3 or sizes[1] < 1e-6 * sizes[0]:
        order = np.argsort(flat[:, 0])
        return [(cloud[a], cloud[b]) for a, b in pairwise(order)]
    order = np.argsort(np.arctan2(flat[:, 1], flat[:, 0]))
    return [(cloud[a], cloud[b]) for a, b in zip(order, np.roll(order, -1), strict=True)]


def _turned_to(direction: FloatArray) -> FloatArray:
    """Return axes (3, 3) whose third one has a direction (3,)."""
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), np.array(direction))
    return np.array(turn.toRotationMatrix())


_PLAIN = (0.62, 0.66, 0.70, 1.0)
"""Colour of a shape that has none."""
_THIN = 1e-9
"""Least edge of a box around a mesh [m]."""
_COLLECTION = "example-robot-data"


class RobotFigure(StickFigure):
    """A robot as the shapes of its own file, and as rods and balls, to choose from.

    Meshes are opened only inside of the folder of the file and of `package_dirs`. What is missing or refused
    is told in `notes`, and the rods are shown.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    source : str or path-like, optional
        What it was read from: the path of its URDF, SDF or MJCF, the text, or its name. Without, there are
        rods only.
    package_dirs : iterable of path-like
        Folders that hold the packages of ``package://name/...``, or are one of this name; of an SDF the
        models of ``model://name/...``, and files that it includes.

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
        super().__init__(loop)
        self.skins: dict[str, Skin] = {}
        self.notes: tuple[str, ...] = ()
        count = 0
        if source is not None:
            file = file_of(source)
            named = file is not None and file != os.fspath(source)
            dirs = [*package_dirs, *(_collection(file) if named and file else [])]
            count = self._add_all(file if named and file else source, dirs)
        self.usual = {"sticks": not count or bool(self.notes)}

    def _add_all(self, source: str | os.PathLike[str], package_dirs: Iterable[str | os.PathLike[str]]) -> int:
        """Add the shapes of a file; return how many."""
        files = MeshFiles(folder_of(source), package_dirs)
        try:
            visuals, left_out = visuals_of(self.model, source, package_dirs)
        except MissingExtraError as error:
            self.notes = (f"rods are drawn: {error}",)
            return 0
        count = 0
        for number, visual in enumerate(visuals):
            name = f"shape_{number}_{self.model.names[visual.joint]}".replace("/", "_")
            try:
                self._add_shape(name, visual, files)
                count += 1
            except (FileError, ModelError, MissingExtraError) as error:
                left_out.append(str(error))
        self.notes = tuple(_told(left_out))
        return count

    def _add_shape(self, name: str, visual: Visual, files: MeshFiles) -> None:
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
        self._add(name, visual.joint, solid, place, _PLAIN if colour is None else colour)


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
