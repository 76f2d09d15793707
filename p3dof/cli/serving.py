"""Serving a live page from the command line: until Ctrl-C, or a termination signal."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Protocol

import click
from rich.console import Console

from p3dof.cli.kinds import Number, Whole
from p3dof.cli.output import print_plain
from p3dof.viewer.start import FASTEST, SLOWEST

_ENDING = ("SIGINT", "SIGTERM", "SIGHUP")

PORT = click.option(
    "--port",
    type=Whole(0, 65535),
    help="Port of the page on this machine, 0 for any; the first free one from 7000 on without it.",
)
SPEED = click.option(
    "--speed",
    type=Number(SLOWEST, FASTEST),
    default=1.0,
    show_default=True,
    help="How many times faster than in reality.",
)
PAUSED = click.option("--paused", is_flag=True, help="Begin with the motion stopped.")
OPEN = click.option(
    "--open/--no-open", "browse", default=True, show_default=True, help="Open the user's browser."
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


def serve(make: Callable[[], Served], what: str, browse: bool) -> None:
    """Serve a page until Ctrl-C or a termination signal.

    Parameters
    ----------
    make : callable
        Returns the page, served already.
    what : str
        What it shows, for the line that says where it is.
    browse : bool
        Whether to open the user's browser, if it can have a window.
    """
    with until_signalled() as wait, make() as viewer:
        print_plain(Console(), f"{viewer.url} shows {what}; Ctrl-C ends it")
        sys.stdout.flush()
        if browse and _has_display():
            viewer.open()
        wait(viewer.wait)


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


def _has_display() -> bool:
    """Return whether a browser can have a window: without, Python would open one in the terminal."""
    wanted = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")
    return sys.platform in {"win32", "darwin"} or any(os.environ.get(name) for name in wanted)
