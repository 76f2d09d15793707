"""Work in shares on threads, for everything that leaves Python for long: how many, which shares, one pool.

And the other way round: what many threads of a user's share. What calls write to is a `Workspace`, of which
every thread has its own; what can only be one thread's, since its caller keeps it filled from call to call,
is guarded by `OneThread`. Neither asks for Python's lock. Everything else that is kept between calls is only
ever replaced as a whole, by what any other thread would have found too.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Generic, TypeVar

from p3dof._base.checks import shown
from p3dof._base.errors import InputError

_Part = TypeVar("_Part")
_Result = TypeVar("_Result")
_Made = TypeVar("_Made")


class Workspace(threading.local):
    """What every thread has of its own of one object: what its methods write to.

    Each thread that uses an instance calls its ``__init__`` again, with the same arguments, when it first
    does, and has attributes of its own from then on. They go with the thread, or with the instance. The
    arguments are shared: they stay as they are, or are workspaces themselves.
    """


class Own(Workspace, Generic[_Made]):
    """Something that every thread makes for itself, such as the data of a library."""

    def __init__(self, make: Callable[[], _Made]) -> None:
        self.here = make()


class OneThread:
    """A guard of what only one thread may use: that which asks first, until it is given away."""

    def __init__(self, what: str) -> None:
        self._what = what
        self._thread: dict[str, int] = {}

    def __reduce__(self) -> tuple[type[OneThread], tuple[str]]:
        return OneThread, (self._what,)  # a copy is nobody's yet

    def give(self) -> None:
        """Make it this thread's, whoever has had it before."""
        self._thread["has it"] = threading.get_ident()

    def check(self) -> None:
        """Raise unless it is this thread's, or nobody's yet."""
        me = threading.get_ident()
        if self._thread.setdefault("has it", me) != me:  # whole, whoever else asks now
            raise InputError(f"{self._what}: another thread uses it")


def processors() -> int:
    """Return how many processors the process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def thread_count(threads: int | None) -> int:
    """Return on how many threads to work at most."""
    asked = os.environ.get("P3DOF_THREADS")
    name, wanted = (
        ("threads", threads) if threads is not None or not asked else ("P3DOF_THREADS", _number(asked))
    )
    if wanted is None:
        return processors()
    whole = hasattr(wanted, "__index__") and not isinstance(wanted, bool)
    if not whole or not 1 <= int(wanted) <= 1024:
        raise InputError(f"{name}: expected a number from 1 to 1024, got {shown(wanted)}")
    return int(wanted)


def _number(text: str) -> int | str:
    return int(text) if text.isdecimal() and len(text) < 10 else text


def shares(count: int, threads: int, least: int = 1) -> list[tuple[int, int]]:
    """Return starts and stops of parts as alike as whole numbers are; one part at the least."""
    parts = max(1, min(threads, count // least))
    ends = [count * part // parts for part in range(parts + 1)]
    return [(ends[k], ends[k + 1]) for k in range(parts)]


def slices(count: int, size: int) -> Iterator[slice]:
    """Yield a range in blocks of a size, the last one shorter."""
    for start in range(0, count, size):
        yield slice(start, min(start + size, count))


def in_threads(job: Callable[[_Part], _Result], parts: Sequence[_Part]) -> list[_Result]:
    """Do a job on all parts at once, the first on this thread: it need not wait for the others to wake up.

    What it returned. Where it raises, the others are waited for; then the first part's error is raised.

    `job`: called with a part; it must leave Python's lock for most of its time, and not ask for threads
    itself.
    """
    if not parts:
        return []
    others = [_pool(len(parts) - 1).submit(job, part) for part in parts[1:]]
    try:
        first = job(parts[0])
    finally:
        for other in others:
            other.exception()
    return [first, *(other.result() for other in others)]


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, "p3dof")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # threads do not come along into a forked process
