"""A motion of any robot as one HTML file that plays in any browser, as a picture, or as a film."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from p3dof.checks import FloatArray, Progress, positive, shown
from p3dof.closed_loop import ClosedLoopModel
from p3dof.errors import InputError
from p3dof.page.drawable import Drawable
from p3dof.page.robots.motion import JointMotion, Moment
from p3dof.viewer.films import checked_rate, save_film
from p3dof.viewer.frames import MAX_FRAMES, Frames, Labels, page_of
from p3dof.viewer.headless import SIZE, checked_size, picture_of
from p3dof.viewer.recorder import Recorder
from p3dof.viewer.robots.readings import ClosureReadings
from p3dof.viewer.robots.scene import RobotScene

_SMALLEST = "Other actuator forces would do too: these are the smallest, and those in closures go with them."


def robot_animation_html(
    robot: Drawable,
    motion: JointMotion,
    speed: float = 1.0,
    fps: float = 60.0,
    title: str = "robot",
    loop: ClosedLoopModel | None = None,
    layers: Mapping[str, bool] | None = None,
) -> str:
    """Return a page that plays a motion of any robot, with the forces on it, in a loop.

    Parameters
    ----------
    robot : Drawable
        Its tree and its solids: ``model`` and ``visual_model``.
    motion : JointMotion
        Its joints over time; between samples they are interpolated.
    speed : float
        Seconds of the motion a second; the page has a control for it.
    fps : float
        Frames a second of what is seen at this speed; a little more so that they end with the motion.
    title : str
        Heading of the page.
    loop : ClosedLoopModel, optional
        The robot's closures are drawn too.
    layers : mapping of str to bool, optional
        What is seen at first, as for `RobotScene`; the page has boxes for it.

    Returns
    -------
    str
        HTML with everything in it.

    Raises
    ------
    MissingExtraError
        If MeshCat is not installed.
    InputError
        If an argument does not fit, or there would be too many frames.
    """
    if not isinstance(title, str):
        raise InputError(f"title: expected text, got {shown(title)}")
    step = positive("speed", speed, InputError) / positive("fps", fps, InputError)
    return _page(robot, motion, _times(motion, step), float(speed), title, loop, layers)


def robot_picture(
    robot: Drawable,
    motion: JointMotion,
    time: float | None = None,
    title: str = "robot",
    loop: ClosedLoopModel | None = None,
    layers: Mapping[str, bool] | None = None,
    size: tuple[int, int] = SIZE,
) -> bytes:
    """Return a picture of a moment of a motion, as PNG.

    Parameters
    ----------
    robot, motion, title, loop, layers
        As of `robot_animation_html`; the picture has room for the whole motion.
    time : float, optional
        Time of the motion [s]; its first by default.
    size : tuple of int
        Width and height [pixels].

    Returns
    -------
    bytes

    Raises
    ------
    MissingExtraError
        If MeshCat, playwright or a browser is missing.
    InputError
        If an argument does not fit.
    """
    instant = motion.time[:1] if time is None else np.array([time], dtype=float)
    return picture_of(_page(robot, motion, instant, 1.0, title, loop, layers), size)


def save_robot_film(
    path: str | os.PathLike[str],
    robot: Drawable,
    motion: JointMotion,
    speed: float = 1.0,
    fps: float = 25.0,
    title: str = "robot",
    loop: ClosedLoopModel | None = None,
    layers: Mapping[str, bool] | None = None,
    size: tuple[int, int] = SIZE,
    progress: Progress | None = None,
) -> Path:
    """Write a film of a motion of any robot: an MP4, or a GIF that plays in a loop.

    Parameters
    ----------
    path : path-like
        The file, whose name ends in ``.mp4`` or ``.gif``.
    robot, motion, speed, title, loop, layers
        As of `robot_animation_html`.
    fps : float
        Frames a second, at most 50 for a GIF.
    size : tuple of int
        Width and height [pixels].
    progress : callable, optional
        Called with (done, total) frames.

    Returns
    -------
    Path
        The path written.

    Raises
    ------
    MissingExtraError
        If MeshCat, playwright or a browser is missing, or for an MP4 ffmpeg.
    FileError
        If the file cannot be written.
    InputError
        If an argument does not fit.
    """
    rate = checked_rate(path, fps)
    checked_size(size)
    time = _times(motion, positive("speed", speed, InputError) / rate)
    html = _page(robot, motion, time, float(speed), title, loop, layers)
    return save_film(path, html, time - time[0], rate, size, progress)


def _page(
    robot: Drawable,
    motion: JointMotion,
    time: FloatArray,
    speed: float,
    title: str,
    loop: ClosedLoopModel | None,
    layers: Mapping[str, bool] | None,
) -> str:
    """Return a page with frames at some times (N,)."""
    window = Recorder()
    scene = RobotScene(robot, motion, window, loop, layers)
    moments = [motion.at(robot.model, float(instant)) for instant in time]
    for moment in moments:
        window.next_frame()
        scene.show(moment)
    q, forces = (np.array([getattr(moment, name) for moment in moments]) for name in ("q", "forces"))
    digits = max(1, 2 - math.floor(math.log10(min(scene.largest.values(), default=1.0))))
    labels = Labels(
        motion.actuated,
        scene.colours,
        f"{scene.legend} {_SMALLEST}" if motion.smallest else scene.legend,
        scene.units,
        digits,
        scene.layers.rows(),
        _closures(loop, moments),
    )
    return page_of(window, Frames(time, q, forces), labels, speed, title, scene.mesh)


def _times(motion: JointMotion, step: float) -> FloatArray:
    """Return evenly spaced times, at most a step apart."""
    span = float(motion.time[-1] - motion.time[0])
    if not span / step < MAX_FRAMES:
        raise InputError(f"fps, speed: expected at most {MAX_FRAMES} frames, got {span / step:.0f}")
    count = max(math.ceil(span / step - 1e-9), 1) + 1 if span else 1
    return np.linspace(motion.time[0], motion.time[-1], count)


def _closures(loop: ClosedLoopModel | None, moments: list[Moment]) -> list[dict[str, object]]:
    """Return what the page lists of closures and couplings, with their forces over the frames."""
    if loop is None:
        return []
    readings = ClosureReadings(loop)
    texts = zip(*(readings.texts(moment) for moment in moments), strict=True)
    return [{**vars(one), "texts": list(over)} for one, over in zip(readings.readings, texts, strict=True)]
