"""Many runs computed elsewhere: handed to the workers of a client in parts, in memory.

`p3dof.design.sweeps.RunSweep` stores runs, resumes, and reduces what is too much to store.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.blocks.crew import Crew, crew_of, died, dropped
from p3dof._base.checks import FloatArray, Progress
from p3dof._base.errors import SweepError
from p3dof.closed_form.compiled.many import HISTORY_WIDTH, RESULT_WIDTH
from p3dof.machine.parameters import Parameters
from p3dof.runs.many.columns import RunColumns
from p3dof.runs.many.plan import Task
from p3dof.runs.many.running import Batch, Machines
from p3dof.runs.many.singly import run_singly
from p3dof.runs.many.stops import NOT_RUN

SECONDS = 0.25
"""About how long a part takes."""

_NUMBERS = 1_000_000
"""Most numbers that go out with a part and come back: 8 MB."""

DEATHS = 3
"""How many workers a part may cost before it is given up."""

Found = tuple[FloatArray, FloatArray | None, bool]
"""Results (R, RESULT_WIDTH), histories (K, N, HISTORY_WIDTH) of those that keep them, and whether it was
interrupted."""


@dataclass(frozen=True, eq=False)
class RunWork:
    """Runs, and what to do with them; by threads of one process, or in parts elsewhere.

    Parameters
    ----------
    task : Task
        What is asked of every run.
    columns : RunColumns
        What differs.
    machine : Parameters
        What has no column.
    kept : ndarray of int
        Runs whose histories are kept.
    every : int
        A row of a history every so many ticks.
    level : str or None
        Of the extension; None to make runs one by one.
    lanes : bool
        Side by side; else one after the other.
    """

    task: Task
    columns: RunColumns
    machine: Parameters
    kept: NDArray[np.int64]
    every: int
    level: str | None
    lanes: bool

    @cached_property
    def batch(self) -> Batch:
        """The runs as the engine takes them."""
        assert self.level is not None  # noqa: S101 - the engine is not asked otherwise
        machines = Machines.of(self.columns, self.machine)
        return Batch(self.every, self.task, self.columns, machines, self.level, self.kept, self.lanes)

    def run(self, threads: int, progress: Progress | None) -> Found:
        """Make all runs in this process."""
        if self.level is None:
            return run_singly(self.task, self.columns, self.machine, self.kept, self.every, progress)
        return self.batch.run(threads, progress)

    def part(self, start: int, stop: int) -> RunWork:
        """Return some of the runs, which keep their numbers."""
        kept = self.kept[(self.kept >= start) & (self.kept < stop)] - start
        return replace(self, columns=self.columns.part(start, stop), kept=kept)


def run_with(client: Any, work: RunWork, seconds: float, progress: Progress | None) -> Found:
    """Make runs by the workers of a client; the same bits as of this process.

    Parameters
    ----------
    client : distributed.Client or concurrent.futures.Executor
        Who computes.
    work : RunWork
        The runs.
    seconds : float
        About how long all of them take.
    progress : callable, optional
        Called with (done, total) runs.

    Returns
    -------
    results, histories, interrupted

    Raises
    ------
    InputError
        If `client` is something else, or the controller cannot be sent.
    SweepError
        If workers die again and again, or the cluster drops what it had.
    """
    crew = crew_of(client, 1, None)
    count = work.columns.count
    results = np.full((count, RESULT_WIDTH), np.nan)
    results[:, 0] = NOT_RUN
    taken = _Taken(results, work.kept, progress)
    parts = (
        (start, stop, crew.told(work.part(start, stop), "controller and wrench"))
        for start, stop in _cuts(work, seconds)
    )
    try:
        _hand_out(crew, parts, taken)
    except KeyboardInterrupt:
        taken.interrupted = True
    finally:
        crew.leave()
    if len(work.kept) and taken.histories is None:  # interrupted before the first one
        taken.histories = np.full((len(work.kept), 1, HISTORY_WIDTH), np.nan)
    return results, taken.histories, taken.interrupted


def _cuts(work: RunWork, seconds: float) -> Iterator[tuple[int, int]]:
    """Yield the first run of each part, and the one behind its last."""
    count = work.columns.count
    states = HISTORY_WIDTH * (work.task.ticks / work.every + 2) * len(work.kept) / count
    each = len(work.columns.columns) + RESULT_WIDTH + states
    size = max(1, int(min(SECONDS * count / max(seconds, 1e-9), _NUMBERS / each)))
    for start in range(0, count, size):
        yield start, min(start + size, count)


@dataclass(eq=False)
class _Taken:
    """What came back so far."""

    results: FloatArray
    kept: NDArray[np.int64]
    progress: Progress | None
    histories: FloatArray | None = None
    interrupted: bool = False
    done: int = 0

    def take(self, start: int, stop: int, found: Found) -> None:
        """Put the runs of a part in their places."""
        results, histories, self.interrupted = found
        self.results[start:stop] = results
        if histories is not None:
            if self.histories is None:
                self.histories = np.full((len(self.kept), *histories.shape[1:]), np.nan)
            first = int(np.searchsorted(self.kept, start))
            self.histories[first : first + len(histories)] = histories
        self.done += stop - start
        if self.progress is not None:
            self.progress(self.done, len(self.results))


def _hand_out(crew: Crew, parts: Iterator[tuple[int, int, Any]], taken: _Taken) -> None:
    """Let workers make all parts, a few at a time; those that were lost with a worker again."""
    pending: dict[Any, tuple[int, int, Any]] = {}
    again: list[tuple[int, int, Any]] = []
    deaths: dict[int, int] = {}
    try:
        while True:
            while len(pending) < crew.room and (part := again.pop() if again else next(parts, None)):
                pending[crew.submit(_make, part[2])] = part
            if not pending:
                return
            lost = []
            for future in crew.wait(pending):
                part = pending.pop(future)
                try:
                    taken.take(part[0], part[1], crew.take(future))
                except Exception as error:
                    if dropped(error):
                        raise SweepError("the cluster dropped runs that it had to make") from error
                    if not died(error):
                        raise
                    lost.append(part)
            for part in lost:
                deaths[part[0]] = deaths.get(part[0], 0) + 1
                if not crew.renews or deaths[part[0]] > DEATHS:
                    raise SweepError(f"workers died while run {part[0]} or one beside it was made")
            if lost:
                again += lost + [pending.pop(future) for future in crew.renew(pending)]
            if taken.interrupted:
                return
    finally:
        crew.cancel(pending)


def _make(told: Any) -> Found:
    """Make the runs of a part: what a worker does."""
    work: RunWork = told if isinstance(told, RunWork) else pickle.loads(told)  # noqa: S301 - by whom we work for
    return work.run(1, None)
