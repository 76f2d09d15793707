"""Many runs in blocks on threads, or in parts at the workers of a client."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from p3dof._base.blocks.crew import Crew, crew_of, died, dropped
from p3dof._base.checks import FloatArray, Progress
from p3dof._base.errors import SweepError
from p3dof.analysis.designs.folding import folding_of
from p3dof.closed_form.compiled import many
from p3dof.closed_form.compiled.formulas import MODEL
from p3dof.closed_form.compiled.reduced import SMALLER_ZEROS, model_of
from p3dof.closed_form.compiled.reduced.dynamics import friction_numbers
from p3dof.machine.parameters import Parameters
from p3dof.runs.many.columns import NOT_RUN, SEED, STARTS, RunColumns
from p3dof.runs.many.plan import CAREFULLY, NEAR, SharedTask, engine_of, fill, have_friction, parts_of_steps
from p3dof.runs.many.singly import run_singly

BLOCK = 1024  # most runs in a block: a unit of work for a thread

_NUMBERS = 4_000_000  # most numbers of noise and histories in a block: 32 MB

_LONG = 4_000_000  # most ticks in a block: some tenths of a second, in which nobody can interrupt it


@dataclass(frozen=True, eq=False)
class Machines:
    """The machines of runs: 36 numbers each, those of friction where any has some, and their limits."""

    model: tuple[Any, ...]  # as `Model.numbers`, and `FRICTION` after them: each a number, or a column (R,)
    travel: tuple[Any, Any]  # limits, each a number or a column [m, rad]
    tilt: tuple[Any, Any]
    force: Any  # largest forces [N]

    @classmethod
    def of(cls, columns: RunColumns, machine: Parameters) -> Machines:
        """Return those of columns."""
        limits = machine.limits
        if columns.designs is None:
            friction = friction_numbers(machine.friction) if machine.friction else []
            return cls((*model_of(machine).numbers, *friction), limits.travel, limits.tilt, limits.force)
        designs = columns.designs
        folding = folding_of(tuple(designs.columns), designs.machine, designs.bodies)
        given = {name: np.ravel(column) for name, column in designs.columns.items()}
        folded = folding.fold(given).numbers

        def limit(name: str, own: float) -> Any:
            return given.get(f"limits.{name}", own)

        return cls(
            tuple(folded),
            (limit("travel.low", limits.travel[0]), limit("travel.high", limits.travel[1])),
            (limit("tilt.low", limits.tilt[0]), limit("tilt.high", limits.tilt[1])),
            limit("force", limits.force),
        )

    def symmetric(self, count: int) -> NDArray[np.bool_]:
        """Return which machines the smaller kernels serve, (R,)."""
        found = np.ones(count, dtype=bool)
        for name, number in zip(MODEL, self.model[: len(MODEL)], strict=True):
            if name in SMALLER_ZEROS:
                found &= np.broadcast_to(np.asarray(number) == 0, count)
        return found


class _Form(NamedTuple):
    """What the runs of a block have in common: the kernels, histories or none, steps."""

    symmetric: bool
    keep: bool
    friction: bool
    parts: int


@dataclass(frozen=True, eq=False)
class Batch:
    """Runs for the engine."""

    every: int  # a row of a history every so many ticks
    task: SharedTask  # what is asked of every one
    columns: RunColumns  # what differs
    machines: Machines  # what is moved
    level: str  # of the extension
    kept: NDArray[np.int64]  # runs whose histories are kept
    lanes: bool = True  # side by side; else one after the other

    @cached_property
    def parts(self) -> NDArray[np.int64]:
        """Into how many parts the steps of each run are cut, (R,); `CAREFULLY` for DOP853."""
        own, start = self.columns.own, self.task.start
        y, theta = own.get("start.y", start[0]), own.get("start.theta", start[2])
        return parts_of_steps(self.task, self.machines.model, y, theta, self.columns.count)

    @cached_property
    def engines(self) -> dict[int, many.Engine]:
        """What runs share, by these parts."""
        found = {}
        for parts in {1, *self.parts.tolist()}:
            near = np.inf if parts == CAREFULLY else NEAR
            found[parts] = engine_of(replace(self.task, parts=max(parts, 1)), self.every, near)
        return found

    @property
    def engine(self) -> many.Engine:
        """That with whole steps."""
        return self.engines[1]

    def run(self, threads: int, progress: Progress | None) -> tuple[FloatArray, FloatArray | None, bool]:
        """Run all; return the results (R, RESULT_WIDTH), the histories, and whether it was interrupted."""
        count = self.columns.count
        results = np.full((count, many.RESULT_WIDTH), np.nan)
        results[:, 0] = self.columns.status
        shape = (len(self.kept), self.engine.rows, many.HISTORY_WIDTH)
        histories = np.full(shape, np.nan) if len(self.kept) else None
        cancel = np.zeros(1, np.int64)

        def work(runs: NDArray[np.int64], form: _Form) -> int:
            found, history = self._block(runs, form, cancel)
            done = np.isfinite(found[:, 0])
            results[runs[done]] = found[done]
            if history is not None and histories is not None:
                histories[np.searchsorted(self.kept, runs)] = history
            return int(done.sum())

        made = int((self.columns.status != NOT_RUN).sum())
        jobs = ((lambda block=block: work(*block)) for block in self._blocks())
        interrupted = _on_threads(jobs, threads, cancel, made, count, progress)
        return results, histories, interrupted

    def _blocks(self) -> Iterator[tuple[NDArray[np.int64], _Form]]:
        """Yield the runs of each block, and what they have in common."""
        count = self.columns.count
        wanted = self.columns.status == NOT_RUN
        keep = np.zeros(count, dtype=bool)
        keep[self.kept] = True
        rough = have_friction(self.machines.model, count)
        forms = np.column_stack([~self.machines.symmetric(count), keep, rough, self.parts])
        ticks = self.engine.ticks
        for row in np.unique(forms[wanted], axis=0):
            runs = np.flatnonzero(wanted & (forms == row).all(axis=1))
            form = _Form(not row[0], bool(row[1]), bool(row[2]), int(row[3]))
            room = (6 * ticks if self.task.control.noise else 0) + (
                self.engine.rows * many.HISTORY_WIDTH if form.keep else 0
            )
            long = _LONG // (ticks * max(form.parts, 1))
            size = max(1, min(BLOCK, _NUMBERS // max(room, 1), max(32, long)))
            for start in range(0, len(runs), size):
                yield runs[start : start + size], form

    def _block(
        self, runs: NDArray[np.int64], form: _Form, cancel: NDArray[np.int64]
    ) -> tuple[FloatArray, FloatArray | None]:
        rows, engine = self._rows(runs, form), self.engines[form.parts]
        results = np.full((len(runs), many.RESULT_WIDTH), np.nan)
        history = np.full((len(runs), engine.rows, many.HISTORY_WIDTH), np.nan) if form.keep else None
        noise = self._noise(runs)
        engine.run(
            self.level, form.symmetric, rows, results, cancel, noise, history, self.lanes, form.friction
        )
        none = results[:, many.RESULTS["samples"]][:, 0] == 0  # of no tick there is no largest one
        for name in ("peak_error", "peak_force"):
            results[none, many.RESULTS[name]] = np.nan
        return results, history

    def _rows(self, runs: NDArray[np.int64], form: _Form) -> FloatArray:
        own = {name: column[runs] for name, column in self.columns.own.items()}
        rows, m, count = many.empty_inputs(len(runs)), self.machines, self.columns.count
        for k, name in enumerate(STARTS):
            rows[:, many.INPUTS["x"].start + k] = own.get(name, self.task.start[k])

        def of(value: Any) -> Any:
            return value[runs] if np.ndim(value) and len(value) == count else value

        model = m.model if form.friction else m.model[: len(MODEL)]
        side = many.set_machines(rows, tuple(of(number) for number in model), form.symmetric)
        kinds = self.task.stop_at
        if "singular pose" in kinds:
            rows[:, many.INPUTS["side"].start] = np.where(side < 0, -1.0, 1.0)
        first = many.INPUTS["bound"].start
        for k, (kind, limit) in enumerate(
            (("slider stop", m.travel[0]), ("slider stop", m.travel[1]), ("tilt limit", m.tilt[0]),
             ("tilt limit", m.tilt[1]))
        ):  # fmt: skip
            if kind in kinds:
                rows[:, first + k] = of(limit)
        force = of(m.force)
        limits = np.broadcast_to(np.reshape(force, (-1, 1)), (len(runs), 3))
        saturation = self.task.control.saturation
        cut = limits if saturation is True else self.task.control.largest_forces(np.inf)
        fill(rows, self.task, own, cut)
        return rows

    def _noise(self, runs: NDArray[np.int64]) -> FloatArray | None:
        """Return the numbers that `Encoders` of each run would draw."""
        noise = self.task.control.noise
        if noise is None:
            return None
        seeds = self.columns.own.get(SEED)
        chosen = noise.seed + self.columns.first + runs if seeds is None else seeds[runs].astype(np.int64)
        return np.stack(
            [np.random.default_rng(int(s)).standard_normal((self.engine.ticks, 6)) for s in chosen]
        )


def _on_threads(
    jobs: Iterator[Callable[[], int]],
    threads: int,
    cancel: NDArray[np.int64],
    done: int,
    total: int,
    progress: Progress | None,
) -> bool:
    """Do jobs on threads, a few ahead; return whether somebody interrupted them."""
    pool = ThreadPoolExecutor(threads, "p3dof runs")
    running: set[Future[int]] = set()
    try:
        while True:
            for job in islice(jobs, 2 * threads - len(running)):
                running.add(pool.submit(job))
            if not running:
                return False
            finished, running = wait(running, return_when=FIRST_COMPLETED)
            done += sum(future.result() for future in finished)
            if progress is not None:
                progress(done, total)
    except KeyboardInterrupt:
        cancel[0] = 1
        return True
    finally:
        cancel[0] = 1
        pool.shutdown(wait=True, cancel_futures=True)


SECONDS = 0.25  # about how long a part takes

_SENT = 1_000_000  # most numbers that go out with a part and come back: 8 MB

DEATHS = 3  # how many workers a part may cost before it is given up

Found = tuple[FloatArray, FloatArray | None, bool]
"""Results (R, RESULT_WIDTH), histories (K, N, HISTORY_WIDTH) of those that keep them, and whether it was
interrupted."""


@dataclass(frozen=True, eq=False)
class RunWork:
    """Runs, and what to do with them; by threads of one process, or in parts elsewhere."""

    task: SharedTask  # what is asked of every run
    columns: RunColumns  # what differs
    machine: Parameters  # what has no column
    kept: NDArray[np.int64]  # runs whose histories are kept
    every: int  # a row of a history every so many ticks
    level: str | None  # of the extension; None to make runs one by one
    lanes: bool  # side by side; else one after the other

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
    """Make runs by the workers of a client; the same bits as of this process."""
    crew = crew_of(client, 1, None)
    count = work.columns.count
    results = np.full((count, many.RESULT_WIDTH), np.nan)
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
        taken.histories = np.full((len(work.kept), 1, many.HISTORY_WIDTH), np.nan)
    return results, taken.histories, taken.interrupted


def _cuts(work: RunWork, seconds: float) -> Iterator[tuple[int, int]]:
    """Yield the first run of each part, and the one behind its last."""
    count = work.columns.count
    states = many.HISTORY_WIDTH * (work.task.ticks / work.every + 2) * len(work.kept) / count
    each = len(work.columns.columns) + many.RESULT_WIDTH + states
    size = max(1, int(min(SECONDS * count / max(seconds, 1e-9), _SENT / each)))
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
