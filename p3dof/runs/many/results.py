"""`ManyRuns`: what many runs leave behind, and its tables."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.checks import FloatArray
from p3dof._base.errors import InputError
from p3dof._base.files import pack_arrays, suffix_of, write_atomic
from p3dof._base.tables import (
    ShownInNotebook,
    Table,
    Tabular,
    formatted,
    html_of,
    notebook_html,
    number,
    table_of,
    time_text,
)
from p3dof.closed_form.compiled.many import START
from p3dof.machine.parameters import LEGS
from p3dof.runs.many.columns import FINISHED, NOT_RUN, faults, kind_of, reason_of, unit_of

_AXES = (("y", "m"), ("z", "m"), ("theta", "rad"))
_FIGURES = ("peak_error", "rms_error", "peak_force", "rms_force")


@dataclass(frozen=True, eq=False)
class RunHistories(ShownInNotebook):
    """States on the way of some runs.

    Parameters
    ----------
    runs : ndarray of int, shape (K,)
        Which runs.
    time : ndarray, shape (K, N)
        Of the samples [s]; NaN where a run had ended before, as all else.
    pose, velocity : ndarray, shape (K, N, 3)
        Of the platform.
    forces, asked : ndarray, shape (K, N, 3)
        Forces on the sliders A, B, C, and those that the controller asked for [N].
    """

    runs: NDArray[np.int64]
    time: FloatArray
    pose: FloatArray
    velocity: FloatArray
    forces: FloatArray
    asked: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class ManyRuns(ShownInNotebook, Tabular):
    """What R runs leave behind: figures of each, counted at the ticks of the controller (else at all steps).

    Parameters
    ----------
    stop : ndarray of int16, shape (R,)
        Why it ended: -1 finished; `reason` and `p3dof.runs.many.reason_of` say the others in words.
    time : ndarray, shape (R,)
        When it ended [s].
    pose, velocity : ndarray, shape (R, 3)
        Where it ended.
    peak_error, rms_error : ndarray, shape (R, 3)
        Tracking errors of y, z, θ [m, m, rad]; NaN where there was nothing to follow.
    peak_force, rms_force : ndarray, shape (R, 3)
        Of the actuators A, B, C on their sliders [N].
    work, energy : ndarray, shape (R,)
        Work of all actuators, and the same with braking counted as work [J].
    careful : ndarray of bool, shape (R,)
        Whether it came near a limit and went on by DOP853.
    given : dict of str to ndarray, shape (R,)
        The columns of the runs in SI units.
    seconds : float
        On the clock.
    interrupted : bool
        Whether somebody stopped the work before all runs were done.
    note : str
        What ran: lanes of the extension, or the Python integrator and why.
    histories : RunHistories or None
        If they were asked for.
    """

    _row_name = "run"

    stop: NDArray[np.int16]
    time: FloatArray
    pose: FloatArray
    velocity: FloatArray
    peak_error: FloatArray
    rms_error: FloatArray
    peak_force: FloatArray
    rms_force: FloatArray
    work: FloatArray
    energy: FloatArray
    careful: NDArray[np.bool_]
    given: dict[str, FloatArray]
    seconds: float
    interrupted: bool
    note: str
    histories: RunHistories | None = None

    def __len__(self) -> int:
        return len(self.stop)

    def __repr__(self) -> str:
        told = ", ".join(f"{count} {kind}" for kind, count in self.counts().items())
        return f"ManyRuns({len(self)} runs: {told})"

    @property
    def finished(self) -> NDArray[np.bool_]:
        """Which runs went on to their end, (R,)."""
        return np.equal(self.stop, FINISHED)

    @property
    def done(self) -> NDArray[np.bool_]:
        """Which runs were made, or could not be; the others were interrupted, (R,)."""
        return np.not_equal(self.stop, NOT_RUN)

    def counts(self) -> dict[str, int]:
        """Return how many runs ended for each kind of reason, the most frequent first."""
        codes, numbers = np.unique(self.stop, return_counts=True)
        found: Counter[str] = Counter()
        for code, count in zip(codes.tolist(), numbers.tolist(), strict=True):
            found[kind_of(code)] += count
        return dict(found.most_common())

    def reason(self, run: int) -> str:
        """Return in words why a run ended, and when; or which of its columns cannot be."""
        stop = int(self.stop[run])
        when = f" at t = {self.time[run]:.6g} s" if 0 <= stop < START else ""
        bad = faults(self.given, run, stop)
        return f"{kind_of(stop)}: {bad}" if bad else reason_of(stop).replace(":", f"{when}:", 1)

    def _words(self, of: Callable[[int], str]) -> NDArray[Any]:
        codes, where = np.unique(self.stop, return_inverse=True)
        return np.array([of(code) for code in codes.tolist()])[where]

    def to_columns(self) -> dict[str, NDArray[Any]]:
        """Return the columns of the runs and all figures, (R,) each; the names hold the units.

        ``stop`` is the kind of reason for which a run ended, as of `counts`, and ``reason`` tells more.
        """
        units = {name: unit_of(name) for name in self.given}
        found: dict[str, NDArray[Any]] = {
            f"{name} [{unit}]" if unit else name: self.given[name] for name, unit in units.items()
        }
        found["stop"] = self._words(kind_of)
        found["reason"] = self._words(lambda code: reason_of(code).partition(": ")[2])
        found["end [s]"] = self.time
        for k, (axis, unit) in enumerate(_AXES):
            found[f"{axis} [{unit}]"] = self.pose[:, k]
            found[f"{axis}dot [{unit}/s]"] = self.velocity[:, k]
        for name in _FIGURES:
            marks = _AXES if name.endswith("error") else tuple((leg, "N") for leg in LEGS)
            for k, (mark, unit) in enumerate(marks):
                found[f"{name} {mark} [{unit}]"] = getattr(self, name)[:, k]
        found["work [J]"], found["energy [J]"] = self.work, self.energy
        return found

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the columns to a file; the ending of the name chooses the format.

        Parameters
        ----------
        path : path-like
            ``.csv`` (17 significant digits) or ``.npz`` (NumPy arrays, with the histories).

        Raises
        ------
        InputError
            If the ending is another one.
        FileError
            If the file cannot be written.
        """
        if suffix_of(path, "run") == ".csv":
            return self.to_csv(path)
        arrays = {name.replace("/", " per "): np.asarray(x) for name, x in self.to_columns().items()}
        if self.histories is not None:
            arrays |= {f"history {name}": values for name, values in vars(self.histories).items()}
        return write_atomic(path, pack_arrays(arrays))

    def history(self, run: int) -> dict[str, FloatArray]:
        """Return the states on the way of a run: time (N,), pose, velocity, forces and asked (N, 3).

        Raises
        ------
        InputError
            If it was not asked for.
        """
        kept = self.histories
        if kept is None or run not in kept.runs:
            raise InputError(f"run: no history of run {run} was recorded; see histories=")
        at = np.flatnonzero(kept.runs == run)
        there = np.isfinite(kept.time[at[0]])
        names = ("time", "pose", "velocity", "forces", "asked")
        return {name: getattr(kept, name)[at[0]][there] for name in names}


_QUANTILES = (0.05, 0.5, 0.95, 1.0)


def figures_table(runs: ManyRuns) -> Table:
    """Return how the figures of the finished runs are distributed."""
    good = runs.finished
    columns = {
        f"largest error in {axis} [{unit}]": scale * runs.peak_error[good, k]
        for k, (axis, unit, scale) in enumerate((("y", "mm", 1e3), ("z", "mm", 1e3), ("θ", "mrad", 1e3)))
    }
    columns |= {f"largest force {leg} [N]": runs.peak_force[good, k] for k, leg in enumerate(LEGS)}
    columns["work [J]"] = runs.work[good]
    rows = {
        name: tuple(formatted(value, ".4g") for value in np.quantile(column, _QUANTILES))
        for name, column in columns.items()
        if len(column) and np.isfinite(column).all()
    }
    return table_of("Figures of the finished runs", ("figure", "5 %", "median", "95 %", "largest"), rows)


def stops_table(runs: ManyRuns) -> Table:
    """Return how many runs ended for each reason."""
    rows = {
        kind: (formatted(count, "d"), formatted(count / len(runs), ".3g", "%"))
        for kind, count in runs.counts().items()
    }
    return table_of("How the runs ended", ("reason", "runs", "share"), rows)


def failures(runs: ManyRuns, first: int = 0) -> list[str]:
    """Return for each reason that runs did not go on to their end: the first of them, and how many more."""
    codes, runs_of, counts = np.unique(runs.stop, return_index=True, return_counts=True)
    told = {}
    for code, run, count in zip(codes.tolist(), runs_of.tolist(), counts.tolist(), strict=True):
        if code not in (FINISHED, NOT_RUN):
            more = f" (and {count - 1} more run{'s' if count > 2 else ''})" if count > 1 else ""
            told[run] = f"run {run + first}: {runs.reason(run)}{more}"
    return [told[run] for run in sorted(told)]


@html_of.register(ManyRuns)
def many_runs_html(runs: ManyRuns) -> str:
    """Return how a notebook shows many runs, as HTML."""
    facts = f"{len(runs)} runs in {time_text(runs.seconds)}, {runs.note}"
    more = [*(["interrupted"] if runs.interrupted else []), *failures(runs)]
    return notebook_html("Many runs", facts, [stops_table(runs), figures_table(runs)], more)


@html_of.register(RunHistories)
def histories_html(kept: RunHistories) -> str:
    """Return how a notebook shows histories, as HTML."""
    facts = f"{len(kept.runs)} runs, {number(kept.time.shape[-1])} samples"
    return notebook_html("RunHistories", facts, [], [])
