"""`sweep`: compute what is missing of a sweep, block by block, here or on a cluster."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from p3dof._base.blocks import storage
from p3dof._base.blocks.crew import Crew, Work, crew_of, died, dropped, run_blocks
from p3dof._base.blocks.problem import Problem
from p3dof._base.blocks.reduction import Reduction, State
from p3dof._base.blocks.results import Sweep
from p3dof._base.blocks.storage import (
    NAME_OF_FILE,
    TOTALS,
    Format,
    Manifest,
    Totals,
    locked,
    manifest_of,
    numbers_there,
    path_of,
    read_manifest,
    require_same,
)
from p3dof._base.checks import Progress, whole
from p3dof._base.errors import FileError, SweepError
from p3dof._base.files import called, check_writable, write_atomic

MOST_BLOCKS = 10**8  # most blocks of a sweep: each is a file

RETRIES = 3  # how many deaths of workers a block may see


class SweepInterrupted(KeyboardInterrupt):
    """Ctrl-C during a sweep; the message says how to go on."""


_Numbers: TypeAlias = tuple[int, ...]  # of the blocks of a call, one after the other

_MOST_TOGETHER, _LARGEST_TOGETHER = 16, 4_000_000
"""Most blocks of a call, and about how much their reductions may bring back [bytes]."""


def sweep(
    problem: Problem,
    folder: str | os.PathLike[str],
    *,
    client: Any = None,
    workers: int = 1,
    reductions: Sequence[Reduction] = (),
    keep: Sequence[str] | Literal["all"] | None = "all",
    seed: int = 0,
    block_size: int | None = None,
    format: Format = "npz",  # noqa: A002 - what users call it
    resume: bool = False,
    shared: bool = True,
    in_flight: int | None = None,
    progress: Progress | None = None,
) -> Sweep:
    """Compute a problem block by block into a folder: here, in processes beside, or on a cluster.

    The content of a block depends on its number and the seed alone, so that it does not matter who computes
    it, when, and how often; each is one file, written whole or not at all. A sweep that was interrupted, by
    Ctrl-C or by a machine that failed, goes on with ``resume=True`` and ends in the same bits.

    Parameters
    ----------
    problem : Problem
        What to compute, such as `p3dof.design.sweeps.DesignSweep`.
    folder : path-like
        Where the results go: the manifest ``sweep.json``, and ``blocks/``.
    client : distributed.Client or concurrent.futures.Executor, optional
        Who computes: a cluster of Dask, `p3dof.blocks.Processes`, or any executor; this process without
        one.
    workers : int
        Threads of this process, where there is no client.
    reductions : sequence of Reduction
        What to find in each block, and of all: `TopK`, `ParetoArchive`, `Histogram`, `Moments`.
    keep : "all", sequence of str, or None
        Columns to store; with None the reductions are all that is stored.
    seed : int
        Of all random numbers.
    block_size : int, optional
        Items of a block; as the problem says by default.
    format : {"npz", "parquet"}
        How blocks are stored; Parquet needs pyarrow (extra ``tables``).
    resume : bool
        Go on with the sweep that is in the folder, which must be the same one. Its blocks are read: those
        that are damaged are computed again, and told in `Sweep.notes`.
    shared : bool
        Whether the workers see the folder, and write their blocks themselves; otherwise blocks come back, and
        are written here.
    in_flight : int, optional
        Most blocks that are on their way at a time; by default two a worker, or on a cluster two calls a
        worker of some blocks that take a quarter of a second together.
    progress : callable, optional
        Called with (items done, all items).

    Returns
    -------
    Sweep
        The results, as `Sweep.load` reads them.

    Raises
    ------
    SweepError
        If the folder holds another sweep, or this one without `resume`; if another process works on it; if
        workers die again and again, or compute something else than the problem says.
    FileError
        If something cannot be read or written; what is done stays.
    InputError
        If an argument does not fit.
    MissingExtraError
        If a library for the format is not installed.
    SweepInterrupted
        A `KeyboardInterrupt` that says how to go on.
    """
    manifest = manifest_of(problem, seed, block_size, keep, format, tuple(reductions))
    whole("blocks, count / block_size", manifest.blocks, 1, MOST_BLOCKS)
    crew = crew_of(client, workers, in_flight)
    where = Path(called(folder)).absolute()
    work = crew.told(Work(problem, manifest, str(where) if shared else None))
    with locked(where):
        run = _Run(manifest, where, crew, progress, _begin(manifest, where, resume), shared)
        try:
            run.look_at_blocks()
            run.compute(work)
        except KeyboardInterrupt as error:
            raise SweepInterrupted(f"interrupted: {run.how_to_go_on()}") from error
        finally:
            crew.leave()
        run.finish()
    return Sweep.load(where, notes=tuple(run.notes), computed=run.computed)


def _begin(manifest: Manifest, folder: Path, resume: bool) -> bool:
    """Write the manifest of a new sweep, or compare that of one that is there; return whether it is."""
    path = folder / NAME_OF_FILE
    if not path.exists():
        storage.require_format(manifest.format)
        check_writable(path)
        write_atomic(path, manifest.text)
        return False
    require_same(read_manifest(folder), manifest, folder)
    storage.require_format(manifest.format)
    if not resume:
        there = len(numbers_there(folder, manifest))
        raise SweepError(
            f"{folder}: holds {there} of {manifest.blocks} blocks of this sweep; to resume it: resume=True"
        )
    return True


class _Run:
    """A sweep while it is computed."""

    def __init__(
        self,
        manifest: Manifest,
        folder: Path,
        crew: Crew,
        progress: Progress | None,
        resumed: bool,
        shared: bool,
    ) -> None:
        self.notes: list[str] = []
        self._manifest, self._folder, self._crew, self._progress = manifest, folder, crew, progress
        self._there = np.zeros(manifest.blocks, dtype=bool)
        self._resumed, self._shared = resumed, shared
        self._totals = Totals(manifest)
        self._items = 0
        self._seconds, self._bytes = 0.0, 1  # of a block, as far as known
        self.computed = 0

    def look_at_blocks(self) -> None:
        """Take over the blocks that are there; what is damaged counts as missing, and is told."""
        if not self._resumed:
            return
        for number in numbers_there(self._folder, self._manifest):
            block, path = self._manifest.block(number), path_of(self._folder, self._manifest, number)
            try:
                content = storage.read_block(self._manifest, block, path)
            except FileError as error:
                self.notes.append(f"computed again: {error}")
            else:
                self._note(number, content.states)

    def compute(self, work: bytes | Work) -> None:
        """Hand out what is missing, and take what comes back."""
        todo = deque(np.flatnonzero(~self._there).tolist())
        again: list[int] = []
        deaths: dict[int, int] = {}
        pending: dict[Any, _Numbers] = {}
        try:
            while True:
                while (todo or again) and len(pending) < self._crew.room:
                    numbers = self._next(again, todo)
                    pending[self._crew.submit(run_blocks, work, numbers)] = numbers
                if not pending:
                    return
                lost = [gone for future in self._done(pending) for gone in self._take(future, pending)]
                if lost:
                    again += self._bury(lost, deaths, pending)
        finally:
            self._crew.cancel(pending)

    def finish(self) -> None:
        """Write what the reductions found of all."""
        if self._manifest.reductions:
            write_atomic(self._folder / TOTALS, storage.pack_totals(self._manifest, self._totals.states()))

    def _next(self, again: list[int], todo: deque[int]) -> _Numbers:
        """Return the blocks of the next call: fewer towards the end, so that all workers end together."""
        if again:
            return (again.pop(),)
        together = self._crew.batching / self._seconds if self._seconds and self._shared else 1.0
        share = len(todo) / self._crew.room
        count = int(max(1.0, min(together, share, _MOST_TOGETHER, _LARGEST_TOGETHER / self._bytes)))
        return tuple(todo.popleft() for _ in range(count))

    def _done(self, pending: dict[Any, _Numbers]) -> Collection[Any]:
        try:
            return self._crew.wait(pending)
        except BaseException as error:
            if dropped(error):
                raise SweepError(f"the cluster dropped blocks: {self.how_to_go_on()}") from error
            raise

    def _take(self, future: Any, pending: dict[Any, _Numbers]) -> _Numbers:
        """Take what came back; return the numbers of blocks whose worker died."""
        numbers = pending.pop(future)
        try:
            found, seconds = self._crew.take(future)
        except BaseException as error:
            if died(error):
                return numbers
            if dropped(error):
                raise SweepError(f"the cluster dropped block {numbers[0]}: {self.how_to_go_on()}") from error
            if isinstance(error, FileError):
                raise FileError(f"{error.args[0]}; {self.how_to_go_on()}") from error
            raise
        self._seconds = seconds / len(numbers)
        self._bytes = 1 + sum(array.nbytes for state in found[0].states for array in state.values())
        for number, done in zip(numbers, found, strict=True):
            if done.data is not None:
                write_atomic(path_of(self._folder, self._manifest, number), done.data)
            self._note(number, done.states)
            self.computed += 1
        return ()

    def _bury(self, lost: list[int], deaths: dict[int, int], pending: dict[Any, _Numbers]) -> list[int]:
        """Replace workers that died, unless that has been done too often; return what is to be done again."""
        for number in lost:
            deaths[number] = deaths.get(number, 0) + 1
        worst = max(lost, key=lambda number: deaths[number])
        if not self._crew.renews or deaths[worst] > RETRIES:
            raise SweepError(
                f"workers died while block {worst} or one beside it was computed, and it was given up: "
                f"{self.how_to_go_on()}"
            )
        return lost + [number for future in self._crew.renew(pending) for number in pending.pop(future)]

    def _note(self, number: int, states: tuple[State, ...]) -> None:
        self._there[number] = True
        self._totals.add(states)
        self._items += len(self._manifest.block(number))
        if self._progress is not None:
            self._progress(self._items, self._manifest.count)

    def how_to_go_on(self) -> str:
        """Return how far it is, and how to resume."""
        done = int(self._there.sum())
        told = f"{done} of {self._manifest.blocks} blocks are in {self._folder}"
        return f"{told}; to resume it: resume=True"
