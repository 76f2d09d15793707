"""The figure of a balance: forces of the actuators without and with it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from p3dof._base.checks import shown
from p3dof._base.errors import InputError
from p3dof.design.balance import BestBalance
from p3dof.machine.parameters import LEGS
from p3dof.report.plots.common import COLOURS, new_figure, tidy

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def balance_figure(found: BestBalance) -> Figure:
    """Draw the forces of the three actuators without and with a balance, and their root mean squares.

    Parameters
    ----------
    found : BestBalance
        The balance.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If `found` is something else.
    MissingExtraError
        If matplotlib is not installed.
    """
    if not isinstance(found, BestBalance):
        raise InputError(f"found: expected a BestBalance, got {shown(found)}")
    figure = new_figure(figsize=(8.4, 7.2))
    panels = figure.subplots(3, 1, sharex=True)
    for k, (axis, leg) in enumerate(zip(panels, LEGS, strict=True)):
        curves = (
            ("without", "0.55", "--", found.before[:, k], found.rms_before[k]),
            ("with", COLOURS[k], "-", found.after[:, k], found.rms_after[k]),
        )
        for label, colour, style, values, rms in curves:
            text = f"{label}: RMS {rms:.4g} N, peak {abs(values).max():.4g} N"
            axis.plot(found.time, values, color=colour, ls=style, lw=1.5, label=text)
        axis.axhline(0, color="0.6", lw=0.6, zorder=0)
        chosen = ", ".join(f"{name} {row[k]:.4g} {unit}" for name, unit, row in found.named_values)
        axis.set_title(f"{leg}: {chosen}", fontsize=10, loc="left")
        axis.set_ylabel("force [N]")
        axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=9)
        tidy(axis)
    panels[-1].set_xlabel("time [s]")
    return figure
