"""A motion as one HTML file that plays in any browser, from a disk and with no network."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np

from p3dof import kinematics
from p3dof.checks import FloatArray, positive, shown
from p3dof.errors import InputError
from p3dof.files import suffix_of, write_atomic
from p3dof.kinematics import reachable_poses
from p3dof.methods import InverseDynamics
from p3dof.page.machine import Machine, require_machine
from p3dof.page.poses import joints_of, trace_of
from p3dof.page.room import COLOURS, LEGS, Room
from p3dof.viewer.frames import MAX_FRAMES, Frames, Labels, page_of
from p3dof.viewer.recorder import Recorder
from p3dof.viewer.scale import ArrowScale
from p3dof.viewer.scene import Scene

TITLE = "3-DOF spatial parallel manipulator"
_SAME = 1e-6
"""By how much sliders may differ between the two methods, in lengths of a leg."""


def animation_html(
    robot: Machine, result: InverseDynamics, speed: float = 1.0, fps: float = 60.0, title: str = TITLE
) -> str:
    """Return a page that plays a motion with its forces, in a loop.

    Joints are exact at every frame and go straight from one to the next, forces are interpolated from the
    samples. Where the result is NaN the last pose within reach stays, without arrows.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    result : InverseDynamics
        Of this machine, by either method.
    speed : float
        Seconds of the motion a second; the page has a control for it.
    fps : float
        Frames a second of what is seen at this speed; a little more so that they end with the motion.
    title : str
        Heading of the page.

    Returns
    -------
    str
        HTML with everything in it; about 1.2 MB for 1 s at 60 frames a second.

    Raises
    ------
    MissingExtraError
        If MeshCat is not installed.
    InputError
        If an argument does not fit, no sample is valid, or there would be too many frames.
    """
    if not isinstance(title, str):
        raise InputError(f"title: expected text, got {shown(title)}")
    frames = frames_of(robot, result, speed, fps)
    window = Recorder()
    scale = ArrowScale.of_motion(robot, result)
    scene = Scene(robot, window, scale)
    scene.draw_trace(trace_of(robot, result.motion.pose[result.valid]))
    for joints, forces in zip(frames.joints, frames.forces, strict=True):
        window.next_frame()
        scene.display(joints, forces)
    labels = Labels(tuple(leg.upper() for leg in LEGS), tuple(COLOURS[leg] for leg in LEGS), scale.legend)
    return page_of(window, frames, labels, float(speed), title, Room.around(robot.parameters).mesh)


def save_animation(
    path: str | os.PathLike[str],
    robot: Machine,
    result: InverseDynamics,
    speed: float = 1.0,
    fps: float = 60.0,
    title: str = TITLE,
) -> Path:
    """Write the page of `animation_html`, whole or not at all.

    Parameters
    ----------
    path : path-like
        The file, whose name ends in ``.html``; missing folders are made.
    robot, result, speed, fps, title
        As of `animation_html`.

    Returns
    -------
    Path
        The path written.

    Raises
    ------
    FileError
        If the file cannot be written.
    MissingExtraError, InputError
        As of `animation_html`.
    """
    suffix_of(path, "animation")
    return write_atomic(path, animation_html(robot, result, speed, fps, title))


def frames_of(robot: Machine, result: InverseDynamics, speed: float, fps: float) -> Frames:
    """Return what to show of a result at a speed and a frame rate.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    result : InverseDynamics
        Of this machine.
    speed, fps : float
        As of `animation_html`.

    Returns
    -------
    Frames
        From the first sample to the last, at most ``speed / fps`` apart.

    Raises
    ------
    InputError
        As of `animation_html`.
    """
    require_machine(robot)
    if not isinstance(result, InverseDynamics):
        raise InputError(f"result: expected an InverseDynamics, got {shown(result)}")
    step = positive("speed", speed, InputError) / positive("fps", fps, InputError)
    _check_machine(robot, result)
    motion = result.motion
    steps = motion.duration / step
    if not steps < MAX_FRAMES:
        raise InputError(f"fps, speed: expected at most {MAX_FRAMES} frames, got {steps:.0f}")
    samples = max(math.ceil(steps - 1e-9), 1) + 1 if len(motion) > 1 else 1
    moved = motion.resampled(samples) if len(motion) > 1 else motion
    poses = _held(reachable_poses(robot.parameters.geometry, moved.pose, "nan"))
    forces = [np.interp(moved.time, result.time, column) for column in result.forces.T]
    return Frames(moved.time, joints_of(robot, poses), np.stack(forces, axis=-1))


def _check_machine(robot: Machine, result: InverseDynamics) -> None:
    """Refuse a result whose sliders are not where this machine's are."""
    sliders = kinematics.inverse_kinematics(robot.parameters.geometry, result.motion.pose, "nan").sliders
    if not len(sliders) == len(result.forces) == len(result.joints.q):
        raise InputError(f"result: expected joints and forces of all its {len(sliders)} samples")
    off = np.abs(sliders - result.sliders)[result.valid]
    if not (off <= _SAME * robot.parameters.geometry.L).all():  # NaN: out of reach of this machine
        raise InputError("result: expected one of this machine, got sliders where this machine has none")


def _held(poses: FloatArray) -> FloatArray:
    """Fill rows of NaN with the row before, at the beginning with the first one that is not."""
    valid = np.flatnonzero(np.isfinite(poses).all(axis=-1))
    if not len(valid):
        raise InputError("result: expected a motion with a pose within reach")
    latest = np.searchsorted(valid, np.arange(len(poses)), side="right") - 1
    return np.asarray(poses[valid[np.maximum(latest, 0)]])
