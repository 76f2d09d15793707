"""Any robot as rods and balls: from each joint to the next ones, and to the ends of closures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from p3dof.checks import FloatArray
from p3dof.closed_loop import ClosedLoopModel
from p3dof.errors import MissingExtraError

_THICK = 0.02
"""Radius of a rod, as a share of the largest distance in the robot."""
_COLOURS = (
    (0.35, 0.45, 0.60, 1.0),
    (0.75, 0.55, 0.30, 1.0),
    (0.40, 0.60, 0.45, 1.0),
    (0.60, 0.45, 0.60, 1.0),
)
_BALL = (0.2, 0.2, 0.2, 1.0)


class StickFigure:
    """A robot that has no shapes, to be drawn: its tree, and rods for solids.

    Parameters
    ----------
    loop : ClosedLoopModel
        The robot.

    Raises
    ------
    MissingExtraError
        If coal, which holds the shapes, is not installed.
    """

    def __init__(self, loop: ClosedLoopModel) -> None:
        try:
            import coal
        except ImportError as error:
            raise MissingExtraError("shapes need coal: pip install 'p3dof[viz]'") from error
        self.model = loop.model
        self.visual_model = pin.GeometryModel()
        ends = _ends(loop)
        lengths = [float(np.linalg.norm(p)) for points in ends.values() for p in points]
        radius = _THICK * max([length for length in lengths if length > 0], default=0.1)
        for joint, points in ends.items():
            colour = _COLOURS[joint % len(_COLOURS)]
            if joint:
                self._add(joint, "ball", 0, coal.Sphere(1.6 * radius), pin.SE3.Identity(), _BALL)
            for number, point in enumerate(points):
                length = float(np.linalg.norm(point))
                if length > radius:
                    place = pin.SE3(_turned_to(point / length), point / 2)
                    self._add(joint, "rod", number, coal.Cylinder(radius, length), place, colour)

    def _add(
        self, joint: int, what: str, number: int, shape: Any, place: pin.SE3, colour: tuple[float, ...]
    ) -> None:
        name = f"{self.model.names[joint]}_{what}_{number}"
        solid = pin.GeometryObject(name, joint, place, shape)
        solid.meshColor = np.array(colour)
        self.visual_model.addGeometryObject(solid)


def _ends(loop: ClosedLoopModel) -> dict[int, list[FloatArray]]:
    """Return, for every joint, where rods from it end, in its own axes."""
    model = loop.model
    ends: dict[int, list[FloatArray]] = {i: [] for i in range(model.njoints)}
    for i in range(1, model.njoints):
        if model.parents[i]:  # the ground is not drawn
            ends[int(model.parents[i])].append(np.array(model.jointPlacements[i].translation))
    closing = {name for c in loop.sidecar.closures for name in (c.frame1, c.frame2)}
    for frame in model.frames:
        if frame.name in closing and frame.parentJoint:
            ends[int(frame.parentJoint)].append(np.array(frame.placement.translation))
    for i in range(1, model.njoints):
        if not any(np.linalg.norm(point) > 0 for point in ends[i]):  # a last link: to its mass centre, twice
            ends[i].append(2.0 * np.array(model.inertias[i].lever))
    return ends


def _turned_to(direction: FloatArray) -> FloatArray:
    """Return axes whose third one has a direction."""
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), direction)
    return np.array(turn.toRotationMatrix())
