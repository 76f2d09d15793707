"""`LiveViewer`: the machine in a page with controls, to play a motion or to move the platform by hand."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from p3dof import kinematics
from p3dof.checks import FloatArray, frozen_array, shown
from p3dof.errors import InputError, ReachError, SingularityError
from p3dof.methods import InverseDynamics
from p3dof.motion import Motion, WrenchOverTime
from p3dof.page.machine import Machine, require_machine
from p3dof.page.poses import trace_of
from p3dof.viewer.connections import Message
from p3dof.viewer.live_page import LivePage, Request, player_of
from p3dof.viewer.panel import AXES, arrow_scales, off_scale, plain, setup_message, slider_ranges
from p3dof.viewer.player import within
from p3dof.viewer.scene import Scene
from p3dof.viewer.server import ServedWindow, Server
from p3dof.viewer.states import CASES, Shown, States

_HOME = np.zeros(3)
_TRACE_POINTS = 2001


class LiveViewer(LivePage):
    """A machine in the browser, with its controls, until it is stopped or the process ends.

    In the page a motion is played, and the platform follows three sliders. Whatever a page can do, the
    methods do too; all pages show the same.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    motion : Motion or InverseDynamics, optional
        What can be played; without, the platform stands at home.
    wrench : array-like, shape (6,) or (N, 6), or callable, optional
        External load at the samples of a `Motion`, as of `Manipulator.inverse_dynamics`.
    port : int, optional
        Of the server, 0 for any; the first free one from 7000 on by default.
    speed : float
        How many times faster than in reality, from 0.1 to 4.
    fps : float
        Most frames per second.
    playing : bool
        Whether the motion plays already.
    at : float, optional
        Time of the motion to begin at [s]; its first by default.

    Attributes
    ----------
    scene : Scene
        What is drawn.
    server : Server
        What serves it.

    Raises
    ------
    ReachError, SingularityError
        If a sample of a `Motion` is out of reach or singular.
    InputError
        If an argument does not fit, or the port is busy.
    MissingExtraError
        If MeshCat is not installed.
    """

    KINDS: ClassVar[tuple[str, ...]] = (*LivePage.KINDS, "case", "pose")
    PAGE: ClassVar[str] = "machine"
    scene: Scene

    def __init__(
        self,
        robot: Machine,
        motion: Motion | InverseDynamics | None = None,
        *,
        wrench: WrenchOverTime = None,
        port: int | None = None,
        speed: float = 1.0,
        fps: float = 60.0,
        playing: bool = True,
        at: float | None = None,
    ) -> None:
        require_machine(robot)
        self.robot = robot
        self._result = _solved(robot, motion, wrench)
        times = None if self._result is None else self._result.time
        super().__init__(player_of(times, speed, playing, at), self._result is not None, fps)
        self._states = States(robot, self._result)
        self._case = CASES[0]
        self._by_hand = _HOME if self._result is None else None
        self._refused: tuple[str | None, str] = (None, "")
        self._marked: str | None = None
        self._shown = self._states.of_pose(_HOME, self._player.time, _HOME, self._case)
        self._ranges = slider_ranges(robot)
        self._setup = setup_message(robot, self._result, self._states)
        self._scales = arrow_scales(robot, self._result, self._states)
        self.scene = Scene(robot, scale=self._scales[0])
        if self._result is not None:
            self.scene.draw_trace(_trace(robot, self._result.motion))
        self._serve(port)

    @property
    def shown(self) -> Shown:
        """What is shown now, while a page is open."""
        return self._shown

    def show_forces(self, case: str) -> None:
        """Show other forces.

        Parameters
        ----------
        case : {"total", "static", "dynamic"}
            What the motion takes, what holds each pose at rest, or the difference.

        Raises
        ------
        InputError
            If there is no such case.
        """
        self.received({"type": "case", "value": case})

    def move_to(self, pose: ArrayLike) -> None:
        """Move the platform by hand; a played motion stops.

        Parameters
        ----------
        pose : array-like, shape (3,)
            y [m], z [m], θ [rad].

        Raises
        ------
        ReachError
            If the pose is out of reach.
        InputError
            If it does not fit, or lies outside the ranges of the sliders.
        """
        kinematics.inverse_kinematics(self.robot.parameters.geometry, frozen_array("pose", pose, (3,)))
        self.received({"type": "pose", "value": np.asarray(pose, dtype=float).tolist()})

    def _own_request(self, kind: str, value: Any) -> Request:
        if kind == "case":
            if value not in CASES:
                raise InputError(f"case: expected one of {', '.join(CASES)}, got {shown(value)}")
            return lambda: setattr(self, "_case", value)
        pose = frozen_array("pose", value, (3,))
        for name, number, (low, high) in zip(AXES, pose, self._ranges, strict=True):
            within(name, float(number), low, high)
        return lambda: self._take(pose)

    def _show(self, time: float) -> Message:
        try:
            if self._by_hand is None:
                self._shown = self._states.of_time(time, self._case)
            else:
                self._shown = self._states.of_pose(self._by_hand, time, self._shown.pose, self._case)
            self._refused = (None, "")
        except ReachError as error:
            self._refused = (error.leg, f"{error}")
        except SingularityError as error:
            self._refused = ("c", f"{error}")
        leg, _ = self._refused
        if leg != self._marked:
            self.scene.mark_leg(leg)
            self._marked = leg
        self.scene.set_scale(self._scales[self._by_hand is not None])
        self.scene.display(self._shown.q, self._shown.forces)
        leg, message = self._refused
        return {
            "case": self._case,
            "pose": self._shown.pose.tolist(),
            "sliders": self._shown.sliders.tolist(),
            "forces": plain(self._shown.forces),
            "leg": leg,
            "message": message,
            "limits": list(self._shown.limits),
            "legend": self.scene.scale.legend,
            "off_scale": off_scale(self.scene.scale, self._shown.forces),
        }


def viewer(robot: Machine, port: int | None = None) -> Any:
    """Return Pinocchio's visualizer of a machine at home, shown in a page without controls.

    The page is at ``visualizer.viewer.url()``; it is served until ``visualizer.viewer.close()``, or
    the end of the process.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    port : int, optional
        Of the server, 0 for any; the first free one from 7000 on by default.

    Returns
    -------
    pinocchio.visualize.MeshcatVisualizer

    Raises
    ------
    InputError
        If the port is busy.
    MissingExtraError
        If MeshCat is not installed.
    """
    window = ServedWindow()
    scene = Scene(robot, window)
    window.server = Server(window, port)
    return scene.visualizer


def _solved(
    robot: Machine, motion: Motion | InverseDynamics | None, wrench: WrenchOverTime
) -> InverseDynamics | None:
    if isinstance(motion, Motion):
        return robot.inverse_dynamics(motion, method="virtual-power", wrench=wrench)
    if wrench is not None:
        raise InputError("wrench: expected a Motion to go with it")
    if not isinstance(motion, InverseDynamics | None):
        raise InputError(f"motion: expected a Motion or InverseDynamics, got {type(motion).__name__}")
    return motion


def _trace(robot: Machine, motion: Motion) -> FloatArray:
    some = np.unique(np.linspace(0, len(motion) - 1, min(len(motion), _TRACE_POINTS)).round().astype(int))
    return trace_of(robot, motion.pose[some])
