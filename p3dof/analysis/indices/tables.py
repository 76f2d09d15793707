"""Tables of indices: at a few poses, or over many."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.tables import NONE, Table, html_of, notebook_html, number, table_of
from p3dof.analysis.indices.definitions import COLUMNS
from p3dof.analysis.indices.results import Indices

_FEW = 6  # poses that have a column each


def indices_table(found: Indices, columns: Mapping[str, FloatArray]) -> Table:
    """Return indices at up to six poses, or their least, mean and largest values over more."""
    poses = found.pose.reshape(-1, 3)
    few = len(poses) <= _FEW
    header = [_called(pose) for pose in poses] if few else ["least", "mean", "largest"]
    rows = {}
    for name, values in columns.items():
        flat = np.atleast_1d(values).ravel()
        known = flat[np.isfinite(flat)]
        shown = flat if few else (known.min(), known.mean(), known.max()) if len(known) else [math.nan] * 3
        rows[name] = (*(number(float(v)) for v in shown), COLUMNS[name].unit_of(name))
    bad = found.reason.ravel()
    told = [f"{_called(pose)}: {why}" for pose, why in zip(poses, bad, strict=True) if why]
    note = f"No indices at {'; '.join(told[:_FEW])}{'; ...' if told[_FEW:] else ''}." if told else ""
    title = f"Indices, characteristic length {1e3 * found.length:g} mm"
    if not few:
        title += f", over {len(poses)} poses"
    return table_of(title, ("index", *header, "unit"), rows, note)


def _called(pose: FloatArray) -> str:
    y, z, theta = pose
    if not np.isfinite(pose).all():
        return NONE
    return f"({1e3 * y:g} mm, {1e3 * z:g} mm, {math.degrees(theta):.4g}°)"


@html_of.register(Indices)
def indices_html(found: Indices) -> str:
    """Return how a notebook shows indices, as HTML."""
    return notebook_html("Indices", repr(found), [indices_table(found, found.columns)])
