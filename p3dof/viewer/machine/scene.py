"""`Scene`: the machine drawn through Pinocchio's MeshCat visualizer, with forces and the path of P."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, as_floats, frozen_array
from p3dof._base.errors import InputError
from p3dof.machine.description.shapes import PLATFORM
from p3dof.machine.motion import states_of
from p3dof.methods import InverseDynamics
from p3dof.methods.virtual_power import VirtualPowerMethod
from p3dof.viewer.machine.document import TITLE
from p3dof.viewer.machine.room import (
    AXES,
    COLOURS,
    GLASS,
    LEGS,
    LINKS_OF_LEGS,
    RAIL,
    TRACE,
    Machine,
    Room,
    require_machine,
    skin_of,
    trace_of,
)
from p3dof.viewer.machine.runs import Samples
from p3dof.viewer.machine.showing import solved
from p3dof.viewer.playing import MotionScene, Take, served
from p3dof.viewer.stage import (
    above,
    colour_number,
    draw_arrow,
    draw_floor,
    draw_legend,
    draw_path,
    legend_ends,
    number,
    placed,
    round_below,
    set_length,
    set_stage,
    sideways,
    write_text,
)
from p3dof.viewer.window import SceneWindow

_POSES = 41
"""Along each axis of the poses that are looked at for forces at rest."""
_FAR = 4.0
"""Forces at rest beyond so many times the middle one are those near a singularity, which have no bound."""
_CUT = 1.01
"""An arrow may be so much longer than the longest: forces at rest are looked at in samples."""


@dataclass(frozen=True)
class ArrowScale:
    """Lengths of arrows: in proportion to the forces, the longest for the largest one."""

    newtons: float  # the largest force [N]
    metres: float  # the length of its arrow [m]
    low: float  # between which heights the arrows are, tips included [m]
    high: float
    words: str  # what the largest force is one of

    @classmethod
    def of_motion(cls, robot: Machine, result: InverseDynamics, *more: FloatArray) -> ArrowScale:
        """Return the scale for a motion.

        For the largest of all forces; where they are NaN there is no arrow.
        """
        forces = np.stack((result.forces, *more))
        return cls.of(robot, forces, result.sliders)

    @classmethod
    def at_rest(cls, robot: Machine) -> ArrowScale:
        """Return the scale for a machine that is moved by hand: for what holds it at rest.

        That is the largest force over the poses within reach, travel and tilt, but not those near a
        singularity: forces beyond four times the middle one are left out.
        """
        geometry, tilt = robot.parameters.geometry, robot.parameters.limits.tilt
        reach = geometry.L - (geometry.R - geometry.r)
        y, theta = np.meshgrid(np.linspace(-reach, reach, _POSES), np.linspace(*tilt, _POSES))
        poses = np.stack((y, np.zeros_like(y), theta), axis=-1).reshape(-1, 3)
        states = states_of(poses, on_invalid="nan")
        forces = np.abs(VirtualPowerMethod(robot.parameters).forces(states))
        found = forces[np.isfinite(forces)]
        found = found[found <= _FAR * np.median(found)] if len(found) else found
        words = "about the largest static actuator force"
        return cls.of(robot, found, np.full(found.shape, np.nan), words).by_hand(robot)

    @classmethod
    def of(
        cls,
        robot: Machine,
        forces: FloatArray,
        sliders: FloatArray,
        words: str = "the largest force of the motion",
    ) -> ArrowScale:
        """Return the scale for forces (..., 3) [N] on sliders (..., 3) [m]; NaN does not count."""
        metres = robot.parameters.geometry.R
        largest = float(np.abs(forces[np.isfinite(forces)]).max(initial=0.0))
        if largest < np.finfo(float).tiny:  # no force at all
            limit = robot.parameters.limits.force
            largest, words = (limit, "the limit of the drives") if math.isfinite(limit) else (1.0, "1 N")
        ends = np.stack(np.broadcast_arrays(sliders, sliders + metres / largest * forces))
        ends = ends[np.isfinite(ends)]
        return cls(largest, metres, ends.min(initial=np.inf), ends.max(initial=-np.inf), words)

    def by_hand(self, robot: Machine) -> ArrowScale:
        """Return the same scale for a platform that is also moved by hand: all over the travel."""
        low, high = robot.parameters.limits.travel
        return replace(self, low=min(self.low, low - self.metres), high=max(self.high, high + self.metres))

    @property
    def reference(self) -> float:
        """The force of the legend's arrow: 1, 2 or 5 times a power of ten, at most the largest [N]."""
        return round_below(self.newtons)

    @property
    def legend(self) -> str:
        """What the arrows mean, in words."""
        return (
            f"The grey arrow is {number(self.reference)} N; "
            f"the longest is {number(self.newtons)} N, {self.words}."
        )

    def length(self, force: float) -> float:
        """Return how long the arrow of a force is [m], negative for one that points down.

        In proportion to the force, but cut off for one that is `beyond` the largest.
        """
        return float(np.clip(force / self.newtons, -_CUT, _CUT) * self.metres)

    def beyond(self, force: float) -> bool:
        """Return whether a force is larger than the scale's largest, so that its arrow is cut off."""
        return bool(abs(force) > _CUT * self.newtons)


TEXTS = {"cut": "off scale", "open": "undetermined"}
"""What is written over an arrow that is cut off, and in place of one whose force is NaN."""


class ForceArrows:
    """The arrows of the forces A, B, C, and one for a round number of newtons."""

    def __init__(self, viewer: Any, room: Room, scale: ArrowScale) -> None:
        self.scale = scale
        self.radius = 0.7 * room.size.rod_radius
        self._viewer, self._room = viewer, room
        self._places = {leg: room.pivots[leg] + shift for leg, shift in room.beside.items()}
        low, high = room.travel  # the legend stands left of the machine, about as far from the eye
        self._legend = above(-1.7 * room.radius * sideways(), (low + high) / 2 - 0.5 * scale.metres)

    @property
    def ends(self) -> FloatArray:
        """All that the arrows reach, and what is written about the legend's, shape (N, 3)."""
        ends = [above(p, end) for p in self._places.values() for end in (self.scale.low, self.scale.high)]
        return np.stack((*ends, *legend_ends(self._legend, self.scale.metres, self._room.letter)))

    def draw(self) -> None:
        """Put all into the scene; `show` places it."""
        import meshcat.geometry as mg

        for leg in LEGS:
            material = mg.MeshLambertMaterial(color=colour_number(COLOURS[leg]))
            draw_arrow(self._viewer["forces"][leg], self.radius, material)
            for name, text in TEXTS.items():
                write_text(self._viewer[name][leg]["text"], text, np.zeros(3), 2 * self._room.letter)
        self._viewer["legend"].set_transform(placed(self._legend))
        self._draw_legend()

    def show(self, sliders: FloatArray, forces: FloatArray | None) -> None:
        """Show forces."""
        self._viewer["legend"].set_property("visible", forces is not None)
        newtons = np.zeros(3) if forces is None else forces
        for leg, slider, force in zip(LEGS, sliders.tolist(), newtons.tolist(), strict=True):
            node, place = self._viewer["forces"][leg], above(self._places[leg], slider)
            length = self.scale.length(force)
            node.set_transform(placed(place))
            set_length(node, length, self.radius)
            self._say("open", leg, bool(np.isnan(force)), place)
            below = 1.4 * self._room.letter if length < 0 else 0.0
            self._say("cut", leg, self.scale.beyond(force), above(place, length - below))

    def set_scale(self, scale: ArrowScale) -> None:
        """Take another scale, and draw the legend anew; the arrows follow when they are shown."""
        if scale != self.scale:
            self.scale = scale
            self._draw_legend()

    def _say(self, name: str, leg: str, so: bool, place: FloatArray) -> None:
        """Show one of `TEXTS` over a place, or hide it."""
        self._viewer[name][leg].set_property("visible", so)
        if so:
            self._viewer[name][leg].set_transform(placed(above(place, 0.7 * self._room.letter)))

    def _draw_legend(self) -> None:
        scale = self.scale.newtons, self.scale.metres
        draw_legend(self._viewer["legend"], *scale, "N", self.radius, self._room.letter)


MARK = (0.85, 0.05, 0.1, 1.0)
"""Colour of a leg that is out of reach."""


class Scene(MotionScene):
    """One machine in a window, at home at first.

    Everything is drawn under ``/meshcat``, whose axes are those of the fixed frame, in metres.
    ``Scene(robot).record(motion).save("motion.html")`` writes a page that plays a motion.
    """

    title = TITLE

    def __init__(
        self, robot: Machine, window: SceneWindow | None = None, scale: ArrowScale | None = None
    ) -> None:
        require_machine(robot)
        if not isinstance(scale, ArrowScale | None):
            raise InputError(f"scale: expected an ArrowScale, got {type(scale).__name__}")
        if not isinstance(window, SceneWindow | None):
            raise InputError(f"window: expected a SceneWindow, got {type(window).__name__}")
        self.robot = robot
        super().__init__(window, robot.model, robot.visual_model)
        self._room = Room.around(robot.parameters)
        scale = ArrowScale.at_rest(robot) if scale is None else scale
        self._arrows = ForceArrows(self._viewer, self._room, scale)
        self._columns = [robot.model.names[1:].tolist().index(f"slide_{leg}") for leg in LEGS]
        self._set_stage()
        draw_scenery(self._viewer["scenery"], self._room)
        self._arrows.draw()
        self._draw_platform()
        self._lighten_frame()
        self.display(np.zeros(robot.model.nq))

    @property
    def scale(self) -> ArrowScale:
        """How long the arrows are."""
        return self._arrows.scale

    def display(self, q: ArrayLike, forces: ArrayLike | None = None) -> None:
        """Show the machine at joint positions, and the forces of its actuators."""
        newtons = None if forces is None else as_floats("forces", forces)  # NaN where undetermined
        if newtons is not None and newtons.shape != (3,):
            raise InputError(f"forces: expected shape (3,), got {newtons.shape}")
        with self.drawing:
            joints = frozen_array("q", q, (self.robot.model.nq,))
            self.visualizer.display(joints)
            self._arrows.show(joints[self._columns], newtons)

    def follow(self) -> None:
        """Draw the platform's skin and P where its solids are."""
        self._viewer["platform"].set_transform(self._frame("platform_center"))

    def set_scale(self, scale: ArrowScale) -> None:
        """Draw the arrows in another scale from the next `display` on; the camera stays where it is."""
        with self.drawing:
            self._arrows.set_scale(scale)

    def draw_trace(self, points: ArrayLike) -> None:
        """Draw the path of a point; it replaces the one before."""
        with self.drawing:
            draw_path(self._viewer["trace"], points, colour_number(TRACE))

    def take(self, motion: Any, wrench: Any = None) -> Take:
        """Return what is played of a `Motion`, an `InverseDynamics` or a `Simulation`."""
        samples = Samples.of(self.robot, solved(self.robot, motion, wrench))
        path = trace_of(self.robot, samples.motion.pose)
        return Take(samples.motion.time, samples.joints.q, samples.forces, path)

    def begin(self, take: Take) -> None:
        """Draw the path of P, and set camera and scale of the arrows for a motion."""
        self.set_scale(ArrowScale.of(self.robot, take.forces, take.q[:, self._columns]))
        self.draw_trace(take.path)
        self._set_stage()

    def another(self) -> Scene:
        """Return the same machine in a window of its own."""
        return Scene(self.robot, SceneWindow(), self.scale)

    def mark_leg(self, leg: str | None) -> None:
        """Turn a leg red, and the others back to their colours."""
        if leg is not None and leg not in LINKS_OF_LEGS:
            raise InputError(f"leg: expected 'a', 'b', 'c' or None, got {leg!r}")
        for name, links in LINKS_OF_LEGS.items():
            for solid in self.robot.visual_model.geometryObjects:
                if solid.name.rpartition("_")[0] in links:
                    colour = MARK if name == leg else solid.meshColor.tolist()
                    self._solid(solid.name).set_property("color", list(colour))

    def _set_stage(self) -> None:
        set_stage(self._viewer, np.concatenate((self._room.corners, self._arrows.ends)), self._room.scale)

    def _draw_platform(self) -> None:
        """Draw the platform's skin, which hides the seams of its solids, and P, which nothing hides."""
        import meshcat.geometry as mg

        geometry, size = self.robot.parameters.geometry, self._room.size
        node = self._viewer["platform"]
        material = mg.MeshPhongMaterial(color=colour_number(PLATFORM.rgba))
        node["skin"].set_object(mg.TriangularMeshGeometry(*skin_of(geometry.r, size)), material)
        ink = mg.MeshBasicMaterial(color=colour_number(TRACE), depthTest=False, transparent=True)
        node["P"].set_object(mg.Sphere(0.5 * size.rod_radius), ink)

    def _lighten_frame(self) -> None:
        """Make the frame, which stands between the eye and the legs, light enough to see through."""
        for solid in self.robot.visual_model.geometryObjects:
            if solid.parentJoint == 0:
                self._solid(solid.name).set_property("color", list(GLASS))

    def _solid(self, name: str) -> Any:
        return self._viewer[f"{self.visualizer.viewerVisualGroupName}/{name}"]

    def _frame(self, name: str) -> FloatArray:
        """Return where a frame of the model is, as a matrix."""
        visualizer, number = self.visualizer, self.robot.model.getFrameId(name)
        placement = pin.updateFramePlacement(visualizer.model, visualizer.data, number)
        return np.asarray(placement.homogeneous)


def draw_scenery(viewer: Any, room: Room) -> None:
    """Draw floor, axes of the fixed frame, guides and the letters of the legs."""
    draw_floor(viewer["floor"], room.half, room.bottom)
    _draw_axes(viewer["axes"], room)
    _draw_guides(viewer["guides"], room)


def _draw_axes(node: Any, room: Room) -> None:
    """Draw the axes of the fixed frame from its origin O, with their names."""
    import meshcat.geometry as mg

    length, radius = room.axes
    for i, (name, colour) in enumerate(AXES.items()):
        turned = np.eye(4)
        turned[:3, :3] = np.roll(np.eye(3), 2 - i, axis=1)  # z along the axis
        node[name].set_transform(turned)
        draw_arrow(node[name], radius, mg.MeshLambertMaterial(color=colour_number(colour)))
        set_length(node[name], length, radius)
        write_text(node[f"{name}_name"], f"{name}0", turned[:3, 2] * 1.25 * length, 0.25 * length)


def _draw_guides(node: Any, room: Room) -> None:
    """Draw the axes of the sliders as thin rods over their travel, and the letters of the legs."""
    import meshcat.geometry as mg

    bottom, top, radius = room.rails
    for leg, pivot in room.pivots.items():
        matrix = np.eye(4)
        matrix[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
        matrix[:3, 3] = above(pivot, (bottom + top) / 2)
        rod = mg.Cylinder(top - bottom, radius)
        node[leg].set_object(rod, mg.MeshLambertMaterial(color=colour_number(RAIL)))
        node[leg].set_transform(matrix)
        write_text(node[f"{leg}_name"], leg.upper(), room.names[leg], room.letter)


def viewer(robot: Machine, port: int | None = None) -> Any:
    """Return Pinocchio's visualizer of a machine at home, shown in a page without controls.

    ``viewer(robot).play(motion)`` plays a motion in it: `p3dof.viewer.visualizer.MotionVisualizer`. The page
    is at ``visualizer.viewer.url()``; it is served until ``visualizer.viewer.close()``, or the end of the
    process.
    """
    return served(lambda window: Scene(robot, window), port)
