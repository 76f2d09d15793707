"""A motion of any robot as one HTML file that plays in any browser."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from p3dof.checks import FloatArray, positive, shown
from p3dof.errors import InputError
from p3dof.viewer.drawing import Drawable
from p3dof.viewer.frames import MAX_FRAMES, Frames, Labels, page_of
from p3dof.viewer.recorder import Recorder
from p3dof.viewer.robot_scene import JointMotion, RobotScene
from p3dof.viewer.stage import number


def robot_animation_html(
    robot: Drawable, motion: JointMotion, speed: float = 1.0, fps: float = 60.0, title: str = "robot"
) -> str:
    """Return a page that plays a motion of any robot, with the forces of its actuators, in a loop.

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
    window = Recorder()
    scene = RobotScene(robot, motion, window)
    frames = _frames(robot, motion, step)
    for joints, forces in zip(frames.joints, frames.forces, strict=True):
        window.next_frame()
        scene.display(joints, forces)
    longest = " and ".join(f"{number(largest)} {unit}" for unit, largest in scene.largest.items())
    legend = f"The longest arrow is {longest}." if longest else ""
    digits = max(1, 2 - math.floor(math.log10(min(scene.largest.values(), default=1.0))))
    labels = Labels(motion.actuated, scene.colours, legend, scene.units, digits)
    return page_of(window, frames, labels, float(speed), title, scene.mesh)


def _frames(robot: Drawable, motion: JointMotion, step: float) -> Frames:
    """Return evenly spaced frames, at most a step apart."""
    span = float(motion.time[-1] - motion.time[0])
    if not span / step < MAX_FRAMES:
        raise InputError(f"fps, speed: expected at most {MAX_FRAMES} frames, got {span / step:.0f}")
    count = max(math.ceil(span / step - 1e-9), 1) + 1 if span else 1
    time = np.linspace(motion.time[0], motion.time[-1], count)
    joints = np.array([_between(robot, motion, float(instant)) for instant in time])
    forces = [np.interp(time, motion.time, column) for column in motion.known.T]
    return Frames(time, joints, np.array(forces).reshape(-1, count).T)


def _between(robot: Drawable, motion: JointMotion, time: float) -> FloatArray:
    """Return the joints at a time."""
    after = int(np.searchsorted(motion.time, time))
    if after == 0:
        return np.asarray(motion.q[0])
    last, span = after - 1, motion.time[after] - motion.time[after - 1]
    share = float((time - motion.time[last]) / span)
    return np.asarray(pin.interpolate(robot.model, motion.q[last], motion.q[after], share))
