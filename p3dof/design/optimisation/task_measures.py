"""Designs that do tasks with drives: `Duty`, `Discrete` choices, and what is measured of motors and bearings.

Measures of a motion are taken over each part of a task with what is carried there, and put together: the
worst part, the root of the mean square over time, or the sum; then the worst task, or the weighted mean.
Those of drives and bearings are those of `p3dof.size_drives` and `p3dof.design.bearings.bearing_life`, with
margins, surroundings and required life of the catalogue; their gradients are central differences.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cached_property, partial
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from p3dof._base.checks import FloatArray, Readable, meant, not_negative, positive, shown
from p3dof._base.errors import InputError, P3dofError
from p3dof._base.time_series.times import sample_count
from p3dof.analysis.designs.columns import OFFSETS
from p3dof.design.bearings import Bearings, bearing_life
from p3dof.design.drives import Catalogue, Drive, Screw, Sizing, cycle_of, size_of
from p3dof.design.drives.sizing import Cycle
from p3dof.design.fastest import fastest_plan
from p3dof.design.forces_of_tasks import forces_of_task, reactions_of_task
from p3dof.design.optimisation.population import (
    DRIVE,
    Better,
    LoadCase,
    OfDesigns,
    Pieces,
    Population,
    Setting,
    worst_gradient,
    worst_of,
)
from p3dof.design.sizing import static_loads
from p3dof.design.tasks import Plan, Task
from p3dof.machine.motion import Motion
from p3dof.machine.parameters import Body
from p3dof.manipulator import Manipulator

Together: TypeAlias = Literal["worst", "mean"]
"""How tasks count together in an objective: the worst of them, or their weighted mean."""

LEAD = f"{DRIVE}lead"  # the variable that is no column of designs [m]
PARTS = ("motor", "screw", "gear")  # what may be chosen from a catalogue
_AXES = 3  # all have the same drive
_SAMPLES = 201  # of a task, at least
_KEPT = 256  # machines whose cycles are kept
_STEP = 1e-5  # of differences, as a share of a variable
_MASSLESS = ("actuators.counterbalance.", "actuators.spring.")
_OF_SPEED = (
    "speed",
    "gear speed",
    "nut speed",
    "DN",
    "critical speed",
    "belt speed",
    "rack speed",
)  # ratings that speeds of sliders alone decide


@dataclass(frozen=True, eq=False)
class Duty(Readable):
    """A task that every design does.

    Parameters
    ----------
    task : Task
        What it has to do.
    duration : float, optional
        Time of the whole task [s], as of `Task.plan`.
    rest : float
        How long the machine rests after it [s].
    weight : float
        How much it counts in a mean over several tasks.
    samples : int
        Least number of samples, as of `Task.plan`.

    Raises
    ------
    InputError, TaskError
        If an argument does not fit, or the task cannot be done in this time.
    """

    task: Task
    duration: float | None = None
    rest: float = 0.0
    weight: float = 1.0
    samples: int = _SAMPLES

    def __post_init__(self) -> None:
        if not isinstance(self.task, Task):
            raise InputError(f"tasks: expected a Task, got {shown(self.task)}")
        object.__setattr__(self, "rest", not_negative("rest", self.rest))
        object.__setattr__(self, "weight", positive("weight", self.weight, InputError))
        sample_count(self.samples, least=2)
        _ = self.plan

    @cached_property
    def plan(self) -> Plan:
        """The task in time."""
        return self.task.plan(self.duration, self.samples)

    def moved(self, offset: FloatArray) -> Plan:
        """Return the plan with all poses moved by an offset (3,)."""
        if not offset.any():
            return self.plan
        pieces = tuple(replace(piece, motion=_moved(piece.motion, offset)) for piece in self.plan.pieces)
        return replace(self.plan, motion=_moved(self.plan.motion, offset), pieces=pieces)

    def finer(self, times: int) -> Duty:
        """Return the same with so many times more samples."""
        return replace(self, samples=self.samples * times)


def _moved(motion: Motion, offset: FloatArray) -> Motion:
    return Motion(
        motion.time,
        motion.pose + offset,
        motion.velocity,
        motion.acceleration,
        check=False,
        start=motion.start,
    )


@dataclass(frozen=True, eq=False)
class Duties:
    """What all designs do, by which drive, in which bearings."""

    tasks: tuple[Duty, ...]
    together: Together = "worst"
    drive: Drive | None = None
    bearings: Bearings | None = None
    catalogue: Catalogue | None = None  # whose margins, surroundings and required life hold for all drives
    known: dict[Any, Any] = field(default_factory=dict, repr=False)  # cycles of machines, whatever the drive

    def cases(self, setting: Setting) -> Iterator[LoadCase]:
        """Yield each part of each task as a setting of its own."""
        for index, duty in enumerate(self.tasks):
            for piece in duty.plan.pieces:
                load = {} if piece.payload is None else _payload(piece.payload)
                wrench = piece.wrench if piece.wrench.any() else None
                own = replace(
                    setting, motion=piece.motion, wrench=wrench, fixed={**setting.fixed, **load}, duties=None
                )
                yield LoadCase(own, index, piece.motion.duration)

    def finer(self, times: int) -> Duties:
        """Return the same with so many times more samples."""
        return replace(self, tasks=tuple(duty.finer(times) for duty in self.tasks), known={})

    def settings(self) -> dict[str, Any]:
        """Return what results depend on, as plain data: whatever differs in a task or a part differs here."""
        return {
            "tasks": [plain(duty) for duty in self.tasks],
            "together": self.together,
            "drive": plain(self.drive),
            "catalogue": plain(self.catalogue),
            "bearings": plain(self.bearings),
        }

    def drive_of(self, population: Population, index: int) -> Drive:
        """Return the drive of a design: with the lead that it has."""
        drive, names = self.drive, population.setting.names
        if drive is None:
            raise InputError("drives: measures of drives need some: drives=...")
        if LEAD not in names:
            return drive
        return with_lead(drive, float(population.values[index, names.index(LEAD)]))

    @property
    def lead(self) -> float:
        """The lead of the screw that all designs have [m]."""
        screw = None if self.drive is None else self.drive.transmission
        if not isinstance(screw, Screw):
            raise InputError("lead: needs drives with a screw: drives=...")
        return screw.lead

    def sizing(self, population: Population, index: int, duty: int) -> Sizing:
        """Return what a task takes of the drives of a design."""
        cycle, held, when, mass = self._cycle(population, index, duty)
        drive, of = self.drive_of(population, index), self.catalogue
        return size_of(
            cycle,
            drive,
            held=held,
            held_time=when,
            load_mass=mass,
            margins=None if of is None else of.margins,
            ambient=None if of is None else of.ambient,
            life=None if of is None else of.life,
        )

    def _cycle(
        self, population: Population, index: int, duty: int
    ) -> tuple[Cycle, FloatArray, FloatArray, FloatArray]:
        """Return forces of a task without the drive, and what brakes and inertia ratios need."""
        key = duty, *((name, float(column[index])) for name, column in population.columns.items())
        if key not in self.known:
            robot, plan, rest = self._robot(population, index, duty)
            found = forces_of_task(robot, plan)
            held, when, mass, last = static_loads(robot, found)
            if len(self.known) >= _KEPT:
                self.known.clear()
            self.known[key] = replace(cycle_of(found, rest), holding=last), held, when, mass
        known: tuple[Cycle, FloatArray, FloatArray, FloatArray] = self.known[key]
        return known

    def _robot(self, population: Population, index: int, duty: int) -> tuple[Manipulator, Plan, float]:
        task = self.tasks[duty]
        return Manipulator(population.designs[index]), task.moved(_offset(population, index)), task.rest

    def lives(self, population: Population, index: int, duty: int) -> dict[str, float]:
        """Return the lives of ball nuts, whose dynamic rating is known, and the least of bearings [h]."""
        found: dict[str, float] = {}
        if self.bearings is not None:
            robot, plan, rest = self._robot(population, index, duty)
            report = bearing_life(robot.parameters, reactions_of_task(robot, plan), self.bearings, rest=rest)
            lives = [one.hours for one in report.bearings] + [one.hours for one in report.guides]
            found["bearings"] = float(min(lives, default=np.inf))
        if self.drive is not None:
            axes = self.sizing(population, index, duty).axes
            found |= {f"nut {leg}": axis.nut.hours for leg, axis in enumerate(axes) if axis.nut is not None}
        if not found:
            raise InputError(
                "life: needs bearings, or a screw with a dynamic rating: bearings=..., drives=..."
            )
        return found

    def fastest(self, population: Population, index: int, duty: int) -> float:
        """Return the least time of a task within force and speed of the machine's limits [s]."""
        task, offset = self.tasks[duty].task, _offset(population, index)
        points = [replace(point, pose=point.pose + offset) for point in task.waypoints]
        names = ("name", "path", "profile", "smoothness", "turning_length", "carrying", "limits")
        moved = Task(points, **{name: getattr(task, name) for name in names})
        return fastest_plan(Manipulator(population.designs[index]), moved).duration


def _offset(population: Population, index: int) -> FloatArray:
    columns = population.columns
    return np.array([columns[name][index] if name in columns else 0.0 for name in OFFSETS])


def _payload(body: Body) -> dict[str, float]:
    """Return a body as the columns of a payload."""
    inertia = body.inertia
    found = {"payload.mass": body.mass}
    found |= {f"payload.com.{axis}": float(body.com[k]) for k, axis in enumerate("xyz")}
    pairs = {a + b: inertia["xyz".index(a), "xyz".index(b)] for a, b in ("xx", "yy", "zz", "xy", "xz", "yz")}
    return found | {f"payload.inertia.{axes}": float(value) for axes, value in pairs.items()}


def plain(value: Any) -> Any:
    """Return what an object is made of as plain data, to the last digit."""
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, float | np.floating):
        number = float(value)
        return number if np.isfinite(number) else repr(number)  # JSON has no others
    if is_dataclass(value):
        own = {item.name: plain(getattr(value, item.name)) for item in fields(value)}
        return {"": type(value).__name__, **own}
    if isinstance(value, Mapping):
        return {str(name): plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    return value if isinstance(value, str | int | None) else repr(value)


def with_lead(drive: Drive, lead: float) -> Drive:
    """Return a drive with another lead of its screw; efficiency and inertia stay as they are given."""
    if not isinstance(drive.transmission, Screw):
        raise InputError(f"lead: {drive.transmission.name} is no screw")
    screw = drive.transmission
    name = screw.name if lead == screw.lead else f"{screw.name}, lead {1e3 * lead:.4g} mm"
    return replace(drive, transmission=replace(screw, name=name, lead=lead))


def duties_of(population: Population, name: str) -> Duties:
    """Return the tasks of a problem, or raise if it has none."""
    duties = population.setting.duties
    if duties is None:
        raise InputError(f"{name}: needs tasks: tasks=...")
    assert isinstance(duties, Duties)  # noqa: S101 - as it was made
    return duties


@dataclass(frozen=True)
class OverTasks:
    """A measure over all tasks of a problem."""

    measure: Any  # over a motion, or of a task
    mean: bool = False  # the weighted mean of the tasks, instead of the worst

    @property
    def name(self) -> str:
        """As of the measure."""
        return str(self.measure.name)

    @property
    def unit(self) -> str:
        """As of the measure."""
        return str(self.measure.unit)

    @property
    def better(self) -> Better:
        """As of the measure."""
        found: Better = self.measure.better
        return found

    @property
    def figures(self) -> tuple[Any, ...]:
        """As of the measure."""
        return tuple(self.measure.figures)

    @property
    def slow(self) -> bool:
        """Whether it takes long."""
        return bool(getattr(self.measure, "slow", False))

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,)."""
        tasks = [worst_of(values, self.better) for values in self._by_task(population)]
        return self._together(np.stack(tasks, axis=1), population)

    def _together(self, tasks: FloatArray, population: Population) -> FloatArray:
        return np.asarray(tasks @ self._weights(population)) if self.mean else worst_of(tasks, self.better)

    def _weights(self, population: Population) -> FloatArray:
        weights = np.array([duty.weight for duty in duties_of(population, self.name).tasks])
        return np.asarray(weights / weights.sum())

    def _by_task(self, population: Population) -> list[FloatArray]:
        """Return the pieces of each task, (D, P)."""
        over, duties = self.measure.over, duties_of(population, self.name)
        if over == "task":
            return [_of_task(self.measure, population, k)[0] for k in range(len(duties.tasks))]
        each = getattr(self.measure, "each", lambda part: self.measure.values(part)[:, None])
        with np.errstate(all="ignore"):
            return [
                _joined(over, [each(part) for part in parts], shares) for parts, shares in _parts(population)
            ]

    def pieces(self, population: Population) -> Pieces:
        """Return the pieces of all tasks, or their mean as one, and the gradients."""
        count = len(duties_of(population, self.name).tasks)
        if self.measure.over == "task":
            found = [_pieces_of_task(self.measure, population, k) for k in range(count)]
        else:
            found = [
                _joined_pieces(self.measure.over, [self.measure.pieces(part) for part in parts], shares)
                for parts, shares in _parts(population)
            ]
        if not self.mean:
            return Pieces(
                np.concatenate([each.values for each in found], axis=1),
                lambda: np.concatenate([each.gradients for each in found], axis=1),
            )
        weights = self._weights(population)
        value = np.stack([worst_of(each.values, self.better) for each in found], axis=1) @ weights
        return Pieces(
            value[:, None],
            lambda: np.einsum(
                "k,kdn->dn", weights, np.stack([worst_gradient(each, self.better) for each in found])
            )[:, None],
        )


def _parts(population: Population) -> Iterator[tuple[list[Population], list[float]]]:
    """Yield the parts of each task, and their shares of its time."""
    cases = population.setting.cases
    for duty in dict.fromkeys(case.duty for case in cases):
        own = [k for k, case in enumerate(cases) if case.duty == duty]
        total = sum(cases[k].duration for k in own)
        yield [population.cases[k] for k in own], [cases[k].duration / total for k in own]


def _joined(over: str, parts: Sequence[FloatArray], shares: Sequence[float]) -> FloatArray:
    """Return the pieces of a task from those of its parts."""
    if over == "rms":
        return np.asarray(np.sqrt(np.einsum("k,kdp->dp", np.array(shares), np.stack(parts) ** 2)))
    return np.asarray(np.sum(parts, axis=0)) if over == "sum" else np.concatenate(parts, axis=1)


def _joined_pieces(over: str, parts: Sequence[Pieces], shares: Sequence[float]) -> Pieces:
    values = _joined(over, [part.values for part in parts], shares)

    def gradients() -> FloatArray:
        with np.errstate(invalid="ignore", divide="ignore"):  # where a part is at rest
            rows = [np.nan_to_num(part.gradients) for part in parts]
        if over == "worst":
            return np.concatenate(rows, axis=1)
        if over == "sum":
            return np.asarray(np.sum(rows, axis=0))
        total = sum(
            share * part.values[..., None] * row for share, part, row in zip(shares, parts, rows, strict=True)
        )
        return np.asarray(total / values[..., None])

    return Pieces(values, gradients)


def _of_task(measure: Any, population: Population, duty: int) -> tuple[FloatArray, list[str]]:
    """Return the numbers of a measure of a task (D, P), NaN where a design has none, and their names."""
    rows: list[dict[str, float]] = []
    for index in range(len(population)):
        row: dict[str, float] = {}
        if population.feasible[index]:
            try:
                row = measure.of_task(population, index, duty)
            except InputError:
                raise
            except P3dofError:  # no such machine, or none that does the task
                row = {}
        rows.append(row)
    names = list(dict.fromkeys(name for row in rows for name in row)) or [""]
    none = 0.0 if measure.better == "small" else np.inf
    return np.array([[row.get(n, none if row else np.nan) for n in names] for row in rows]), names


def _pieces_of_task(measure: Any, population: Population, duty: int) -> Pieces:
    values, names = _of_task(measure, population, duty)
    return Pieces(values, partial(_differences, measure, population, duty, names))


def _differences(measure: Any, population: Population, duty: int, names: list[str]) -> FloatArray:
    """Return central differences of the numbers of a task by all variables, (D, P, n)."""
    values, slopes = population.values, []
    for k in range(values.shape[1]):
        step = np.zeros_like(values)
        step[:, k] = _STEP * np.maximum(np.abs(values[:, k]), 1e-3)
        if getattr(measure, "rough", False):  # times are known to some 1e-6 of them only
            step[:, k] *= 200
        both = []
        for sign in (1.0, -1.0):
            found, told = _of_task(measure, Population(population.setting, values + sign * step), duty)
            place = {name: i for i, name in enumerate(told)}
            none: FloatArray = np.full(len(values), np.nan)
            both.append(np.stack([found[:, place[n]] if n in place else none for n in names], axis=1))
        slopes.append((both[0] - both[1]) / (2 * step[:, [k]]))
    return np.nan_to_num(np.stack(slopes, axis=-1), posinf=0.0, neginf=0.0)


@dataclass(frozen=True)
class OfDrives(OfDesigns):
    """A measure of the drives over a task, one number for each axis, or for each rating of each axis."""

    slow: bool = True

    def of_task(self, population: Population, index: int, duty: int) -> dict[str, float]:
        """Return its numbers of one design."""
        sizing = duties_of(population, self.name).sizing(population, index, duty)
        if self.name == "rms_torque":
            return {str(leg): axis.rms_torque for leg, axis in enumerate(sizing.axes)}
        return {
            f"{leg} {rating.name}": rating.required / rating.limit
            if rating.limit > 0
            else (np.inf if rating.required > 0 else 0.0)
            for leg, axis in enumerate(sizing.axes)
            for rating in axis.ratings
        }

    def least(self, population: Population) -> float:
        """Return what it is at least for these variables of the machine, whatever counterbalances do.

        Of the ratings that the sliders' speeds alone decide, and of the ratio of inertia, where neither moved
        masses nor the lead vary.
        """
        if self.name == "rms_torque":
            return -np.inf
        tasks = range(len(duties_of(population, self.name).tasks))
        still = all(name.startswith(_MASSLESS) for name in population.setting.names)
        known = (*_OF_SPEED, "inertia ratio") if still else _OF_SPEED
        found = [
            value
            for duty in tasks
            for name, value in self.of_task(population, 0, duty).items()
            if name.partition(" ")[2] in known
        ]
        return max(found, default=-np.inf)

    def values(self, population: Population) -> FloatArray:
        """Raise: it is one of tasks only."""
        duties_of(population, self.name)
        raise InputError(f"{self.name}: is one of tasks")  # pragma: no cover - it is wrapped in `OverTasks`

    pieces = values


class OfBearings(OfDrives):
    """The least life of bearings, guides and ball nuts over a task."""

    def of_task(self, population: Population, index: int, duty: int) -> dict[str, float]:
        """Return it of one design."""
        return duties_of(population, self.name).lives(population, index, duty)


@dataclass(frozen=True)
class OfParts(OfDesigns):
    """A sum over the parts of the drives of all axes, of numbers that the catalogue has."""

    column: str = "cost"

    def values(self, population: Population) -> FloatArray:
        """Return it of designs, (D,)."""
        drive = duties_of(population, self.name).drive
        if drive is None:
            raise InputError(f"{self.name}: needs drives: drives=...")
        total = 0.0
        for part in (drive.motor, drive.gear, drive.transmission):
            own = getattr(part, self.column, None)
            if own is None and part != type(drive.gear)():
                raise InputError(f"{self.name}: {part.name} has no {self.column} in the catalogue")
            total += _AXES * float(own or 0.0)
        return np.full(len(population), total)

    def pieces(self, population: Population) -> Pieces:
        """Return its one piece, which does not change with any variable."""
        values = self.values(population)
        return Pieces(values[:, None], np.zeros((len(values), 1, len(population.setting.names))))


OF_TASKS = (
    OfDrives("rms_torque", "N m", "small", "largest rms torque of a motor over a task", over="task"),
    OfDrives(
        "worst_utilisation", "", "small",
        "largest required value of all drives by what the margin leaves of the rated one",
        over="task",
    ),
    OfBearings(
        "life", "h", "large", "least life L10 of bearings, guides and ball nuts over a task", over="task"
    ),
    OfParts("cost", "", "small", "cost of the drives of all axes, in the unit of the catalogue"),
    OfParts("drive_mass", "kg", "small", "mass of the drives of all axes", column="mass"),
)  # fmt: skip
"""Measures that need tasks."""


@dataclass(frozen=True, eq=False)
class Discrete(Readable):
    """A variable that is one of some values: a part of the drives, or a number."""

    label: str  # as the user calls it
    name: str  # one of `PARTS`, or the full name of a column [SI units]
    values: tuple[Any, ...]

    def told(self, index: int) -> str:
        """Return a value in words."""
        value = self.values[index]
        return f"{value:g}" if isinstance(value, float) else str(value.name)


def chosen_parts(label: str, given: Any, drives: Catalogue | None) -> Discrete:
    """Return which parts of a catalogue a variable may be: all, or some by their names."""
    if drives is None:
        raise InputError(f"variables.{label}: needs a catalogue: drives=...")
    kind = {"motor": "motors", "screw": "transmissions", "gear": "gears"}[label]
    parts = {part.name: part for part in getattr(drives, kind)}
    wanted = given.get("one_of") if isinstance(given, Mapping) and set(given) == {"one_of"} else given
    if wanted == "all":
        return Discrete(label, label, tuple(parts.values()))
    if isinstance(wanted, str) or not isinstance(wanted, Sequence) or not wanted:
        raise InputError(f"variables.{label}: expected 'all' or a list of names, got {shown(given)}")
    for name in wanted:
        if not isinstance(name, str) or name not in parts:
            hint = meant(name, parts, 0.5) if isinstance(name, str) else ""
            told = f"the catalogue has no {shown(name)}{hint or '.'} It has {', '.join(parts)}"
            raise InputError(f"variables.{label}: {told}")
    if len(set(wanted)) < len(wanted):
        raise InputError(f"variables.{label}: a name is there twice")
    return Discrete(label, label, tuple(parts[name] for name in wanted))


def require_together(together: Any) -> Together:
    """Return how tasks count together, or raise."""
    if together not in get_args(Together):
        raise InputError(f"together: expected 'worst' or 'mean', got {shown(together)}")
    found: Together = together
    return found
