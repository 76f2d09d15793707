"""`MotionVisualizer`: Pinocchio's MeshCat visualizer, which also plays and records whole motions.

It imports meshcat, and so is imported when something is to be shown in it.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import meshcat
import numpy as np
from pinocchio.visualize import MeshcatVisualizer

from p3dof._base.checks import FloatArray
from p3dof.viewer.stage import ROOT
from p3dof.viewer.window import has_display

if TYPE_CHECKING:
    from p3dof.viewer.recording import Recording


class MotionVisualizer(MeshcatVisualizer):  # type: ignore[misc]  # it has no types
    """A `pinocchio.visualize.MeshcatVisualizer` that knows the scene around its robot.

    Its page is at ``viewer.url()``, and is served until ``viewer.close()``, or the end of the process.
    """

    def __init__(self, scene: Any, model: Any, visual_model: Any) -> None:
        super().__init__(model, None, visual_model)
        self.scene = scene
        self.initViewer(viewer=meshcat.Visualizer(window=scene.window))
        self.loadViewerModel(ROOT)

    def display(self, q: FloatArray | None = None) -> None:
        """Show the robot at joint positions (nq,), or where it was last."""
        with self.scene.drawing:
            super().display(q)
            self.scene.follow()

    def play(
        self,
        motion: Any,
        dt: float | None = None,
        callback: Any = None,
        capture: bool = False,
        *,
        wrench: Any = None,
        speed: float = 1.0,
        at: float | None = None,
        repeat: bool = False,
        **others: Any,
    ) -> Any:
        """Play a motion in real time, with the forces of the actuators and the path of P; Ctrl-C ends it.

        Where no page is open yet, it says where it is, opens the browser if there is one, and waits for it
        for some seconds. Pictures that would come too late are left out.

        Parameters
        ----------
        motion : Motion, InverseDynamics, Simulation; RobotRun or JointMotion; or array-like, shape (N, nq)
            What is played. Joint positions are played by Pinocchio, `dt` [s] for each; only they take `dt`,
            `callback` and `capture`.
        wrench : array-like, shape (6,) or (N, 6), or callable, optional
            External load on the platform at P over a `Motion` [N, N m].
        speed : float
            How many times faster than in reality, from 0.1 to 4.
        at : float, optional
            Time of the motion to begin at [s]; its first by default.
        repeat : bool
            Whether to play it again and again, until Ctrl-C.

        Raises
        ------
        ReachError, SingularityError
            If a sample of a `Motion` is out of reach or singular.
        InputError
            If an argument does not fit.
        """
        if isinstance(motion, np.ndarray | Sequence) and not isinstance(motion, str):
            return super().play(motion, dt, callback, capture, **others)
        player = self.scene.player(motion, wrench=wrench, speed=speed, at=at, repeat=repeat)
        with suppress(KeyboardInterrupt):  # what was drawn stays
            if not self.scene.window.watched:
                print(f"{self.viewer.url()} shows the motion", file=sys.stderr)  # noqa: T201 - as MeshCat does
                if has_display():
                    self.viewer.open()
            player.run()
        return None

    def record(self, motion: Any, **options: Any) -> Recording:
        """Return a motion as one page that plays it with no network and no Python.

        ``visualizer.record(motion).save("motion.html")``. Takes `motion` and the options of `play`, with
        ``repeat=True`` by default, and `playing`, whether it moves when it is opened.
        """
        found: Recording = self.scene.record(motion, **options)
        return found
