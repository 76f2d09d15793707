"""The report: what was computed about a motion, put into one page."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, Progress, require
from p3dof._base.errors import InputError
from p3dof._base.samples import OnInvalid
from p3dof.analysis.energy import Energy, balance_table, bodies_table, drives_table
from p3dof.analysis.reactions import (
    ALL,
    AnyReactions,
    Choice,
    Stiffness,
    how_chosen,
    names_table,
    open_tables,
    reactions_table,
)
from p3dof.machine.motion import Motion, WrenchOverTime, motion_table
from p3dof.machine.parameters import LEGS, parameter_tables, payload_table
from p3dof.manipulator import Manipulator
from p3dof.methods import evidence_table, limits_table
from p3dof.methods.comparison import Comparison, agreement_table
from p3dof.report.templates import Heading, Pictures, pictures_of, rendered, template, write_report

TITLE = "Inverse dynamics of a 3-DOF spatial parallel manipulator"


@dataclass(frozen=True, eq=False)
class Findings:
    """What a report tells about a motion."""

    robot: Manipulator  # the machine
    motion: Motion  # its motion
    comparison: Comparison  # the forces by Pinocchio, by virtual powers and by the kernels
    energy: Energy  # of the forces by Pinocchio
    reactions: AnyReactions  # in all joints


def render(
    robot: Manipulator,
    motion: Motion,
    wrench: WrenchOverTime = None,
    on_invalid: OnInvalid = "raise",
    *,
    comparison: Comparison | None = None,
    progress: Progress | None = None,
    reactions: AnyReactions | None = None,
    joints: Choice = ALL,
    stiffness: Stiffness | None = None,
    **heading: Any,
) -> str:
    """Return the report on a motion as one HTML page that loads nothing from elsewhere; the page.

    With a comparison or reactions that are known, what they are made from is not asked for. All else is
    ``title``, ``about``, ``command``, ``page``, ``picture`` and ``date``, which stand around the numbers.
    """
    from p3dof.analysis.reactions.evaluation import of_result

    page_of = template("report.html.j2")
    require("robot", robot, Manipulator)
    words = Heading(**heading).words(TITLE)
    if comparison is None:
        comparison = robot.compare(motion, wrench=wrench, on_invalid=on_invalid, progress=progress)
    elif not isinstance(comparison, Comparison) or comparison.first.motion is not motion:
        raise InputError("comparison: expected what robot.compare found of this motion")
    if not (comparison.first.valid.any() and comparison.second.valid.any()):
        raise InputError(f"no sample of the motion is within what the machine can do ({len(motion)} samples)")
    if reactions is None:
        reactions = of_result(
            robot.bare_loop, robot.parameters, comparison.first, joints, on_invalid, stiffness
        )
    elif not isinstance(reactions, AnyReactions) or reactions.motion is not motion:
        raise InputError("reactions: expected those of this motion")
    found = Findings(robot, motion, comparison, robot.energy(comparison.first), reactions)
    return rendered(page_of, words | _content(found))


def write(
    path: str | os.PathLike[str], robot: Manipulator, motion: Motion, *args: Any, **options: Any
) -> Path:
    """Write the report on a motion to a file.

    Parameters
    ----------
    path : path-like
        The file, replaced whole or not at all: ``.html``, or ``.pdf``, which a Chromium prints.
    robot, motion, *args, **options
        As for `render`.

    Raises
    ------
    InputError
        If the name ends in something else.
    FileError
        If the file cannot be written.
    MissingExtraError
        If playwright or a browser is missing for a PDF.
    P3dofError
        As `render`.
    """
    return write_report(path, lambda: render(robot, motion, *args, **options))


def _content(findings: Findings) -> dict[str, Any]:
    """Return what the template shows of the numbers."""
    parameters, motion = findings.robot.parameters, findings.motion
    comparison, energy = findings.comparison, findings.energy
    first, second = comparison.first, comparison.second
    pictures: Pictures = pictures_of(findings.robot, (first, second), energy, findings.reactions)
    return {
        "possible": second.possible,
        "agree": comparison.agree,
        "difference": f"{comparison.largest_difference:.1e}",
        "share": f"{comparison.share:.1e}",
        "samples": int(second.valid.sum()),
        "warnings": comparison.warnings,
        "key": _key_numbers(findings),
        "parameters": parameter_tables(parameters),
        "motion": motion_table(motion, second.wrench),
        "agreement": agreement_table(comparison),
        "evidence": evidence_table(first, second),
        "drives": drives_table(energy),
        "kinetic": bodies_table(energy),
        "balance": balance_table(energy),
        "limits": limits_table(second, parameters.limits),
        "payload": payload_table(parameters),
        "names": names_table(),
        "reactions": reactions_table(findings.reactions),
        "open": open_tables(findings.reactions),
        "undecided": how_chosen(findings.reactions),
        "pictures": pictures,
    }


def _key_numbers(findings: Findings) -> dict[str, str]:
    """Return the few numbers that a reader looks for first."""
    drives = findings.energy.drives
    loads = {
        "peak force": (drives.peak_force, "N"),
        "RMS force": (drives.rms_force, "N"),
        "peak speed": (drives.peak_speed, "m/s"),
        "peak power": (drives.peak_power, "W"),
    }
    return {name: _largest(values, unit) for name, (values, unit) in loads.items()}


def _largest(values: FloatArray, unit: str) -> str:
    """Return the largest of the actuators' values and whose it is; a dash if there is none."""
    if np.isnan(values).any():
        return "–"
    leg = int(np.argmax(values))
    return f"{values[leg]:.4g} {unit} ({LEGS[leg]})"
