"""The figure of all joints over a motion: positions, velocities, accelerations."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from p3dof._base.checks import shown
from p3dof._base.errors import InputError
from p3dof.methods import InverseDynamics
from p3dof.report.plots.common import COLOURS, line, new_figure, shade_gaps, tidy

if TYPE_CHECKING:
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
        The joints by either method; invalid samples are hatched gaps.

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
                drawn = values[:, result.joints.names.index(name)]
                line(axis, result.time, drawn, result.valid, label=name, **style)
            shade_gaps(axis, result.time, result.valid)
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
    return figure
