"""What keeps one page from taking all of the server: how much it may send, and how much waits for it."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable


class Allowance:
    """So many a second, and so many at once; what is not used is saved up to that number.

    Parameters
    ----------
    rate : float
        How many a second [1/s].
    burst : float
        How many at once, and at first.
    clock : callable
        Returns seconds.
    """

    def __init__(self, rate: float, burst: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._rate, self._burst, self._clock = rate, burst, clock
        self._left, self._since = burst, clock()

    def take(self) -> bool:
        """Take one; return whether there was one left."""
        now = self._clock()
        self._left = min(self._burst, self._left + self._rate * (now - self._since))
        self._since = now
        if self._left < 1:
            return False
        self._left -= 1
        return True


class Outbox:
    """Messages in the order in which they are to go, of those with the same key only the latest.

    Parameters
    ----------
    most : int
        How many can wait.
    most_bytes : int
        How long they can be together [bytes].

    Attributes
    ----------
    full : bool
        Whether a message did not fit any more, and was not taken; from then on none is.
    """

    def __init__(self, most: int, most_bytes: int) -> None:
        self._most, self._most_bytes = most, most_bytes
        self._waiting: dict[Hashable, bytes | str] = {}
        self._bytes = 0
        self.full = False

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, message: bytes | str, key: Hashable = None) -> bool:
        """Add a message, in place of an earlier one with its key.

        Parameters
        ----------
        message : bytes or str
            The message.
        key : hashable, optional
            Without, it replaces nothing and nothing replaces it.

        Returns
        -------
        bool
            Whether it was taken.
        """
        key = object() if key is None else key
        self._bytes += len(message) - len(self._waiting.pop(key, ""))
        self.full = self.full or len(self._waiting) >= self._most or self._bytes > self._most_bytes
        if self.full:
            self._waiting.clear()
            self._bytes = 0
            return False
        self._waiting[key] = message
        return True

    def pop(self) -> tuple[Hashable, bytes | str] | None:
        """Take the message that has waited longest, with its key; None when none waits."""
        if not self._waiting:
            return None
        key = next(iter(self._waiting))
        message = self._waiting.pop(key)
        self._bytes -= len(message)
        return key, message
