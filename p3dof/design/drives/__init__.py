"""Drives: motors, gears, screws and belts; what a cycle takes of them, and which of a catalogue fit."""

from p3dof.design.drives.catalogue import GENERIC, Catalogue, read_catalogue, write_catalogue
from p3dof.design.drives.margins import VERDICTS, Ambient, Margins, margins_of
from p3dof.design.drives.motor import Motor, Winding
from p3dof.design.drives.sizing import AxisLoads, Cycle, Rating, Sizing, cycle_of, size_of
from p3dof.design.drives.tables import (
    axes_table,
    caveats,
    not_checked,
    ranking_table,
    ratings_table,
    verdict,
    write_ranking,
)
from p3dof.design.drives.transmission import Belt, Drive, Gear, Screw

__all__ = [
    "GENERIC",
    "VERDICTS",
    "Ambient",
    "AxisLoads",
    "Belt",
    "Catalogue",
    "Cycle",
    "Drive",
    "Gear",
    "Margins",
    "Motor",
    "Rating",
    "Screw",
    "Sizing",
    "Winding",
    "axes_table",
    "caveats",
    "cycle_of",
    "margins_of",
    "not_checked",
    "ranking_table",
    "ratings_table",
    "read_catalogue",
    "size_of",
    "verdict",
    "write_catalogue",
    "write_ranking",
]
