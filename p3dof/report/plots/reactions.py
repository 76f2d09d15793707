"""The figure of the reactions in the joints over a motion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from p3dof.analysis.reactions import JOINTS, AnyReactions
from p3dof.report.plots.common import COLOURS, GAP, GAP_STYLE, few_ticks, line, new_figure, shade_gaps

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_KINDS = (("forces", "force [N]", COLOURS[0]), ("moments", "moment [N m]", COLOURS[1]))
_ROWS = (
    ("slide_a", "hinge_a", "loop_a"),
    ("slide_b", "hinge_b", "loop_b"),
    ("slide_c", "hinge_c", "hinge_left", "hinge_right"),
    ("hinge_lower", "hinge_platform", "loop_c"),
)
"""The panels: leg A, leg B, leg C from its slider to the platform."""

_LABELS = {joint.name: joint.label for joint in JOINTS}
_STYLES: Mapping[str, Mapping[str, Any]] = {
    "elastic": {"ls": "-", "lw": 1.2},
    "paper": {"ls": (0, (4, 2)), "lw": 0.8},
    "points": {"ls": (0, (1, 1.2)), "lw": 0.8},
}
"""Of open loads, by the way they are found: solid, dashes and dots."""

_NOTHING = 1e-9
"""Moments that are rounding, of a joint that bears none [N m]."""


def reactions_figure(result: AnyReactions) -> Figure:
    """Draw the resultant force and moment in every joint over the motion.

    Parameters
    ----------
    result : Reactions or ReactionsComparison
        The reactions. What rigid bodies determine is drawn solid, and what elastic joints bear too; dashes
        stand for ``"paper"`` and dots for ``"points"``. Panels have the names of the tables and the drawing.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    """
    figure = new_figure(figsize=(10.5, 8.0))
    axes = figure.subplots(len(_ROWS), 4, sharex=True)
    for row, names in zip(axes, _ROWS, strict=True):
        for axis in row[len(names) :]:
            axis.set_axis_off()
        for axis, name in zip(row, names, strict=False):
            axis.set_title(f"{name} ({_LABELS[name]})", fontsize=9, y=1.0)
            for side, (kind, _, colour) in zip((axis, axis.twinx()), _KINDS, strict=True):
                _draw(side, result, name, kind, colour)
            shade_gaps(axis, result.time, result.valid)
            axis.grid(color="0.9", lw=0.6)
            axis.tick_params(axis="x", labelsize=7)
    for axis in (*axes[-1, :3], axes[-2, 3]):
        axis.tick_params(labelbottom=True)
        axis.set_xlabel("time [s]", fontsize=8)
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Artist] = [Line2D([], [], lw=1.2, color=colour, label=label) for _, label, colour in _KINDS]
    solid = "determined, or elastic joints" if result.rests_on_stiffness else "determined"
    handles.append(Line2D([], [], lw=1.2, color="0.3", label=solid))
    ideal = [way for way in result.ways if way != "elastic"]
    handles += [
        Line2D([], [], color="0.3", label=f"open, joints as {way!r}", **_STYLES[way]) for way in ideal
    ]
    if not result.possible:
        handles.append(Patch(**GAP_STYLE, label=GAP))
    axes[0, 3].legend(handles=handles, loc="center", frameon=False, fontsize=9)
    note = "Rigid bodies cannot decide\nopen loads: dashes and dots are\none of many, and no bounds."
    axes[1, 3].text(0.5, 0.5, note, fontsize=9, ha="center", va="center", transform=axes[1, 3].transAxes)
    figure.suptitle("resultants in the joints", fontsize=10)
    return figure


def _draw(axis: Axes, result: AnyReactions, name: str, kind: str, colour: str) -> None:
    """Draw the size of a joint's force or moment against its own scale, in its colour."""
    each = {one.way: one[name] for one in result.each}
    determined = all(getattr(one, f"determined_{kind}")[result.valid].all() for one in each.values())
    sizes = {name: np.linalg.norm(getattr(one, kind), axis=-1) for name, one in each.items()}
    if determined:  # the same in all
        sizes = {"": next(iter(sizes.values()))}
    axis.spines["top"].set_visible(False)
    axis.margins(x=0.01)
    largest = max(np.nanmax(size, initial=0.0) for size in sizes.values())
    if kind == "moments" and largest <= _NOTHING:
        axis.set_yticks([])
        axis.spines["right"].set_visible(False)
        return
    for way, size in sizes.items():
        line(axis, result.time, size, result.valid, color=colour, **_STYLES.get(way, _STYLES["elastic"]))
    axis.set_ylim(0, 1.05 * largest or 1.0)
    few_ticks(axis)
    axis.tick_params(axis="y", labelsize=7, colors=colour)
