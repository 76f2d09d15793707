"""`Scene`: the machine drawn through Pinocchio's MeshCat visualizer, with forces and the path of P."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, as_floats
from p3dof._base.errors import InputError
from p3dof.machine.description.shapes import PLATFORM
from p3dof.viewer.document.machine import Machine, require_machine
from p3dof.viewer.document.room import GLASS, LEGS, LINKS_OF_LEGS, Room
from p3dof.viewer.document.skin import skin_of
from p3dof.viewer.drawing import TRACE, Drawing
from p3dof.viewer.forces import ForceArrows
from p3dof.viewer.scale import ArrowScale
from p3dof.viewer.scenery import draw_scenery
from p3dof.viewer.stage import colour_number, set_stage
from p3dof.viewer.window import SceneWindow

MARK = (0.85, 0.05, 0.1, 1.0)
"""Colour of a leg that is out of reach."""


class Scene(Drawing):
    """One machine in a window, at home at first.

    Everything is drawn under ``/meshcat``, whose axes are those of the fixed frame, in metres.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    window : SceneWindow, optional
        What to draw into; a new one by default.
    scale : ArrowScale, optional
        How long the arrows are, and where they reach; for a machine at rest by default. A grey arrow
        beside the machine tells it.

    Attributes
    ----------
    visualizer : pinocchio.visualize.MeshcatVisualizer
        The plain visualizer of the machine, to go on from.
    window : SceneWindow
        What is drawn into.

    Raises
    ------
    MissingExtraError
        If MeshCat is not installed.
    InputError
        If `robot` is no Manipulator or `window` no SceneWindow.
    """

    def __init__(
        self, robot: Machine, window: SceneWindow | None = None, scale: ArrowScale | None = None
    ) -> None:
        require_machine(robot)
        if not isinstance(scale, ArrowScale | None):
            raise InputError(f"scale: expected an ArrowScale, got {type(scale).__name__}")
        super().__init__(robot, window)
        self.robot = robot
        self._room = Room.around(robot.parameters)
        scale = ArrowScale.at_rest(robot) if scale is None else scale
        self._arrows = ForceArrows(self._viewer, self._room, robot.parameters.geometry.b, scale)
        self._columns = [robot.model.names[1:].tolist().index(f"slide_{leg}") for leg in LEGS]
        set_stage(self._viewer, np.concatenate((self._room.corners, self._arrows.ends)), self._room.scale)
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
        """Show the machine at joint positions, and the forces of its actuators.

        Parameters
        ----------
        q : array-like, shape (10,)
            Joints in Pinocchio's order, as of `joints_of` [m, rad].
        forces : array-like, shape (3,), optional
            Of the actuators A, B, C [N]; "undetermined" stands in place of the arrow of a NaN. One beyond
            the scale is cut off, and "off scale" stands at its tip. Without forces there are no arrows.

        Raises
        ------
        InputError
            If a shape does not fit, or a joint is not finite.
        """
        newtons = None if forces is None else three_forces(forces)
        with self._drawing:
            joints = self.place(q)
            self._viewer["platform"].set_transform(self._frame("platform_center"))
            self._arrows.show(joints[self._columns], newtons)

    def set_scale(self, scale: ArrowScale) -> None:
        """Draw the arrows in another scale from the next `display` on; the camera stays where it is.

        Parameters
        ----------
        scale : ArrowScale
            The scale.
        """
        with self._drawing:
            self._arrows.set_scale(scale)

    def mark_leg(self, leg: str | None) -> None:
        """Turn a leg red, and the others back to their colours.

        Parameters
        ----------
        leg : {"a", "b", "c"} or None
            The leg, as in `p3dof.ReachError.leg`; None for none.

        Raises
        ------
        InputError
            If there is no such leg.
        """
        if leg is not None and leg not in LINKS_OF_LEGS:
            raise InputError(f"leg: expected 'a', 'b', 'c' or None, got {leg!r}")
        for name, links in LINKS_OF_LEGS.items():
            for solid in self.robot.visual_model.geometryObjects:
                if solid.name.rpartition("_")[0] in links:
                    colour = MARK if name == leg else solid.meshColor.tolist()
                    self._solid(solid.name).set_property("color", list(colour))

    def _draw_platform(self) -> None:
        """Draw the platform's skin, which hides the seams of its solids, and P, which nothing hides."""
        import meshcat.geometry as mg

        geometry, size = self.robot.parameters.geometry, self._room.size
        node = self._viewer["platform"]
        material = mg.MeshPhongMaterial(color=colour_number(PLATFORM.rgba))
        node["skin"].set_object(mg.TriangularMeshGeometry(*skin_of(geometry.r, size)), material)
        ink = mg.MeshBasicMaterial(color=TRACE, depthTest=False, transparent=True)
        node["P"].set_object(mg.Sphere(0.5 * size.rod_radius), ink)

    def _lighten_frame(self) -> None:
        """Make the frame, which stands between the eye and the legs, light enough to see through."""
        for solid in self.robot.visual_model.geometryObjects:
            if solid.parentJoint == 0:
                self._solid(solid.name).set_property("color", list(GLASS))

    def _frame(self, name: str) -> FloatArray:
        """Return where a frame of the model is, as a matrix."""
        visualizer, number = self.visualizer, self.robot.model.getFrameId(name)
        placement = pin.updateFramePlacement(visualizer.model, visualizer.data, number)
        return np.asarray(placement.homogeneous)


def three_forces(forces: ArrayLike) -> FloatArray:
    """Return the forces of the actuators, shape (3,), which may be NaN [N].

    Raises
    ------
    InputError
        If they are something else.
    """
    newtons = as_floats("forces", forces)
    if newtons.shape != (3,):
        raise InputError(f"forces: expected shape (3,), got {newtons.shape}")
    return newtons
