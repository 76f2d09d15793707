"""Any robot as a page: in a file or a notebook, or live with Python behind it."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import FloatArray, as_floats, frozen_array, real, require, shown
from p3dof._base.errors import InputError
from p3dof.loops import ClosedLoopModel
from p3dof.loops.compiled.kept import Method, method_of
from p3dof.viewer.document.document import Shown, robot_document
from p3dof.viewer.document.encoding import decoded
from p3dof.viewer.document.figure import Drawable, RobotFigure
from p3dof.viewer.document.html import Page

if TYPE_CHECKING:
    from p3dof.viewer.live_viewer import LiveViewer

Shapes = str | os.PathLike[str] | Drawable
"""A robot's file or name, or what is seen of it."""


def robot_page(
    robot: ClosedLoopModel,
    run: Shown | None = None,
    *,
    shapes: Shapes | None = None,
    package_dirs: Iterable[str | os.PathLike[str]] = (),
    runs: Mapping[str, Shown] | None = None,
    external: Mapping[str, ArrayLike] | None = None,
    title: str | None = None,
    notes: Iterable[str] = (),
    closure_forces: bool = False,
    at: float | None = None,
    speed: float = 1.0,
    playing: bool = False,
) -> Page:
    """Return a page of any robot, to be saved or shown in a notebook; Python is not needed any more.

    Parameters
    ----------
    robot : ClosedLoopModel
        The robot, as of `p3dof.load_robot`.
    run : RobotRun or JointMotion, optional
        What is shown; without, the robot stands where its loops close near the reference.
    shapes : str, path-like or Drawable, optional
        The file that the robot was read from, or its name, to show the shapes that the file gives it; or what
        is seen of it. Rods without.
    package_dirs : iterable of path-like
        Folders that meshes may be in, besides that of the file.
    runs : mapping of str to RobotRun or JointMotion, optional
        Further runs by name, to be compared with it.
    external : mapping of str to array-like, shape (6,), optional
        Wrenches that act on frames: force [N], moment [N m] in world axes. A `JointMotion` has its own.
    title : str, optional
        Heading; the robot's name by default.
    notes : iterable of str
        What a reader of the page should know.
    closure_forces : bool
        Whether the forces in the closures are seen at first; else only where there are few closures.
    at : float, optional
        Time of the run to begin at [s]; its first by default.
    speed : float
        How many times faster than in reality, from 0.1 to 4.
    playing : bool
        Whether it plays already.

    Raises
    ------
    AssemblyError
        If the loops do not close.
    InputError
        If an argument does not fit.
    """
    figure = figure_of(robot, shapes, package_dirs)
    document = robot_document(robot, figure, run, runs=runs, external=external, title=title)
    document["runs"][0]["notes"] += notes
    time = decoded(document["runs"][0]["time"])
    layers = {"closures": True} | ({"multipliers": True} if closure_forces else {})
    start = start_of(time, at, speed, playing and len(time) > 1)
    return Page({**document, "start": {**start, "layers": layers}})


def show_robot(
    robot: ClosedLoopModel,
    run: Shown | None = None,
    *,
    shapes: Shapes | None = None,
    package_dirs: Iterable[str | os.PathLike[str]] = (),
    runs: Mapping[str, Shown] | None = None,
    external: Mapping[str, ArrayLike] | None = None,
    title: str | None = None,
    notes: Iterable[str] = (),
    closure_forces: bool = False,
    at: float | None = None,
    speed: float = 1.0,
    playing: bool = True,
    port: int | None = None,
    method: Method = "general",
) -> LiveViewer:
    """Show any robot in the browser, live: it follows sliders and the pointer, more runs can be sent to it.

    Parameters
    ----------
    robot, run, shapes, package_dirs, runs, external, title, notes, closure_forces, at, speed, playing
        As of `robot_page`.
    port : int, optional
        Of the server, 0 for any; the first free one from 7000 on by default.
    method : {"general", "compiled"} or CompiledLoop
        What computes positions and forces while joints are moved by hand where the page cannot do so by
        itself, as of a robot with composite joints: the robot, or C that is compiled for it, where there is a
        compiler and the compiled dynamics is to be trusted.

    Returns
    -------
    LiveViewer
        With ``url``, ``show(run)`` and ``stop()``; it shows itself in a notebook.

    Raises
    ------
    AssemblyError
        If the loops do not close.
    InputError
        If an argument does not fit, or the port is busy.
    MissingExtraError
        If tornado, which the extra ``viz`` brings, is not installed.
    """
    from p3dof.viewer.answers import RobotAnswers
    from p3dof.viewer.live_viewer import LiveViewer

    figure = figure_of(robot, shapes, package_dirs)
    copy = robot.copy()
    page = robot_page(
        copy,
        run,
        shapes=figure,
        runs=runs,
        external=external,
        title=title,
        notes=notes,
        closure_forces=closure_forces,
        at=at,
        speed=speed,
        playing=playing,
    )
    document, answers = page.document, None
    method_of(copy, method)
    if document["engine"]["kind"] == "none":
        document = document | {"engine": {"kind": "ask"}}
        start = np.array(decoded(document["runs"][0]["q"])[0])
        answers = RobotAnswers(copy, start, _acting(run, external), method) if copy.actuated else None

    def run_of(another: Any) -> dict[str, Any]:
        if another is None:
            raise InputError("run: expected a run or a motion of the robot, got None")
        options: dict[str, Any] = {"external": external, "engine": "none"}
        found: dict[str, Any] = robot_document(copy, figure, another, **options)["runs"][0]
        return found

    return LiveViewer(document, run_of, answers, port)


def figure_of(
    robot: ClosedLoopModel, shapes: Shapes | None, package_dirs: Iterable[str | os.PathLike[str]] = ()
) -> Drawable:
    """Return what is seen of a robot: as given, or the shapes of its file, or rods."""
    require("robot", robot, ClosedLoopModel)
    if hasattr(shapes, "visual_model"):
        return shapes  # type: ignore[return-value]  # it has what is drawn
    return RobotFigure(robot, shapes, package_dirs)  # type: ignore[arg-type]


def _acting(run: Shown | None, external: Mapping[str, ArrayLike] | None) -> dict[str, Any]:
    """Return the wrenches (6,) that act while the robot is moved by hand: those of the beginning."""
    if external:
        return {name: as_floats(f"external {name}", wrench) for name, wrench in external.items()}
    wrenches = getattr(run, "acting", None)
    if not isinstance(wrenches, Mapping):
        return {}
    return {name: frozen_array(f"wrench {name}", rows[0], (6,)) for name, rows in wrenches.items()}


SLOWEST, FASTEST = 0.1, 4.0
"""How many times faster than in reality a run can be played."""


def start_of(time: FloatArray | None, at: float | None, speed: float, playing: bool) -> dict[str, Any]:
    """Return where a page begins, as a document has it."""
    if not isinstance(playing, bool):
        raise InputError(f"playing: expected True or False, got {shown(playing)}")
    start: dict[str, Any] = {"speed": within("speed", speed, SLOWEST, FASTEST), "playing": playing}
    if at is not None:
        if time is None:
            raise InputError("at: expected a run to go with it")
        start["time"] = within("at", at, float(time[0]), float(time[-1]))
    return start


def within(name: str, value: object, low: float, high: float) -> float:
    """Return a number from a page or a user, if it lies in a range."""
    number = value if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
    if not low <= number <= high:
        raise InputError(f"{name}: expected a number from {low:g} to {high:g}, got {shown(value)}")
    return real(name, number)
