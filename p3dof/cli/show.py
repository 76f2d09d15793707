"""`p3dof show`: the machine in the browser, or as a file to look at."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import click
from rich.console import Console

from p3dof.cli.app import app
from p3dof.cli.files import OutputFile
from p3dof.cli.options import Case, Number, Whole, with_case
from p3dof.cli.output import print_plain, print_warnings, progress_bar
from p3dof.cli.payloads import print_payloads
from p3dof.files import SUFFIXES, suffix_of, together
from p3dof.manipulator import InverseDynamics
from p3dof.viewer.player import FASTEST, SLOWEST

_ENDING = ("SIGINT", "SIGTERM", "SIGHUP")


@app.command()
@with_case
@click.option(
    "--port",
    type=Whole(0, 65535),
    help="Port of the page on this machine, 0 for any; the first free one from 7000 on without it.",
)
@click.option(
    "--speed",
    type=Number(SLOWEST, FASTEST),
    default=1.0,
    show_default=True,
    help="How many times faster than in reality.",
)
@click.option("--fps", type=Number(1, 240), help="Frames a second; 60 without it, 25 in a film.")
@click.option(
    "--at", type=float, help="Time of the motion to begin at, and of the picture [s]; its first without it."
)
@click.option("--paused", is_flag=True, help="Begin with the motion stopped.")
@click.option("--open/--no-open", "browse", default=True, show_default=True, help="Open the user's browser.")
@click.option(
    "--out",
    type=OutputFile("show"),
    help="Write a file instead of serving: .html (plays with no network), .mp4, .gif or .png (see below).",
)
@click.option(
    "--video",
    type=OutputFile("film"),
    help="Likewise a film, .mp4 or .gif (needs a Chromium, and playwright).",
)
@click.option(
    "--screenshot",
    type=OutputFile("picture"),
    help="Likewise a picture, .png (needs them too).",
)
def show(
    case: Case,
    port: int | None,
    speed: float,
    fps: float | None,
    at: float | None,
    paused: bool,
    browse: bool,
    out: Path | None,
    video: Path | None,
    screenshot: Path | None,
) -> int:
    """Show the machine and its forces in the browser: play a motion, or move the platform by hand.

    The page is served to this machine only, until Ctrl-C or a termination signal, which end it with exit
    code 0. With --out, --video or --screenshot files are written instead, with exit code 1 when the machine
    cannot make the motion. Needs the extra 'viz'.
    """
    case.protect(out, video, screenshot)
    case.require_moment("--at", at)
    from p3dof.viewer.live import LiveViewer

    console = Console()
    print_payloads(console, case)
    result, _ = case.solve("virtual-power")
    print_warnings(console, result.warnings)
    if out or video or screenshot:
        paths = [path for path in (out, screenshot, video) if path is not None]
        with together():
            written = [_write(path, case, result, speed, fps, at) for path in paths]
        for path in written:
            print_plain(console, f"wrote {path}")
        return 0 if result.possible else 1
    with (
        _until_signalled() as wait,
        LiveViewer(
            case.robot, result, port=port, speed=speed, fps=fps or 60.0, playing=not paused, at=at
        ) as viewer,
    ):
        print_plain(console, f"{viewer.url} shows the machine; Ctrl-C ends it")
        sys.stdout.flush()
        if browse and _has_display():
            viewer.open()
        wait(viewer.wait)
    return 0


def _write(
    path: Path, case: Case, result: InverseDynamics, speed: float, fps: float | None, at: float | None
) -> Path:
    """Write what the ending of a name stands for: an animation, a film or a picture."""
    from p3dof.viewer.animation import save_animation
    from p3dof.viewer.video import save_screenshot, save_video, view_of

    ending = suffix_of(path, "show")
    if ending in SUFFIXES["animation"]:
        return save_animation(path, case.robot, result, speed, fps or 60.0)
    if ending in SUFFIXES["picture"]:
        return save_screenshot(path, case.robot, **view_of(case.robot, result, at))
    with progress_bar("film", 1) as progress:
        return save_video(path, case.robot, result, fps or 25.0, speed=speed, progress=progress)


@contextmanager
def _until_signalled() -> Iterator[Callable[[Callable[[float], bool]], None]]:
    """Give a function that waits for Ctrl-C or a termination signal, from whenever it came on."""
    ended = threading.Event()

    def end(_number: int, _frame: FrameType | None) -> None:
        ended.set()

    def wait(step: Callable[[float], bool]) -> None:
        while not ended.is_set() and not step(0.2):
            pass

    main = threading.current_thread() is threading.main_thread()
    numbers = [getattr(signal, name) for name in _ENDING if main and hasattr(signal, name)]
    if not sys.platform.startswith("win"):
        numbers = [n for n in numbers if n != signal.SIGHUP or signal.getsignal(n) != signal.SIG_IGN]  # nohup
    before = [signal.signal(number, end) or signal.SIG_DFL for number in numbers]
    try:
        yield wait
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def _has_display() -> bool:
    """Return whether a browser can have a window: without, Python would open one in the terminal."""
    wanted = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")
    return sys.platform in {"win32", "darwin"} or any(os.environ.get(name) for name in wanted)
