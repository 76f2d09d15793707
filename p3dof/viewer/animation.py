"""A motion as one HTML file that plays in any browser, from a disk and with no network."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from p3dof import kinematics
from p3dof.checks import FloatArray, positive, shown
from p3dof.errors import InputError
from p3dof.files import suffix_of, write_atomic
from p3dof.kinematics.states import reachable_poses
from p3dof.methods import InverseDynamics
from p3dof.viewer.machine import Machine, require_machine
from p3dof.viewer.pages import as_script, filled, resource, standalone
from p3dof.viewer.scale import ArrowScale
from p3dof.viewer.scene import Scene, joints_of, trace_of
from p3dof.viewer.scenery import COLOURS, LEGS, Room
from p3dof.viewer.window import Command, SceneWindow

TITLE = "3-DOF spatial parallel manipulator"
_SAME = 1e-6
"""By how much sliders may differ between the two methods, in lengths of a leg."""
MAX_FRAMES = 20_000
"""Most frames of an animation: that is tens of megabytes."""
_KINDS = ("position", "quaternion", "scale"), ("vector3", "quaternion", "vector3")
"""What a transform is made of, and what the page calls their types."""


@dataclass(frozen=True, eq=False)
class Frames:
    """What is shown, evenly spaced in time.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Times of the motion [s].
    joints : ndarray, shape (N, 10)
        Joints in Pinocchio's order; those of the last pose within reach where one is not.
    forces : ndarray, shape (N, 3)
        Of the actuators A, B, C [N]; NaN where there are none.
    """

    time: FloatArray
    joints: FloatArray
    forces: FloatArray

    @property
    def rate(self) -> float:
        """Frames a second of the motion; 1 when there is only one."""
        return (len(self.time) - 1) / float(self.time[-1] - self.time[0]) if len(self.time) > 1 else 1.0


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
    window = _Recorder()
    scale = ArrowScale.of_motion(robot, result)
    scene = Scene(robot, window, scale)
    scene.draw_trace(trace_of(robot, result.motion.pose[result.valid]))
    for joints, forces in zip(frames.joints, frames.forces, strict=True):
        window.next_frame()
        scene.display(joints, forces)
    motion = {
        "title": title,
        "start": float(frames.time[0]),
        "speed": float(speed),
        "rate": frames.rate,
        "mesh": round(Room.around(robot.parameters).mesh, 12),
        "legend": scale.legend,
        "names": [leg.upper() for leg in LEGS],
        "colours": [_web_colour(COLOURS[leg]) for leg in LEGS],
        "forces": [[_plain(force) for force in row] for row in frames.forces],
    }
    script = filled(resource("animation.js"), MOTION=as_script(motion))
    return standalone([*window.messages(), _packed(window.clips(frames.rate))], title, script)


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


class _Recorder(SceneWindow):
    """A window that remembers where everything was in every frame."""

    def __init__(self) -> None:
        super().__init__()
        self._count = 0
        self._placements: dict[str, dict[int, FloatArray]] = {}
        self._visible: dict[str, dict[int, bool]] = {}

    def next_frame(self) -> None:
        self._count += 1

    def send(self, command: Command) -> None:
        data = command.lower()
        if self._count and data["type"] == "set_transform":
            matrix = np.reshape(data["matrix"], (4, 4)).T
            self._placements.setdefault(data["path"], {})[self._count - 1] = matrix
        elif self._count and data["type"] == "set_property" and data["property"] == "visible":
            self._visible.setdefault(data["path"], {})[self._count - 1] = data["value"]
        super().send(command)

    def clips(self, rate: float) -> dict[str, Any]:
        """Return the command that plays the frames: only what moves is in it."""
        tracks = {path: _placed(matrices) for path, matrices in self._placements.items()}
        for path, shown_at in self._visible.items():
            if len(set(shown_at.values())) > 1:
                tracks.setdefault(path, []).append(_track("visible", "bool", shown_at.items()))
        return {
            "type": "set_animation",
            "path": "",
            "animations": [
                {"path": path, "clip": {"fps": rate, "name": "motion", "tracks": moving}}
                for path, moving in tracks.items()
                if moving
            ],
            "options": {"play": True, "repetitions": math.inf},
        }


def _placed(matrices: dict[int, FloatArray]) -> list[dict[str, Any]]:
    """Return the tracks of what is placed so in these frames; none if it stands still.

    What stays the same has one key, and is not left out: the page starts from the last transform, in which it
    takes a mirrored z for a turned and mirrored x.
    """
    parts = [_parts(matrix) for matrix in matrices.values()]
    tracks, moves = [], False
    for name, kind, values in zip(*_KINDS, zip(*parts, strict=True), strict=True):
        constant = np.ptp(values, axis=0).max() == 0
        moves = moves or not constant
        keys = zip(matrices, (value.tolist() for value in values[: 1 if constant else None]), strict=False)
        tracks.append(_track(name, kind, keys))
    return tracks if moves else []


def _parts(matrix: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Take a transform apart: position, quaternion (x, y, z, w) and scale, negative along a mirrored z."""
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    scale[2] = np.copysign(scale[2], np.linalg.det(matrix[:3, :3]))
    return matrix[:3, 3], pin.Quaternion(matrix[:3, :3] / scale).coeffs(), scale


def _track(name: str, kind: str, keys: Any) -> dict[str, Any]:
    return {
        "name": f".{name}",
        "type": kind,
        "keys": [{"time": frame, "value": value} for frame, value in keys],
    }


def _packed(command: dict[str, Any]) -> bytes:
    """Pack an animation in single precision, which is all that a page keeps of it."""
    import umsgpack

    return bytes(umsgpack.packb(command, force_float_precision="single"))


def _plain(force: float) -> float | None:
    return round(float(force), 4) if math.isfinite(force) else None


def _web_colour(rgba: Sequence[float]) -> str:
    return "#" + "".join(f"{round(255 * part):02x}" for part in rgba[:3])
