"""Tables of drives: how they rank, what a cycle takes of each axis, and of which ratings."""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path

from p3dof._base.files import suffix_of, write_atomic
from p3dof._base.tables import NONE, Table, html_of, notebook_html, number, percent, table_of
from p3dof.design.drives.sizing import Rating, Sizing
from p3dof.design.drives.unchecked import not_checked
from p3dof.machine.parameters import LEGS

_RPM = 30 / math.pi


def ranking_table(found: Sequence[Sizing], most: int = 10) -> Table:
    """Return the first of ranked drives: whether they fit, and which rating is used most.

    Parameters
    ----------
    found : sequence of Sizing
        In their order.
    most : int
        How many to list.

    Returns
    -------
    Table
    """
    rows: list[tuple[str, ...]] = []
    for sizing in found[:most]:
        leg, rating = sizing.worst
        axes = [percent(axis.worst.share, 0) for axis in sizing.axes]
        fits = "yes" if sizing.fits else "no"
        name = sizing.drives[0].name
        rows.append((name, fits, f"{rating.name} of {leg}", *axes, number(sizing.bus_peak_power)))
    header = ("drive", "fits", "most used", *(f"{leg} used" for leg in LEGS), "bus [W]")
    left = len(found) - most
    fitting = sum(sizing.fits for sizing in found)
    note = f"{fitting} of {len(found)} fit." + (f" {left} more are not listed." if left > 0 else "")
    return Table("Drives", header, tuple(rows), note)


def axes_table(sizing: Sizing) -> Table:
    """Return what a cycle takes of the drive of each axis.

    Parameters
    ----------
    sizing : Sizing
        Of one drive on each axis.

    Returns
    -------
    Table
    """
    axes = sizing.axes
    rows = {
        "peak torque [N m]": [number(axis.peak_torque) for axis in axes],
        "at t [s]": [number(axis.peak_time) for axis in axes],
        "inertia's share there": [f"{axis.peak_inertia_share:.0%}" for axis in axes],
        "rms torque [N m]": [number(axis.rms_torque) for axis in axes],
        "the same, brake closed at rest [N m]": [number(axis.braked_rms_torque) for axis in axes],
        "top speed [rpm]": [number(_RPM * axis.top_speed) for axis in axes],
        "rms speed [rpm]": [number(_RPM * axis.rms_speed) for axis in axes],
        "peak power [W]": [number(axis.peak_power) for axis in axes],
        "work given [J]": [number(axis.positive_work) for axis in axes],
        "work taken back [J]": [number(axis.negative_work) for axis in axes],
        "inertia of load by rotor": [_range(axis.inertia_ratio) for axis in axes],
        "lead of least rms torque [mm]": [_lead(axis.best_lead) for axis in axes],
        "reflected mass [kg]": [number(drive.reflected_mass) for drive in sizing.drives],
    }
    note = (
        f"On a common bus: {number(sizing.bus_positive_work)} J given, {number(sizing.bus_negative_work)} J "
        f"taken back, at most {number(sizing.bus_peak_power)} W and {number(sizing.bus_peak_braking)} W."
    )
    return table_of(sizing.drives[0].name, ("of the motor", *LEGS), rows, note)


def ratings_table(sizing: Sizing, where: Callable[[float], str] | None = None) -> Table:
    """Return how much of each rating is used, when and on which part of the way.

    Parameters
    ----------
    sizing : Sizing
        Of one drive on each axis.
    where : callable, optional
        Time to the name of a part of the cycle.

    Returns
    -------
    Table
    """
    rows: dict[str, tuple[str, ...]] = {}
    for leg, axis in zip(LEGS, sizing.axes, strict=True):
        for rating in sorted(axis.ratings, key=lambda one: -one.share):
            whole = math.isnan(rating.time)
            place = "over the cycle" if whole else ("" if where is None else where(rating.time))
            name = f"{leg}: {rating.name}" + (f" [{rating.unit}]" if rating.unit else "")
            share = percent(rating.share)
            values = number(rating.required), number(rating.allowed)
            rows[name] = (*values, share, NONE if whole else number(rating.time), place)
    header = ("rating", "required", "allowed", "used", "at t [s]", "on the way")
    return table_of("How much of the ratings is used", header, rows)


def verdict(sizing: Sizing, where: Callable[[float], str] | None = None) -> str:
    """Return whether drives fit, and which rating is used most; all that are exceeded, the farthest first.

    Parameters
    ----------
    sizing : Sizing
        Of one drive on each axis.
    where : callable, optional
        Time to the name of a part of the cycle.

    Returns
    -------
    str
    """
    named = [_words(leg, rating, where) for leg, rating in sizing.exceeded or (sizing.worst,)]
    return f"{'fits' if sizing.fits else 'does not fit'}: {'; '.join(named)}"


def _words(leg: str, rating: Rating, where: Callable[[float], str] | None) -> str:
    if rating.share == math.inf:
        much = f"takes {number(rating.required)} {rating.unit} where none is allowed"
    else:
        much = f"is used to {percent(rating.share, 0)}"
    if math.isnan(rating.time):
        return f"{rating.name} of {leg} {much}, over the cycle"
    place = f", {where(rating.time)}" if where is not None else ""
    return f"{rating.name} of {leg} {much}, at t = {number(rating.time)} s{place}"


@html_of.register(Sizing)
def sizing_html(sizing: Sizing) -> str:
    """Return how a notebook shows drives on their axes, as HTML."""
    facts = f"{verdict(sizing)}. Not checked: {'; '.join(not_checked(sizing))}."
    return notebook_html("Drives", facts, [axes_table(sizing), ratings_table(sizing)])


def _lead(lead: float) -> str:
    return NONE if math.isnan(lead) else number(1e3 * lead)


def _range(ends: tuple[float, float]) -> str:
    low, high = ends
    if math.isnan(low):
        return NONE
    return number(round(low, 2)) if math.isclose(low, high) else f"{low:.2g} to {high:.2g}"


def write_ranking(found: Sequence[Sizing], path: str | os.PathLike[str]) -> Path:
    """Write ranked drives to a CSV file: whether they fit, and how much of each rating of each axis is used.

    Parameters
    ----------
    found : sequence of Sizing
        In their order.
    path : path-like
        The file; replaced whole or not at all.

    Returns
    -------
    Path
        The path written.

    Raises
    ------
    InputError
        If its name does not end in ``.csv``.
    FileError
        If the file cannot be written.
    """
    suffix_of(path, "table")
    names = list(
        dict.fromkeys(rating.name for sizing in found for axis in sizing.axes for rating in axis.ratings)
    )
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["drive", "fits", *(f"{name} {leg} used" for leg in LEGS for name in names)])
    for sizing in found:
        shares = [
            {rating.name: f"{rating.share:.17g}" for rating in axis.ratings}.get(name, "")
            for axis in sizing.axes
            for name in names
        ]
        writer.writerow([sizing.drives[0].name, int(sizing.fits), *shares])
    return write_atomic(path, text.getvalue())
