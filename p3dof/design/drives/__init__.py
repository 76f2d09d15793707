"""Drives: motors, gears, screws and belts; what a cycle takes of them, and which of a catalogue fit."""

from p3dof.design.drives.catalogue import GENERIC, Catalogue, read_catalogue, write_catalogue
from p3dof.design.drives.margins import VERDICTS, Ambient, Margins, margins_of
from p3dof.design.drives.motor import Amplifier, Motor, Winding
from p3dof.design.drives.nuts import NutLife, RequiredLife, required_life
from p3dof.design.drives.sizing import AxisLoads, Cycle, Rating, Sizing, cycle_of, size_of, with_supply
from p3dof.design.drives.stopping import StopLoads, StopRamp, brake_fall, stops_table
from p3dof.design.drives.supply import BusLoads, Supply, SupplyLoads, supply_table
from p3dof.design.drives.tables import (
    axes_table,
    caveats,
    not_checked,
    nuts_table,
    ranking_table,
    ratings_table,
    verdict,
    write_ranking,
)
from p3dof.design.drives.transmission import Belt, Drive, Gear, Rack, Screw

__all__ = [
    "GENERIC",
    "VERDICTS",
    "Ambient",
    "Amplifier",
    "AxisLoads",
    "Belt",
    "BusLoads",
    "Catalogue",
    "Cycle",
    "Drive",
    "Gear",
    "Margins",
    "Motor",
    "NutLife",
    "Rack",
    "Rating",
    "RequiredLife",
    "Screw",
    "Sizing",
    "StopLoads",
    "StopRamp",
    "Supply",
    "SupplyLoads",
    "Winding",
    "axes_table",
    "brake_fall",
    "caveats",
    "cycle_of",
    "margins_of",
    "not_checked",
    "nuts_table",
    "ranking_table",
    "ratings_table",
    "read_catalogue",
    "required_life",
    "size_of",
    "stops_table",
    "supply_table",
    "verdict",
    "with_supply",
    "write_catalogue",
    "write_ranking",
]
