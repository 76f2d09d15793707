"""The figure of all joints over a motion: positions, velocities, accelerations."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from p3dof.checks import FloatArray, shown
from p3dof.errors import InputError
from p3dof.methods import InverseDynamics
from p3dof.plots.common import COLOURS, new_figure, tidy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDE: dict[str, Any] = {"lw": 3.2, "alpha": 0.4}
_DASHED: dict[str, Any] = {"lw": 1.3, "ls": (0, (4, 2))}
_COLUMNS: tuple[tuple[str, str, dict[str, dict[str, Any]]], ...] = (
    (
        "sliders",
        "m",
        {f"slide_{leg}": {"color": colour} for leg, colour in zip("abc", COLOURS, strict=True)},
    ),
    (
        "hinges at the sliders",
        "rad",
        {f"hinge_{leg}": {"color": colour} for leg, colour in zip("abc", COLOURS, strict=True)},
    ),
    ("platform", "rad", {"hinge_platform": {"color": "#cc79a7"}}),
    (
        "parallelogram",
        "rad",
        {
            "hinge_left": {"color": COLOURS[2], **_WIDE},
            "hinge_right": {"color": "0.1", **_DASHED},
            "hinge_lower": {"color": "#e69f00"},
        },
    ),
)
"""The columns of panels: title, unit, and the joints with their lines."""

_ROWS = (("position", "q", ""), ("velocity", "v", "/s"), ("acceleration", "a", "/s²"))


def joints_figure(result: InverseDynamics) -> Figure:
    """Draw position, velocity and acceleration of the sliders and of the passive joints over the motion.

    Parameters
    ----------
    result : InverseDynamics
        The joints by either method; rows of invalid samples are left out.

    Returns
    -------
    matplotlib.figure.Figure
        Rows of positions, velocities, accelerations; columns of sliders, hinges at the sliders, hinge of the
        platform, hinges of the parallelogram.

    Raises
    ------
    InputError
        If `result` is something else, or none of its samples is valid.
    MissingExtraError
        If matplotlib is not installed.
    """
    if not isinstance(result, InverseDynamics):
        raise InputError(f"result: expected InverseDynamics, got {shown(result)}")
    if not result.valid.any():
        raise InputError("result: expected at least one valid sample, got none")
    figure = new_figure(figsize=(12.0, 7.2))
    axes = figure.subplots(len(_ROWS), len(_COLUMNS), sharex=True)
    for column, (title, unit, lines) in zip(axes.T, _COLUMNS, strict=True):
        for axis, (quantity, field, rate) in zip(column, _ROWS, strict=True):
            values = getattr(result.joints, field)
            for name, style in lines.items():
                _line(axis, result, values[:, result.joints.names.index(name)], label=name, **style)
            axis.axhline(0, color="0.6", lw=0.6, zorder=0)
            axis.set_ylabel(f"{quantity} [{unit}{rate}]")
            tidy(axis)
        column[-1].set_xlabel("time [s]")
        column[0].legend(
            title=title,
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            alignment="left",
            frameon=False,
            fontsize=9,
            title_fontsize=10,
        )
    figure.align_ylabels()
    return figure


def _line(axis: Axes, result: InverseDynamics, values: FloatArray, **style: Any) -> None:
    """Draw a curve of the valid samples; those without a valid neighbour are dots."""
    beside = np.concatenate([[False], result.valid, [False]])
    alone = np.flatnonzero(result.valid & ~beside[:-2] & ~beside[2:])
    dots = {"marker": "o", "ms": 4, "markevery": alone.tolist()} if len(alone) else {}
    axis.plot(result.time, np.where(result.valid, values, np.nan), **{"lw": 1.4, **dots, **style})
