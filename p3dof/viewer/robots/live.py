"""`RobotViewer`: any robot in a page with controls, to play a motion or to move its joints by hand."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from p3dof.checks import frozen_array, shown
from p3dof.closed_loop import ClosedLoopModel
from p3dof.closed_loop.compiling_model import Method
from p3dof.errors import InputError
from p3dof.page.drawable import Drawable
from p3dof.page.robots.figure import RobotFigure
from p3dof.page.robots.motion import JointMotion, Moment, Run, held
from p3dof.page.robots.ranges import slider_ranges
from p3dof.viewer.connections import Message
from p3dof.viewer.live_page import LivePage, Request, player_of
from p3dof.viewer.player import within
from p3dof.viewer.robots.hand import Hand, compiled_of
from p3dof.viewer.robots.layers import checked_layers
from p3dof.viewer.robots.panel import Panel, setup_message
from p3dof.viewer.robots.scene import RobotScene


class RobotViewer(LivePage):
    """Any robot in the browser, with its controls, until it is stopped or the process ends.

    In the page a motion is played, and the actuated joints follow sliders: the loops are closed at each
    change, from where the robot is. What cannot be reached that way is told, and the picture stays. Whatever
    a page can do, the methods do too; all pages show the same.

    Parameters
    ----------
    robot : ClosedLoopModel
        The robot; a copy of it is worked with.
    motion : JointMotion or RobotRun, optional
        What can be played; without, the robot stands where its loops close near the reference.
    figure : Drawable, optional
        Its solids; by default a `RobotFigure` of the next two.
    shapes : str or path-like, optional
        The file that the robot was read from, or its name, to show the shapes that the file gives it.
    package_dirs : iterable of path-like
        Folders that meshes may be in, besides that of the file.
    external : mapping of str to array-like, shape (6,), optional
        Wrenches that act on frames: force [N], moment [N m] in world axes. A `JointMotion` has its own, and
        those of its beginning act while the robot is moved by hand.
    layers : mapping of str to bool, optional
        What is seen at first, see `p3dof.viewer.robots.layers.LAYERS`.
    title : str, optional
        Heading of the page; the robot's name by default.
    warnings : iterable of str
        What the page says beneath the motion.
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
    method : {"general", "compiled"} or CompiledLoop
        What computes positions and forces while the robot is moved by hand: the robot, or C that is compiled
        for it, where there is a compiler and the compiled dynamics is to be trusted.

    Attributes
    ----------
    scene : RobotScene
        What is drawn.
    server : Server
        What serves it.

    Raises
    ------
    AssemblyError
        If the loops do not close.
    InputError
        If an argument does not fit, or the port is busy.
    MissingExtraError
        If MeshCat is not installed.
    """

    KINDS: ClassVar[tuple[str, ...]] = (*LivePage.KINDS, "joints", "home", "layers")
    PAGE: ClassVar[str] = "robot"
    scene: RobotScene

    def __init__(
        self,
        robot: ClosedLoopModel,
        motion: JointMotion | Run | None = None,
        *,
        figure: Drawable | None = None,
        shapes: str | os.PathLike[str] | None = None,
        package_dirs: Iterable[str | os.PathLike[str]] = (),
        external: Mapping[str, ArrayLike] | None = None,
        layers: Mapping[str, bool] | None = None,
        title: str | None = None,
        warnings: Iterable[str] = (),
        port: int | None = None,
        speed: float = 1.0,
        fps: float = 60.0,
        playing: bool = True,
        at: float | None = None,
        method: Method = "general",
    ) -> None:
        if not isinstance(robot, ClosedLoopModel):
            raise InputError(f"robot: expected a ClosedLoopModel, got {shown(robot)}")
        self.robot = robot.copy()
        self._motion = _motion_of(self.robot, motion, external)
        plays = len(self._motion.time) > 1
        super().__init__(player_of(self._motion.time if plays else None, speed, playing, at), plays, fps)
        first = self._motion.sample(0)
        self._load = dict(first.wrenches)
        self._compiled = compiled_of(self.robot, np.array(first.q), self._load, method)
        self._hand = Hand(self.robot, np.array(first.q), self._compiled)
        self._by_hand = None if plays else self._hand.values
        self._moment, self._refused, self._why = first, "", ""
        figure = RobotFigure(self.robot, shapes, package_dirs) if figure is None else figure
        warnings = (*warnings, *getattr(figure, "notes", ()))
        self.scene = RobotScene(figure, self._motion, None, self.robot, layers)
        self._ranges = slider_ranges(self.robot, self._hand.home, self.scene.half)
        self._panel = Panel(self.robot, self._motion)
        name = str(self.robot.model.name) if title is None else title
        self._setup = setup_message(self._panel, self.scene, self._ranges, name, warnings)
        self._largest = dict(self.scene.largest)
        self._serve(port)

    @property
    def shown(self) -> Moment:
        """What is shown now, while a page is open."""
        return self._moment

    @property
    def message(self) -> str:
        """Why the joints are not where they were moved to by hand; empty if they are."""
        return self._refused

    def move_to(self, values: ArrayLike | Mapping[str, float]) -> None:
        """Move actuated joints by hand; a played motion stops.

        What cannot be reached is told in the page, and in `message` when the next frame is drawn.

        Parameters
        ----------
        values : array-like, shape (n,), or mapping of str to float
            Of all actuated joints, or of some by name [m or rad].

        Raises
        ------
        InputError
            If it does not fit, or lies outside the ranges of the sliders.
        """
        if isinstance(values, Mapping):
            now = dict(zip(self.robot.actuated, self._hand.values.tolist(), strict=True))
            for name, value in values.items():
                if name not in now:
                    raise InputError(f"values: the joint {shown(name)} is not actuated")
                now[name] = float(value)
            values = list(now.values())
        self.received({"type": "joints", "value": np.asarray(values).tolist()})

    def home(self) -> None:
        """Move the robot to where it was at the beginning."""
        self.received({"type": "home"})

    def show_layers(self, **wanted: bool) -> None:
        """Show parts of the picture, or hide them.

        Parameters
        ----------
        **wanted : bool
            Names of `p3dof.viewer.robots.layers.LAYERS`; what is not named stays as it is.

        Raises
        ------
        InputError
            If there is no such part.
        """
        self.received({"type": "layers", "value": wanted})

    def _own_request(self, kind: str, value: Any) -> Request:
        if kind == "layers":
            wanted = checked_layers(value)
            return lambda: self.scene.layers.choose(wanted)
        if kind == "home":
            return self._go_home
        if not self.robot.actuated:
            raise InputError("joints: the robot has no actuated joints")
        values = frozen_array("joints", value, (len(self.robot.actuated),))
        each = zip(
            self.robot.actuated, values.tolist(), self._hand.values.tolist(), self._ranges, strict=True
        )
        for name, number, now, (low, high) in each:
            within(name, number, min(low, now), max(high, now))  # a motion may have led it beyond
        return lambda: self._take(values)

    def _go_home(self) -> None:
        self._hand.go_home()
        self._take(self._hand.values)

    def _show(self, time: float) -> Message:
        by_hand = self._by_hand is not None
        if self._by_hand is None:
            self._moment, self._refused, self._why = self._motion.at(self.robot.model, time), "", ""
            self._hand.follow(self._moment.q)
            self.scene.largest.update(self._largest)
        else:
            self._hand.moves_to(self._by_hand)
            self._refused = self._hand.refused
            if self._moment.q is not self._hand.q:
                self._moment, self._why = held(self.robot, self._hand.q, self._load, self._compiled)
        self.scene.show(self._moment, by_hand=by_hand)
        return {
            **self._panel.state(self._moment, self._refused, self._why),
            "legend": self.scene.legend,
            "layers": self.scene.layers.seen,
        }


def _motion_of(
    robot: ClosedLoopModel, motion: JointMotion | Run | None, external: Mapping[str, ArrayLike] | None
) -> JointMotion:
    """Return what to show, with an actuator force for each actuated joint: NaN where it is not known."""
    if motion is None:
        return JointMotion.at_rest(robot, None, external)
    if not isinstance(motion, JointMotion):
        return JointMotion.of_run(robot, motion, external)
    if external is not None:
        raise InputError("external: the motion has its own wrenches, expected None")
    if motion.actuated not in ((), robot.actuated):
        raise InputError("motion: expected forces of the robot's actuated joints, in their order")
    if motion.actuated == robot.actuated:
        return motion
    unknown = np.full((len(motion.time), len(robot.actuated)), np.nan)
    return replace(motion, actuated=robot.actuated, forces=unknown)
