"""The engineer's report: whether a machine fits a task, and all that this rests on."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from p3dof._base.checks import require, shown
from p3dof._base.errors import InputError
from p3dof._base.tables import number, percent
from p3dof.analysis.reactions import how_chosen, names_table, reactions_table
from p3dof.design.assessment import (
    Assessment,
    as_result,
    assumptions,
    loads_table,
    needs_table,
    short,
    uses_table,
)
from p3dof.design.bearings import advice_table, bearings_table, guides_table, rods_table
from p3dof.design.clearance import clearance_table
from p3dof.design.design_comparison import DesignComparison, comparison_table, verdicts_table
from p3dof.design.drives import (
    axes_table,
    nuts_table,
    ranking_table,
    ratings_table,
    stops_table,
    supply_table,
)
from p3dof.design.fastest import sizing_table
from p3dof.design.forces_of_tasks import TaskForces, forces_of_task, pieces_table, without_jumps
from p3dof.machine.motion import motion_table
from p3dof.machine.parameters import parameter_tables, payload_table
from p3dof.manipulator import Manipulator
from p3dof.methods import limits_table
from p3dof.report import plots
from p3dof.report.plots.mechanism import mechanism_figure
from p3dof.report.templates import Heading, Picture, picture, rendered, template, write_report

_ALTERNATIVES = 8


@dataclass(frozen=True)
class AssessmentPictures:
    """The pictures of the report on an assessment."""

    mechanism: Picture  # the machine, how much of the ratings is used, and forces over the cycle
    used: Picture
    forces: Picture
    task: Picture | None  # of a task; of drives, if some were chosen
    drives: Picture | None
    clearance: Picture | None  # of the nearest parts, if their distances were asked for


def render_assessment(found: Assessment, **heading: Any) -> str:
    """Return the report on an assessment as one HTML page that loads nothing from elsewhere; the page.

    Its first lines say whether the machine fits, which rating is worst, when, where and by how much. Around
    the numbers stand ``title``, ``about``, ``command``, ``page``, ``picture`` and ``date``.
    """
    require("found", found, Assessment)
    page_of = template("assessment.html.j2")
    words = Heading(**heading).words(found.name)
    return rendered(page_of, words | _answer(found) | _content(found))


def write_assessment(path: str | os.PathLike[str], found: Assessment, **options: Any) -> Path:
    """Write the report on an assessment to a file.

    Parameters
    ----------
    path : path-like
        The file, replaced whole or not at all: ``.html``, or ``.pdf``, which a Chromium prints.
    found : Assessment
        Of `p3dof.assess`.
    **options
        As of `render_assessment`.

    Raises
    ------
    InputError
        If the name ends in something else, or an argument does not fit.
    FileError
        If the file cannot be written.
    MissingExtraError
        If Jinja2 or matplotlib is not installed, or playwright or a browser for a PDF.
    """
    return write_report(path, lambda: render_assessment(found, **options))


def moving_page(found: Assessment) -> Any:
    """Return the page in which the machine moves over the cycle, with the loads of its joints if known."""
    reactions = found.reactions
    if reactions is not None and isinstance(found.found, TaskForces):
        reactions = without_jumps(reactions, found.found.plan)
    result, clearance = as_result(found.found), found.clearance
    if clearance is not None and not np.array_equal(clearance.pose, result.motion.pose):
        clearance = None  # of other samples, or of a workspace
    return found.robot.page(result, reactions=reactions, clearance=clearance, title=found.name)


def _answer(found: Assessment) -> dict[str, Any]:
    """Return what the first lines say."""
    one = found.worst
    given, back, where = _energy(found)
    return {
        "fits": found.fits,
        "answer": found.answer,
        "reserve": found.worst.verdict,
        "reason": found.reason,
        "unchecked": found.unchecked,
        "chosen": None if found.drives is None else found.drives.name,
        "energy": f"{short(given)} J supplied, {short(back)} J regenerated {where}",
        "key": {
            "used most": f"{one.name} of {one.part}: {percent(one.share)}",
            "when": one.when,
            "cycle": f"{number(found.cycle_time)} s",
            "cycles an hour": f"{3600 / found.cycle_time:.0f}",
            "energy a cycle": f"{short(given)} J",
            "mean power": f"{short(given / found.cycle_time)} W",
        },
        "owner": "task" if one.kind == "task" else "machine",
        "warnings": found.warnings,
        "uses": uses_table(found, 12),
    }


def _energy(found: Assessment) -> tuple[float, float, str]:
    """Return the work that is given and taken back over a cycle [J], and where."""
    if found.drives is None:
        return (*found.slider_energy, "at the sliders, on a common bus without losses")
    sizing = found.drives
    return sizing.bus_positive_work, sizing.bus_negative_work, "by the motors' shafts, on a common bus"


def _content(found: Assessment) -> dict[str, Any]:
    """Return what the template shows of the numbers."""
    parameters, forces = found.robot.parameters, found.found
    task = isinstance(forces, TaskForces)
    motion = forces.plan.motion if isinstance(forces, TaskForces) else forces.motion
    report, sizing = found.bearings, found.drives
    shown_of = (bearings_table, guides_table, rods_table, advice_table)
    lives = [] if report is None else [table(report) for table in shown_of]
    lives += [] if sizing is None else [nuts_table(sizing)]
    return {
        "pictures": _pictures(found),
        "loads": loads_table(found),
        "limits": (
            sizing_table(forces, parameters.limits, found.limits)
            if isinstance(forces, TaskForces)
            else limits_table(forces, parameters.limits)
        ),
        "pieces": pieces_table(forces) if isinstance(forces, TaskForces) else None,
        "needs": needs_table(found) if sizing is None else None,
        "axes": None if sizing is None else axes_table(sizing),
        "ratings": None if sizing is None else ratings_table(sizing, found.place if task else None),
        "clearance": None if found.clearance is None else clearance_table(found.clearance),
        "supply": None if sizing is None or sizing.supply is None else supply_table(sizing.supply),
        "stops": stops_table(found.stops) if found.stops else None,
        "ranking": ranking_table(found.ranked, _ALTERNATIVES) if len(found.ranked) > 1 else None,
        "lives": [table for table in lives if table.rows],
        "reactions": None if found.reactions is None else reactions_table(found.reactions),
        "undecided": None if found.reactions is None else how_chosen(found.reactions),
        "names": names_table(),
        "assumptions": assumptions(found),
        "agreement": _agreement(found),
        "motion": motion_table(motion, as_result(forces).wrench),
        "parameters": parameter_tables(parameters),
        "payload": payload_table(parameters),
    }


def _agreement(found: Assessment) -> str:
    """Say how well the two methods agree on the forces, which are worked out by both here."""
    both = []
    for method in ("pinocchio", "virtual-power"):
        if isinstance(found.found, TaskForces):
            both.append(forces_of_task(found.robot, found.found.plan, method).forces)
        else:
            given = found.found
            both.append(found.robot.inverse_dynamics(given.motion, wrench=given.wrench, method=method).forces)
    results = found.found.results if isinstance(found.found, TaskForces) else (found.found,)
    apart = ", without load-dependent friction" * any(one.coulomb is not None for one in results)
    gap, most = float(np.abs(both[0] - both[1]).max()), float(np.abs(both[1]).max())
    told = (
        f"Pinocchio and virtual powers differ by {gap:.1e} N at most, {gap / most:.1e} of the largest force"
    )
    return told + apart


def _pictures(found: Assessment) -> AssessmentPictures:
    robot: Manipulator = found.robot
    forces = found.found
    motion = forces.plan.motion if isinstance(forces, TaskForces) else forces.motion
    time = found.worst.time
    row = 0 if np.isnan(time) else int(np.abs(motion.time - time).argmin())
    span = f"over the cycle of {found.cycle_time:.4g} s"
    return AssessmentPictures(
        mechanism=picture(
            mechanism_figure(robot, motion.pose[row], motion),
            "Drawing of the mechanism from the front, the side, the top and at an angle, with the joints.",
            f"The mechanism at t = {motion.time[row]:.4g} s and the path of P.",
        ),
        used=picture(
            plots.utilisation_figure(found),
            f"Bars of the utilisation of each rating. {found.verdict}.",
            "Utilisation of each rating, by axis.",
        ),
        forces=picture(
            plots.axis_forces_figure(found),
            f"Forces of A, B and C {span}.",
            "Forces at the nuts, and those of the motors at the sliders; dotted lines are the waypoints."
            if found.drives is not None
            else "Forces of the sliders; dotted lines are the waypoints.",
        ),
        task=(
            picture(
                plots.task_figure(forces),
                f"The path of the platform, pose, slider speeds and forces {span}.",
                "Path, pose, slider speeds and forces; shaded while something is carried.",
            )
            if isinstance(forces, TaskForces)
            else None
        ),
        drives=(
            None
            if found.drives is None
            else picture(
                plots.drives_figure(found.drives, found.cycle),
                "Torque over speed of each motor within its curves.",
                "Torque over speed: the cycle is the curve, its root mean square the dot; the curve must "
                "stay in the light area, the dot in the dark one."
                + (
                    ""
                    if found.drives.supply is None
                    else " Beside them, the voltage of the bus in steady state."
                ),
            )
        ),
        clearance=(
            None
            if found.clearance is None
            else picture(
                plots.clearance_figure(found.clearance),
                f"Least distances of the nearest parts. {found.clearance.verdict}.",
                "Least distances of the nearest parts; the dashed line is the distance required.",
            )
        ),
    )


_TITLE = "Designs side by side"


def render_designs(found: Sequence[DesignComparison], **heading: Any) -> str:
    """Return comparisons of designs as one HTML page that loads nothing from elsewhere; the page.

    Around the numbers stand ``title``, ``about``, ``command`` and ``date``.
    """
    if not found or not all(isinstance(one, DesignComparison) for one in found):
        raise InputError(f"found: expected DesignComparison objects, got {shown(found)}")
    page_of = template("designs.html.j2")
    words = Heading(**heading).words(_TITLE)
    told = {one.name: assumptions(one) for part in found for one in part.assessments}
    common = [
        (topic, value)
        for topic, value in next(iter(told.values())).items()
        if all(other.get(topic) == value for other in told.values())
    ]
    own = [
        (name, {topic: value for topic, value in one.items() if (topic, value) not in common})
        for name, one in told.items()
    ]
    words["parts"] = [_part(one) for one in found]
    words["assumptions"] = [("All of them", dict(common)), *(pair for pair in own if pair[1])]
    return rendered(page_of, words)


def write_designs(path: str | os.PathLike[str], found: Sequence[DesignComparison], **options: Any) -> Path:
    """Write comparisons of designs to a file; the path written."""
    return write_report(path, lambda: render_designs(found, **options))


def _part(found: DesignComparison) -> dict[str, Any]:
    names = ", ".join(found.names)
    return {
        "title": found.title,
        "fits": all(one.fits for one in found.assessments),
        "verdicts": [(one.name, one.verdict, one.unchecked) for one in found.assessments],
        "table": comparison_table(found),
        "ratings": verdicts_table(found),
        "picture": picture(
            plots.comparison_figure(found),
            f"Forces and speeds of A, B and C over time, of {names}.",
            "Forces and speeds of the sliders, overlaid.",
        ),
        "warnings": [(one.name, one.warnings) for one in found.assessments],
    }
