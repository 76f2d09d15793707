"""The table of a motion and of what loads it."""

from __future__ import annotations

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.tables import Table, html_of, notebook_html, number, table_of
from p3dof._base.time_series.times import counted_told
from p3dof.machine.motion.core import Motion


def motion_table(motion: Motion, wrench: FloatArray | None = None) -> Table:
    """Return how far, how fast and how hard the platform moves, and what loads it."""
    names = (("y [m], per s, per s²", 0), ("z [m], per s, per s²", 1), ("θ [rad], per s, per s²", 2))
    rows = {
        name: (
            motion.pose[:, k].min(),
            motion.pose[:, k].max(),
            np.abs(motion.velocity[:, k]).max(),
            np.abs(motion.acceleration[:, k]).max(),
        )
        for name, k in names
    }
    note = (
        f"{len(motion)} samples over {number(motion.duration)} s."
        f"{f' T{counted_told(motion.start)[1:]}.' if motion.start else ''}"
        f"{'' if wrench is None else _loads(wrench)}"
    )
    header = ("platform", "lowest", "highest", "largest speed", "largest acceleration")
    return table_of("Motion", header, rows, note)


@html_of.register(Motion)
def motion_html(motion: Motion) -> str:
    """Return how a notebook shows a motion, as HTML."""
    span = f"from {number(motion.time[0])} to {number(motion.time[-1])} s"
    return notebook_html("Motion", f"{len(motion)} samples, {span}", [motion_table(motion)])


def _loads(wrench: FloatArray) -> str:
    """Return the largest load in words."""
    largest = np.abs(wrench).max(axis=0)
    if not largest.any():
        return " No external load."
    force, moment = (", ".join(number(value) for value in part) for part in (largest[:3], largest[3:]))
    return f" Largest external force and moment at P, by components: {force} N; {moment} N m."
