"""Pictures and films of a page, taken in a browser without a window: at exact times, as PNG, MP4 or GIF."""

from __future__ import annotations

import io
import math
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, Progress, positive, require
from p3dof._base.errors import FileError, InputError, MissingExtraError
from p3dof._base.files import scratch_folder, suffix_of, write_atomic
from p3dof.viewer.document.encoding import decoded
from p3dof.viewer.document.html import Page
from p3dof.viewer.headless import SIZE, PageShooter, as_image, aside, checked_size, opened, picture_of
from p3dof.viewer.showing import within

MAX_FRAMES = 20_000
"""Most frames of a film."""


def save_screenshot(
    path: str | os.PathLike[str], page: Page, time: float | None = None, size: tuple[int, int] = SIZE
) -> Path:
    """Write a picture of the machine of a page, as PNG; the path written."""
    suffix_of(path, "picture")
    return write_atomic(path, screenshot(page, time, size))


def screenshot(page: Page, time: float | None = None, size: tuple[int, int] = SIZE) -> bytes:
    """Return the picture that `save_screenshot` writes; arguments and errors are the same."""
    checked_size(size)
    times = times_of(page)
    if time is not None:
        within("time", time, float(times[0]), float(times[-1]))
    start = page.document.get("start", {}).get("time", times[0])
    return picture_of(page.html, size, float(start) if time is None else time, PageShooter)


def save_video(
    path: str | os.PathLike[str],
    page: Page,
    fps: float = 25.0,
    speed: float = 1.0,
    size: tuple[int, int] = SIZE,
    progress: Progress | None = None,
) -> Path:
    """Write a film of the first run of a page: an MP4, or a GIF that plays in a loop; the path written.

    Every frame is drawn at its exact time, however long that takes (about a tenth of a second each).
    """
    rate = checked_rate(path, fps)
    checked_size(size)
    factor = positive("speed", speed, InputError)
    times = frame_times(times_of(page), factor / rate)
    seconds = float(times[-1] - times[0]) / factor
    if len(times) > 1:
        rate = (len(times) - 1) / seconds
    encode = _gif if suffix_of(path, "film") == ".gif" else _mp4(_ffmpeg())

    def shoot() -> list[bytes]:
        pictures = []
        with opened(page.html, size, PageShooter) as taking:
            for count, time in enumerate(times.tolist(), 1):
                pictures.append(taking.picture(time))
                if progress is not None:
                    progress(count, len(times))
        return pictures

    return write_atomic(path, encode(aside(shoot), rate))


def times_of(page: Page) -> FloatArray:
    """Return the times of the first run of a page, shape (N,) [s]."""
    require("page", page, Page)
    if not page.document["runs"]:
        raise InputError("page: expected one with a run")
    return np.asarray(decoded(page.document["runs"][0]["time"]))


def frame_times(time: FloatArray, step: float) -> FloatArray:
    """Return evenly spaced times from the first to the last, at most so far apart.

    One time of a run with one sample.
    """
    steps = float(time[-1] - time[0]) / step
    if not steps < MAX_FRAMES:
        raise InputError(f"fps, speed: expected at most {MAX_FRAMES} frames, got {steps:.0f}")
    return np.linspace(time[0], time[-1], max(math.ceil(steps - 1e-9), 1) + 1 if len(time) > 1 else 1)


_GIF_FPS = 50.0
"""Browsers show GIFs no faster."""


def checked_rate(path: str | os.PathLike[str], fps: float) -> float:
    """Return a frame rate, if a film of this name can have it."""
    rate = positive("fps", fps, InputError)
    if suffix_of(path, "film") == ".gif" and rate > _GIF_FPS:
        raise InputError(f"fps: expected at most {_GIF_FPS:g} for a GIF, got {rate:g}")
    return rate


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
