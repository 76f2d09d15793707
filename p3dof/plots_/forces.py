"""Figures; needs the extra ``plot`` (matplotlib)."""

from __future__ import annotations

import io
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from p3dof.errors import InputError, MissingExtraError
from p3dof.files import write_atomic
from p3dof.manipulator import InverseDynamics

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = ("#0072b2", "#d55e00", "#009e73")
"""Colours of the legs A, B, C: distinct for colour-blind readers and in grey print."""

_STYLES: tuple[dict[str, Any], ...] = ({"lw": 3.0, "alpha": 0.35}, {"lw": 1.2})
_NAMES = {"pinocchio": "Pinocchio (URDF, closures, RNEA)", "virtual-power": "virtual power (paper)"}


def forces_figure(results: Sequence[InverseDynamics]) -> Figure:
    """Draw the three actuator forces over the motion (the paper's Figs. 3-5), and two results' difference.

    Parameters
    ----------
    results : sequence of InverseDynamics
        One result, or two of the same motion by different methods.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If there are not one or two results, or two of different motions.
    MissingExtraError
        If matplotlib is not installed.
    """
    if len(results) not in {1, 2}:
        raise InputError(f"results: expected one or two, got {len(results)}")
    if len(results) == 2 and not np.array_equal(results[0].time, results[1].time):
        raise InputError("results: expected two results of the same motion, got different times")
    rows = len(results)
    figure = _new_figure(figsize=(10.5, 3.1 if rows == 1 else 4.8))
    from matplotlib.lines import Line2D

    axes = figure.subplots(rows, 3, sharex=True, squeeze=False, height_ratios=(3, 1.4)[:rows])
    for leg, name in enumerate("ABC"):
        top = axes[0, leg]
        for result, style in zip(results, _STYLES[-rows:], strict=True):
            top.plot(result.time, result.forces[:, leg], color=COLOURS[leg], **style)
        top.set_title(f"actuator {name}", fontsize=10)
        top.set_ylabel("force [N]")
        if rows == 2:
            difference = results[0].forces[:, leg] - results[1].forces[:, leg]
            axes[1, leg].plot(results[0].time, difference, color=COLOURS[leg], lw=0.7)
            axes[1, leg].axhline(0, color="0.6", lw=0.5, zorder=0)
            axes[1, leg].set_ylabel("difference [N]")
            axes[1, leg].ticklabel_format(axis="y", style="sci", scilimits=(0, 0))
        axes[-1, leg].set_xlabel("time [s]")
    handles = [Line2D([], [], color="0.3", **style) for style in _STYLES[-rows:]]
    labels = [_NAMES.get(result.method, result.method) for result in results]
    figure.legend(handles, labels, loc="outside upper center", ncols=2, frameon=False, fontsize=9)
    for axis in axes.ravel():
        axis.grid(color="0.9", lw=0.6)
        axis.spines[["top", "right"]].set_visible(False)
        axis.margins(x=0.01)
    return figure


def save(figure: Figure, path: str | os.PathLike[str]) -> Path:
    """Write a figure; the ending of the name chooses the format (png, svg, pdf).

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        The figure.
    path : path-like
        The file; replaced whole or not at all.

    Returns
    -------
    Path
        The path written.

    Raises
    ------
    FileError
        If the file cannot be written.
    InputError
        If the ending is not a format that matplotlib writes.
    """
    path = Path(path)
    kind = path.suffix.lstrip(".").lower()
    if kind not in figure.canvas.get_supported_filetypes():
        raise InputError(f"{path}: expected a file name that ends in .png, .svg or .pdf")
    stream = io.BytesIO()
    metadata = {"Date": None} if kind == "svg" else {}
    figure.savefig(stream, format=kind, dpi=160, metadata=metadata)
    return write_atomic(path, stream.getvalue())


def _new_figure(figsize: tuple[float, float]) -> Figure:
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingExtraError("figures need matplotlib: pip install 'p3dof[plot]'") from error
    except (
        ValueError
    ) as error:  # matplotlib refuses its own settings, such as MPLBACKEND, when it is imported
        raise InputError(f"matplotlib cannot start: {error}") from error
    return Figure(figsize=figsize, layout="constrained")
