"""`RobotScene`: any robot drawn through Pinocchio's MeshCat visualizer, its forces and a point's path."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

import numpy as np
import pinocchio as pin

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError
from p3dof.loops import ClosedLoopModel
from p3dof.loops.sidecar import suggestion
from p3dof.loops.tables import is_slide
from p3dof.viewer.document.encoding import PALETTE, some_of
from p3dof.viewer.document.figure import Drawable
from p3dof.viewer.document.motion import JointMotion
from p3dof.viewer.document.solids import drawn_meshes, named, room_of
from p3dof.viewer.document.trees import tree_of
from p3dof.viewer.playing import MotionScene, Take, served
from p3dof.viewer.showing import Shapes, figure_of
from p3dof.viewer.stage import (
    above,
    colour_number,
    draw_arrow,
    draw_floor,
    draw_legend,
    draw_path,
    enlargement,
    legend_ends,
    placed,
    set_length,
    set_stage,
    sideways,
)
from p3dof.viewer.window import SceneWindow

_LONGEST = 0.5
"""Length of the longest arrow, as a share of half the robot's size."""
_THICK = 0.05
"""Radius of arrows, as a share of the longest one's length."""
_LETTER = 0.3
"""Size of the letters of the legend, as a share of the same."""
_UNITS = {1: "N", 2: "N m"}
"""Of arrows with so many heads."""
_LOOKED_AT = 60
"""At so many samples at most it is looked where arrows end."""
_PATH = 0x7B1FA2


class JointArrows:
    """Arrows of the actuators at their joints: forces along slides, torques, with two heads, about hinges.

    The largest force of a motion and its largest torque are as long as each other.
    """

    def __init__(self, viewer: Any, legend: Any, robot: ClosedLoopModel) -> None:
        self._viewer, self._legend = viewer, legend
        tree = tree_of(robot.model)
        self.joints = [robot.model.getJointId(name) for name in robot.actuated]
        self.heads = [1 if is_slide(robot, joint) else 2 for joint in self.joints]
        self.names = robot.actuated
        z = np.array([0.0, 0.0, 1.0])
        axes = [np.array(tree[joint - 1].get("axis", z)) for joint in self.joints]
        self.turns = [pin.SE3(pin.Quaternion.FromTwoVectors(z, axis), np.zeros(3)) for axis in axes]
        self.most = dict.fromkeys(_UNITS, 0.0)
        self.largest: FloatArray = np.ones(len(self.joints))
        self.metres = 1.0

    def set_scale(self, forces: FloatArray, metres: float) -> None:
        """Take forces (N, n) whose largest get arrows of a length [m], and draw all anew."""
        import meshcat.geometry as mg

        known = np.abs(np.where(np.isfinite(forces), forces, 0.0))
        kinds = np.array(self.heads)
        self.most = {n: known[:, kinds == n].max(initial=0.0) if known.size else 0.0 for n in _UNITS}
        self.largest = np.array([self.most[heads] or 1.0 for heads in self.heads])
        self.metres = metres
        for i, (name, heads) in enumerate(zip(self.names, self.heads, strict=True)):
            ink = int(PALETTE[i % len(PALETTE)][1:], 16)
            material = mg.MeshLambertMaterial(color=ink, depthTest=False, transparent=True)  # seen inside
            draw_arrow(self._viewer[name], _THICK * metres, material, heads)

    def draw_legends(self, points: FloatArray) -> FloatArray:
        """Draw the scales of forces and torques left of points (N, 3); return these and what they reach."""
        letter, right = _LETTER * self.metres, sideways()
        place = (points.min(axis=0) + points.max(axis=0)) / 2
        place = above(place + (min(points @ right) - place @ right) * right, -0.5 * self.metres)
        for heads, unit in _UNITS.items():
            node = self._legend[f"of_{heads}"]
            node.delete()
            if self.most[heads]:
                place = place - 2 * letter * right
                scale = self.most[heads], self.metres
                draw_legend(node, *scale, unit, _THICK * self.metres, letter, heads)
                node.set_transform(placed(place))
                points = np.stack((*points, *legend_ends(place, self.metres, letter)))
        return points

    def lengths(self, forces: FloatArray) -> FloatArray:
        """Return the lengths (n,) of arrows, negative against the axis [m]."""
        return np.asarray(forces / self.largest * self.metres)

    def places(self, data: pin.Data) -> list[pin.SE3]:
        """Return where arrows start and point to along z."""
        return [data.oMi[joint] * turn for joint, turn in zip(self.joints, self.turns, strict=True)]

    def show(self, data: pin.Data, forces: FloatArray | None) -> None:
        """Show forces (n,) of a robot whose joints are placed; none where they are NaN."""
        self._legend.set_property("visible", forces is not None)
        newtons = np.full(len(self.joints), np.nan) if forces is None else forces
        for name, heads, place, length in zip(
            self.names, self.heads, self.places(data), self.lengths(newtons).tolist(), strict=True
        ):
            self._viewer[name].set_transform(place.homogeneous)
            set_length(self._viewer[name], length, _THICK * self.metres, heads)


class RobotScene(MotionScene):
    """Any robot in a window of MeshCat, at first where its loops close near the reference.

    Everything is drawn under ``/meshcat``, in the axes of the world and metres.
    """

    def __init__(
        self,
        robot: ClosedLoopModel,
        figure: Drawable,
        window: SceneWindow | None = None,
        trace: str | None = None,
    ) -> None:
        self.robot, self._figure, self._trace = robot, figure, trace
        if trace is not None and not robot.model.existFrame(trace):
            known = suggestion(str(trace), (frame.name for frame in robot.model.frames))
            raise InputError(f"trace: the robot has no frame {shown(trace)}; {known}")
        self.title = str(robot.model.name)
        visual = pin.GeometryModel()
        seen = getattr(figure, "usual", {}).get("sticks", True)
        hidden: frozenset[str] = frozenset() if seen else getattr(figure, "sticks", frozenset())
        for name, solid in named(figure.visual_model):
            if solid.name not in hidden:
                copy = pin.GeometryObject(solid)
                copy.name = name.replace("/", "_")
                visual.addGeometryObject(copy)
        super().__init__(window, robot.model, visual)
        self._draw_meshes()
        self._arrows = JointArrows(self._viewer["forces"], self._viewer["legend"], robot)
        self.begin(self._standing())
        self.display(robot.assemble().q)

    def _standing(self) -> Take:
        q = self.robot.assemble().q[None]
        return Take(np.zeros(1), q, np.zeros((1, 0)), np.zeros((0, 3)))

    def take(self, motion: Any, wrench: Any = None) -> Take:
        """Return what is played of a `JointMotion`, or of a run with time, q and forces."""
        if wrench is not None:
            raise InputError("wrench: a run of any robot has its own loads")
        if not all(hasattr(motion, name) for name in ("time", "q", "forces")):
            raise InputError(f"motion: expected a RobotRun or a JointMotion, got {shown(motion)}")
        q = np.asarray(motion.q, dtype=float)
        if q.ndim != 2 or q.shape[1] != self.model.nq:
            raise InputError(f"motion: expected q of shape (N, {self.model.nq}), got {q.shape}")
        known = motion.known if isinstance(motion, JointMotion) else motion.forces
        return Take(np.asarray(motion.time), q, np.asarray(known), self._path(q))

    def _path(self, q: FloatArray) -> FloatArray:
        if self._trace is None:
            return np.zeros((0, 3))
        data, frame = self.model.createData(), self.model.getFrameId(self._trace)
        points = np.full((len(q), 3), np.nan)
        for point, row in zip(points, q, strict=True):
            if np.isfinite(row).all():
                pin.forwardKinematics(self.model, data, row)
                point[:] = pin.updateFramePlacement(self.model, data, frame).translation
        return points

    def begin(self, take: Take) -> None:
        """Draw floor and path, and set camera and scale of the arrows for a motion."""
        room = room_of(self.model, self.visualizer.visual_model, take.q)
        low, high = room.min(axis=0), room.max(axis=0)
        half = max(float((high - low).max()) / 2, 1e-6)
        self._arrows.set_scale(take.forces, _LONGEST * half)
        points = np.concatenate((room, self._ends(take), take.path[np.isfinite(take.path).all(axis=1)]))
        points = self._arrows.draw_legends(points)
        x, y, _ = ((points.min(axis=0) + points.max(axis=0)) / 2).tolist()
        set_stage(self._viewer, points, enlargement(half), (x, y))
        draw_floor(self._viewer["floor"], max(half, float(np.abs(room[:, :2]).max())), float(low[2]))
        draw_path(self._viewer["trace"], take.path, _PATH)

    def _ends(self, take: Take) -> FloatArray:
        """Return where arrows begin and end over a motion, (M, 3)."""
        data, found = self.model.createData(), [np.zeros((0, 3))]
        for i in some_of(len(take.time), _LOOKED_AT):
            if take.forces.size and np.isfinite(take.q[i]).all():
                pin.forwardKinematics(self.model, data, take.q[i])
                tips = self._arrows.lengths(np.nan_to_num(take.forces[i]))[:, None] * [0.0, 0.0, 1.0]
                places = self._arrows.places(data)
                found += [np.array([p.act(tip), p.translation]) for p, tip in zip(places, tips, strict=True)]
        return np.concatenate(found)

    def display(self, q: FloatArray, forces: FloatArray | None = None) -> None:
        """Show the robot at a configuration (nq,), and the forces (n,) of its actuators."""
        with self.drawing:
            self.visualizer.display(np.asarray(q, dtype=float))
            self._arrows.show(self.visualizer.data, forces)

    def another(self) -> RobotScene:
        """Return the same robot in a window of its own."""
        return RobotScene(self.robot, self._figure, SceneWindow(), self._trace)

    def _draw_meshes(self) -> None:
        """Draw the meshes of the robot's file in the places of the boxes that stand for them."""
        import meshcat.geometry as mg

        for name, parts in drawn_meshes(self._figure).items():
            node = self._viewer[f"{self.visualizer.viewerVisualGroupName}/{name}"]
            node.delete()
            for i, (mesh, rgb) in enumerate(parts):
                material = mg.MeshPhongMaterial(color=colour_number(rgb), flatShading=True)
                node[f"part_{i}"].set_object(mg.TriangularMeshGeometry(*mesh), material)


def robot_viewer(
    robot: ClosedLoopModel,
    shapes: Shapes | None = None,
    package_dirs: Iterable[str | os.PathLike[str]] = (),
    *,
    trace: str | None = None,
    port: int | None = None,
) -> Any:
    """Return Pinocchio's MeshCat visualizer of any robot, which also plays its motions.

    ``robot_viewer(robot, "robot.urdf").play(run)`` plays a run in real time, with arrows of the actuators:
    along slides forces, about hinges torques, which have two heads, and grey ones for scale;
    ``record(run).save("run.html")`` writes a page that plays it. The live page is at
    ``visualizer.viewer.url()`` until ``visualizer.viewer.close()``.

    Parameters
    ----------
    robot : ClosedLoopModel
        The robot, as of `p3dof.load_robot`.
    shapes, package_dirs
        As of `robot_page`: the file that the robot was read from, for its shapes; rods without.
    trace : str, optional
        The frame whose path is drawn.
    port : int, optional
        Of the server, 0 for any; the first free one from 7000 on by default.

    Raises
    ------
    AssemblyError
        If the loops do not close.
    InputError
        If an argument does not fit, or the port is busy.
    MissingExtraError
        If meshcat, which the extra ``viz`` brings, is not installed.
    """
    figure = figure_of(robot, shapes, package_dirs)
    return served(lambda window: RobotScene(robot.copy(), figure, window, trace), port)
