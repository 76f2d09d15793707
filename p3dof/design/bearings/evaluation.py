"""Lives of bearings and guides, and buckling of rods, from reactions over a cycle."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from p3dof._base.checks import FloatArray, Readable, not_negative, shown
from p3dof._base.errors import InputError, SampleError
from p3dof._base.tables import (
    NONE,
    Numeral,
    ShownInNotebook,
    Table,
    html_of,
    notebook_html,
    number,
    percent,
    table_of,
)
from p3dof.analysis.reactions import (
    JOINTS,
    AnyReactions,
    Reactions,
    ReactionsComparison,
    RodSection,
    Stiffness,
)
from p3dof.closed_form import kinematics
from p3dof.design.bearings.catalogue import SLIDES, TURNING, Bearing, Bearings, Guide
from p3dof.design.drives import RequiredLife, required_life
from p3dof.machine.parameters import Parameters

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
    required: float = math.nan  # what was required of these [h]; NaN if nothing was

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
    mean_load: float
    """Equivalent load of the whole cycle, weighted by the way, of the carriage that bears more [N]; NaN if it
    does not move."""
    peak_load: float  # largest equivalent load of a carriage [N]
    peak_time: float  # when [s]
    way: float  # of a cycle, to and fro [m]
    moment_share: float  # which part of the equivalent load comes from moments, in the mean over the cycle
    life: float  # of the carriage that bears more [m]; infinite if it does not move
    hours: float  # the same in hours of the cycle
    required: float = math.nan  # what was required of these [h]; NaN if nothing was
    mean_loads: tuple[float, ...] = ()  # of each carriage, as `mean_load` [N]

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

    @property
    def parts(self) -> tuple[BearingLife | GuideLife, ...]:
        """All bearings and guides."""
        return (*self.bearings, *self.guides)

    @property
    def lasts(self) -> bool:
        """Whether no part lives shorter than is required."""
        return not any(one.hours < one.required for one in self.parts)


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
        one.joint: _row(one, (percent(one.moment_share, 0), one.way), one.life / 1e3, place)
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


def advice_table(report: BearingReport) -> Table:
    """Return what to do about bearings and guides whose lives do not tell all, part by part."""
    rows = {
        one.joint: (
            f"swings {math.degrees(one.swing):.3g}°: false brinelling",
            "a full turn now and then" if one.swing > _SMALL / 2 else "a plain or needle bearing",
            "grease against fretting",
        )
        for one in report.bearings
        if one.swing < _SMALL
    }
    rows |= {
        one.joint: (
            f"{one.moment_share:.0%} of its load from moments",
            "two carriages on the rail",
            "a wider rail",
        )
        for one in report.guides
        if one.moment_share > _OFTEN and one.guide.distance is None
    }
    header = ("joint", "finding", "what to do", "or")
    return table_of("What to do about bearings and guides", header, rows)


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
    return Numeral(f"> {LONG:,.0f}", hours) if hours > LONG else number(hours)


def _safety(value: float) -> str:
    if math.isnan(value):
        return NONE
    return "no load" if math.isinf(value) else number(value)


@html_of.register(BearingReport)
def report_html(report: BearingReport) -> str:
    """Return how a notebook shows bearings, guides and rods, as HTML."""
    tables = [bearings_table(report), guides_table(report), rods_table(report), advice_table(report)]
    facts = f"a cycle of {number(report.cycle)} s"
    return notebook_html(
        "Bearings", facts, [table for table in tables if table.rows], list(report.warnings), WIDTH
    )


_OFTEN = 0.5  # from which share of moments in a guide's load two carriages are recommended
_SMALL = math.radians(60)  # below this swing the ways of neighbouring rolling elements may not overlap
_MUCH, _FEW = 0.05, 4  # from which share of the largest load what misfits add is told, and of how many joints
_SAFE = {"buckling": 4.0}
_ENDS = {
    "leg_a": ("hinge_a", "loop_a"),
    "leg_b": ("hinge_b", "loop_b"),
    "rod_left": ("hinge_left", "hinge_lower"),
    "rod_right": ("hinge_right", "loop_c"),
}


def bearing_life(
    parameters: Parameters,
    reactions: AnyReactions,
    bearings: Bearings,
    *,
    stiffness: Stiffness | None = None,
    rest: float = 0.0,
    life: RequiredLife | str | None = None,
) -> BearingReport:
    """Return how long bearings and guides live under a cycle that is repeated, and how safe rods are.

    Lives are basic ratings L10: of bearings (C / P_m)^p million revolutions (ISO 281) with the mean P_m of
    P^p over the angle turned; of guides (C / P_m)^p times the way that C holds for (ISO 14728-1), with the
    sizes of both forces across and of all moments, these over their ratings times C, added up. Rods are
    hinged beams: Euler's load π² E I / L², and first bending frequency π / 2 L² √(E I L / m)
    with E I of the section in `stiffness` and the mass m that the leg or rod has in `parameters`.

    Parameters
    ----------
    parameters : Parameters
        The machine.
    reactions : Reactions or ReactionsComparison
        Of elastic joints, over one cycle.
    bearings : Bearings
        What the joints run in.
    stiffness : Stiffness, optional
        That of the reactions: for the section of the rods.
    rest : float
        How long the machine rests after the last sample of a cycle [s].
    life : RequiredLife or str, optional
        What bearings and guides have to live, such as ``"20000 h"``; that of `bearings` without it.

    Raises
    ------
    SampleError
        If the machine cannot perform the whole motion.
    InputError
        If an argument does not fit, or the reactions are not those of elastic joints.
    """
    elastic = _elastic(reactions)
    if not isinstance(bearings, Bearings):
        raise InputError(f"bearings: expected Bearings, got {shown(bearings)}")
    if not elastic.possible or len(elastic.time) < 2:
        raise SampleError(
            "reactions: a life needs a motion that the machine can make, of two samples or more"
        )
    pause = not_negative("rest", rest)
    cycle = elastic.motion.duration + pause
    rates = _rates(parameters, elastic)
    needed = required_life(life if life is not None else bearings.life)
    of_bearings, of_guides = [], []
    for joint in (*SLIDES, *TURNING):
        part = bearings.of(joint)
        if isinstance(part, Guide):
            of_guides.append(_guide(elastic, joint, part, rates[joint], cycle, needed))
        elif isinstance(part, Bearing):
            of_bearings.append(_bearing(elastic, joint, part, rates[joint], cycle, needed))
    section = (Stiffness() if stiffness is None else stiffness).rods
    rods = () if section is None else tuple(rod_check(parameters, elastic, name, section) for name in _ENDS)
    warnings = (*_warnings(of_bearings, of_guides, rods), *_misfits(elastic, of_bearings))
    return BearingReport(tuple(of_bearings), tuple(of_guides), rods, cycle, warnings)


def _elastic(reactions: AnyReactions) -> Reactions:
    """Return the reactions of elastic joints."""
    if isinstance(reactions, ReactionsComparison):
        return reactions.elastic
    if not isinstance(reactions, Reactions):
        raise InputError(f"reactions: expected Reactions, got {shown(reactions)}")
    if not reactions.rests_on_stiffness:
        raise InputError(
            f"reactions: {reactions.way!r} leaves loads of the bearings undetermined; ask for 'elastic' ones"
        )
    return reactions


def _rates(parameters: Parameters, reactions: Reactions) -> dict[str, FloatArray]:
    """Return how fast each joint turns about its axis, or slides, (N,) [rad/s or m/s]."""
    motion = reactions.motion
    moving = kinematics.mechanism_motion(
        parameters.geometry, motion.pose, motion.velocity, motion.acceleration
    )
    omega = {name: body.omega for name, body in moving.bodies.items()}
    found = {}
    for i, joint in enumerate(JOINTS):
        if joint.name in SLIDES:
            found[joint.name] = moving.bodies[joint.successor].at(np.zeros(3))[1][:, 2]
            continue
        axis = reactions.rotations[:, i, :, 1]
        relative = omega[joint.successor] - omega[joint.predecessor]
        found[joint.name] = np.einsum("ni,ni->n", relative, axis)
    return found


def _mean(load: FloatArray, rate: FloatArray, time: FloatArray, exponent: float) -> tuple[float, float]:
    """Return the mean load over a way or an angle, and how long that is."""
    way = float(np.trapezoid(np.abs(rate), time))
    if way == 0:
        return math.nan, 0.0
    return float(np.trapezoid(load**exponent * np.abs(rate), time) / way) ** (1 / exponent), way


def _times(rating: float, mean: float, exponent: float) -> float:
    """Return how often a rating holds; for ever without a load or a way."""
    if not mean > 0:
        return math.inf
    logarithm = exponent * math.log10(rating / mean)
    return math.inf if logarithm > 300 else 10**logarithm


def _bearing(
    reactions: Reactions,
    joint: str,
    bearing: Bearing,
    rate: FloatArray,
    cycle: float,
    needed: RequiredLife | None,
) -> BearingLife:
    forces, time = reactions[joint].forces, reactions.time
    radial, axial = np.hypot(forces[:, 0], forces[:, 2]), np.abs(forces[:, 1])
    load, static = bearing.equivalent(radial, axial), bearing.static_equivalent(radial, axial)
    mean, angle = _mean(load, rate, time, bearing.exponent)
    turns = angle / (2 * math.pi)
    life = 1e6 * _times(bearing.dynamic, mean, bearing.exponent)
    hours = life / turns * cycle / 3600 if turns else math.inf
    steps = np.diff(time) * (rate[1:] + rate[:-1]) / 2
    way = np.concatenate([[0.0], np.cumsum(steps)])
    peaks = [(float(each.max()), float(time[each.argmax()])) for each in (load, static)]
    required = math.nan if needed is None else needed.hours_of(cycle)
    swing = float(np.ptp(way))
    return BearingLife(joint, bearing, mean, *peaks[0], *peaks[1], turns, swing, life, hours, required)


def _guide(
    reactions: Reactions,
    joint: str,
    guide: Guide,
    rate: FloatArray,
    cycle: float,
    needed: RequiredLife | None,
) -> GuideLife:
    one, time = reactions[joint], reactions.time
    forces, moments = guide.parts(one.forces, one.moments)
    load = guide.equivalent(one.forces, one.moments)
    means = [_mean(column, rate, time, guide.exponent) for column in load.T]
    mean, way = max(means)
    life = guide.basis * _times(guide.dynamic, mean, guide.exponent)
    hours = life / way * cycle / 3600 if way else math.inf
    bare = forces + moments
    shares = np.divide(moments, bare, out=np.zeros_like(bare), where=bare > 0).mean(axis=1)
    share = float(np.trapezoid(shares, time) / (time[-1] - time[0]))
    at = int(load.max(axis=1).argmax())
    peak = float(load[at].max()), float(time[at])
    required = math.nan if needed is None else needed.hours_of(cycle, way)
    each = tuple(mean for mean, _ in means)
    return GuideLife(joint, guide, mean, *peak, way, share, life, hours, required, each)


def rod_check(parameters: Parameters, reactions: Reactions, name: str, section: RodSection) -> RodCheck:
    """Return what a leg or rod bears over a cycle."""
    length, mass = parameters.geometry.L, getattr(parameters.bodies, name).mass
    along = np.concatenate([reactions[joint].forces[:, 0] for joint in _ENDS[name][:1]])
    lower = _ENDS[name][1]
    if lower == "hinge_lower":  # its reaction stands in the axes of the cross-bar
        i, k = reactions.joints.index(lower), reactions.joints.index(_ENDS[name][0])
        turned = np.einsum("nji,njk->nik", reactions.rotations[:, k], reactions.rotations[:, i])
        tip = np.einsum("nij,nj->ni", turned, reactions[lower].forces)[:, 0]
    else:
        tip = reactions[lower].forces[:, 0]
    thrust = np.concatenate([along, tip])  # of the upper end on the rod, and of the rod on what is below
    bending = math.pi * section.radius(length, mass) ** 4 / 4
    stiff = section.young * bending
    at = int(thrust.argmax()) % len(reactions.time)
    return RodCheck(
        name,
        float(max(thrust.max(), 0.0)),
        float(reactions.time[at]) if thrust.max() > 0 else math.nan,
        float(max(-thrust.min(), 0.0)),
        math.pi**2 * stiff / length**2,
        math.pi / (2 * length**2) * math.sqrt(stiff * length / mass),
    )


def _warnings(
    bearings: list[BearingLife], guides: list[GuideLife], rods: tuple[RodCheck, ...]
) -> tuple[str, ...]:
    """Return what to know before the numbers are used."""
    parts: list[BearingLife | GuideLife] = [*bearings, *guides]
    told = [
        f"{rod.rod} buckles at {rod.buckling:.4g} N, {rod.buckling_safety:.2g} times its compression; "
        f"{_SAFE['buckling']:g} times are usual"
        for rod in rods
        if rod.buckling_safety < _SAFE["buckling"]
    ]
    for one in parts:
        asked = (one.bearing if isinstance(one, BearingLife) else one.guide).static_safety
        if one.static_safety < asked:
            told.append(
                f"{one.joint}: static safety {one.static_safety:.2g} at t = {one.static_time:.4g} s, "
                f"less than {asked:g}"
            )
    told += [
        f"{one.joint}: {number(one.hours)} h of life, {number(one.required)} h are required"
        for one in parts
        if one.hours < one.required
    ]
    heavy = [guide for guide in guides if guide.moment_share > _OFTEN and guide.guide.distance is None]
    if heavy:
        share = max(guide.moment_share for guide in heavy)
        names = ", ".join(guide.joint for guide in heavy)
        told.append(
            f"{names}: up to {share:.0%} of the load comes from moments; two carriages on each rail "
            "would carry them as small forces"
        )
    small = [one for one in bearings if one.swing < _SMALL]
    if small:
        told.append(
            f"{len(small)} hinges oscillate by less than {math.degrees(_SMALL):.0f}°: rolling elements may "
            "wear the part of the raceway that they roll on (false brinelling), which L10 does not include; "
            "what to do is told for each"
        )
    if any(one.hours > LONG for one in parts):
        told.append(
            f"lives above {LONG:,.0f} h are no prediction: lubrication, dirt and wear end them before"
        )
    return tuple(told)


def _misfits(reactions: Reactions, bearings: list[BearingLife]) -> list[str]:
    """Return what assembly errors add to the loads of bearings at worst, where that is much."""
    added = {one.joint: reactions[one.joint].fit[:, 0][:, [0, 2]] for one in bearings}
    most = {joint: float(np.hypot(*fit.T).max()) for joint, fit in added.items()}
    large = [
        f"{one.joint} {most[one.joint]:.3g} N"
        for one in sorted(bearings, key=lambda one: -most[one.joint])
        if most[one.joint] > _MUCH * one.peak_load
    ]
    if not large:
        return []
    return [
        f"assembly errors add up to {', '.join(large[:_FEW])} across the axis, which lives and safety "
        "factors do not include"
    ]
