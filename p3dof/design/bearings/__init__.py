"""Bearings, guides and rods: how long they live and how far they are from failing, over a cycle.

The loads are those of `p3dof.analysis.reactions`, of elastic joints where rigid bodies leave them open.
"""

from p3dof.design.bearings.catalogue import Bearing, Bearings, Guide, read_bearings
from p3dof.design.bearings.evaluation import (
    BearingLife,
    BearingReport,
    GuideLife,
    RodCheck,
    advice_table,
    bearing_life,
    bearings_table,
    guides_table,
    rods_table,
)

__all__ = [
    "Bearing",
    "BearingLife",
    "BearingReport",
    "Bearings",
    "Guide",
    "GuideLife",
    "RodCheck",
    "advice_table",
    "bearing_life",
    "bearings_table",
    "guides_table",
    "read_bearings",
    "rods_table",
]
