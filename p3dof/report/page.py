"""The report: what was computed about a motion, put into one page."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from p3dof._base.checks import FloatArray, Progress, shown
from p3dof._base.errors import InputError
from p3dof._base.files import suffix_of, write_atomic
from p3dof._base.samples import OnInvalid
from p3dof.analysis.energy import Energy, balance_table, bodies_table, drives_table
from p3dof.analysis.reactions import (
    ALL,
    AnyReactions,
    Choice,
    Stiffness,
    how_chosen,
    names_table,
    of_result,
    open_tables,
    reactions_table,
)
from p3dof.machine.motion import Motion, WrenchOverTime, motion_table
from p3dof.machine.parameters import LEGS, parameter_tables, payload_table
from p3dof.manipulator import Manipulator
from p3dof.methods import evidence_table, limits_table
from p3dof.methods.comparison import Comparison
from p3dof.methods.comparison_tables import agreement_table
from p3dof.report.figures import Pictures, pictures_of
from p3dof.report.templates import data_uri, dated, rendered, template, texts, versions

TITLE = "Inverse dynamics of a 3-DOF spatial parallel manipulator"


@dataclass(frozen=True, eq=False)
class Findings:
    """What a report tells about a motion.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    motion : Motion
        Its motion.
    comparison : Comparison
        The forces by Pinocchio, by virtual powers and by the kernels.
    energy : Energy
        Of the forces by Pinocchio.
    reactions : Reactions or ReactionsComparison
        In all joints.
    """

    robot: Manipulator
    motion: Motion
    comparison: Comparison
    energy: Energy
    reactions: AnyReactions


def render(
    robot: Manipulator,
    motion: Motion,
    wrench: WrenchOverTime = None,
    on_invalid: OnInvalid = "raise",
    title: str | None = None,
    about: Mapping[str, str] | None = None,
    command: str | None = None,
    page: str | None = None,
    date: datetime | None = None,
    progress: Progress | None = None,
    joints: Choice = ALL,
    stiffness: Stiffness | None = None,
    picture: bytes | None = None,
    comparison: Comparison | None = None,
    reactions: AnyReactions | None = None,
) -> str:
    """Return the report on a motion as one HTML page that loads nothing from elsewhere.

    Parameters
    ----------
    robot : Manipulator
        The machine.
    motion : Motion
        Its motion.
    wrench : array-like, shape (6,) or (N, 6), or callable, optional
        External force and moment on the platform at P, as for `Manipulator.inverse_dynamics` [N, N m].
    on_invalid : {"raise", "nan"}
        Raise for samples that are out of reach or singular, or leave them out.
    title : str, optional
        Heading of the page; `TITLE` by default.
    about : mapping of str to str, optional
        What else its head should tell, such as where machine and motion come from.
    command : str, optional
        How to make this report again.
    page : str, optional
        A page that shows the motion, such as ``robot.page(motion).html``; it is put into a frame of the
        report, where instants in tables lead to.
    date : datetime, optional
        When it was made; now by default.
    progress : callable, optional
        Called with (done, total) while Pinocchio solves.
    joints : {"all", "elastic", "paper", "points"}
        How loads are found that rigid bodies leave open; see `p3dof.analysis.reactions`.
    stiffness : Stiffness, optional
        How joints and rods give way; guesses by default.
    picture : bytes, optional
        A picture of the machine (PNG), for paper, where nothing moves; it takes the place of that page.
    comparison : Comparison, optional
        What `robot.compare` found of this motion and load, if it is known already.
    reactions : Reactions or ReactionsComparison, optional
        Likewise, of the joints; `joints` and `stiffness` are not asked then.

    Returns
    -------
    str
        The page.

    Raises
    ------
    ReachError, SingularityError, SampleError
        Naming the first bad sample.
    InputError
        If an argument does not fit, or no sample of the motion is valid.
    MissingExtraError
        If Jinja2 or matplotlib is not installed.
    """
    page_of = template("report.html.j2")
    if not isinstance(robot, Manipulator):
        raise InputError(f"robot: expected a Manipulator, got {shown(robot)}")
    texts(title=title, command=command, page=page)
    when = dated(date)
    if comparison is None:
        comparison = robot.compare(motion, wrench=wrench, on_invalid=on_invalid, progress=progress)
    elif not isinstance(comparison, Comparison) or comparison.first.motion is not motion:
        raise InputError("comparison: expected what robot.compare found of this motion")
    if not (comparison.first.valid.any() and comparison.second.valid.any()):
        raise InputError(f"no sample of the motion is within what the machine can do ({len(motion)} samples)")
    if reactions is None:
        reactions = of_result(robot.loop, robot.parameters, comparison.first, joints, on_invalid, stiffness)
    elif not isinstance(reactions, AnyReactions) or reactions.motion is not motion:
        raise InputError("reactions: expected those of this motion")
    findings = Findings(robot, motion, comparison, robot.energy(comparison.first), reactions)
    words: dict[str, Any] = {
        "title": TITLE if title is None else title,
        "about": dict(about or {}),
        "command": command,
        "page": page,
        "picture": None if picture is None else data_uri(picture),
        "date": when,
        "versions": versions(),
        **_content(findings),
    }
    return rendered(page_of, words)


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

    Returns
    -------
    Path
        The path written.

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
    printed = suffix_of(path, "report") == ".pdf"
    text = render(robot, motion, *args, **options)
    if not printed:
        return write_atomic(path, text)
    from p3dof.viewer.headless import pdf_of

    return write_atomic(path, pdf_of(text))


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
