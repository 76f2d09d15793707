"""Who computes blocks: this process, its threads, processes beside it, or a cluster."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
import time
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from concurrent.futures.process import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

from p3dof._base.blocks import storage
from p3dof._base.blocks.problem import Problem, computed
from p3dof._base.blocks.reduction import State
from p3dof._base.blocks.storage import Manifest, path_of, require_folder
from p3dof._base.checks import one_line, shown, whole
from p3dof._base.errors import InputError
from p3dof._base.files import write_atomic

_LOOK_AGAIN = 5.0  # how often the size of a cluster is asked for, which may grow [s]

_BATCH = 0.25  # how long a call of a cluster should take: its scheduler takes some milliseconds for each [s]

MOST_WORKERS = 4096


class Processes(Executor):
    """Worker processes on this machine that are started anew when one of them dies.

    To be used as ``with p3dof.blocks.Processes(8) as client: p3dof.sweep(..., client=client)``. They
    end with the process that started them, however it ends. A script that starts them guards what it runs by
    ``if __name__ == "__main__":``.

    Parameters
    ----------
    workers : int
        How many.

    Raises
    ------
    InputError
        If `workers` is not a whole number of one or more.
    """

    def __init__(self, workers: int) -> None:
        self.workers = whole("workers", workers, 1, MOST_WORKERS)
        self._pool = self._new()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Let a worker call a function that can be pickled."""
        return self._pool.submit(fn, *args, **kwargs)

    def map(
        self, fn: Callable[..., Any], *iterables: Any, timeout: float | None = None, chunksize: int = 1
    ) -> Iterator[Any]:
        """Call a function for each item, as any executor does; parameters as of the built-in one."""
        return self._pool.map(fn, *iterables, timeout=timeout, chunksize=chunksize)

    def renew(self) -> None:
        """Start other processes for those that are broken."""
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._pool = self._new()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes when they have done what they do."""
        self._pool.shutdown(wait=wait, cancel_futures=cancel_futures)

    @property
    def pids(self) -> tuple[int, ...]:
        """The numbers of the processes that run now."""
        return tuple(self._pool._processes or ())

    def _new(self) -> ProcessPoolExecutor:
        context = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(self.workers, mp_context=context, initializer=_begin_worker)


def _begin_worker() -> None:
    """Leave Ctrl-C to the process that started this one, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: Any) -> None:
    parent.join()
    os._exit(1)


def crew_of(client: Any, workers: int, in_flight: int | None) -> Crew:
    """Return what blocks are handed to, whatever the user gave."""
    workers = whole("workers", workers, 1, MOST_WORKERS)
    if in_flight is not None:
        in_flight = whole("in_flight", in_flight, 1, 10**6)
    if client is None and workers == 1:
        return Crew(_Here(), in_flight or 1)
    if client is None:
        return Crew(ThreadPoolExecutor(workers), in_flight or 2 * workers, own=True)
    if isinstance(client, Executor):
        known = getattr(client, "workers", None) or getattr(client, "_max_workers", None) or workers
        return Crew(client, in_flight or 2 * int(known))
    if hasattr(client, "scheduler_info") and hasattr(client, "nthreads"):
        return _Cluster(client, in_flight)
    raise InputError(
        "client: expected a distributed.Client, an executor of concurrent.futures or None, "
        f"got {shown(client)}"
    )


class Crew:
    """Who computes blocks, as an executor."""

    dumps: Callable[[Any], bytes] = staticmethod(pickle.dumps)

    batching: float = 0.0
    """How long a call should take at least, because handing it over takes some milliseconds [s]."""

    def __init__(self, executor: Executor, room: int, own: bool = False) -> None:
        self._executor, self._room, self._own = executor, room, own

    def told(self, work: Any, name: str = "problem") -> Any:
        """Return something as workers are told it: as bytes that they make it of again; here, as it is."""
        if isinstance(self._executor, _Here):
            return work
        try:
            return self.dumps(work)
        except Exception as error:
            told = one_line(f"{type(error).__name__}: {error}", 200)
            raise InputError(f"{name}: expected what can be pickled ({told})") from error

    @property
    def room(self) -> int:
        """How many blocks may wait or be computed now."""
        return self._room

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Hand a call over; return its future."""
        try:
            return self._executor.submit(function, *arguments)
        except BrokenExecutor as error:  # it broke since the last call: told as of a call that was on its way
            failed: Future[Any] = Future()
            failed.set_exception(error)
            return failed

    def wait(self, pending: Collection[Any]) -> Collection[Any]:
        """Wait until some calls are done; return these."""
        return wait(pending, return_when=FIRST_COMPLETED).done

    def take(self, future: Any) -> Any:
        """Return the result of a call that is done, or raise its error; it is not kept anywhere else."""
        return future.result()

    def cancel(self, pending: Collection[Any]) -> None:
        """Take back what has not begun."""
        for future in pending:
            future.cancel()

    @property
    def renews(self) -> bool:
        """Whether `renew` replaces workers that died; a cluster has done so before it tells."""
        return hasattr(self._executor, "renew")

    def renew(self, pending: Collection[Any]) -> list[Any]:
        """Replace workers that died; return the calls that were lost with them, of those that are pending."""
        self._executor.renew()  # type: ignore[attr-defined]  # `renews`
        return [future for future in pending if future.done() and _fell(future)]

    def leave(self) -> None:
        """End what was started here."""
        if self._own:
            self._executor.shutdown(wait=True, cancel_futures=True)


class _Cluster(Crew):
    """Who computes blocks, as a client of Dask: it computes again what workers had that died."""

    def __init__(self, client: Any, in_flight: int | None) -> None:
        import cloudpickle  # Dask's: takes what is defined in a script or notebook too
        import distributed

        self._client: Any = client
        self._executor: Any = None
        self._wait: Any = distributed.wait
        self.dumps = cloudpickle.dumps
        self._in_flight = in_flight
        self.batching = _BATCH if in_flight is None else 0.0
        self._asked, self._threads = -_LOOK_AGAIN, 0

    @property
    def room(self) -> int:
        """How many blocks may wait or be computed now: a cluster may grow."""
        if self._in_flight is not None:
            return self._in_flight
        if time.monotonic() - self._asked >= _LOOK_AGAIN:
            self._threads = sum(self._client.nthreads().values())
            self._asked = time.monotonic()
        return max(2, 2 * self._threads)

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Hand a call over; return its future."""
        return self._client.submit(function, *arguments, pure=False)

    def wait(self, pending: Collection[Any]) -> Collection[Any]:
        """Wait until some calls are done; return these."""
        done: Collection[Any] = self._wait(list(pending), return_when="FIRST_COMPLETED").done
        return done

    def take(self, future: Any) -> Any:
        """Return the result of a call that is done, or raise its error; the cluster forgets it."""
        try:
            return future.result()
        finally:
            future.release()

    def cancel(self, pending: Collection[Any]) -> None:
        """Take back what has not begun."""
        if pending and self._client.status == "running":
            self._client.cancel(list(pending))

    @property
    def renews(self) -> bool:
        """Nothing is left to do: the cluster has replaced workers that died."""
        return False

    def leave(self) -> None:
        """Leave the cluster to whom it belongs."""


def died(error: BaseException) -> bool:
    """Return whether an error says that a worker died, rather than what it computed failed."""
    return isinstance(error, BrokenExecutor) or type(error).__name__ == "KilledWorker"


def dropped(error: BaseException) -> bool:
    """Return whether an error says that nobody works on a block any more."""
    return isinstance(error, CancelledError) or type(error).__name__ in {
        "CancelledError",
        "FutureCancelledError",
        "FuturesCancelledError",
        "CommClosedError",
    }


def _fell(future: Future[Any]) -> bool:
    """Return whether a call was lost with a worker."""
    error = None if future.cancelled() else future.exception()
    return future.cancelled() or (error is not None and died(error))


class _Here(Executor):
    """The calling thread: a call is done when it is handed over."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class Work(NamedTuple):
    """What every worker is told once."""

    problem: Problem
    manifest: Manifest
    folder: str | None


class Done(NamedTuple):
    """What comes back of a block."""

    states: tuple[State, ...]
    data: bytes | None


_memory = threading.local()


def run_blocks(told: bytes | Work, numbers: tuple[int, ...]) -> tuple[list[Done], float]:
    """Compute some blocks: what a worker does; return how long it took too."""
    work = told if isinstance(told, Work) else _unpacked(told)
    if work.folder is not None:
        require_folder(Path(work.folder))
    begun = time.perf_counter()
    found = [_run_block(work, number) for number in numbers]
    return found, time.perf_counter() - begun


def _run_block(work: Work, number: int) -> Done:
    manifest = work.manifest
    block = manifest.block(number)
    columns = computed(work.problem, block)
    states = tuple(reduction.of(columns, block.start) for reduction in manifest.reductions)
    content = storage.Content({name: columns[name] for name in manifest.keep}, states)
    data = storage.pack_block(manifest, block, content)
    if work.folder is None:
        return Done(states, data)
    write_atomic(path_of(Path(work.folder), manifest, number), data)
    return Done(states, None)


def _unpacked(packed: bytes) -> Work:
    """Return what a worker was told: the last one is remembered by each thread, for its own use."""
    if getattr(_memory, "packed", None) != packed:
        _memory.work = pickle.loads(packed)  # noqa: S301 - by the process that we work for
        _memory.packed = packed
    work: Work = _memory.work
    return work
