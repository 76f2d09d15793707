"""The time of a motion that is played, and the thread that draws its frames."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

from p3dof.checks import shown
from p3dof.errors import InputError

SLOWEST, FASTEST = 0.1, 4.0
"""How many times faster than in reality a motion can be played."""

END_PAUSE = 0.5
"""How long the end is shown before the motion begins again [s]."""


class Player:
    """Says which time of a motion is shown: it runs, stops, jumps, and begins again at the end.

    Parameters
    ----------
    start, end : float
        First and last time of the motion [s].
    speed : float
        How many times faster than in reality, from `SLOWEST` to `FASTEST`.
    playing : bool
        Whether it runs already.
    at : float, optional
        The time to begin at [s]; the first by default.
    clock : callable
        Returns seconds.

    Raises
    ------
    InputError
        If the speed or the time is out of range.
    """

    def __init__(
        self,
        start: float,
        end: float,
        speed: float = 1.0,
        playing: bool = True,
        at: float | None = None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.start, self.end = start, end
        self._clock = clock
        self._playing = playing
        self._speed = within("speed", speed, SLOWEST, FASTEST)
        self._from = start if at is None else within("at", at, start, end)
        self._since = clock()  # when `_from` was shown

    @property
    def playing(self) -> bool:
        """Whether time runs."""
        return self._playing

    @property
    def speed(self) -> float:
        """How many times faster than in reality."""
        return self._speed

    @property
    def time(self) -> float:
        """The time of the motion that is shown [s]."""
        if not self._playing:
            return self._from
        length = self.end - self.start
        run = self._from - self.start + self._speed * (self._clock() - self._since)
        return self.start + min(run % (length + self._speed * END_PAUSE), length)

    def play(self) -> None:
        """Let time run: from the beginning if it had come to the end."""
        if not self._playing:
            self._go(self.start if self._from >= self.end else self._from, True)

    def pause(self) -> None:
        """Stop."""
        self._go(self.time, False)

    def seek(self, to: float) -> None:
        """Stop at a time.

        Parameters
        ----------
        to : float
            Time of the motion [s].

        Raises
        ------
        InputError
            If the motion has no such time.
        """
        self._go(within("time", to, self.start, self.end), False)

    def set_speed(self, speed: float) -> None:
        """Go on at another speed.

        Parameters
        ----------
        speed : float
            How many times faster than in reality, from `SLOWEST` to `FASTEST`.

        Raises
        ------
        InputError
            If it is out of range.
        """
        speed = within("speed", speed, SLOWEST, FASTEST)
        self._go(self.time, self._playing)
        self._speed = speed

    def _go(self, at: float, playing: bool) -> None:
        self._from, self._since, self._playing = at, self._clock(), playing


class Frames:
    """A thread that draws: at an even rate while something moves, and once whenever it is asked.

    The instants are those of an absolute clock; what comes too late is left out.

    Parameters
    ----------
    draw : callable
        Draws a frame; returns whether more are to follow without being asked.
    rate : float
        Most frames per second.
    name : str
        Of the thread.
    """

    def __init__(self, draw: Callable[[], bool], rate: float, name: str) -> None:
        self._draw = draw
        self._period = 1 / rate
        self._asked = threading.Event()
        self._ended = threading.Event()
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self.count = 0

    @property
    def running(self) -> bool:
        """Whether the thread draws."""
        return self._thread.is_alive()

    def start(self) -> None:
        """Begin, with a first frame."""
        self._asked.set()
        self._thread.start()

    def ask(self) -> None:
        """Have a frame drawn soon."""
        self._asked.set()

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until the thread is to end; raise what it died of.

        Parameters
        ----------
        timeout : float, optional
            How long [s]; for ever without.

        Returns
        -------
        bool
            Whether it ended.
        """
        ended = self._ended.wait(timeout)
        if self._error is not None:
            raise self._error
        return ended

    def stop(self) -> None:
        """End the thread; may be called more than once."""
        self._ended.set()
        self._asked.set()
        if self.running and threading.current_thread() is not self._thread:
            self._thread.join(timeout=10)

    def _run(self) -> None:
        due, more = time.perf_counter(), False
        while True:
            if not more:
                self._asked.wait()
            self._asked.clear()
            if self._ended.is_set():
                return
            try:
                more = self._draw()
            except Exception as error:  # handed on by `wait`
                self._error = error
                self._ended.set()
                return
            self.count += 1
            due = max(due + self._period, time.perf_counter())
            self._ended.wait(due - time.perf_counter())


def within(name: str, value: object, low: float, high: float) -> float:
    """Return a number from a page or a user, if it lies in a range.

    Parameters
    ----------
    name : str
        What to call it.
    value : object
        What came.
    low, high : float
        The range, ends included.

    Returns
    -------
    float

    Raises
    ------
    InputError
        If it is something else.
    """
    number = value if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
    if not low <= number <= high:
        raise InputError(f"{name}: expected a number from {low:g} to {high:g}, got {shown(value)}")
    return float(number)
