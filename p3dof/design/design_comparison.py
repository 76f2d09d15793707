"""`compare_designs`: machines, or tasks, side by side: what each takes, and which is better."""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from p3dof._base.checks import FloatArray, Progress, Readable, shown
from p3dof._base.errors import InputError, SampleError
from p3dof._base.files import suffix_of, write_atomic
from p3dof._base.tables import (
    NONE,
    Columns,
    ShownInNotebook,
    Table,
    Tabular,
    columns_by,
    formatted,
    html_of,
    notebook_html,
    number,
    percent,
    table_of,
)
from p3dof.analysis.load_friction import LoadFriction
from p3dof.analysis.reactions import JOINTS, Stiffness
from p3dof.design.assessment import Assessment, as_result, assess
from p3dof.design.bearings import Bearings
from p3dof.design.drives import Drive, RequiredLife
from p3dof.design.drives.sizing import BRAKE_SAFETY
from p3dof.design.drives.tables import YES
from p3dof.design.fastest import fastest_plan, limits_of
from p3dof.design.forces_of_tasks import TaskForces, forces_of_task
from p3dof.design.tasks import AxisLimits, Task
from p3dof.machine.motion import Motion, paper_motion
from p3dof.machine.parameters import LEGS, Parameters
from p3dof.manipulator import Manipulator
from p3dof.methods import InverseDynamics
from p3dof.methods.registry import Method

Better = Literal["lower", "higher", ""]
_MOST = 12  # most columns of a comparison
_POSES = 200  # poses at which the room of the joints is looked at
_SAME = 5e-4  # share up to which two numbers are as good: as many digits as tables have of differences
PAPERS = "the paper's motion"  # what machines are compared over where no task is given


@dataclass(frozen=True, eq=False)
class DesignMeasure(Readable):
    """A number of each design.

    Parameters
    ----------
    name, unit : str
        What it is.
    better : {"lower", "higher", ""}
        Which direction is better; empty where neither is.
    values : tuple of float
        Of the designs; NaN where one has none.
    """

    name: str
    unit: str
    better: Better
    values: tuple[float, ...]

    @property
    def label(self) -> str:
        """Name and unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    @property
    def differences(self) -> FloatArray:
        """How much more each has than the first, as a share of the first; NaN of nothing."""
        values = np.asarray(self.values)
        with np.errstate(divide="ignore", invalid="ignore"):
            found = (values - values[0]) / abs(values[0])
        return np.where(values == values[0], 0.0, np.where(np.isfinite(found), found, np.nan))

    @property
    def best(self) -> int | None:
        """Which design is the best; None where several are, or neither direction is better."""
        values = np.asarray(self.values) * (1 if self.better == "lower" else -1)
        if not self.better or np.isnan(values).any():
            return None
        order = np.argsort(values)
        first, second = values[order[:2]]
        close = first == second or abs(second - first) <= _SAME * max(abs(first), abs(second))
        return None if close else int(order[0])


@dataclass(frozen=True, eq=False)
class DesignComparison(ShownInNotebook, Tabular):
    """Machines over a task, or a machine over tasks, side by side.

    Parameters
    ----------
    title : str
        What they have in common: the task, or the machine.
    assessments : tuple of Assessment
        The designs, by their names; differences are against the first.
    """

    _row_name = "measure"

    title: str
    assessments: tuple[Assessment, ...]

    def __repr__(self) -> str:
        return f"DesignComparison({self.title}: {', '.join(self.names)})"

    @property
    def names(self) -> tuple[str, ...]:
        """What the designs are called."""
        return tuple(one.name for one in self.assessments)

    @cached_property
    def measures(self) -> tuple[DesignMeasure, ...]:
        """Loads, powers, time, ratings, mass, installation space, and lives where they are known."""
        each = [_measured(one) for one in self.assessments]
        keys = list(dict.fromkeys(key for one in each for key in one))
        return tuple(DesignMeasure(*key, tuple(one.get(key, math.nan) for one in each)) for key in keys)

    def __getitem__(self, name: str) -> DesignMeasure:
        for measure in self.measures:
            if measure.name == name:
                return measure
        known = ", ".join(measure.name for measure in self.measures)
        raise InputError(f"measure: expected one of {known}, got {shown(name)}")

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as plain data for JSON: verdicts, values, differences; None for no number."""
        designs = [
            {
                "name": one.name,
                "fits": one.fits,
                "verdict": one.verdict,
                "drive": _drive(one),
                "not_checked": list(one.unchecked),
            }
            for one in self.assessments
        ]
        measures = [
            {
                "name": one.name,
                "unit": one.unit,
                "better": one.better or None,
                "values": [_plain(value) for value in one.values],
                "differences": [_plain(value) for value in one.differences],
                "best": None if one.best is None else self.names[one.best],
            }
            for one in self.measures
        ]
        return {"title": self.title, "designs": designs, "measures": measures}

    def to_columns(self) -> Columns:
        """Return measures with units, values, differences in percent and the best; one measure a row."""
        first, *others = self.names
        values = np.array([one.values for one in self.measures])
        percents = 100 * np.array([one.differences for one in self.measures])
        best = ["" if one.best is None else self.names[one.best] for one in self.measures]
        return {
            "over": np.full(len(best), self.title),
            "measure": np.array([one.name for one in self.measures]),
            "unit": np.array([one.unit for one in self.measures]),
            **columns_by("{}", self.names, values),
            **columns_by(f"{{}} against {first} [%]", others, percents[:, 1:]),
            "better": np.array([one.better for one in self.measures]),
            "best": np.array(best),
        }


def write_comparisons(found: Sequence[DesignComparison], path: str | os.PathLike[str]) -> Path:
    """Write comparisons to a CSV file, one below the other; arguments and errors as of `to_csv`."""
    suffix_of(path, "table")
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    for columns in (one.to_columns() for one in found):
        writer.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            writer.writerow(cell if isinstance(cell, str) else f"{cell:.17g}" for cell in row)
    return write_atomic(path, text.getvalue())


def compare_designs(
    designs: Mapping[str, Manipulator | Parameters],
    tasks: Mapping[str, Task | Motion] | Task | Motion | None = None,
    *,
    duration: float | None = None,
    fastest: bool = False,
    drives: Drive | Sequence[Drive] | Mapping[str, Drive | Sequence[Drive]] | None = None,
    bearings: Bearings | None = None,
    stiffness: Stiffness | None = None,
    load_friction: LoadFriction | None = None,
    rest: float = 0.0,
    brake_safety: float = BRAKE_SAFETY,
    per_axis: bool = False,
    life: RequiredLife | str | None = None,
    frictionless: bool = False,
    samples: int = 2001,
    progress: Progress | None = None,
) -> list[DesignComparison]:
    """Compare machines over tasks: loads, powers, energy, cycle time, worst rating, mass, space, lives.

    Parameters
    ----------
    designs : mapping of str to Manipulator or Parameters
        The machines by name; differences are against the first.
    tasks : mapping of str to Task or Motion, or one of them, optional
        What they have to do; the paper's motion without it. Of one machine, several tasks are compared with
        each other.
    duration : float, optional
        Time of each task, dwells included [s].
    fastest : bool
        Do each task as fast as each machine's own limits allow.
    drives : Drive, sequence of Drive, or mapping of str to one of these, optional
        Such as a `p3dof.design.drives.Catalogue`: each design gets the best of them; or, by the names of
        designs, those of each.
    bearings, stiffness, rest, brake_safety, per_axis, life, frictionless
        As of `assess`.
    load_friction : LoadFriction, optional
        Friction of all machines that grows with the loads of their joints.
    samples : int
        Least number of samples of a task.
    progress : callable, optional
        Called with (done, total) pairs of machine and task.

    Returns
    -------
    list of DesignComparison
        One a task; of one machine and several tasks one in all.

    Raises
    ------
    SampleError
        If a machine cannot perform a task; the message names it.
    InputError
        If an argument does not fit, or there is nothing to compare.
    """
    robots = {name: _machine(name, one) for name, one in _named(designs, "designs").items()}
    jobs = _jobs(tasks)
    if isinstance(drives, Mapping) and drives.keys() != robots.keys():
        raise InputError(f"drives: expected those of {', '.join(robots)}, got {', '.join(map(str, drives))}")
    if len(robots) * len(jobs) < 2:
        raise InputError("designs: expected at least two machines, or one machine and two tasks")
    if len(robots) * len(jobs) > _MOST * max(len(jobs), 1) or len(jobs) > _MOST:
        raise InputError(f"designs: expected at most {_MOST} beside each other")
    alone = len(robots) == 1
    found: dict[str, list[Assessment]] = {name: [] for name in jobs}
    for done, (job, (name, robot)) in enumerate(((job, item) for job in jobs for item in robots.items()), 1):
        try:
            forces = planned_forces(
                robot,
                jobs[job],
                duration=duration,
                fastest=fastest,
                samples=samples,
                load_friction=load_friction,
                stiffness=stiffness,
            )
        except SampleError as error:
            error.args = (f"{job if alone else name}: {error}", *error.args[1:])
            raise
        found[job].append(
            assess(
                robot,
                forces,
                drives=drives[name] if isinstance(drives, Mapping) else drives,
                bearings=bearings,
                stiffness=stiffness,
                limits=_limits(robot, jobs[job]),
                rest=rest,
                brake_safety=brake_safety,
                per_axis=per_axis,
                life=life,
                frictionless=frictionless,
                name=job if alone else name,
            )
        )
        if progress is not None:
            progress(done, len(jobs) * len(robots))
    if alone:
        return [DesignComparison(next(iter(robots)), tuple(one for job in found.values() for one in job))]
    return [DesignComparison(job, tuple(each)) for job, each in found.items()]


def planned_forces(
    robot: Manipulator,
    work: Task | Motion,
    *,
    duration: float | None = None,
    fastest: bool = False,
    samples: int = 2001,
    load_friction: LoadFriction | None = None,
    stiffness: Stiffness | None = None,
) -> TaskForces | InverseDynamics:
    """Return the forces over a motion, or over a task in a given or the least time: see `compare_designs`."""
    method: Method = "compiled" if load_friction is None else "virtual-power"
    friction = {"load_friction": load_friction, "stiffness": stiffness}
    if isinstance(work, Motion):
        return robot.inverse_dynamics(work, method=method, **friction)  # type: ignore[arg-type]  # by name
    if fastest and duration is not None:
        raise InputError("duration: the fastest motion has its own")
    task = work.on(robot.parameters.geometry)
    plan = fastest_plan(robot, task, samples=samples) if fastest else task.plan(duration, samples)
    return forces_of_task(robot, plan, method, **friction)  # type: ignore[arg-type]  # likewise


def _named(given: Any, what: str) -> dict[str, Any]:
    if not isinstance(given, Mapping) or not all(isinstance(name, str) and name for name in given):
        raise InputError(f"{what}: expected a mapping of names, got {shown(given)}")
    return dict(given)


def _machine(name: str, given: Any) -> Manipulator:
    if isinstance(given, Manipulator):
        return given
    if isinstance(given, Parameters):
        return Manipulator(given)
    raise InputError(f"designs: {name}: expected a Manipulator or Parameters, got {shown(given)}")


def _jobs(tasks: Any) -> dict[str, Task | Motion]:
    if tasks is None:
        return {PAPERS: paper_motion(1001)}
    if isinstance(tasks, Task | Motion):
        return {(tasks.name if isinstance(tasks, Task) else "") or "the task": tasks}
    jobs = _named(tasks, "tasks")
    for name, job in jobs.items():
        if not isinstance(job, Task | Motion):
            raise InputError(f"tasks: {name}: expected a Task or a Motion, got {shown(job)}")
    if not jobs:
        raise InputError("tasks: expected at least one, got none")
    return jobs


def _limits(robot: Manipulator, work: Task | Motion) -> AxisLimits | None:
    """Return the limits of a task, if it has any."""
    return limits_of(robot, work) if isinstance(work, Task) and work.limits else None


def _measured(found: Assessment) -> dict[tuple[str, str, Better], float]:
    """Return the numbers of a design, by name, unit and direction."""
    result = as_result(found.found)
    forces, speed = found.found.forces, found.found.slider_velocities
    power = (forces * speed).sum(axis=1)
    given, back = found.slider_energy
    time = found.found.time
    values: dict[tuple[str, str, Better], float] = {}
    for k, leg in enumerate(LEGS):
        values[f"peak force of {leg}", "N", "lower"] = float(np.abs(forces[:, k]).max())
    for k, leg in enumerate(LEGS):
        mean = np.trapezoid(forces[:, k] ** 2, time) / (time[-1] - time[0])
        values[f"rms force of {leg}", "N", "lower"] = math.sqrt(float(mean))
    for k, leg in enumerate(LEGS):
        values[f"top speed of {leg}", "m/s", "lower"] = float(np.abs(speed[:, k]).max())
    values["peak power", "W", "lower"] = float(power.max())
    values["work supplied per cycle", "J", "lower"] = given
    values["work regenerated per cycle", "J", ""] = -back
    values["cycle time", "s", "lower"] = found.cycle_time
    values["highest utilisation", "%", "lower"] = 100 * found.worst.share
    if found.drives is not None:
        values |= _of_drives(found)
    values["moving mass", "kg", "lower"] = found.robot.parameters.bodies.mass
    x, y, z = _room(found.robot, result)
    values["footprint of the joints", "m²", "lower"] = x * y
    values["height of the joints", "m", "lower"] = z
    values["nearest singularity", "°", "higher"] = math.degrees(float(np.abs(result.actuation).min()))
    if found.bearings is not None:
        values |= _of_bearings(found)
    return values


def _of_drives(found: Assessment) -> dict[tuple[str, str, Better], float]:
    sizing = found.drives
    if sizing is None:
        return {}
    return {
        ("peak torque of the motors", "N m", "lower"): max(abs(axis.peak_torque) for axis in sizing.axes),
        ("rms torque of the motors", "N m", "lower"): max(axis.rms_torque for axis in sizing.axes),
        ("peak power of the bus", "W", "lower"): sizing.bus_peak_power,
        ("work of the motors per cycle", "J", "lower"): sizing.bus_positive_work,
    }


def _of_bearings(found: Assessment) -> dict[tuple[str, str, Better], float]:
    report = found.bearings
    if report is None:
        return {}
    values: dict[tuple[str, str, Better], float] = {}
    if report.bearings:
        values["shortest life of bearings", "h", "higher"] = min(one.hours for one in report.bearings)
    if report.guides:
        values["shortest life of guides", "h", "higher"] = min(one.hours for one in report.guides)
    if report.rods:
        values["largest compression of rods", "N", "lower"] = max(one.compression for one in report.rods)
    return values


def _room(robot: Manipulator, result: InverseDynamics) -> FloatArray:
    """Return the size of the box, along x0, y0, z0, that all joints stay in over a motion, (3,) [m]."""
    import pinocchio as pin

    model = robot.model
    data = model.createData()
    frames = [model.getFrameId(joint.frame) for joint in JOINTS]
    rows = np.unique(np.linspace(0, len(result.time) - 1, _POSES).round().astype(int))
    states = result.joints.columns(tuple(str(name) for name in model.names[1:]))
    points = []
    for row in rows:
        pin.framesForwardKinematics(model, data, states.q[row])
        points += [data.oMf[frame].translation.copy() for frame in frames]
    return np.asarray(np.ptp(np.array(points), axis=0))


def comparison_table(found: DesignComparison) -> Table:
    """Return designs side by side, with differences against the first and which is better."""
    header = ["measure", found.names[0]]
    for name in found.names[1:]:
        header += [name, f"{name} − {found.names[0]}"]
    rows = [tuple(_row(found, measure)) for measure in found.measures]
    note = f"Differences are in percent of {found.names[0]}; lower or higher is the direction that is better."
    return Table(f"Comparison: {found.title}", (*header, "better"), tuple(rows), note, "wide")


def _row(found: DesignComparison, measure: DesignMeasure) -> list[str]:
    cells = [measure.label, _cell(measure.values[0])]
    for value, more in zip(measure.values[1:], measure.differences[1:], strict=True):
        cells += [_cell(value), formatted(more, "+.1f", "%")]
    best = NONE if measure.best is None else f"{found.names[measure.best]} ({measure.better})"
    return [*cells, best]


def verdicts_table(found: DesignComparison) -> Table:
    """Return for each design whether it fits, and which rating it uses most."""
    rows = {}
    for one in found.assessments:
        worst = one.worst
        drive = [] if one.drives is None else [_drive(one) or ""]
        words = YES[worst.verdict], f"{worst.name} of {worst.part}", percent(worst.share), worst.when
        rows[one.name] = [*words, *drive]
    header = ["design", "fits", "critical rating", "utilisation", "when"]
    drives = any(one.drives is not None for one in found.assessments)
    unchecked = dict.fromkeys(words for one in found.assessments for words in one.unchecked)
    note = f"Not checked: {'; '.join(unchecked)}."
    for told in dict.fromkeys(told for one in found.assessments for told in one.assumed):
        names = ", ".join(one.name for one in found.assessments if told in one.assumed)
        note += f" Assumed of {names}: {told}."
    return table_of("Critical ratings", [*header, *(["drive"] if drives else [])], rows, note)


def _drive(found: Assessment) -> str | None:
    return None if found.drives is None else found.drives.name


def _cell(value: float) -> str:
    if math.isinf(value):
        return "beyond" if value > 0 else NONE
    return number(value, form=".5g")


def _plain(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


@html_of.register(DesignComparison)
def comparison_html(found: DesignComparison) -> str:
    """Return how a notebook shows designs side by side, as HTML."""
    facts = "; ".join(f"{one.name} {one.verdict}" for one in found.assessments)
    return notebook_html("Designs", facts, [comparison_table(found)])
