"""What the commands show: tables, warnings, a progress bar."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from p3dof.manipulator import Comparison, InverseDynamics
from p3dof.parameters import LEGS, Limits


@contextmanager
def progress_bar(name: str, total: int) -> Iterator[Update | None]:
    """Show a bar while something works; nothing at all where nobody looks."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield None
        return
    columns = (TextColumn(name), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        yield Update(bar, total)


class Update:
    """What `Manipulator.inverse_dynamics` calls while it works."""

    def __init__(self, bar: Progress, total: int) -> None:
        self._bar, self._task = bar, bar.add_task("", total=total)

    def __call__(self, done: int, total: int) -> None:
        """Show how far it is."""
        self._bar.update(self._task, completed=done, total=total)


def agreement_table(found: Comparison) -> Table:
    """Return the largest difference of the two methods for each actuator.

    Parameters
    ----------
    found : Comparison
        Both methods over a motion.

    Returns
    -------
    rich.table.Table
    """
    table = Table("actuator", "largest force [N]", "largest difference [N]", "of its largest force")
    table.title = f"{found.first.method} against {found.second.method}"
    worst = found.difference[found.both_valid].max(axis=0, initial=0)
    for leg, name in enumerate(LEGS):
        peak, scale = found.second.peak_forces[leg], found.second.force_scale[leg]
        share = worst[leg] / scale if scale else 0
        table.add_row(name, fixed(peak, 6), f"{worst[leg]:.1e}", f"{share:.1e}")
    return table


def evidence_table(*runs: tuple[InverseDynamics, float]) -> Table:
    """Return closure error, power residual and time per sample of results.

    Parameters
    ----------
    *runs : tuple of (InverseDynamics, float)
        Results and the seconds that each took.

    Returns
    -------
    rich.table.Table
    """
    table = Table("method", escape("closure error [m]"), "power residual", "time per sample")
    for result, seconds in runs:
        peak = np.abs(result.power[result.valid]).max(initial=0)
        residual = np.abs(result.power_residual[result.valid]).max(initial=0)
        told = peak and result.possible
        share = f"{residual / peak:.1e} of {peak:.1f} W" if told else f"{residual:.1e} W"
        gap = result.closure_error[result.valid].max(initial=0)
        each = time_text(seconds / len(result.time))
        table.add_row(result.method, f"{gap:.1e}", share, each)
    return table


def time_text(seconds: float) -> str:
    """Return a short time in words: three digits and the unit that suits it.

    Parameters
    ----------
    seconds : float
        The time [s].

    Returns
    -------
    str
        Such as ``"72.1 µs"`` or ``"10.3 ms"``.
    """
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6), ("ns", 1e-9)):
        digits = f"{seconds / size:.3g}"
        if float(digits) >= 1 or unit == "ns":
            break
    return f"{float(digits):.15g} {unit}"


def limits_table(result: InverseDynamics, limits: Limits) -> Table:
    """Return how much of each limit a motion uses, and when it uses most of it.

    Parameters
    ----------
    result : InverseDynamics
        Over the motion.
    limits : Limits
        What the actuators can do.

    Returns
    -------
    rich.table.Table
    """
    table = Table(
        "limit of", "peak", escape("at t [s]"), "limit", "used", title="how much of the limits is used"
    )
    for one in result.utilisations(limits):
        known = not np.isnan(one.share)
        cells = (f"{one.value:.6g}", f"{one.time:.4g}") if known else ("-", "-")
        share = f"{one.share:.1%}" if known else "-"
        table.add_row(escape(f"{one.quantity} {one.leg} [{one.unit}]"), *cells, f"{one.limit:.6g}", share)
    return table


def fixed(value: float, digits: int = 4) -> str:
    """Return a number with so many decimals; a dash for what does not exist."""
    return "-" if np.isnan(value) else f"{value:.{digits}f}"


def print_warnings(console: Console, warnings: Sequence[str]) -> None:
    """Print what a reader of a result should know, one line each; see `InverseDynamics.warnings`."""
    for warning in warnings:
        console.print(warning, style="yellow", markup=False, highlight=False, soft_wrap=True)


def print_plain(console: Console, text: str) -> None:
    """Print without wrapping or markup: a path stays whole and can be copied."""
    console.print(text, markup=False, highlight=False, soft_wrap=True)
