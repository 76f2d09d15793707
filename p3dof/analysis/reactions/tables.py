"""Tables of the joints: their names, and what they bear."""

from __future__ import annotations

import math

from p3dof._base.tables import Table, html_of, notebook_html, number, table_of
from p3dof.analysis.reactions.comparison import AnyReactions, ReactionsComparison, how_chosen
from p3dof.analysis.reactions.joints import JOINTS, Joint
from p3dof.analysis.reactions.one_joint import Peak
from p3dof.analysis.reactions.results import Reactions

_NOTHING = 1e-9
"""Reactions that are rounding, of a joint that bears none [N, N m]."""


AXES = (
    "Components in files are in the axes of the body after the joint; of loop_a, loop_b and loop_c, of the "
    "leg or rod before it. Those of hinge_lower are the lower cross-bar's, as a link of the URDF: at home "
    "those of its rods, not the fixed ones in which its mass centre and inertia are given."
)
"""In which axes the components of reactions are."""


def names_table() -> Table:
    """Return the key that ties the names in the drawing to those in tables, files and the parameter file.

    Returns
    -------
    Table
    """
    rows = tuple((joint.label, joint.name, joint.meaning) for joint in sorted(JOINTS, key=_by_label))
    note = f"The labels are the paper's, but for C7, which the paper does not name. {AXES}"
    return Table(
        "Names of the joints", ("in the drawing", "in tables and files", "what it is"), rows, note, "words"
    )


def _by_label(joint: Joint) -> str:
    return joint.label


_LOADS = {
    "force": "force [N]",
    "axial": "axial [N]",
    "radial": "radial [N]",
    "rms_force": "RMS force [N]",
    "moment": "moment [N m]",
    "across": "across [N m]",
    "rms_moment": "RMS moment [N m]",
}
_FIT = {"fit_force": "fit [N]", "fit_moment": "fit [N m]"}
_NAMES = {joint.name: f"{joint.name} ({joint.label})" for joint in JOINTS}


def reactions_table(result: AnyReactions) -> Table:
    """Return the largest loads of every joint, to size it for.

    Parameters
    ----------
    result : Reactions or ReactionsComparison
        Over a motion.

    Returns
    -------
    Table
    """
    peaks = result.peaks()
    columns = dict(_LOADS)
    if any(peak.fit_force or peak.fit_moment for peak in peaks):
        columns |= _FIT
    rows = {_NAMES[peak.joint]: tuple(_cell(peak, name) for name in columns) for peak in peaks}
    residual = result.residual[result.valid].max(initial=0.0)
    marks = (
        "~: rests on the stiffness of joints and rods"
        if result.rests_on_stiffness
        else "open: rigid bodies do not determine it, see below"
    )
    fit = "; fit: no misfit of assembly adds more" if len(columns) > len(_LOADS) else ""
    note = (
        "Axial and radial: along and across the joint's axis; moment and across: all, and across the axis; "
        f"{marks}{fit}. Largest error of Newton's and Euler's equations: {residual:.1e} N or N m."
    )
    title = "Largest reactions: to size joints for"
    if not result.rests_on_stiffness:
        title = "Largest reactions that rigid bodies determine: to size joints for"
    return table_of(title, ("joint", *columns.values()), rows, note, "wide", decimals=2)


def _cell(peak: Peak, name: str) -> float | str:
    """Return one load; what stiffness decides is marked, and what nothing decides is called open."""
    value = _load(getattr(peak, name))
    if name not in peak.undetermined:
        return value
    return "open" if math.isnan(value) else f"~{value:.2f}"


def open_tables(result: AnyReactions) -> list[Table]:
    """Return the loads that rigid bodies leave open, in each way: of forces and of moments.

    Parameters
    ----------
    result : Reactions or ReactionsComparison
        Over a motion.

    Returns
    -------
    list of Table
        None for elastic joints alone.
    """
    if result.ways == ("elastic",):
        return []  # all of it stands among the loads to size for
    values = {(peak.joint, peak.load): peak.values for peak in result.open_peaks()}
    tables = []
    for what, unit in (("forces", "[N]"), ("moments", "[N m]")):
        loads = [name for name, title in _LOADS.items() if title.endswith(unit)]
        columns = [(name, kind) for name in loads for kind in result.ways]
        rows = {
            _NAMES[joint]: tuple(
                _load(values[joint, name][kind]) if (joint, name) in values else "" for name, kind in columns
            )
            for joint in result.joints
            if any((joint, name) in values for name in loads)
        }
        header = ("joint", *(f"{_LOADS[name]} {kind}" for name, kind in columns))
        title = f"Open {what}: not to size joints for"
        if result.rests_on_stiffness:
            title = f"Open {what}: of elastic joints, and by two idealisations, which are no bounds"
        tables.append(table_of(title, header, rows, "", "wide", decimals=2))
    return tables


def _load(value: float) -> float:
    return 0.0 if abs(value) < _NOTHING else value


@html_of.register(ReactionsComparison)
@html_of.register(Reactions)
def reactions_html(result: AnyReactions) -> str:
    """Return how a notebook shows reactions, as HTML."""
    words = ", ".join(result.ways)
    facts = f"open loads: {words}; {len(result.time)} samples over {number(result.motion.duration)} s"
    invalid = int((~result.valid).sum())
    warnings = [f"{invalid} samples are invalid: no largest load is known"] if invalid else []
    tables = [table for table in open_tables(result) if table.rows]
    remark = how_chosen(result)
    return notebook_html("Reactions", facts, [reactions_table(result), *tables], warnings, remark)
