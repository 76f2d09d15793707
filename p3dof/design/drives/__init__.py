"""Drives: motors, gears, screws and belts; what a cycle takes of them, and which of a catalogue fit."""

from p3dof.design.drives.catalogue import GENERIC, Catalogue, read_catalogue
from p3dof.design.drives.cycle import Cycle, cycle_of
from p3dof.design.drives.drive import Drive
from p3dof.design.drives.motor import Motor
from p3dof.design.drives.sizing import AxisLoads, Rating, Sizing, size_of
from p3dof.design.drives.tables import axes_table, ranking_table, ratings_table, verdict, write_ranking
from p3dof.design.drives.transmission import Belt, Gear, Screw
from p3dof.design.drives.unchecked import not_checked
from p3dof.design.drives.winding import Winding

__all__ = [
    "GENERIC",
    "AxisLoads",
    "Belt",
    "Catalogue",
    "Cycle",
    "Drive",
    "Gear",
    "Motor",
    "Rating",
    "Screw",
    "Sizing",
    "Winding",
    "axes_table",
    "cycle_of",
    "not_checked",
    "ranking_table",
    "ratings_table",
    "read_catalogue",
    "size_of",
    "verdict",
    "write_ranking",
]
