"""`Drawing`: a robot's solids in a window, through Pinocchio's MeshCat visualizer, and a path in space."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, as_floats, frozen_array
from p3dof._base.errors import InputError, MissingExtraError
from p3dof.viewer.document.drawable import Drawable
from p3dof.viewer.window import SceneWindow

ROOT = "p3dof"
"""Name of the robot under MeshCat's root, ``/meshcat``."""
TRACE = 0x7B1FA2
"""Colour of a path."""


class Drawing:
    """A robot in a window.

    Everything is drawn under ``/meshcat``, whose axes are those of the fixed frame, in metres.

    Parameters
    ----------
    robot : Drawable
        Its tree and its solids.
    window : SceneWindow, optional
        What to draw into; a new one by default.

    Attributes
    ----------
    visualizer : pinocchio.visualize.MeshcatVisualizer
        The plain visualizer of the robot, to go on from.
    window : SceneWindow
        What is drawn into.

    Raises
    ------
    MissingExtraError
        If MeshCat is not installed.
    InputError
        If `window` is no SceneWindow.
    """

    def __init__(self, robot: Drawable, window: SceneWindow | None = None) -> None:
        if not isinstance(window, SceneWindow | None):
            raise InputError(f"window: expected a SceneWindow, got {type(window).__name__}")
        self.model = robot.model
        self.visual_model = robot.visual_model
        self.window = SceneWindow() if window is None else window
        self._drawing = threading.RLock()  # one picture after the other, whichever threads draw
        self.visualizer = _visualizer(robot, self.window, self._drawing)
        self._viewer = self.visualizer.viewer

    def place(self, q: ArrayLike) -> FloatArray:
        """Put the solids where they are at joint positions; return these, checked.

        Parameters
        ----------
        q : array-like, shape (nq,)
            Joints in Pinocchio's order [m, rad].

        Returns
        -------
        ndarray, shape (nq,)

        Raises
        ------
        InputError
            If the shape does not fit, or a joint is not finite.
        """
        joints = frozen_array("q", q, (self.model.nq,))
        self.visualizer.display(joints)
        return joints

    def draw_trace(self, points: ArrayLike) -> None:
        """Draw the path of a point; it replaces the one before.

        Parameters
        ----------
        points : array-like, shape (N, 3)
            In the fixed frame [m]; where one is not finite the line has a gap. For the manipulator's platform
            see `trace_of`.

        Raises
        ------
        InputError
            If the shape does not fit.
        """
        import meshcat.geometry as mg

        path = as_floats("points", points)
        if path.ndim != 2 or path.shape[1] != 3:
            raise InputError(f"points: expected shape (N, 3), got {path.shape}")
        steps = np.stack((path[:-1], path[1:]), axis=1)  # (N-1, 2, 3)
        steps = steps[np.isfinite(steps).all(axis=(1, 2))]
        line = mg.PointsGeometry(steps.reshape(-1, 3).T.astype(np.float32))
        ink = mg.LineBasicMaterial(color=TRACE, depthTest=False)  # seen through the platform
        with self._drawing:
            self._viewer["trace"].delete()
            if len(steps):
                self._viewer["trace"].set_object(mg.LineSegments(line, ink))

    def _solid(self, name: str) -> Any:
        return self._viewer[f"{ROOT}/visuals/{name}"]


def _visualizer(robot: Drawable, window: SceneWindow, drawing: threading.RLock) -> Any:
    """Return Pinocchio's visualizer with the robot loaded into a window."""
    try:
        import meshcat
    except ImportError as error:
        raise MissingExtraError("the viewer needs meshcat: pip install 'p3dof[viz]'") from error
    from pinocchio.visualize import MeshcatVisualizer

    visualizer = MeshcatVisualizer(robot.model, None, robot.visual_model)
    draw = visualizer.display

    def display(q: FloatArray | None = None) -> None:
        with drawing:
            draw(q)

    visualizer.display = display
    visualizer.initViewer(viewer=meshcat.Visualizer(window=window))
    visualizer.loadViewerModel(ROOT)
    return visualizer
