"""Tables of drives: how they rank, what a cycle takes of each axis, and of which ratings."""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path

from p3dof._base.files import suffix_of, write_atomic
from p3dof._base.tables import NONE, Cell, Table, html_of, notebook_html, number, percent, table_of
from p3dof.design.drives.margins import VERDICTS
from p3dof.design.drives.sizing import RPM, Rating, Sizing
from p3dof.design.drives.transmission import USUAL_PRELOAD, Drive, Gear, Rack, Screw
from p3dof.machine.parameters import LEGS


def not_checked(sizing: Sizing) -> tuple[str, ...]:
    """Return what was not checked of drives, in words, by the field of the catalogue that has no number."""
    found: dict[str, None] = {}
    required = any(rating.name == "life" for axis in sizing.axes for rating in axis.ratings)
    for drive in dict.fromkeys(sizing.drives):
        found |= dict.fromkeys((*_of_motor(drive), *_of_gear(drive), *_of_transmission(drive, required)))
    if sizing.supply is None:
        found |= {"bus voltage and braking resistor over all axes (no supply)": None}
    return tuple(found)


def _of_motor(drive: Drive) -> list[str]:
    motor, name = drive.motor, drive.motor.name
    known = {
        f"heat of {name} within the cycle (no time_constant)": motor.time_constant is not None,
        f"load by rotor inertia of {name} (max_inertia_ratio allows any)": motor.max_inertia_ratio
        != math.inf,
        f"power of the amplifier of {name} (no max_power)": motor.max_power < math.inf,
        f"braking power of amplifier and resistor of {name} (no max_braking_power)": motor.max_braking_power
        < math.inf,
        f"holding when the power fails ({name} has no brake_torque)": motor.brake_torque > 0,
        f"currents of {name} (no amplifier)": motor.amplifier is not None,
    }
    return [words for words, checked in known.items() if not checked]


def _of_gear(drive: Drive) -> list[str]:
    gear = drive.gear
    unnamed = gear.name == Gear().name
    if gear.ratio == 1 and unnamed:
        return []
    name = "the gear" if unnamed else gear.name
    known = {
        f"speed of {name} (no max_speed)": gear.max_speed < math.inf,
        f"torque of {name} (no max_torque)": gear.max_torque < math.inf,
        f"life of {name}": False,
    }
    return [words for words, checked in known.items() if not checked]


def _of_transmission(drive: Drive, required: bool) -> list[str]:
    part = drive.transmission
    if not isinstance(part, Screw):
        known = {
            f"speed of {part.name} (no max_speed)": part.max_speed < math.inf,
            f"strength of {part.name} (no max_force)": part.max_force < math.inf,
            f"life of {part.name}, which its maker knows": False,
        }
        if not isinstance(part, Rack):
            known[f"slack and tension of {part.name} (no pretension, no max_tension)"] = (
                part.pretension > 0 and part.max_tension < math.inf
            )
        return [words for words, checked in known.items() if not checked]
    known = {
        f"speed of the nut of {part.name} (max_speed allows any)": part.max_speed != math.inf,
        f"critical speed and buckling of {part.name} (no diameter and length)": part.critical_speed
        < math.inf,
        f"life of the nut of {part.name} (no dynamic rating)": part.dynamic is not None,
        f"whether the life of the nut of {part.name} suffices (no life was required)": required
        or part.dynamic is None,
        f"static load of the nut of {part.name} (no static rating)": part.static is not None,
        f"drag of the preload of {part.name} (no drag, no nominal_diameter in the file)": part.drag > 0
        or part.preload_force == 0,
    }
    return [words for words, checked in known.items() if not checked]


FALLS = "no end within the travel: the axis falls or runs on, as no brake stops it in time (see brake_torque)"
"""What is said of a way that is infinite."""
YES = dict(zip(VERDICTS, ("yes", "no reserve", "no"), strict=True))
"""Verdicts in a column of a table."""


def ranking_table(found: Sequence[Sizing], most: int = 10) -> Table:
    """Return the first of ranked drives: whether they fit, and which rating is used most."""
    rows: list[tuple[str, ...]] = []
    for sizing in found[:most]:
        leg, rating = sizing.worst
        axes = [percent(axis.worst.share, 0) for axis in sizing.axes]
        fits, name = YES[sizing.verdict], sizing.name
        rows.append((name, fits, f"{rating.name} of {leg}", *axes, number(sizing.bus_peak_power)))
    header = ("drive", "fits", "critical rating", *(f"{leg} used" for leg in LEGS), "bus [W]")
    left = len(found) - most
    fitting = sum(sizing.fits for sizing in found)
    note = f"{fitting} of {len(found)} fit with their margins." + (
        f" {left} more are not listed." if left > 0 else ""
    )
    return Table("Drives", header, tuple(rows), note)


def axes_table(sizing: Sizing) -> Table:
    """Return what a cycle takes of the drive of each axis."""
    axes = sizing.axes
    rows: dict[str, Sequence[str]] = {
        "peak torque [N m]": [number(axis.peak_torque) for axis in axes],
        "at t [s]": [number(axis.peak_time) for axis in axes],
        "share of inertia there": [percent(axis.peak_inertia_share, 0) for axis in axes],
        "rms torque [N m]": [number(axis.rms_torque) for axis in axes],
        "rms torque, brake closed at rest [N m]": [number(axis.braked_rms_torque) for axis in axes],
        "top speed [rpm]": [number(RPM * axis.top_speed) for axis in axes],
        "rms speed [rpm]": [number(RPM * axis.rms_speed) for axis in axes],
        "peak power [W]": [number(axis.peak_power) for axis in axes],
        "work supplied [J]": [number(axis.positive_work) for axis in axes],
        "work regenerated [J]": [number(axis.negative_work) for axis in axes],
        "ratio of load to rotor inertia": [_range(axis.inertia_ratio) for axis in axes],
        "lead for minimum rms torque [mm]": [_lead(axis.best_lead) for axis in axes],
        "reflected mass [kg]": [number(drive.reflected_mass) for drive in sizing.drives],
    }
    note = (
        f"On a common bus: {number(sizing.bus_positive_work)} J supplied, "
        f"{number(sizing.bus_negative_work)} J regenerated, "
        f"at most {number(sizing.bus_peak_power)} W and {number(sizing.bus_peak_braking)} W."
    )
    return table_of(sizing.name, ("of the motor", *LEGS), rows, note)


def ratings_table(sizing: Sizing, where: Callable[[float], str] | None = None) -> Table:
    """Return how much of each rating is used, when and on which part of the way."""
    rows: dict[str, tuple[str, ...]] = {}
    owners = {leg: list(axis.ratings) for leg, axis in zip(LEGS, sizing.axes, strict=True)}
    for owner, rating in sizing.others:
        owners.setdefault(owner, []).append(rating)
    for leg, ratings in owners.items():
        for rating in sorted(ratings, key=lambda one: -one.share):
            whole = math.isnan(rating.time)
            place = "over the cycle" if whole else ("" if where is None else where(rating.time))
            name = f"{leg}: {rating.name}" + (f" [{rating.unit}]" if rating.unit else "")
            share = percent(rating.share)
            values = number(rating.required), number(rating.allowed)
            rows[name] = (
                *values,
                share,
                percent(1 - rating.margin, 0),
                NONE if whole else number(rating.time),
                place,
            )
    header = ("rating", "required", "rated", "used", "limit", "at t [s]", "segment")
    return table_of("Utilisation of ratings", header, rows)


def nuts_table(sizing: Sizing) -> Table:
    """Return how long the ball nuts live; without rows where no dynamic rating is known."""
    pairs = list(zip(sizing.axes, sizing.drives, strict=True))
    if all(axis.nut is None for axis, _ in pairs):
        return Table("Ball nuts", ("of the nut", *LEGS), ())
    rows: dict[str, list[Cell]] = {
        "preload [N]": [],
        "largest force [N]": [],
        "at t [s]": [],
        "turns per cycle": [],
        "mean speed [rpm]": [],
        "mean load, flank pressed upwards [N]": [],
        "mean load, other flank [N]": [],
        "L10 [Mrev]": [],
        "L10 [h]": [],
        "static safety": [],
        "drag of preload [N m]": [],
        "lead deviation over 300 mm [µm]": [],
    }
    for axis, drive in pairs:
        part, nut = drive.transmission, axis.nut
        values: list[float] = [math.nan] * len(rows)
        if nut is not None and isinstance(part, Screw):
            safety = math.inf if part.static is None else part.static / nut.largest
            values = [
                nut.preload, nut.largest, nut.largest_time, nut.turns, RPM * nut.mean_speed,
                *nut.mean_loads, nut.life / 1e6, nut.hours, safety, part.drag, 1e6 * part.lead_deviation,
            ]  # fmt: skip
        for cells, value in zip(rows.values(), values, strict=True):
            cells.append(number(value) if math.isfinite(value) else NONE)
    silent = dict.fromkeys(
        drive.transmission.name
        for drive in sizing.drives
        if isinstance(drive.transmission, Screw) and drive.transmission.dynamic is not None
        and drive.transmission.preload is None
    )  # fmt: skip
    note = "Life of both flanks together (ISO 3408-5), all turns counted, dwells in the hours."
    if silent:
        note += f" Preload of {', '.join(silent)}: {USUAL_PRELOAD:.0%} of the dynamic rating, assumed."
    return table_of("Ball nuts", ("of the nut", *LEGS), rows, note)


def verdict(sizing: Sizing, where: Callable[[float], str] | None = None) -> str:
    """Return whether drives fit, with which reserve, or which ratings are exceeded, the farthest first.

    Parameters
    ----------
    sizing : Sizing
        Of one drive on each axis.
    where : callable, optional
        Time to the name of a part of the cycle.
    """
    broken = sizing.exceeded or sizing.without_reserve
    if not broken:
        leg, rating = sizing.worst
        least = f"{rating.name} of {leg}, {_when(rating, where)}"
        return f"fits with {percent(1 - rating.share, 0)} reserve; the least is {least}"
    told = [_words(leg, rating, where) for leg, rating in broken]
    more = len(sizing.without_reserve) if sizing.exceeded else 0
    also = f"; {more} more without reserve" if more else ""
    return f"{sizing.verdict}: {'; '.join(told)}{also}"


def _words(leg: str, rating: Rating, where: Callable[[float], str] | None) -> str:
    if rating.share == math.inf:
        much = f"takes {number(rating.required)} {rating.unit} where none is permissible"
        if rating.required == math.inf:
            much = f"has {FALLS}"
    else:
        much = f"has a utilisation of {percent(rating.share, 0)}"
    if rating.verdict == VERDICTS[1]:
        much += f" ({percent(1 - rating.margin, 0)} keep the margin)"
    return f"{rating.name} of {leg} {much}, {_when(rating, where)}"


def _when(rating: Rating, where: Callable[[float], str] | None) -> str:
    if math.isnan(rating.time):
        return "over the cycle"
    place = f", {where(rating.time)}" if where is not None else ""
    return f"at t = {number(rating.time)} s{place}"


def caveats(sizing: Sizing) -> tuple[str, ...]:
    """Return what the verdict on drives rests on: defaults in place of numbers, and remarks."""
    assumed = f"assumed: {'; '.join(sizing.assumed)}" if sizing.assumed else ""
    return (*([assumed] if assumed else []), *sizing.remarks)


@html_of.register(Sizing)
def sizing_html(sizing: Sizing) -> str:
    """Return how a notebook shows drives on their axes, as HTML."""
    facts = f"{verdict(sizing)}. Not checked: {'; '.join(not_checked(sizing))}."
    tables = [axes_table(sizing), ratings_table(sizing), nuts_table(sizing)]
    return notebook_html("Drives", facts, [table for table in tables if table.rows], caveats(sizing))


def _lead(lead: float) -> str:
    return NONE if math.isnan(lead) else number(1e3 * lead)


def _range(ends: tuple[float, float]) -> str:
    low, high = ends
    if math.isnan(low):
        return NONE
    return number(low, form=".2f") if math.isclose(low, high) else f"{low:.2g} to {high:.2g}"


def write_ranking(found: Sequence[Sizing], path: str | os.PathLike[str]) -> Path:
    """Write ranked drives to a CSV file: whether they fit, and how much of each rating of each axis is used.

    The path written.
    """
    suffix_of(path, "table")
    each = [_owned(sizing) for sizing in found]
    columns = list(dict.fromkeys((owner, name) for one in each for owner, name in one))
    columns.sort(key=lambda one: [*LEGS, one[0]].index(one[0]))
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["drive", "verdict", *(f"{name} {owner} used" for owner, name in columns)])
    for sizing, shares in zip(found, each, strict=True):
        cells = (f"{shares[one]:.17g}" if one in shares else "" for one in columns)
        writer.writerow([sizing.name, sizing.verdict, *cells])
    return write_atomic(path, text.getvalue())


def _owned(sizing: Sizing) -> dict[tuple[str, str], float]:
    """Return how much of each rating is used, by owner and name."""
    axes = [(leg, rating) for leg, axis in zip(LEGS, sizing.axes, strict=True) for rating in axis.ratings]
    return {(owner, rating.name): rating.share for owner, rating in (*axes, *sizing.others)}
