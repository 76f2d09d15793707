"""Pictures and films of a page, taken in a browser without a window: at exact times."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np

from p3dof._base.checks import FloatArray, Progress, positive, shown
from p3dof._base.errors import InputError
from p3dof._base.files import suffix_of, write_atomic
from p3dof.viewer.document.encoding import decoded
from p3dof.viewer.document.saved import Page
from p3dof.viewer.films import checked_rate, save_film
from p3dof.viewer.headless import SIZE, PageShooter, checked_size, picture_of
from p3dof.viewer.start import within

MAX_FRAMES = 20_000
"""Most frames of a film."""


def save_screenshot(
    path: str | os.PathLike[str], page: Page, time: float | None = None, size: tuple[int, int] = SIZE
) -> Path:
    """Write a picture of the machine of a page, as PNG.

    Parameters
    ----------
    path : path-like
        The file, whose name ends in ``.png``.
    page : Page
        As of `p3dof.viewer.page` or `p3dof.viewer.robot_page`.
    time : float, optional
        Time of its first run [s]; where the page begins by default.
    size : tuple of int
        Width and height [pixels].

    Returns
    -------
    Path
        The path written.

    Raises
    ------
    MissingExtraError
        If playwright or a browser is missing.
    FileError
        If the file cannot be written.
    InputError
        If an argument does not fit.
    """
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
    """Write a film of the first run of a page: an MP4, or a GIF that plays in a loop.

    Every frame is drawn at its exact time, however long that takes (about a tenth of a second each).

    Parameters
    ----------
    path : path-like
        The file, whose name ends in ``.mp4`` or ``.gif``.
    page : Page
        As of `p3dof.viewer.page` or `p3dof.viewer.robot_page`.
    fps : float
        Frames a second, at most 50 for a GIF; a little more so that they end with the run.
    speed : float
        Seconds of the run a second.
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
        If playwright or a browser is missing, or for an MP4 ffmpeg.
    FileError
        If the file cannot be written.
    InputError
        If an argument does not fit, or there would be too many frames.
    """
    rate = checked_rate(path, fps)
    checked_size(size)
    factor = positive("speed", speed, InputError)
    times = frame_times(times_of(page), factor / rate)
    seconds = float(times[-1] - times[0]) / factor
    if len(times) > 1:
        rate = (len(times) - 1) / seconds
    return save_film(path, page.html, times, rate, size, progress, PageShooter)


def times_of(page: Page) -> FloatArray:
    """Return the times of the first run of a page, shape (N,) [s].

    Raises
    ------
    InputError
        If it is no page, or has no run.
    """
    if not isinstance(page, Page):
        raise InputError(f"page: expected a Page, got {shown(page)}")
    if not page.document["runs"]:
        raise InputError("page: expected one with a run")
    return np.asarray(decoded(page.document["runs"][0]["time"]))


def frame_times(time: FloatArray, step: float) -> FloatArray:
    """Return evenly spaced times from the first to the last, at most so far apart.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Of the samples [s].
    step : float
        [s]

    Returns
    -------
    ndarray
        One time of a run with one sample.

    Raises
    ------
    InputError
        If there would be more than `MAX_FRAMES`.
    """
    steps = float(time[-1] - time[0]) / step
    if not steps < MAX_FRAMES:
        raise InputError(f"fps, speed: expected at most {MAX_FRAMES} frames, got {steps:.0f}")
    return np.linspace(time[0], time[-1], max(math.ceil(steps - 1e-9), 1) + 1 if len(time) > 1 else 1)
