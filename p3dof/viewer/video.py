"""Pictures and films of the machine, taken in a browser without a window."""

from __future__ import annotations

import io
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from p3dof import kinematics
from p3dof.checks import FloatArray, Progress, frozen_array, positive
from p3dof.errors import FileError, InputError, MissingExtraError
from p3dof.files import scratch_folder, suffix_of, write_atomic
from p3dof.methods import InverseDynamics
from p3dof.viewer.animation import TITLE, animation_html, frames_of
from p3dof.viewer.headless import SIZE, as_image, aside, checked_size, opened, picture_of
from p3dof.viewer.machine import Machine, require_machine
from p3dof.viewer.pages import standalone
from p3dof.viewer.scale import ArrowScale
from p3dof.viewer.scene import Scene, joints_of, three_forces, trace_of
from p3dof.viewer.states import States

_GIF_FPS = 50.0
"""Browsers show GIFs no faster."""


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
    ending = suffix_of(path, "film")
    rate = positive("fps", fps, InputError)
    checked_size(size)
    if ending == ".gif" and rate > _GIF_FPS:
        raise InputError(f"fps: expected at most {_GIF_FPS:g} for a GIF, got {rate:g}")
    frames = frames_of(robot, result, speed, rate)
    times = frames.time - frames.time[0]
    encode = _gif if ending == ".gif" else _mp4(_ffmpeg())
    html = animation_html(robot, result, speed, rate, title)

    def shoot() -> list[bytes]:
        with opened(html, size) as shooter:
            return list(_counted(shooter.picture, times, progress))

    pictures = aside(shoot)
    return write_atomic(path, encode(pictures, frames.rate * float(speed)))


def _counted(shoot: Callable[[float], bytes], times: FloatArray, progress: Progress | None) -> list[bytes]:
    pictures = []
    for time in times:
        pictures.append(shoot(float(time)))
        if progress is not None:
            progress(len(pictures), len(times))
    return pictures


def _gif(pictures: list[bytes], rate: float) -> bytes:
    """Return a GIF that loops; a frame lasts whole hundredths of a second, right on average."""
    palette = _palette(as_image(pictures[0]))
    first, *rest = [as_image(png).quantize(palette=palette, dither=0) for png in pictures]
    ends = np.round(100 / rate * np.arange(len(pictures) + 1))
    stream = io.BytesIO()
    durations = [10 * max(int(step), 2) for step in np.diff(ends)]  # browsers slow down what is shorter
    first.save(stream, "GIF", save_all=True, append_images=rest, duration=durations, loop=0, optimize=False)
    return stream.getvalue()


def _palette(image: Any) -> Any:
    """Return 254 colours as an image: half for what is large and even, half for what is small and bright."""
    large, bright = (image.quantize(colors=127, method=method).getpalette()[:381] for method in (0, 1))
    palette = image.quantize(colors=2)
    palette.putpalette([*large, *bright])
    return palette


def _mp4(ffmpeg: str) -> Callable[[list[bytes], float], bytes]:
    """Return what makes an MP4 that every browser plays: H.264, even sizes, four colour samples a dozen."""

    def encode(pictures: list[bytes], rate: float) -> bytes:
        with scratch_folder() as folder:
            file = folder / "film.mp4"
            run = subprocess.run(  # noqa: S603 - a fixed command
                [
                    *(ffmpeg, "-loglevel", "error", "-y"),
                    *("-f", "image2pipe", "-c:v", "png", "-framerate", f"{rate:.6f}", "-i", "-"),
                    *("-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-c:v", "libx264", "-crf", "18"),
                    *("-pix_fmt", "yuv420p", "-movflags", "+faststart", str(file)),
                ],
                input=b"".join(pictures),
                capture_output=True,
                check=False,
            )
            if run.returncode or not file.exists():
                reason = run.stderr.decode(errors="replace").strip().splitlines() or ["no reason given"]
                raise FileError(f"ffmpeg could not make the film: {reason[-1][:200]}")
            return file.read_bytes()

    return encode


def _ffmpeg() -> str:
    """Return the system's ffmpeg, or the one of imageio-ffmpeg."""
    found = shutil.which("ffmpeg")
    if found:
        return found
    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise MissingExtraError(
            "an MP4 needs ffmpeg: install it, or pip install 'p3dof[video]'; a .gif needs neither"
        ) from error
    return str(imageio_ffmpeg.get_ffmpeg_exe())
