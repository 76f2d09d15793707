"""Any robot as a page: in a file or a notebook, or live with Python behind it."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from p3dof._base.checks import as_floats, frozen_array, shown
from p3dof._base.errors import InputError
from p3dof.loops import ClosedLoopModel
from p3dof.loops.compiling_model import Method
from p3dof.viewer.document.drawable import Drawable
from p3dof.viewer.document.encoding import decoded
from p3dof.viewer.document.robots.document import Shown, robot_document
from p3dof.viewer.document.robots.figure import RobotFigure
from p3dof.viewer.document.saved import Page
from p3dof.viewer.start import start_of

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

    Returns
    -------
    Page

    Raises
    ------
    AssemblyError
        If the loops do not close.
    InputError
        If an argument does not fit.
    """
    figure = figure_of(robot, shapes, package_dirs)
    document = robot_document(robot, figure, run, runs=runs, external=external, title=title)
    return Page(_started(document, notes, closure_forces, at, speed, playing))


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
    """Show any robot in the browser, live: its actuated joints follow sliders, more runs can be sent to it.

    Parameters
    ----------
    robot, run, shapes, package_dirs, runs, external, title, notes, closure_forces, at, speed, playing
        As of `robot_page`.
    port : int, optional
        Of the server, 0 for any; the first free one from 7000 on by default.
    method : {"general", "compiled"} or CompiledLoop
        What computes positions and forces while joints are moved by hand: the robot, or C that is compiled
        for it, where there is a compiler and the compiled dynamics is to be trusted.

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
    from p3dof.viewer.live_viewer import LiveViewer
    from p3dof.viewer.robots.answers import RobotAnswers

    figure = figure_of(robot, shapes, package_dirs)
    copy = robot.copy()
    document = robot_document(copy, figure, run, runs=runs, external=external, title=title, engine="ask")
    document = _started(document, notes, closure_forces, at, speed, playing)
    acting = _acting(run, external)
    answers = RobotAnswers(copy, np.array(decoded(document["runs"][0]["q"])[0]), acting, method)

    def run_of(another: Any) -> dict[str, Any]:
        if another is None:
            raise InputError("run: expected a run or a motion of the robot, got None")
        found: dict[str, Any] = robot_document(copy, figure, another, external=external)["runs"][0]
        return found

    return LiveViewer(document, run_of, answers if copy.actuated else None, port)


def figure_of(
    robot: ClosedLoopModel, shapes: Shapes | None, package_dirs: Iterable[str | os.PathLike[str]] = ()
) -> Drawable:
    """Return what is seen of a robot: as given, or the shapes of its file, or rods.

    Parameters
    ----------
    robot, shapes, package_dirs
        As of `robot_page`.

    Returns
    -------
    Drawable

    Raises
    ------
    InputError
        If something is no robot or folder.
    ModelError
        If the file is malformed.
    """
    if not isinstance(robot, ClosedLoopModel):
        raise InputError(f"robot: expected a ClosedLoopModel, got {shown(robot)}")
    if hasattr(shapes, "visual_model"):
        return shapes  # type: ignore[return-value]  # it has what is drawn
    return RobotFigure(robot, shapes, package_dirs)  # type: ignore[arg-type]


def _started(
    document: dict[str, Any],
    notes: Iterable[str],
    closure_forces: bool,
    at: float | None,
    speed: float,
    playing: bool,
) -> dict[str, Any]:
    """Return a document that says where a page begins, what is seen at first, and what is to be known."""
    first, *rest = document["runs"]
    first = {**first, "notes": [*first["notes"], *notes]}
    time = decoded(document["runs"][0]["time"])
    start = start_of(time, at, speed, playing and len(time) > 1)
    layers = {"closures": True} | ({"multipliers": True} if closure_forces else {})
    return {**document, "runs": [first, *rest], "start": {**start, "layers": layers}}


def _acting(run: Shown | None, external: Mapping[str, ArrayLike] | None) -> dict[str, Any]:
    """Return the wrenches (6,) that act while the robot is moved by hand: those of the beginning."""
    if external:
        return {name: as_floats(f"external {name}", wrench) for name, wrench in external.items()}
    wrenches = getattr(run, "acting", None)
    if not isinstance(wrenches, Mapping):
        return {}
    return {name: frozen_array(f"wrench {name}", rows[0], (6,)) for name, rows in wrenches.items()}
