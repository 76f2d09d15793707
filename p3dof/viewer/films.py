"""Films of pages that play: pictures taken in a browser without a window, as MP4 or GIF."""

from __future__ import annotations

import io
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, Progress, positive
from p3dof._base.errors import FileError, InputError, MissingExtraError
from p3dof._base.files import scratch_folder, suffix_of, write_atomic
from p3dof.viewer.headless import AnyShooter, PageShooter, as_image, aside, opened

_GIF_FPS = 50.0
"""Browsers show GIFs no faster."""


def checked_rate(path: str | os.PathLike[str], fps: float) -> float:
    """Return a frame rate, if a film of this name can have it.

    Parameters
    ----------
    path : path-like
        The file, whose name ends in ``.mp4`` or ``.gif``.
    fps : float
        Frames a second.

    Returns
    -------
    float

    Raises
    ------
    InputError
        If it cannot, or the name does not fit.
    """
    rate = positive("fps", fps, InputError)
    if suffix_of(path, "film") == ".gif" and rate > _GIF_FPS:
        raise InputError(f"fps: expected at most {_GIF_FPS:g} for a GIF, got {rate:g}")
    return rate


def save_film(
    path: str | os.PathLike[str],
    html: str,
    times: FloatArray,
    rate: float,
    size: tuple[int, int],
    progress: Progress | None = None,
    shooter: Callable[[Any], AnyShooter] = PageShooter,
) -> Path:
    """Write a film of a page that plays, every frame at its exact time.

    Parameters
    ----------
    path : path-like
        The file, whose name ends in ``.mp4`` or ``.gif``.
    html : str
        The page.
    times : ndarray, shape (N,)
        Of the frames [s].
    rate : float
        Frames a second.
    size : tuple of int
        Width and height [pixels].
    progress : callable, optional
        Called with (done, total) frames.
    shooter : callable
        What takes pictures of such a page.

    Returns
    -------
    Path
        The path written.

    Raises
    ------
    MissingExtraError
        If playwright or a browser is missing, or for an MP4 ffmpeg.
    FileError
        If the file cannot be written.
    """
    encode = _gif if suffix_of(path, "film") == ".gif" else _mp4(_ffmpeg())

    def shoot() -> list[bytes]:
        with opened(html, size, shooter) as taking:
            return list(_counted(taking.picture, times, progress))

    return write_atomic(path, encode(aside(shoot), rate))


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
