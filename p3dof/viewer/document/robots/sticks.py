"""Any robot as rods and balls: from each joint to the next ones, and to the ends of closures."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray
from p3dof._base.errors import MissingExtraError
from p3dof.loops import ClosedLoopModel

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
    """A robot as rods and balls: its tree, and these for solids.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.
    only : iterable of int, optional
        The joints whose bodies are drawn, 0 for the ground; all by default.

    Attributes
    ----------
    radius : float
        Of the rods [m].

    Raises
    ------
    MissingExtraError
        If coal, which holds the shapes, is not installed.
    """

    def __init__(self, loop: ClosedLoopModel, only: Iterable[int] | None = None) -> None:
        self.model = loop.model
        self.visual_model = pin.GeometryModel()
        ends = _ends(loop)
        self.radius = thickness(loop)
        for joint in ends if only is None else only:
            self._draw(joint, ends[joint])

    @property
    def sticks(self) -> frozenset[str]:
        """Names of the solids that are rods and balls: all."""
        return frozenset(str(solid.name) for solid in self.visual_model.geometryObjects)

    def _draw(self, joint: int, points: list[FloatArray]) -> None:
        coal, radius = shapes_library(), self.radius
        if joint:
            self._add(joint, "ball", 0, coal.Sphere(1.6 * radius), pin.SE3.Identity(), _BALL)
        colour = _COLOURS[joint % len(_COLOURS)] if joint else GROUND
        pairs = [(np.zeros(3), point) for point in points] if joint else _around(points)
        for number, (start, end) in enumerate(pairs):
            length = float(np.linalg.norm(end - start))
            if length > radius:
                place = pin.SE3(_turned_to((end - start) / length), (start + end) / 2)
                self._add(joint, "rod", number, coal.Cylinder(radius, length), place, colour)

    def _add(
        self, joint: int, what: str, number: int, shape: Any, place: pin.SE3, colour: tuple[float, ...]
    ) -> None:
        name = f"{self.model.names[joint]}_{what}_{number}"
        solid = pin.GeometryObject(name, joint, place, shape)
        solid.meshColor = np.array(colour)
        self.visual_model.addGeometryObject(solid)


def thickness(loop: ClosedLoopModel) -> float:
    """Return the radius of a robot's rods [m]."""
    points = [point for joint, found in _ends(loop).items() if joint for point in found]
    lengths = [float(np.linalg.norm(point)) for point in points]
    return THICK * max([length for length in lengths if length > 0], default=0.1)


def shapes_library() -> Any:
    """Return coal.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
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
