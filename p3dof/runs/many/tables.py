"""Tables of many runs."""

from __future__ import annotations

import numpy as np

from p3dof._base.tables import Table, html_of, notebook_html, number, table_of, time_text
from p3dof.machine.parameters import LEGS
from p3dof.runs.many.results import ManyRuns, RunHistories
from p3dof.runs.many.stops import FINISHED, NOT_RUN

_QUANTILES = (0.05, 0.5, 0.95, 1.0)


def figures_table(runs: ManyRuns) -> Table:
    """Return how the figures of the finished runs are distributed.

    Parameters
    ----------
    runs : ManyRuns
        The runs.

    Returns
    -------
    Table
    """
    good = runs.finished
    columns = {
        f"largest error in {axis} [{unit}]": scale * runs.peak_error[good, k]
        for k, (axis, unit, scale) in enumerate((("y", "mm", 1e3), ("z", "mm", 1e3), ("θ", "mrad", 1e3)))
    }
    columns |= {f"largest force {leg} [N]": runs.peak_force[good, k] for k, leg in enumerate(LEGS)}
    columns["work [J]"] = runs.work[good]
    rows = {
        name: tuple(f"{value:.4g}" for value in np.quantile(column, _QUANTILES))
        for name, column in columns.items()
        if len(column) and np.isfinite(column).all()
    }
    return table_of("Figures of the finished runs", ("figure", "5 %", "median", "95 %", "largest"), rows)


def stops_table(runs: ManyRuns) -> Table:
    """Return how many runs ended for each reason.

    Parameters
    ----------
    runs : ManyRuns
        The runs.

    Returns
    -------
    Table
    """
    rows = {kind: (str(count), f"{100 * count / len(runs):.3g} %") for kind, count in runs.counts().items()}
    return table_of("How the runs ended", ("reason", "runs", "share"), rows)


def failures(runs: ManyRuns, first: int = 0) -> list[str]:
    """Return for each reason that runs did not go on to their end: the first of them, and how many more.

    Parameters
    ----------
    runs : ManyRuns
        The runs.
    first : int
        What number to give to the first run.

    Returns
    -------
    list of str
    """
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
