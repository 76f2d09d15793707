"""Tables of a workspace."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from p3dof._base.errors import InputError
from p3dof._base.tables import NONE, Cell, Table, html_of, notebook_html, table_of
from p3dof.analysis.workspace.closed_forms import loci
from p3dof.analysis.workspace.largest import Box
from p3dof.analysis.workspace.workspace import Workspace

_POINTS = 101  # of each locus in JSON


def workspace_table(space: Workspace) -> Table:
    """Return areas and volume of a workspace."""
    rows = {
        "volume in y, z, θ": (space.volume, "m² rad"),
        "area in (y, θ)": (space.area_y_theta, "m rad"),
        "area in (y, z) at θ = 0": (space.area(), "m²"),
        "with every orientation of the tilt": (space.dexterous(), "m²"),
        "with some orientation": (space.reachable, "m²"),
        "home's aspect in (y, θ), without limits": (space.aspects.home, "m rad"),
    }
    return table_of("Workspace", ("size", "value", "unit"), rows, decimals=6)


def box_table(space: Workspace) -> Table:
    """Return the largest boxes of poses in a workspace, all of which can be taken at once.

    Of all boxes, and of those that are symmetric about y = 0 and θ = 0.
    """
    boxes = _boxes(space)
    spans = {name: _spans(box) for name, box in boxes.items()}
    rows = {
        what: (*spans["largest"][k], *spans["symmetric"][k], unit)
        for k, (what, unit) in enumerate((("y", "mm"), ("z", "mm"), ("θ", "deg")))
    }
    sizes = {name: "none" if box is None else f"{box.volume:.6g} m² rad" for name, box in boxes.items()}
    note = (
        f"Of all boxes: {sizes['largest']}; of those with |y| ≤ Y, |θ| ≤ Θ: {sizes['symmetric']}. "
        "z need not follow y and θ in them."
    )
    header = ("largest box", "from", "to", "symmetric: from", "symmetric: to", "unit")
    return table_of("Largest boxes", header, rows, note, decimals=2)


def _spans(box: Box | None) -> Sequence[tuple[Cell, Cell]]:
    """Return the ends of a box in y and z [mm] and θ [deg]."""
    if box is None:
        return 3 * [(NONE, NONE)]
    found = ((1e3, box.y), (1e3, box.z), (math.degrees(1), box.theta))
    return [(factor * low, factor * high) for factor, (low, high) in found]


def _boxes(space: Workspace) -> dict[str, Box | None]:
    """Return the largest boxes by their names; None where there is none."""
    return {"largest": _found(space.largest_box), "symmetric": _found(space.largest_symmetric_box)}


def _found(search: Callable[[], Box]) -> Box | None:
    try:
        return search()
    except InputError:
        return None


def plain_workspace(space: Workspace) -> dict[str, Any]:
    """Return the numbers of a workspace in SI units, ready for JSON."""
    boxes = {
        name: box and {"y": box.y, "z": box.z, "theta": box.theta, "volume": box.volume}
        for name, box in _boxes(space).items()
    }
    limits = space.limits
    aspects = space.aspects
    return {
        "limits": {
            "travel": limits.travel,
            "tilt": limits.tilt,
            "speed": limits.speed,
            "force": limits.force,
        },
        "margins": {
            name: getattr(space.margins, name) for name in ("serial", "actuation", "velocity", "acceleration")
        },
        "volume": space.volume,
        "area_y_theta": space.area_y_theta,
        "area": space.area(),
        "dexterous": space.dexterous(),
        "reachable": space.reachable,
        "aspects": {"home": aspects.home, "above": aspects.above, "below": aspects.below},
        "largest_box": boxes["largest"],
        "largest_symmetric_box": boxes["symmetric"],
        "loci": {
            name: [row for row in curve.tolist() if np.isfinite(row).all()]
            for name, curve in loci(space.sizes, _POINTS).items()
        },
    }


@html_of.register(Workspace)
def workspace_html(space: Workspace) -> str:
    """Return how a notebook shows a workspace, as HTML."""
    facts = f"volume {space.volume:.6g} m² rad"
    return notebook_html("Workspace", facts, [workspace_table(space), box_table(space)])
