"""Reactions of all joints by elastic joints and by both idealisations, side by side."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from p3dof._base.checks import FloatArray
from p3dof._base.errors import InputError
from p3dof._base.tables import ShownInNotebook, Table, Tabular, html_of, notebook_html, number, table_of
from p3dof.analysis.reactions.results import JOINTS, Joint, OpenPeak, Peak, Reactions, largest, peaks_of
from p3dof.loops.linear import BoolArray
from p3dof.machine.motion import Motion

UNDECIDED = (
    "Rigid bodies do not determine the open loads: stiffness, clearance and assembly do. Each idealisation "
    "has one of many possible values. Neither is a bound, and close agreement of both is no evidence."
)
"""What must stand beside every open load."""
ELASTIC = (
    "Loads marked ~ are those of elastic joints and rods between rigid bodies, without clearance. They "
    "are as good as the given stiffness, and depend on the width b of the parallelogram, which the paper "
    "does not give."
)
"""What must stand beside every load of elastic joints."""


@dataclass(frozen=True, eq=False)
class ReactionsComparison(ShownInNotebook, Tabular):
    """Reactions of all joints over a motion, with elastic joints and with two idealisations beside them.

    What rigid bodies determine is the same in all. Of the rest the idealisations show one of many possible
    values each, and neither is a bound: with elastic joints a load can lie outside both.

    Parameters
    ----------
    elastic : Reactions
        Of joints and rods that give way.
    paper, points : Reactions
        With universal joints and a hinge at the cuts, and with balls; open loads by a choice.
    """

    elastic: Reactions
    paper: Reactions
    points: Reactions

    def __repr__(self) -> str:
        worst = largest(self.residual[self.valid])
        return f"ReactionsComparison({self.motion!r}, residual {worst:.1e})"

    @property
    def ways(self) -> tuple[str, ...]:
        """Names of what is compared."""
        return tuple(one.way for one in self.each)

    @property
    def rests_on_stiffness(self) -> bool:
        """Whether loads that rigid bodies leave open are those of elastic joints."""
        return True

    @property
    def motion(self) -> Motion:
        """The motion of the platform."""
        return self.paper.motion

    @property
    def length(self) -> float:
        """What moments are compared with forces by, where a choice is made [m]."""
        return self.paper.length

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the thirteen joints."""
        return self.paper.joints

    @property
    def time(self) -> FloatArray:
        """Times, shape (N,) [s]."""
        return self.paper.time

    @property
    def valid(self) -> BoolArray:
        """Which samples have reactions in all, shape (N,)."""
        return self.elastic.valid & self.paper.valid & self.points.valid

    @property
    def possible(self) -> bool:
        """Whether every sample is valid: else the machine cannot perform the motion."""
        return bool(self.valid.all())

    @property
    def residual(self) -> FloatArray:
        """Largest error of Newton's and Euler's equations in any, shape (N,) [N or N m]."""
        return np.asarray(np.max([one.residual for one in self.each], axis=0))

    @property
    def determined_forces(self) -> BoolArray:
        """Which components of the forces are determined in all, shape (N, 13, 3)."""
        return np.asarray(np.all([one.determined_forces for one in self.each], axis=0))

    @property
    def determined_moments(self) -> BoolArray:
        """Which components of the moments are determined in all, shape (N, 13, 3)."""
        return np.asarray(np.all([one.determined_moments for one in self.each], axis=0))

    @property
    def each(self) -> tuple[Reactions, ...]:
        """What is compared."""
        return self.elastic, self.paper, self.points

    def peaks(self) -> tuple[Peak, ...]:
        """Return the largest loads of all `JOINTS`, for sizing bearings; open ones of elastic joints."""
        return tuple(peak for peak, _ in self._peaks())

    def open_peaks(self) -> tuple[OpenPeak, ...]:
        """Return the largest values, in each way, of the loads that rigid bodies leave open.

        Returns
        -------
        tuple of OpenPeak
            In the order of `JOINTS`.
        """
        return tuple(peak for _, peaks in self._peaks() for peak in peaks)

    def _peaks(self) -> list[tuple[Peak, tuple[OpenPeak, ...]]]:
        return [peaks_of(name, {one.way: one.loads(name) for one in self.each}) for name in self.joints]

    def to_columns(self) -> dict[str, FloatArray]:
        """Return time, all reactions and the residuals, (N,) each, by name and unit.

        A component that is determined throughout has one column. Of any other there are four: its values with
        elastic joints and in both idealisations, and where it is determined (1) and where not (0).
        """
        found = {"t [s]": self.time}
        for k, name in enumerate(self.joints):
            for kind, unit in (("forces", "N"), ("moments", "N m")):
                determined = getattr(self, f"determined_{kind}")[:, k]
                for i, axis in enumerate("xyz"):
                    component = f"{name} {kind[0]}{axis}"
                    values = {one.way: getattr(one, kind)[:, k, i] for one in self.each}
                    if determined[self.valid, i].all():
                        found[f"{component} [{unit}]"] = values["elastic"]
                        continue
                    found |= {f"{component} {way} [{unit}]": each for way, each in values.items()}
                    found[f"{component} determined"] = determined[:, i].astype(float)
        residuals = zip(self.ways, self.each, strict=True)
        return found | {f"residual {name}": one.residual for name, one in residuals}


AnyReactions: TypeAlias = Reactions | ReactionsComparison
"""Found in one way or in all."""


def how_chosen(result: AnyReactions) -> str:
    """Say by which rule the values of open loads were chosen; a few sentences."""
    if not isinstance(result, Reactions | ReactionsComparison):
        raise InputError(f"result: expected Reactions, got {type(result).__name__}")
    told = [ELASTIC] if result.rests_on_stiffness else []
    ideal = [f"{way!r}" for way in result.ways if way != "elastic"]
    if ideal:
        told.append(
            f"{UNDECIDED} Those of {' and '.join(ideal)} have the least sum of squares over all joints, "
            f"moments taken as forces on an arm of {1e3 * result.length:g} mm, as if all were equally stiff."
        )
    return " ".join(told)


_NOTHING = 1e-9  # reactions that are rounding, of a joint that bears none [N, N m]


AXES = (
    "Components in files are in the axes of the body after the joint; of loop_a, loop_b and loop_c, of the "
    "leg or rod before it. Those of hinge_lower are the lower cross-bar's, as a link of the URDF: at home "
    "those of its rods, not the fixed ones in which its mass centre and inertia are given."
)
"""In which axes the components of reactions are."""


def names_table() -> Table:
    """Return the key that ties the names in the drawing to those in tables, files and the parameter file."""
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
    """Return the largest loads of every joint, to size it for."""
    peaks = result.peaks()
    columns = dict(_LOADS)
    if any(peak.fit_force or peak.fit_moment for peak in peaks):
        columns |= _FIT
    rows = {_NAMES[peak.joint]: tuple(_cell(peak, name) for name in columns) for peak in peaks}
    residual = result.residual[result.valid].max(initial=0.0)
    marks = (
        "~: depends on the stiffness of joints and rods"
        if result.rests_on_stiffness
        else "open: not determined by rigid bodies, see below"
    )
    fit = "; fit: no assembly error adds more" if len(columns) > len(_LOADS) else ""
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
