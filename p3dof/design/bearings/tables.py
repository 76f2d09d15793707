"""Tables of bearings, guides and rods."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

from p3dof._base.tables import NONE, Table, html_of, notebook_html, number, table_of
from p3dof.design.bearings.results import BearingLife, BearingReport, GuideLife

_LONG = 1e5
BENDING = (
    "Bends at: first bending frequency, section and modulus as the stiffness file has them, the mass as the "
    "parameters have it, spread evenly over the length."
)
"""Whose stiffness and whose mass the bending frequency has."""
WIDTH = (
    "Loads of rods and bearings rest on the stiffness of joints and on the width b of the parallelogram: "
    "it stands in no paper, and decides no force of an actuator."
)
"""What must stand beside them."""
Place: TypeAlias = Callable[[float], str] | None
"""Says where the machine is at a time."""


def bearings_table(report: BearingReport, place: Place = None) -> Table:
    """Return the bearings of the hinges: loads, angles turned, lives.

    Parameters
    ----------
    report : BearingReport
        Over a cycle.
    place : callable, optional
        Takes a time and returns where the machine then is, in words.

    Returns
    -------
    Table
    """
    header = ("joint", "bearing", *_load(place), "swing [°]", "turns a cycle", "L10 [Mrev]", *_LIFE)
    rows = {
        one.joint: _row(one, (math.degrees(one.swing), one.revolutions), one.life / 1e6, place)
        for one in report.bearings
    }
    note = f"A cycle takes {number(report.cycle)} s. Mean load: equivalent, by angle turned (ISO 281)."
    return table_of("Bearings", header, rows, note, "wide")


def guides_table(report: BearingReport, place: Place = None) -> Table:
    """Return the guides of the sliders: loads, ways, lives.

    Parameters
    ----------
    report : BearingReport
        Over a cycle.
    place : callable, optional
        Takes a time and returns where the machine then is, in words.

    Returns
    -------
    Table
    """
    header = ("joint", "guide", *_load(place), "from moments", "way a cycle [m]", "L10 [km]", *_LIFE)
    rows = {
        one.joint: _row(one, (f"{one.moment_share:.0%}", one.way), one.life / 1e3, place)
        for one in report.guides
    }
    note = "Mean load: equivalent, with moments about the carriage, weighted by the way (ISO 14728-1)."
    return table_of("Guides", header, rows, note, "wide")


_LIFE = ("L10 [h]", "static safety")


def _load(place: Place) -> tuple[str, ...]:
    """Return the names of the columns of the load."""
    return ("mean load [N]", "peak [N]", "at t [s]", *(() if place is None else ("on the way",)))


def _row(
    one: BearingLife | GuideLife, middle: tuple[float | str, float], life: float, place: Place
) -> tuple[str, ...]:
    """Return the cells of a bearing or a guide: load, what is its own, life."""
    name = (one.bearing if isinstance(one, BearingLife) else one.guide).name
    loads = (one.mean_load, one.peak_load, one.peak_time)
    where = () if place is None else (place(one.peak_time),)
    own = (cell if isinstance(cell, str) else number(cell) for cell in middle)
    lives = (number(life) if math.isfinite(life) else NONE, _hours(one.hours), _safety(one.static_safety))
    return (name, *map(number, loads), *where, *own, *lives)


def rods_table(report: BearingReport) -> Table:
    """Return legs and rods: compression against buckling, and the bending frequency.

    Parameters
    ----------
    report : BearingReport
        Over a cycle.

    Returns
    -------
    Table
    """
    rows = {
        rod.rod: (
            number(rod.compression) if rod.compression else "none",
            number(rod.compression_time),
            number(rod.tension) if rod.tension else "none",
            number(rod.buckling),
            _safety(rod.buckling_safety),
            number(rod.frequency),
        )
        for rod in report.rods
    }
    header = (
        "rod",
        "compression [N]",
        "at t [s]",
        "tension [N]",
        "buckles at [N]",
        "safety",
        "bends at [Hz]",
    )
    note = f"{BENDING} {WIDTH}"
    return table_of("Legs and rods, hinged at both ends", header, rows, note, "wide")


def _hours(hours: float) -> str:
    return f"> {_LONG:,.0f}" if hours > _LONG else number(hours)


def _safety(value: float) -> str:
    if math.isnan(value):
        return NONE
    return "no load" if math.isinf(value) else number(value)


@html_of.register(BearingReport)
def report_html(report: BearingReport) -> str:
    """Return how a notebook shows bearings, guides and rods, as HTML."""
    tables = [bearings_table(report), guides_table(report), rods_table(report)]
    facts = f"a cycle of {number(report.cycle)} s"
    return notebook_html(
        "Bearings", facts, [table for table in tables if table.rows], list(report.warnings), WIDTH
    )
