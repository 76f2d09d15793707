"""What is found of bearings, guides and rods over a cycle."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from p3dof._base.checks import Readable
from p3dof._base.tables import NONE, ShownInNotebook, Table, html_of, notebook_html, number, table_of
from p3dof.design.bearings.catalogue import Bearing, Guide

FULL_TURN = 2 * math.pi


@dataclass(frozen=True)
class BearingLife(Readable):
    """A bearing over a cycle."""

    joint: str  # where it is
    bearing: Bearing  # which
    mean_load: float
    """Equivalent load of the whole cycle, weighted by the angle turned: the constant load with the same
    life [N]; NaN if it does not turn."""
    peak_load: float  # largest equivalent load [N]
    peak_time: float  # when [s]
    static_load: float  # largest equivalent static load [N]
    static_time: float  # when [s]
    revolutions: float  # angle turned in a cycle, to and fro, in revolutions
    swing: float  # from one end of its way to the other [rad]
    life: float  # L10 in revolutions: nine of ten bearings reach it; infinite if it does not turn
    hours: float  # the same in hours of the cycle

    @property
    def static_safety(self) -> float:
        """C0 over the largest equivalent static load; NaN without C0."""
        if self.bearing.static is None:
            return math.nan
        return self.bearing.static / self.static_load if self.static_load else math.inf

    @property
    def oscillates(self) -> bool:
        """Whether it never turns right round, so that the formula of its life is a guide only."""
        return self.swing < FULL_TURN


@dataclass(frozen=True)
class GuideLife(Readable):
    """A guide over a cycle."""

    joint: str  # where it is
    guide: Guide  # which
    mean_load: float  # equivalent load of the whole cycle, weighted by the way [N]; NaN if it does not move
    peak_load: float  # largest equivalent load [N]
    peak_time: float  # when [s]
    way: float  # of a cycle, to and fro [m]
    moment_share: float  # which part of the equivalent load comes from moments, in the mean over the cycle
    life: float  # [m]; infinite if it does not move
    hours: float  # the same in hours of the cycle

    @property
    def static_load(self) -> float:
        """Largest equivalent load, which of a guide is the static one too [N]."""
        return self.peak_load

    @property
    def static_time(self) -> float:
        """When that is [s]."""
        return self.peak_time

    @property
    def static_safety(self) -> float:
        """C0 over the largest load; NaN without C0."""
        if self.guide.static is None:
            return math.nan
        return self.guide.static / self.peak_load if self.peak_load else math.inf


@dataclass(frozen=True)
class RodCheck:
    """A leg or rod over a cycle."""

    rod: str  # its link
    compression: float  # the largest, at either end [N]; zero where there is none
    compression_time: float  # when [s]; NaN without any
    tension: float  # the largest, at either end [N]; zero where there is none
    buckling: float  # euler's load with both ends hinged [N]
    frequency: float  # of its first bending vibration with both ends hinged [Hz]

    @property
    def buckling_safety(self) -> float:
        """Euler's load over the largest compression; infinite without any."""
        return self.buckling / self.compression if self.compression else math.inf


@dataclass(frozen=True, eq=False)
class BearingReport(ShownInNotebook):
    """Bearings, guides and rods of a machine over a cycle."""

    bearings: tuple[BearingLife, ...]  # of the hinges that have one
    guides: tuple[GuideLife, ...]  # of the sliders that have one
    rods: tuple[RodCheck, ...]  # legs and rods; none if they are rigid
    cycle: float  # how long a cycle takes [s]
    warnings: tuple[str, ...]  # what to know before these numbers are used, the most important first


LONG = 1e5  # longer lives are not told as numbers: other causes end them [h]
BENDING = (
    "Bends at: first bending frequency, section and modulus as the stiffness file has them, the mass as the "
    "parameters have it, spread evenly over the length."
)
"""Whose stiffness and whose mass the bending frequency has."""
WIDTH = (
    "Loads of rods and bearings depend on the stiffness of joints and on the width b of the parallelogram, "
    "which the paper does not give, and which affects no actuator force."
)
"""What must stand beside them."""
Place: TypeAlias = Callable[[float], str] | None  # says where the machine is at a time


def bearings_table(report: BearingReport, place: Place = None) -> Table:
    """Return the bearings of the hinges: loads, angles turned, lives.

    `place`: takes a time and returns where the machine then is, in words.
    """
    header = ("joint", "bearing", *_load(place), "swing [°]", "turns per cycle", "L10 [Mrev]", *_LIFE)
    rows = {
        one.joint: _row(one, (math.degrees(one.swing), one.revolutions), one.life / 1e6, place)
        for one in report.bearings
    }
    note = f"A cycle takes {number(report.cycle)} s. Mean load: equivalent, by angle turned (ISO 281)."
    return table_of("Bearings", header, rows, note, "wide")


def guides_table(report: BearingReport, place: Place = None) -> Table:
    """Return the guides of the sliders: loads, ways, lives.

    `place`: takes a time and returns where the machine then is, in words.
    """
    header = ("joint", "guide", *_load(place), "from moments", "distance per cycle [m]", "L10 [km]", *_LIFE)
    rows = {
        one.joint: _row(one, (f"{one.moment_share:.0%}", one.way), one.life / 1e3, place)
        for one in report.guides
    }
    note = "Mean load: equivalent, with moments about the carriage, weighted by the distance (ISO 14728-1)."
    return table_of("Guides", header, rows, note, "wide")


_LIFE = ("L10 [h]", "static safety")


def _load(place: Place) -> tuple[str, ...]:
    """Return the names of the columns of the load."""
    return ("mean load [N]", "peak [N]", "at t [s]", *(() if place is None else ("segment",)))


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
    """Return legs and rods: compression against buckling, and the bending frequency."""
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
    return f"> {LONG:,.0f}" if hours > LONG else number(hours)


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
