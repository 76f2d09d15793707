"""Showing what moves: a live page until Ctrl-C; a page in a file, a film, a picture."""

from __future__ import annotations

import logging
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Protocol

import click
from rich.console import Console

from p3dof._base.errors import LOG
from p3dof._base.files import SUFFIXES, suffix_of
from p3dof.cli.app import tell_doubts
from p3dof.cli.kinds import MOMENT_OF_MOTION, Number, Whole, as_one
from p3dof.cli.output import print_plain, progress_bar
from p3dof.viewer.showing import FASTEST, SLOWEST
from p3dof.viewer.window import has_display

if TYPE_CHECKING:
    from p3dof.viewer.document.html import Page

_ENDING = ("SIGINT", "SIGTERM", "SIGHUP")

_OPTIONS = (
    click.option(
        "--meshcat",
        is_flag=True,
        help="Play the motion repeatedly in MeshCat (Pinocchio's MeshcatVisualizer); with --out FILE.html "
        "in a file.",
    ),
    click.option("--once", is_flag=True, help="With --meshcat: play once and end, with exit code 0."),
    click.option(
        "--port",
        type=Whole(0, 65535),
        help="Port of the page on this machine, 0 for any; by default the first free one from 7000 on.",
    ),
    click.option(
        "--speed", type=Number(SLOWEST, FASTEST), default=1.0, help="Playback speed, 1 for real time."
    ),
    click.option("--fps", type=Number(1, 240), help="Frames per second of a film; by default 25."),
    click.option(
        "--at",
        type=MOMENT_OF_MOTION,
        help="Start time of playback, and time of a picture [s]; by default that of the first sample.",
    ),
    click.option("--paused", is_flag=True, help="Start with playback paused."),
    click.option("--open/--no-open", "browse", default=True, help="Open the user's browser."),
)


class Served(Protocol):
    """A page that is served, as a context that ends it."""

    @property
    def url(self) -> str:
        """Where it is."""

    def __enter__(self) -> Any:
        """Return the page."""

    def __exit__(self, *error: object) -> None:
        """End it."""

    def open(self) -> object:
        """Open it in the user's browser."""

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until it has ended."""


@dataclass(frozen=True)
class View:
    """How it is shown, as the options name it."""

    meshcat: bool  # instead of the page with charts
    once: bool  # and no more
    port: int | None  # of the page
    speed: float  # times faster than in reality
    fps: float | None  # frames a second of a film
    at: float | None  # time of the motion to begin at [s]
    paused: bool
    browse: bool  # whether to open the user's browser, if it can have a window

    def __post_init__(self) -> None:
        if self.once and not self.meshcat:
            raise click.UsageError("--once needs --meshcat")
        if self.once and self.paused:
            raise click.UsageError("--once and --paused exclude each other")

    @property
    def page(self) -> dict[str, Any]:
        """What a page takes."""
        return {"at": self.at, "speed": self.speed, "playing": not self.paused}

    def play(self, make: Callable[[], Any], motion: Any, what: str) -> None:
        """Play a motion in MeshCat; `make` returns the visualizer."""
        from p3dof.viewer.playing import PlayedPage

        self.serve(lambda: PlayedPage(make(), motion, **self.page, repeat=not self.once), what)

    def require_page(self, paths: Iterable[Path]) -> None:
        """Refuse what a page of MeshCat cannot be written into, or that is not served."""
        for path in paths:
            if self.meshcat and suffix_of(path, "show") not in SUFFIXES["animation"]:
                raise click.UsageError(f"{path}: --meshcat writes .html only")
            if self.once:
                raise click.UsageError("--once is for what is played live, not for files")

    def serve(self, make: Callable[[], Served], what: str) -> None:
        """Serve a page of something until Ctrl-C or a termination signal."""
        with until_signalled() as wait, make() as viewer:
            tell_doubts()
            LOG.addHandler(logging.lastResort or logging.NullHandler())  # what a server refuses is said
            print_plain(Console(), f"{viewer.url} shows {what}; Ctrl-C ends it")
            sys.stdout.flush()
            if self.browse and has_display():
                viewer.open()
            wait(viewer.wait)

    def write(self, path: Path, page: Page, **size: Any) -> Path:
        """Write what the ending of a name stands for: a page, a film or a picture."""
        from p3dof.viewer.pictures import save_screenshot, save_video

        ending = suffix_of(path, "show")
        if ending in SUFFIXES["animation"]:
            return page.save(path)
        if ending in SUFFIXES["picture"]:
            return save_screenshot(path, page, **size)
        with progress_bar("film", 1) as progress:
            return save_video(path, page, self.fps or 25.0, self.speed, progress=progress, **size)


with_view = as_one("view", View, *_OPTIONS)
"""The options of a `View`, and the view as the argument `view`."""


@contextmanager
def until_signalled() -> Iterator[Callable[[Callable[[float], bool]], None]]:
    """Give a function that waits for Ctrl-C or a termination signal, from whenever it came on."""
    ended = threading.Event()

    def end(_number: int, _frame: FrameType | None) -> None:
        ended.set()

    def wait(step: Callable[[float], bool]) -> None:
        while not ended.is_set() and not step(0.2):
            pass

    main = threading.current_thread() is threading.main_thread()
    numbers = [getattr(signal, name) for name in _ENDING if main and hasattr(signal, name)]
    # What it was started to ignore, by nohup or in the background of a script, is meant for others.
    numbers = [number for number in numbers if signal.getsignal(number) != signal.SIG_IGN]
    before = [signal.signal(number, end) or signal.SIG_DFL for number in numbers]
    try:
        yield wait
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
