"""Figures of tolerances and of sensitivity: bands, bars of shares, histograms with bounds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from p3dof._base.checks import FloatArray, shown
from p3dof._base.errors import InputError
from p3dof.analysis.tolerances import ForceTolerance, LocalSensitivity, PoseTolerance, SobolIndices
from p3dof.report.plots.common import COLOURS, new_figure, tidy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_BARS = 15  # most bars of a panel: the longest ones

_AXES = (("y", 1e6, "µm"), ("z", 1e6, "µm"), ("θ", 1e3, "mrad"))


def tolerance_figure(tolerance: ForceTolerance | PoseTolerance) -> Figure:
    """Draw how uncertain forces or a pose are, and which parameters it comes from.

    Parameters
    ----------
    tolerance : ForceTolerance or PoseTolerance
        What `p3dof.tolerance` returns; of several poses the first is drawn.

    Raises
    ------
    InputError, MissingExtraError
        If it is something else; if matplotlib is not installed.
    """
    if isinstance(tolerance, ForceTolerance):
        return _of_forces(tolerance)
    if isinstance(tolerance, PoseTolerance):
        return _of_pose(tolerance)
    raise InputError(f"tolerance: expected a ForceTolerance or PoseTolerance, got {shown(tolerance)}")


def sensitivity_figure(sensitivity: SobolIndices | LocalSensitivity) -> Figure:
    """Draw which parameters a figure of the forces depends on, and by Sobol' indices its spread.

    Parameters
    ----------
    sensitivity : SobolIndices or LocalSensitivity
        What `p3dof.sensitivity` returns.

    Raises
    ------
    InputError, MissingExtraError
        As `tolerance_figure`.
    """
    if isinstance(sensitivity, SobolIndices):
        return _of_indices(sensitivity)
    if isinstance(sensitivity, LocalSensitivity):
        return _of_derivatives(sensitivity)
    raise InputError(f"sensitivity: expected SobolIndices or LocalSensitivity, got {shown(sensitivity)}")


def _of_forces(found: ForceTolerance) -> Figure:
    figure = new_figure((10.0, 6.6))
    (forces, shares), (sizes, spread) = figure.subplots(2, 2, width_ratios=(3, 2))
    for k, leg in enumerate("ABC"):
        forces.plot(found.time, found.forces[:, k], color=COLOURS[k], lw=1.2, label=leg)
        low, high = found.forces[:, k] - found.worst[:, k], found.forces[:, k] + found.worst[:, k]
        forces.fill_between(found.time, low, high, color=COLOURS[k], alpha=0.15, lw=0)
        forces.fill_between(found.time, found.low[:, k], found.high[:, k], color=COLOURS[k], alpha=0.4, lw=0)
        sizes.plot(found.time, found.deviation[:, k], color=COLOURS[k], lw=1.4, label=leg)
    forces.set_ylabel("force [N]")
    forces.set_title(
        f"dark: 95 % of machines; light: worst case ({found.worst_sigma:g} σ)", fontsize=9, loc="left"
    )
    forces.legend(loc="best", frameon=False, ncols=3)
    sizes.set_ylabel("standard deviation of the force [N]")
    sizes.set_xlabel("time [s]")
    sizes.set_ylim(bottom=0)
    _bars(shares, found.names, 100 * found.shares[3])
    shares.set_xlabel("share of the variance of the peak [%]")
    _peaks(spread, found)
    for axis in (forces, sizes):
        tidy(axis)
    return figure


def _peaks(axis: Axes, found: ForceTolerance) -> None:
    """Draw how the peak is spread: machines drawn, and what the first order says."""
    center, size = float(found.peak[3]), float(np.linalg.norm(found.peak_gradient[3] * found.sigma))
    x = np.linspace(center - 4 * size, center + 4 * size, 200)
    normal = np.exp(-(((x - center) / size) ** 2) / 2) / (size * np.sqrt(2 * np.pi))
    if found.peaks is not None:
        good = found.peaks[np.isfinite(found.peaks[:, 3]), 3]
        label = f"{len(good)} machines sampled"
        axis.hist(good, _bins(len(good)), density=True, color=COLOURS[0], alpha=0.6, label=label)
    axis.plot(x, normal, color="0.25", lw=1.2, label="first order")
    axis.axvline(center, color="0.25", lw=1, ls=":", label=f"nominal {center:.5g} N")
    high = float(found.peak_high[3])
    axis.axvline(high, color=COLOURS[1], lw=1.4, ls="--", label=f"95 % below {high:.5g} N")
    axis.set_xlabel("largest force of the motion [N]")
    _without_heights(axis)


def _of_pose(found: PoseTolerance) -> Figure:
    figure = new_figure((10.0, 6.2))
    axes = figure.subplots(2, 3)
    first = (0,) * (found.pose.ndim - 1)
    for k, (name, scale, unit) in enumerate(_AXES):
        top, below = axes[0, k], axes[1, k]
        _bars(top, found.names, 100 * found.shares[first][k])
        top.set_xlabel(f"share of the variance of {name} [%]")
        size, high = scale * float(found.deviation[first][k]), scale * float(found.high[first][k])
        errors = (
            None if found.errors is None else scale * found.errors.reshape(len(found.errors), -1, 3)[:, 0, k]
        )
        _errors(below, size, high, errors, unit)
        below.set_xlabel(f"error of {name} [{unit}]")
    y, z, theta = found.pose[first]
    figure.suptitle(f"y = {y:g} m, z = {z:g} m, θ = {np.degrees(theta):.4g}°", fontsize=10)
    return figure


def _errors(axis: Axes, size: float, high: float, errors: FloatArray | None, unit: str) -> None:
    if errors is not None:
        good = errors[np.isfinite(errors)]
        axis.hist(good, _bins(len(good)), density=True, color=COLOURS[0], alpha=0.6)
    if size > 0:
        x = np.linspace(-4 * size, 4 * size, 200)
        axis.plot(x, np.exp(-((x / size) ** 2) / 2) / (size * np.sqrt(2 * np.pi)), color="0.25", lw=1.2)
    for bound in (-high, high):
        axis.axvline(bound, color=COLOURS[1], lw=1.4, ls="--")
    axis.set_title(f"σ = {size:.4g}, 95 % within {high:.4g} {unit}", fontsize=9, loc="left")
    _without_heights(axis, legend=False)


def _of_indices(found: SobolIndices) -> Figure:
    figure = new_figure((9.6, 0.35 * min(len(found.names), MOST_BARS) + 3.0))
    bars, spread = figure.subplots(1, 2, width_ratios=(3, 2))
    order = np.argsort(found.total)[-MOST_BARS:]
    places = np.arange(len(order))
    style: dict[str, Any] = {"height": 0.38, "error_kw": {"lw": 1, "capsize": 2, "ecolor": "0.25"}}
    total, first = found.total[order], found.first[order]
    bars.barh(
        places - 0.2,
        total,
        xerr=found.total_error[order],
        color=COLOURS[1],
        label="ST: with interactions",
        **style,
    )
    bars.barh(
        places + 0.2, first, xerr=found.first_error[order], color=COLOURS[0], label="S1: alone", **style
    )
    _named(bars, [found.names[i] for i in order])
    bars.set_xlabel(f"share of the variance of {_short(found.result)}")
    bars.set_xlim(left=0)
    bars.legend(loc="lower right", frameon=False)
    spread.hist(found.values, _bins(len(found.values)), density=True, color=COLOURS[0], alpha=0.6)
    spread.axvline(found.mean, color="0.25", lw=1, ls=":", label=f"mean {found.mean:.5g}")
    for bound, label in ((found.low, f"95 %: {found.low:.5g} to {found.high:.5g}"), (found.high, None)):
        spread.axvline(bound, color=COLOURS[1], lw=1.4, ls="--", label=label)
    spread.set_xlabel(f"{_short(found.result)} [{found.unit}]" if found.unit else _short(found.result))
    _without_heights(spread)
    return figure


def _of_derivatives(found: LocalSensitivity) -> Figure:
    figure = new_figure((7.6, 0.3 * min(len(found.names), MOST_BARS) + 1.6))
    axis = figure.subplots()
    order = np.argsort(np.abs(found.normalised))[-MOST_BARS:]
    places, sizes = np.arange(len(order)), found.normalised[order]
    axis.barh(places, sizes, color=[COLOURS[1] if size > 0 else COLOURS[0] for size in sizes], height=0.7)
    axis.axvline(0, color="0.25", lw=0.8)
    _named(axis, [found.names[i] for i in order])
    axis.set_xlabel(f"change of {_short(found.result)} [%] when the parameter increases by 1 %")
    axis.set_title(f"{_short(found.result)} = {found.value:.6g} {found.unit}", fontsize=9, loc="left")
    return figure


def _bars(axis: Axes, names: tuple[str, ...], values: FloatArray) -> None:
    order = np.argsort(values)[-MOST_BARS:]
    axis.barh(np.arange(len(order)), values[order], color=COLOURS[0], height=0.7)
    _named(axis, [names[i] for i in order])
    axis.set_xlim(0, 1.18 * max(float(values.max()), 1e-9))
    for place, value in enumerate(values[order]):
        axis.annotate(f" {value:.3g}", (float(value), place), va="center", fontsize=8)


def _named(axis: Axes, names: list[str]) -> None:
    """Give each bar its name."""
    tidy(axis)
    axis.set_axisbelow(True)
    axis.set_yticks(range(len(names)), [_short(name) for name in names])
    axis.grid(visible=False, axis="y")


def _without_heights(axis: Axes, legend: bool = True) -> None:
    """Leave the heights of a density away, which say nothing; put the legend above it."""
    tidy(axis)
    axis.set_axisbelow(True)
    axis.set_yticks([])
    axis.set_ylim(bottom=0)
    if legend:
        axis.set_ylim(top=1.5 * axis.get_ylim()[1])
        axis.legend(loc="upper left", fontsize=8, framealpha=1, edgecolor="none")


def _bins(count: int) -> int:
    return int(np.clip(np.sqrt(count) / 1.5, 8, 60))


def _short(name: str) -> str:
    """Return a name of a parameter without what goes without saying."""
    return (
        name.removeprefix("geometry.").removeprefix("bodies.").removeprefix("dimensions.").replace("_", " ")
    )
