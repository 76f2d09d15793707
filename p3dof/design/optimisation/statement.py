"""`Statement` of a problem: variables, objectives, constraints, and what designs are worth by them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import asdict, replace
from functools import cached_property
from typing import Any

import numpy as np
from typing_extensions import Self

from p3dof._base.blocks import digest
from p3dof._base.checks import FloatArray, positive, shown
from p3dof._base.errors import InputError
from p3dof._base.time_series.wrenches import WrenchOverTime
from p3dof.analysis.designs.columns import BodiesOfDesigns, full_name, kept_columns, number_in, solids_among
from p3dof.analysis.designs.results import DesignStatus
from p3dof.closed_form.compiled.designs import compiled_level
from p3dof.closed_form.compiled.kernels import NUMPY
from p3dof.design.bearings import Bearings
from p3dof.design.clearance import Surroundings
from p3dof.design.drives import Catalogue, Drive
from p3dof.design.optimisation.constraints import Constraint, Formula, constraints_of
from p3dof.design.optimisation.evaluated import Asked, Evaluated, Variables, discrete_of, quantity_in_si
from p3dof.design.optimisation.measures import measure_of
from p3dof.design.optimisation.population import (
    Box,
    FunctionMeasure,
    Measure,
    Population,
    Setting,
    worst_gradient,
)
from p3dof.design.optimisation.robust import Robust
from p3dof.design.optimisation.task_measures import (
    LEAD,
    PARTS,
    Discrete,
    Duties,
    Duty,
    OverTasks,
    Together,
    plain,
    require_together,
    with_lead,
)
from p3dof.design.tasks import Task
from p3dof.machine.motion import Motion, paper_motion
from p3dof.machine.parameters import PAPER, Parameters


def settings_of(setting: Setting, asked: Asked) -> dict[str, Any]:
    """Return what results depend on, for JSON; measures of one's own count by their names and functions."""
    variables, box, motion = asked.variables, setting.box, setting.motion
    machine = json.dumps(setting.machine.to_dict(), sort_keys=True)
    bounds = zip(variables.names, variables.low.tolist(), variables.high.tolist(), strict=True)
    return {
        "variables": {name: [low, high] for name, low, high in bounds},
        "objectives": [_measure(measure) for measure in asked.objectives],
        "constraints": [_constraint(item) for item in asked.constraints],
        "box": None if box is None else {"y": list(box.y), "theta": list(box.theta), "grid": list(box.grid)},
        "bodies": setting.bodies,
        "fixed": dict(setting.fixed),
        "machine": hashlib.sha256(machine.encode()).hexdigest(),
        "motion": digest(motion.time, motion.pose, motion.velocity, motion.acceleration),
        "wrench": None if setting.wrench is None else digest(setting.wrench),
        "modulus": setting.modulus,
        "drive_stiffness": setting.drive_stiffness,
        "level": setting.level,
        **({} if setting.surroundings is None else {"surroundings": asdict(setting.surroundings)}),
        **({} if setting.duties is None else {"duties": setting.duties.settings()}),
    }


def _measure(measure: Measure) -> dict[str, Any]:
    kind = type(measure)
    found: dict[str, Any] = {
        "name": measure.name,
        "kind": f"{kind.__module__}.{kind.__qualname__}",
        "better": measure.better,
    }
    if isinstance(measure, FunctionMeasure):
        function = measure.function
        found["function"] = getattr(function, "__qualname__", type(function).__qualname__)
    if isinstance(measure, Formula):
        found["of"] = [_measure(each) for each in measure.measures.values()]
    if isinstance(measure, OverTasks):
        return {**_measure(measure.measure), "mean": measure.mean}
    if isinstance(measure, Robust):
        found |= {
            "sigma": dict(measure.sigma),
            "k": measure.k,
            "points": measure.points,
            "seed": measure.seed,
        }
        found["of"] = _measure(measure.measure)
    return found


def _constraint(item: Constraint) -> dict[str, Any]:
    return {**_measure(item.measure), "at_least": item.at_least, "bound": item.bound}


STEEL_MODULUS = 210e9  # young's modulus of steel [Pa]

DRIVE_STIFFNESS = 1e7  # of one drive, where nobody says [N/m]

SAMPLES = 201  # of the paper's motion, where no motion is given

_CHUNK = 2048  # designs that are evaluated at a time


class Statement:
    """What may change, what is to become better, what must be kept; arguments as of `DesignProblem`."""

    def __init__(
        self,
        variables: Mapping[str, Any],
        motion: Motion | None = None,
        objectives: str | Measure | Sequence[str | Measure] = ("peak_force",),
        constraints: Mapping[str, Any] | Sequence[Any] = (),
        *,
        box: Box | None = None,
        machine: Parameters | None = None,
        bodies: BodiesOfDesigns | Mapping[str, BodiesOfDesigns] = "kept",
        fixed: Mapping[str, Any] | None = None,
        wrench: WrenchOverTime = None,
        modulus: float = STEEL_MODULUS,
        drive_stiffness: float = DRIVE_STIFFNESS,
        surroundings: Surroundings | None = None,
        level: str | None = None,
        threads: int | None = None,
        tasks: Task | Duty | Sequence[Task | Duty] = (),
        together: Together = "worst",
        drives: Catalogue | Drive | None = None,
        bearings: Bearings | None = None,
    ) -> None:
        if not isinstance(surroundings, Surroundings | None):
            raise InputError(f"surroundings: expected Surroundings, got {shown(surroundings)}")
        if box is not None and not isinstance(box, Box):
            raise InputError(f"box: expected a Box, got {shown(box)}")
        catalogue = (
            Catalogue([drives.motor], [drives.transmission], [drives.gear])
            if isinstance(drives, Drive)
            else drives
        )
        if catalogue is not None and not isinstance(catalogue, Catalogue):
            raise InputError(f"drives: expected a Catalogue or a Drive, got {shown(drives)}")
        self.discrete = discrete_of(variables, catalogue)
        taken = [item.label for item in self.discrete]
        rest = {name: bounds for name, bounds in variables.items() if name not in taken}
        self.variables = Variables.of(rest) if rest else Variables((), (), np.zeros(0), np.zeros(0))
        self.chosen: tuple[int, ...] | None = None if self.discrete else ()
        self.together = require_together(together)
        work = _duties(tasks, self.together, catalogue, bearings, self.discrete)
        if work is not None and (motion is not None or wrench is not None):
            raise InputError("tasks: expected no motion and no wrench beside them: the tasks have their own")
        given = (objectives,) if isinstance(objectives, str | Measure) else tuple(objectives)
        if not given:
            raise InputError("objectives: expected one measure or more, got none")
        self.objectives = tuple(self._over(measure_of(item, "objectives"), work) for item in given)
        _require_once([measure.name for measure in self.objectives], "objectives")
        self.constraints = tuple(
            replace(item, measure=self._over(item.measure, work, worst=True))
            for item in constraints_of(constraints)
        )
        needs = (*self.objectives, *(item.measure for item in self.constraints))
        machine, known = PAPER if machine is None else machine, _fixed(fixed or {}, self.variables)
        varied = {*self.variables.names, *(item.name for item in self.discrete)}
        self.solids = solids_among(bodies, machine, known, varied)  # kinds of bodies
        kept = kept_columns(machine, self.solids, {*varied, *known}) if self.solids else {}
        self.setting = Setting(
            machine=machine,
            bodies="solids" if self.solids else "kept",
            fixed={**known, **kept},
            names=self.variables.names,
            motion=(paper_motion(SAMPLES) if work is None else work.tasks[0].plan.motion)
            if motion is None
            else motion,
            wrench=wrench,
            duties=work,
            box=box,
            modulus=positive("modulus", modulus, InputError),
            drive_stiffness=positive("drive_stiffness", drive_stiffness, InputError),
            figures=tuple(dict.fromkeys(group for measure in needs for group in measure.figures)),
            level=compiled_level(level, 1)[0] or NUMPY,
            threads=threads,
            surroundings=surroundings,
        )
        self._try_once()

    def __repr__(self) -> str:
        what, by = ", ".join(measure.name for measure in self.objectives), ", ".join(self.variables.labels)
        return f"{type(self).__name__}({what} by {by}, {len(self.constraints)} constraints)"

    def _try_once(self) -> None:
        """Raise now what measures would raise later."""
        if self.chosen is None:
            return self.choosing((0,) * len(self.discrete))._try_once()
        for name in self.setting.fixed:
            _require_not_carried(name, self.setting.duties)
        for name in self.variables.names:
            _require_not_carried(name, self.setting.duties)
        population = Population(self.setting, self.variables.values(np.full((1, len(self.variables)), 0.5)))
        population.designs  # noqa: B018 - names that do not fit each other
        for measure in (*self.objectives, *(item.measure for item in self.constraints)):
            measure.values(population)
        return None

    def _over(self, measure: Measure, work: Duties | None, worst: bool = False) -> Measure:
        """Return a measure as one of all tasks, where it depends on what is done."""
        if isinstance(measure, Formula):
            inside = {name: self._over(each, work, True) for name, each in measure.measures.items()}
            return replace(measure, measures=inside)
        inner = measure.measure if isinstance(measure, Robust) else measure
        over = getattr(inner, "over", "")
        if work is None or not over:
            return measure
        if inner is not measure:
            raise InputError(f"robust: {inner.name}: measures of tasks are not taken of uncertain machines")
        return OverTasks(measure, mean=self.together == "mean" and not worst)

    def choosing(self, indices: Sequence[int]) -> Self:
        """Return the problem with one value of each discrete variable.

        Parameters
        ----------
        indices : sequence of int
            Which value of each, in the order of the problem.

        Raises
        ------
        InputError
            If there are not so many values.
        """
        chosen = tuple(indices)
        good = len(chosen) == len(self.discrete) and all(
            0 <= k < len(item.values) for k, item in zip(chosen, self.discrete, strict=True)
        )
        if not good:
            raise InputError(
                f"choosing: expected an index for each of {len(self.discrete)} discrete variables"
            )
        new, fixed, work = copy(self), dict(self.setting.fixed), self.setting.duties
        vars(new).pop("start", None)
        parts, lead = {}, None
        for k, item in zip(chosen, self.discrete, strict=True):
            value = item.values[k]
            if item.name in PARTS:
                parts["transmission" if item.name == "screw" else item.name] = value
            elif item.name == LEAD:
                lead = value
            else:
                fixed[item.name] = value
        if work is not None and work.drive is not None:
            drive = replace(work.drive, name="", **parts)
            work = replace(work, drive=drive if lead is None else with_lead(drive, lead))
        new.chosen = chosen
        new.setting = replace(self.setting, fixed=fixed, duties=work)
        return new

    @property
    def choice(self) -> dict[str, str]:
        """What was chosen of each discrete variable, in words."""
        chosen = self.chosen or ()
        return {item.label: item.told(k) for item, k in zip(self.discrete, chosen, strict=bool(chosen))}

    @cached_property
    def start(self) -> FloatArray:
        """The variables of `machine` (n,), to begin with; NaN where it does not tell them."""
        machine, found = self.setting.machine, []
        for name in self.variables.names:
            if name == LEAD:
                found.append(float(getattr(self.setting.duties.drive.transmission, "lead", np.nan)))
            else:
                found.append(number_in(machine, name))
        return np.array(found)

    def evaluate(self, designs: Any) -> Evaluated:
        """Return objectives and constraints of designs; NaN where a design cannot perform the motion.

        Parameters
        ----------
        designs : array-like, shape (D, n) or (n,)
            Their variables, in the order of the problem [SI units].

        Raises
        ------
        InputError
            If they have another shape.
        """
        if self.chosen is None:
            raise InputError(
                "designs: the problem has discrete variables: say which values, by choosing(...)"
            )
        rows = self.variables.rows(designs)
        parts = [self._part(rows[start : start + _CHUNK]) for start in range(0, len(rows), _CHUNK)]
        parts = parts or [self._part(rows)]
        return Evaluated(
            asked=Asked(self.variables, self.objectives, self.constraints),
            designs=rows,
            objectives=np.concatenate([part[0] for part in parts]),
            constraints=np.concatenate([part[1] for part in parts]),
            status=np.concatenate([part[2] for part in parts]),
        )

    def _part(self, rows: FloatArray) -> tuple[FloatArray, FloatArray, Any]:
        population = Population(self.setting, rows)
        status = population.status
        with np.errstate(all="ignore"):
            objectives = [measure.values(population) for measure in self.objectives]
            constraints = [item.measure.values(population) for item in self.constraints]
        bad = status != 0
        found = [
            np.stack(columns, axis=1) if columns else np.zeros((len(rows), 0))
            for columns in (objectives, constraints)
        ]
        found[0][bad] = np.nan
        return found[0], found[1], status

    def gradient(self, design: Any) -> dict[str, FloatArray]:
        """Return exact derivatives (n,) of all objectives and bounded measures at one design, by their names.

        A peak changes as the force at its sample does: where two samples tie, that is the derivative to one
        side.

        Parameters
        ----------
        design : array-like, shape (n,)
            Its variables [SI units].

        Raises
        ------
        InputError
            If the design has another shape, or cannot perform the motion.
        """
        row = self.variables.rows(design)[:1]
        population = Population(self.setting, row)
        if not population.feasible[0]:
            reason = DesignStatus(int(population.status[0])).in_words
            raise InputError(f"design: it has no gradient: {reason}")
        measures = {measure.name: measure for measure in self.objectives}
        measures |= {item.measure.name: item.measure for item in self.constraints}
        return {
            name: worst_gradient(measure.pieces(population), measure.better)[0]
            for name, measure in measures.items()
        }

    def settings(self) -> dict[str, Any]:
        """Return everything that results depend on, as plain data."""
        found = settings_of(self.setting, Asked(self.variables, self.objectives, self.constraints))
        if self.discrete:
            found["discrete"] = {item.label: plain(item.values) for item in self.discrete}
        return found

    def machine(self, design: Any) -> Parameters:
        """Return a design as a machine.

        Parameters
        ----------
        design : array-like, shape (n,)
            Its variables [SI units].

        Raises
        ------
        InputError
            If the design has another shape.
        ParameterError
            If it is none that could be built.
        """
        return self.setting.designs(self.variables.rows(design)[:1])[0]

    def asking(self, objectives: Any = None, constraints: Sequence[Constraint] = ()) -> Self:
        """Return the same problem for other objectives, with further constraints.

        Parameters
        ----------
        objectives : str, Measure, or sequence of these, optional
            What to make better instead.
        constraints : sequence of Constraint
            What must be kept besides.

        Raises
        ------
        InputError
            If there is no such measure.
        """
        new = copy(self)
        if objectives is not None:
            given = (objectives,) if isinstance(objectives, str | Measure) else tuple(objectives)
            own = {measure.name: measure for measure in self.objectives}
            work = self.setting.duties
            new.objectives = tuple(
                own[item]
                if isinstance(item, str) and item in own
                else self._over(measure_of(item, "objectives"), work)
                for item in given
            )
        further = (
            replace(item, measure=self._over(item.measure, self.setting.duties, worst=True))
            for item in constraints
        )
        new.constraints = (*self.constraints, *further)
        needs = (*new.objectives, *(item.measure for item in new.constraints))
        figures = tuple(dict.fromkeys(group for measure in needs for group in measure.figures))
        new.setting = replace(self.setting, figures=figures)
        return new

    def unconstrained(self, objective: Measure) -> Self:
        """Return the same designs with one objective and no constraints."""
        new = self.asking(objective)
        new.constraints = ()
        return new

    def refined(self, times: int) -> Self:
        """Return the same problem on grids of poses and samples that are several times finer.

        Parameters
        ----------
        times : int
            How many times.
        """
        new, setting = self.asking(), self.setting
        box = None if setting.box is None else setting.box.finer(times)
        if setting.duties is not None:
            new.setting = replace(setting, duties=setting.duties.finer(times), box=box)
            return new
        motion = setting.motion.resampled((len(setting.motion) - 1) * times + 1)
        load = setting.wrench
        if load is not None:
            columns = [np.interp(motion.time, setting.motion.time, column) for column in np.asarray(load).T]
            load = np.stack(columns, axis=1)
        new.setting = replace(setting, motion=motion, wrench=load, box=box)
        return new


def _duties(
    tasks: Any, together: Together, catalogue: Catalogue | None, bearings: Any, discrete: Sequence[Discrete]
) -> Duties | None:
    """Return what designs do, and with which drives to begin with; None without tasks."""
    if not isinstance(tasks, Task | Duty | Sequence) or isinstance(tasks, str):
        raise InputError(f"tasks: expected a Task, a Duty or a sequence of them, got {shown(tasks)}")
    given = (tasks,) if isinstance(tasks, Task | Duty) else tuple(tasks)
    if not given:
        for name, value in (("drives", catalogue), ("bearings", bearings)):
            if value is not None:
                raise InputError(f"{name}: expected tasks beside them: tasks=...")
        return None
    if bearings is not None and not isinstance(bearings, Bearings):
        raise InputError(f"bearings: expected Bearings, got {shown(bearings)}")
    duties = tuple(item if isinstance(item, Duty) else Duty(item) for item in given)
    if catalogue is None:
        return Duties(duties, together, None, bearings)
    names = [item.label for item in discrete]
    for label, parts in zip(PARTS, (catalogue.motors, catalogue.transmissions, catalogue.gears), strict=True):
        if len(parts) > 1 and label not in names:
            raise InputError(
                f"drives: there are {len(parts)} to choose from, and no variable {label!r}: "
                f"variables={{{label!r}: 'all'}} tries all"
            )
    drive = Drive(catalogue.motors[0], catalogue.transmissions[0], catalogue.gears[0])
    return Duties(duties, together, drive, bearings, catalogue)


def _require_not_carried(name: str, work: Duties | None) -> None:
    carried = work is not None and any(p.payload is not None for d in work.tasks for p in d.plan.pieces)
    if carried and name.startswith("payload."):
        raise InputError(f"tasks: the platform carries what they say: {name} can be no column besides")


def _fixed(given: Mapping[str, Any], variables: Variables) -> dict[str, float]:
    if not isinstance(given, Mapping):
        raise InputError(f"fixed: expected numbers by name, got {shown(given)}")
    found = {}
    for label, value in given.items():
        name = full_name(label)
        if name in variables.names:
            raise InputError(f"fixed: {label} is a variable, too")
        found[name] = quantity_in_si(name, value, f"fixed.{label}")
    return found


def _require_once(names: list[str], where: str) -> None:
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{where}: {name} is there twice")
