"""Tables of a workspace."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from p3dof.errors import InputError
from p3dof.tables import NONE, Table, html_of, notebook_html, table_of
from p3dof.workspace.loci import loci
from p3dof.workspace.workspace import Workspace

_POINTS = 101
"""Of each locus in JSON."""


def workspace_table(space: Workspace) -> Table:
    """Return areas and volume of a workspace.

    Parameters
    ----------
    space : Workspace
        Whose.

    Returns
    -------
    Table
    """
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
    """Return the largest box of poses in a workspace, all of which can be taken at once.

    Parameters
    ----------
    space : Workspace
        Whose.

    Returns
    -------
    Table
    """
    header = ("largest box", "from", "to", "unit")
    try:
        box = space.largest_box()
    except InputError:
        return table_of(
            "Largest box", header, {"y": (NONE, NONE, "mm")}, "There is none around y = 0, θ = 0."
        )
    rows = {
        "y": (1e3 * box.y[0], 1e3 * box.y[1], "mm"),
        "z": (1e3 * box.z[0], 1e3 * box.z[1], "mm"),
        "θ": (math.degrees(box.theta[0]), math.degrees(box.theta[1]), "deg"),
    }
    note = f"{box.volume:.6g} m² rad; z need not follow y and θ in it."
    return table_of("Largest box", header, rows, note, decimals=2)


def plain_workspace(space: Workspace) -> dict[str, Any]:
    """Return the numbers of a workspace in SI units, ready for JSON.

    Parameters
    ----------
    space : Workspace
        Whose.

    Returns
    -------
    dict
    """
    try:
        box = space.largest_box()
        largest: Any = {"y": box.y, "z": box.z, "theta": box.theta, "volume": box.volume}
    except InputError:
        largest = None
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
        "largest_box": largest,
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
