"""`DesignEvaluation`: one motion, and what is asked of any designs over it.

Designs computed elsewhere: handed to the workers of a client in blocks, in memory.

`p3dof.design.sweeps` stores blocks, resumes, and reduces what is too much to store.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray, Progress, shown
from p3dof._base.errors import InputError
from p3dof._base.time_series.wrenches import Load, WrenchOverTime
from p3dof.analysis.designs.columns import OFFSETS, BodiesOfDesigns, Designs, full_name
from p3dof.analysis.designs.figures import (
    BITS,
    FIGURES,
    SAMPLE,
    STATUS,
    Figure,
    FigureGroup,
    Samples,
    asked_figures,
    asked_for,
    blocks_of,
    gradient_of,
    rows_of,
    sampled,
    samples_of,
)
from p3dof.analysis.designs.folding import Folded, Folding, column_or_number, folding_of
from p3dof.analysis.designs.results import DesignForces, DesignStatus, status_of
from p3dof.closed_form.compiled.designs import DesignLoops, compiled_level, width_of
from p3dof.closed_form.compiled.kernels import NUMPY
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import Parameters

BLOCK = 4096  # designs at a time: their constants stay in the second level of the cache

_PLACES = {**FIGURES, "status_at": Figure("s", SAMPLE, 1)}
_DOUBTFUL = 2  # what the compiled loop says of designs that are not clearly good


class DesignEvaluation:
    """One motion, and what is asked of designs over it; it can be pickled and sent to other processes.

    Parameters
    ----------
    motion : Motion
        What all designs do; at most 100,000 samples.
    wrench : array-like, shape (6,) or (N, 6), or callable, optional
        External force and moment on the platform at P, as of `Manipulator.inverse_dynamics`.
    figures : iterable of {"singularity", "sliders", "power"}
        What to compute beside the forces and the reach.
    gradients : iterable of str
        Columns to differentiate all figures by.
    level, threads
        As of `MachineKernels`.

    Raises
    ------
    InputError
        If an argument does not fit.
    """

    def __init__(
        self,
        motion: Motion,
        wrench: WrenchOverTime = None,
        figures: Iterable[FigureGroup] = ("singularity",),
        gradients: Iterable[str] = (),
        level: str | None = None,
        threads: int | None = None,
    ) -> None:
        self.samples: Samples = samples_of(motion, wrench)
        self.motion = motion
        self.asked = asked_for(figures)
        names = (gradients,) if isinstance(gradients, str) else tuple(gradients)
        self.by = tuple(full_name(name) for name in names)
        self._wrench = None if wrench is None else Load(wrench, motion.start).over(motion.time)
        self._threads = threads
        self._made: dict[bool, DesignLoops] = {}
        self._level, self.threads = compiled_level(level, threads)

    def __reduce__(self) -> Any:
        groups = tuple(group for group, bit in BITS.items() if self.asked & bit)
        level = self._level or NUMPY  # other processes take the same, so that their numbers are the same
        return DesignEvaluation, (self.motion, self._wrench, groups, self.by, level, self._threads)

    def _loops(self, friction: bool) -> DesignLoops | None:
        if self._level is None:
            return None
        if friction not in self._made:
            kind = "with_friction" if friction else "loaded" if len(self.samples.rows) > 9 else ""
            samples = self.samples
            made = DesignLoops(samples.packed(), len(samples), samples.points, kind, self.asked, self._level)
            self._made[friction] = made
        return self._made[friction]

    def check(self, designs: Designs) -> None:
        """Raise unless all columns that figures are differentiated by are there.

        Raises
        ------
        InputError
            If one is missing, or is a limit.
        """
        for name in self.by:
            if name not in designs.columns or name.startswith("limits."):
                raise InputError(
                    f"gradients: expected columns of the designs ({', '.join(designs.columns)}), got {name}"
                )

    def evaluate(self, designs: Designs, progress: Progress | None = None) -> DesignForces:
        """Return what designs need over the motion.

        Parameters
        ----------
        designs : Designs
            The machines.
        progress : callable, optional
            Called with the number of designs done and of all.

        Raises
        ------
        InputError
            If a column to differentiate by is missing.
        """
        self.check(designs)
        folding = folding_of(tuple(designs.columns), designs.machine, designs.bodies)
        status = status_of(designs)
        found = self._room(len(designs))
        starts = range(0, len(designs), BLOCK)
        gradients: list[dict[str, dict[str, FloatArray]]] = [{} for _ in starts] or [self._no_gradients(0)]
        work = partial(self._block, designs, folding, status, found, gradients)
        self._loops(folding.friction)  # made once, before there are threads
        if self.threads == 1 or len(starts) < 2:
            for block in range(len(starts)):
                work(block)
                _tell(progress, block + 1, len(designs))
        else:
            with ThreadPoolExecutor(min(self.threads, len(starts)), "p3dof designs") as pool:
                for done, _ in enumerate(pool.map(work, range(len(starts))), start=1):
                    _tell(progress, done, len(designs))
        return self._results(designs, status, found, _joined(gradients))

    def _block(
        self,
        designs: Designs,
        folding: Folding,
        status: NDArray[np.uint8],
        found: dict[str, FloatArray],
        gradients: list[dict[str, dict[str, FloatArray]]],
        block: int,
    ) -> None:
        """Compute the rows of one block of designs; nothing else is written to."""
        part = slice(block * BLOCK, min((block + 1) * BLOCK, len(designs)))
        columns = {name: column[part] for name, column in designs.columns.items()}
        count = part.stop - part.start
        folded, offsets = folding.fold(columns), _offsets(columns, count)
        possible = status[part] == DesignStatus.FEASIBLE
        loops = self._loops(folding.friction)
        if loops is None:
            rows: FloatArray = np.full((count, width_of(self.asked)), np.nan)
            self._by_numpy(folded, offsets, rows, np.flatnonzero(possible))
        else:
            rows = loops.rows(folded.numbers, offsets, count)
            doubtful = np.flatnonzero(possible & (rows[:, STATUS] == _DOUBTFUL))
            self._by_numpy(folded, offsets, rows, doubtful)
        known = np.where(possible, rows[:, STATUS], status[part]).astype(np.uint8)
        rows[known != DesignStatus.FEASIBLE, 4:] = np.nan
        rows[~possible, SAMPLE:] = np.nan
        status[part] = known
        for name, values in found.items():
            values[part] = _figure(rows, name)
        if self.by:
            good = np.flatnonzero(status[part] == DesignStatus.FEASIBLE)
            gradients[block] = self._gradients(folding, columns, folded, offsets, good)

    def _by_numpy(
        self, folded: Folded, offsets: FloatArray | None, rows: FloatArray, some: NDArray[np.intp]
    ) -> None:
        """Compute the rows of some designs on NumPy: all of them with friction, else those at a margin."""
        for block in blocks_of(len(some), len(self.samples)):
            members = some[block]
            state = sampled(_some(folded, members), self.samples, _moved(offsets, members))
            rows[members] = rows_of(state, self.samples, self.asked)[:, : rows.shape[1]]

    def _gradients(
        self,
        folding: Folding,
        columns: dict[str, FloatArray],
        folded: Folded,
        offsets: FloatArray | None,
        good: NDArray[np.intp],
    ) -> dict[str, dict[str, FloatArray]]:
        found = self._no_gradients(len(next(iter(columns.values()))))
        loops, all_good = self._loops(folding.friction), len(good) == len(columns[self.by[0]])
        if not all_good:
            columns = {name: column[good] for name, column in columns.items()}
            folded, offsets = _some(folded, good), None if offsets is None else offsets[good]
        for name in self.by if len(good) else ():
            rates = Folded(folding.tangents(columns, name))
            moved = (float(name == OFFSETS[0]), float(name == OFFSETS[1]), float(name == OFFSETS[2]))
            if loops is None:
                figures = self._gradient_by_numpy(folded, offsets, rates, moved, len(good))
            else:
                rows = loops.rates(folded.numbers, rates.numbers, moved, offsets, len(good))
                figures = {figure: _figure(rows, figure) for figure in found[name]}
            for figure, values in figures.items():
                found[name][figure][good] = values
        return found

    def _gradient_by_numpy(
        self,
        folded: Folded,
        offsets: FloatArray | None,
        rates: Folded,
        moved: tuple[float, float, float],
        count: int,
    ) -> dict[str, FloatArray]:
        parts = []
        for block in blocks_of(count, len(self.samples)):
            members = np.arange(count)[block]
            state = sampled(_some(folded, members), self.samples, _moved(offsets, members))
            by_numbers = _some(rates, members).numbers
            parts.append(gradient_of(state, self.samples, by_numbers, moved, self.asked))
        return {figure: np.concatenate([part[figure] for part in parts]) for figure in parts[0]}

    def _no_gradients(self, count: int) -> dict[str, dict[str, FloatArray]]:
        return {
            by: {
                name: np.full((count, 3) if figure.width == 3 else (count,), np.nan)
                for name, figure in asked_figures(self.asked).items()
                if name != "peak_time"
            }
            for by in self.by
        }

    def _room(self, count: int) -> dict[str, FloatArray]:
        """Return where the figures of all designs go, by name."""
        names = ("status_at", *asked_figures(self.asked))
        return {name: np.empty((count, 3) if _PLACES[name].width == 3 else count) for name in names}

    def _results(
        self,
        designs: Designs,
        status: NDArray[np.uint8],
        found: dict[str, Any],
        gradients: dict[str, dict[str, FloatArray]],
    ) -> DesignForces:
        found["rms_force"] = np.sqrt(found["rms_force"])
        for name in ("peak_time", "status_at"):
            found[name] = self._times(found[name])
        if "work" in found:
            found["negative_work"] = np.minimum(found["work"] - found["positive_work"], 0.0)
        for derivatives in gradients.values():
            if "work" in derivatives:
                none = found["work"] >= found["positive_work"]
                rest = derivatives["work"] - derivatives["positive_work"]
                derivatives["negative_work"] = np.where(none, 0.0, rest)
        if self.asked & BITS["sliders"]:
            found |= self._margins(designs, found)
        return DesignForces(status=status, **found, gradients=gradients)

    def _times(self, index: FloatArray) -> FloatArray:
        known = np.isfinite(index)
        times = self.samples.time[np.where(known, index, 0).astype(np.intp)]
        return np.where(known, times, np.nan)

    def _margins(self, designs: Designs, found: dict[str, FloatArray]) -> dict[str, FloatArray]:
        """Return what is left to the limits of each design."""
        limits, columns = designs.machine.limits, designs.columns

        def range_of(name: str) -> tuple[Any, Any]:
            low, high = getattr(limits, name)
            return columns.get(f"limits.{name}.low", low), columns.get(f"limits.{name}.high", high)

        (low, high), (least, most) = range_of("travel"), range_of("tilt")
        theta, turned = self.samples.rows[2], columns.get("offset.theta", 0.0)
        tilt = np.minimum(theta.min() + turned - least, most - theta.max() - turned)
        peak = found["peak_force"].max(axis=1)
        below, above = found["lowest_slider"].min(axis=1) - low, high - found["highest_slider"].max(axis=1)
        return {
            "travel_margin": np.minimum(below, above),
            "tilt_margin": np.where(np.isfinite(peak), tilt, np.nan),
            "speed_margin": columns.get("limits.speed", limits.speed) - found["peak_speed"].max(axis=1),
            "force_margin": columns.get("limits.force", limits.force) - peak,
        }


def _figure(rows: FloatArray, name: str) -> FloatArray:
    """Return the column of a figure, or its three."""
    figure = _PLACES[name]
    return rows[:, figure.place] if figure.width == 1 else rows[:, figure.place :][:, :3]


def _tell(progress: Progress | None, blocks: int, count: int) -> None:
    if progress is not None:
        progress(min(blocks * BLOCK, count), count)


def _offsets(columns: dict[str, FloatArray], count: int) -> FloatArray | None:
    if not any(name in columns for name in OFFSETS):
        return None
    return np.stack([columns.get(name, np.zeros(count)) for name in OFFSETS], axis=1)


def _moved(offsets: FloatArray | None, members: NDArray[np.intp]) -> FloatArray:
    return np.zeros((len(members), 3)) if offsets is None else offsets[members]


def _some(folded: Folded, members: NDArray[np.intp]) -> Folded:
    return Folded(tuple(column_or_number(number, members) for number in folded.numbers))


def _joined(gradients: list[dict[str, dict[str, FloatArray]]]) -> dict[str, dict[str, FloatArray]]:
    return {
        name: {figure: np.concatenate([block[name][figure] for block in gradients]) for figure in figures}
        for name, figures in gradients[0].items()
    }


AT_A_TIME = 16 * BLOCK  # designs of a block: tenths of a second of work

_IN_FLIGHT = 32  # blocks that are handed over before the first one is asked for


def evaluate_with(
    client: Any, evaluation: DesignEvaluation, designs: Designs, progress: Progress | None = None
) -> DesignForces:
    """Return what designs need over a motion by the workers of a client: the bits of this process."""
    if not callable(getattr(client, "submit", None)):
        raise InputError(
            f"client: expected a distributed.Client or an executor of concurrent.futures, got {shown(client)}"
        )
    evaluation.check(designs)
    options = {"pure": False} if hasattr(client, "scheduler_info") else {}  # Dask would hash all columns
    starts = range(0, len(designs), AT_A_TIME) or range(1)
    pending: deque[Any] = deque()
    found: list[DesignForces] = []
    waiting = iter(starts)
    try:
        while len(found) < len(starts):
            while len(pending) < _IN_FLIGHT and (start := next(waiting, None)) is not None:
                part = designs.part(start, min(start + AT_A_TIME, len(designs)))
                pending.append(client.submit(evaluation.evaluate, part, **options))
            found.append(pending.popleft().result())
            if progress is not None:
                progress(min(len(found) * AT_A_TIME, len(designs)), len(designs))
    finally:
        for future in pending:
            future.cancel()
    return joined(found)


def joined(parts: list[DesignForces]) -> DesignForces:
    """Return the results of several blocks as one."""
    values: dict[str, Any] = {}
    for item in fields(DesignForces):
        each = [getattr(part, item.name) for part in parts]
        if item.name != "gradients":
            values[item.name] = None if each[0] is None else np.concatenate(each)
    gradients = {
        name: {figure: np.concatenate([part.gradients[name][figure] for part in parts]) for figure in figures}
        for name, figures in parts[0].gradients.items()
    }
    return DesignForces(**values, gradients=gradients)


def forces_of_designs(
    designs: Any,
    motion: Motion,
    machine: Parameters | None = None,
    *,
    bodies: BodiesOfDesigns = "kept",
    wrench: WrenchOverTime = None,
    figures: Iterable[FigureGroup] = ("singularity",),
    gradients: Iterable[str] = (),
    level: str | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
    client: Any = None,
) -> DesignForces:
    """Return peaks, means and least margins of the forces of many designs over one motion.

    A design that cannot perform the motion has NaN and a `DesignStatus` with why; the others do not depend
    on it. The compiled loop computes about a million designs a second and thread over 200 samples.

    Parameters
    ----------
    designs : Designs, or what `Designs` takes
        Columns by name, one number a design: lengths, sizes of solids, masses, friction, payload, limits,
        the place of the motion.
    motion : Motion
        What every design does; at most 100,000 samples. Peaks are those of the samples.
    machine : Parameters, optional
        What has no column; the paper's machine by default.
    bodies : {"kept", "solids"}
        Keep the bodies of `machine`, or compute them anew from solids of each design; see `Designs`.
    wrench : array-like, shape (6,) or (N, 6), or callable, optional
        External force and moment on the platform at P, in the fixed frame [N, N m]; see
        `Manipulator.inverse_dynamics`.
    figures : iterable of {"singularity", "sliders", "power"}
        What to compute beside forces and reach: the least angle from the actuation singularity; slider
        positions, speeds and margins to limits; power, work and all of the sliders.
    gradients : iterable of str
        Columns to differentiate all figures by, exactly. The derivative of a peak is that at its sample:
        where two samples tie, it holds to one side.
    level, threads
        What to run on, as of `MachineKernels`.
    progress : callable, optional
        Called with the number of designs done and of all.
    client : distributed.Client or concurrent.futures.Executor, optional
        Who computes, in blocks of 65,536 designs and to the same bits; this process by default. Where designs
        are too many for the memory, or must survive interruptions, see `p3dof.design.sweeps`.

    Raises
    ------
    InputError
        If a column or an argument does not fit.
    """
    if not isinstance(designs, Designs):
        designs = Designs(designs, machine, bodies)
    evaluation = DesignEvaluation(motion, wrench, figures, gradients, level, threads)
    if client is not None:
        return evaluate_with(client, evaluation, designs, progress)
    return evaluation.evaluate(designs, progress)
