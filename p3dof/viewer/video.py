"""Pictures and films of the machine, taken in a browser without a window."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from p3dof import kinematics
from p3dof.checks import Progress, frozen_array
from p3dof.files import suffix_of, write_atomic
from p3dof.methods import InverseDynamics
from p3dof.page.machine import Machine, require_machine
from p3dof.page.poses import joints_of, trace_of
from p3dof.viewer.animation import TITLE, animation_html, frames_of
from p3dof.viewer.films import checked_rate, save_film
from p3dof.viewer.headless import SIZE, checked_size, picture_of
from p3dof.viewer.pages import standalone
from p3dof.viewer.scale import ArrowScale
from p3dof.viewer.scene import Scene, three_forces
from p3dof.viewer.states import States


def save_screenshot(
    path: str | os.PathLike[str],
    robot: Machine,
    pose: ArrayLike = (0.0, 0.0, 0.0),
    forces: ArrayLike | None = None,
    trace: ArrayLike | None = None,
    size: tuple[int, int] = SIZE,
    scale: ArrowScale | None = None,
) -> Path:
    """Write a picture of the machine at a pose, as PNG.

    Parameters
    ----------
    path : path-like
        The file, whose name ends in ``.png``.
    robot : Manipulator
        The machine.
    pose : array-like, shape (3,)
        y [m], z [m], θ [rad].
    forces : array-like, shape (3,), optional
        Of the actuators A, B, C [N], for the arrows.
    trace : array-like, shape (N, 3), optional
        A path of P in the fixed frame [m]; see `p3dof.viewer.trace_of`.
    size : tuple of int
        Width and height [pixels].
    scale : ArrowScale, optional
        Of the arrows, such as that of a whole motion; for the largest of the forces by default.

    Returns
    -------
    Path
        The path written.

    Raises
    ------
    ReachError
        If the pose is out of reach.
    MissingExtraError
        If MeshCat, playwright or a browser is missing.
    FileError
        If the file cannot be written.
    InputError
        If an argument does not fit.
    """
    suffix_of(path, "picture")
    return write_atomic(path, screenshot(robot, pose, forces, trace, size, scale))


def screenshot(
    robot: Machine,
    pose: ArrayLike = (0.0, 0.0, 0.0),
    forces: ArrayLike | None = None,
    trace: ArrayLike | None = None,
    size: tuple[int, int] = SIZE,
    scale: ArrowScale | None = None,
) -> bytes:
    """Return the picture that `save_screenshot` writes; arguments and errors are the same."""
    checked_size(size)
    require_machine(robot)
    place = frozen_array("pose", pose, (3,))
    joints = joints_of(robot, place)
    if scale is None and forces is not None:
        sliders = kinematics.inverse_kinematics(robot.parameters.geometry, place).sliders
        scale = ArrowScale.of_forces(robot, three_forces(forces), sliders)
    scene = Scene(robot, scale=scale)
    scene.display(joints, forces)
    if trace is not None:
        scene.draw_trace(trace)
    return picture_of(standalone(scene.window.messages()), size)


def view_of(robot: Machine, result: InverseDynamics, time: float | None = None) -> dict[str, Any]:
    """Return what a picture of a moment of a motion shows, as arguments of `save_screenshot`.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    result : InverseDynamics
        Of this machine.
    time : float, optional
        The moment [s]; the beginning by default.

    Returns
    -------
    dict of str to object
        The pose, its forces, the path of P, and the scale of the arrows, that of the whole motion.
    """
    seen = States(robot, result).of_time(float(result.time[0]) if time is None else time, "total")
    return {
        "pose": seen.pose,
        "forces": seen.forces,
        "trace": trace_of(robot, result.motion.pose[result.valid]),
        "scale": ArrowScale.of_motion(robot, result),
    }


def save_video(
    path: str | os.PathLike[str],
    robot: Machine,
    result: InverseDynamics,
    fps: float = 25.0,
    size: tuple[int, int] = SIZE,
    speed: float = 1.0,
    title: str = TITLE,
    progress: Progress | None = None,
) -> Path:
    """Write a film of a motion: an MP4, or a GIF that plays in a loop.

    Every frame is drawn at its exact time, however long that takes (about a quarter of a second each).

    Parameters
    ----------
    path : path-like
        The file, whose name ends in ``.mp4`` or ``.gif``.
    robot : Manipulator
        The machine.
    result : InverseDynamics
        Of this machine, by either method.
    fps : float
        Frames a second, at most 50 for a GIF; a little more so that they end with the motion.
    size : tuple of int
        Width and height [pixels].
    speed : float
        Seconds of the motion a second.
    title : str
        Heading.
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
    frames = frames_of(robot, result, speed, rate)
    html = animation_html(robot, result, speed, rate, title)
    times = frames.time - frames.time[0]
    return save_film(path, html, times, frames.rate * float(speed), size, progress)
