"""The figure of the reactions in the joints over a motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from p3dof.plots.common import COLOURS, new_figure
from p3dof.reactions import Reactions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_KINDS = (("forces", COLOURS[0]), ("moments", COLOURS[1]))


def reactions_figure(result: Reactions) -> Figure:
    """Draw the resultant force and moment in every joint over the motion.

    Parameters
    ----------
    result : Reactions
        The reactions. What rigid bodies do not determine is drawn dashed.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    """
    figure = new_figure(figsize=(10.5, 8.5))
    axes = figure.subplots(4, 4, sharex=True)
    for axis, name in zip(axes.ravel(), result.joints, strict=False):
        one = result[name]
        axis.set_title(name, fontsize=9)
        for side, (kind, colour) in zip((axis, axis.twinx()), _KINDS, strict=True):
            determined = getattr(one, f"determined_{kind}")[result.valid].all()
            size = np.linalg.norm(getattr(one, kind), axis=-1)
            side.plot(result.time, size, color=colour, lw=1.2, ls="-" if determined else "--")
            side.set_ylim(0, max(1e-3, 1.05 * np.nanmax(size, initial=0.0)))
            side.tick_params(axis="y", labelsize=7, colors=colour)
            side.spines["top"].set_visible(False)
            side.margins(x=0.01)
        axis.grid(color="0.9", lw=0.6)
    count = len(result.joints)
    for axis in axes.ravel()[count:]:
        axis.set_visible(False)
    for axis in axes.ravel()[count - 4 : count]:
        axis.tick_params(labelbottom=True)
        axis.set_xlabel("time [s]")
    figure.suptitle(
        f"resultants in the joints, cuts as {result.idealisation}: force [N] blue, moment [N m] orange; "
        "dashed: not determined by rigid bodies",
        fontsize=9,
    )
    return figure
