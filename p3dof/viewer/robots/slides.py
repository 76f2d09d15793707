"""`Slides`: thin rods along the slides of a robot."""

from __future__ import annotations

from typing import Any

import pinocchio as pin

from p3dof.page.robots.lines import line_between
from p3dof.page.robots.sticks import GROUND
from p3dof.viewer.arrows import unit_along_z
from p3dof.viewer.stage import colour_number


class Slides:
    """Thin rods along the slides of a robot, from where each begins to what slides.

    Parameters
    ----------
    viewer : meshcat.Visualizer
        The root of what is drawn.
    model : pin.Model
        The robot's tree.
    radius : float
        Of the rods [m].
    """

    def __init__(self, viewer: Any, model: pin.Model, radius: float) -> None:
        import meshcat.geometry as mg

        self._model, self._node = model, viewer["slides"]
        kinds = [str(joint.shortname()) for joint in model.joints]
        self.joints = [
            i for i, kind in enumerate(kinds) if kind.startswith("JointModelP") and model.nvs[i] == 1
        ]
        """Which joints slide."""
        ink = mg.MeshLambertMaterial(color=colour_number(GROUND))
        for joint in self.joints:
            self._node[str(joint)].set_object(unit_along_z(mg.Cylinder(1.0, radius)), ink)

    def place(self, data: pin.Data) -> None:
        """Show them at joint placements that `data` holds."""
        for joint in self.joints:
            start = data.oMi[int(self._model.parents[joint])] * self._model.jointPlacements[joint]
            line = line_between(start.translation, data.oMi[joint].translation)
            self._node[str(joint)].set_transform(line)
