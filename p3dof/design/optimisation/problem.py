"""`DesignProblem`: which machine would be better, and the ways to it.

A design problem as a YAML file.

Such as this one::

    machine: machine.yaml               # a parameter file, or its content; the paper's machine without it
    motion: {paper: 201}                # samples of the paper's motion, or a motion file: motion.csv
    bodies: solids                      # computed anew for each design, but for one's own; or kept
    variables:                          # named as the columns of `p3dof designs`
      R: [150 mm, 500 mm]
      L: [200 mm, 800 mm]
      rod_radius: [3 mm, 15 mm]
    fixed: {slider_edge: 50 mm}         # the same for all designs
    box: {y: [-100 mm, 100 mm], theta: [-30 deg, 30 deg]}
    objectives: [peak_force, width]
    constraints:
      singularity: {min: 15 deg}
      width: {max: 500 mm}
      relations: [R >= r + 30 mm, R**2 + r**2 <= L**2]    # formulas, in SI units or with units
    robust:                             # of machines as they are built, by standard deviations
      sigma: {R: 0.5 mm, L: 0.5 mm}
      measures: [peak_force, singularity]
      k: 3
    count: 100000                       # how many designs, for `p3dof sweep` alone
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from p3dof._base.blocks import Block, ParetoArchive, Reduction, Samples, Sweep, Uniform, sweep
from p3dof._base.blocks.sampling import Method
from p3dof._base.checks import Progress, shown
from p3dof._base.errors import InputError, P3dofError, TaskError
from p3dof._base.files import called, parse_yaml, read_text
from p3dof._base.quantities import ANGLE, LENGTH, PRESSURE, STIFFNESS, TIME
from p3dof.analysis.designs.files import (
    listed,
    machine_of,
    mapping,
    motion_of,
    named,
    number_of,
    read_beside,
    wrench_of,
)
from p3dof.design.bearings import read_bearings
from p3dof.design.clearance import Surroundings, read_surroundings
from p3dof.design.drives import read_catalogue
from p3dof.design.optimisation.constraints import Constraint, Formula, constraints_of
from p3dof.design.optimisation.evolution import GENERATIONS, Journal
from p3dof.design.optimisation.minimising import (
    STARTS,
    Optimiser,
    asking,
    by_combinations,
    by_descents,
    by_evolution,
    require_effort,
)
from p3dof.design.optimisation.optimum import Optimum
from p3dof.design.optimisation.pareto import GENERATIONS as FRONT_GENERATIONS
from p3dof.design.optimisation.pareto import POINTS, POPULATION, Front, FrontMethod, front_of, require_front
from p3dof.design.optimisation.population import GRID, Box, Measure
from p3dof.design.optimisation.robust import Robust
from p3dof.design.optimisation.statement import DRIVE_STIFFNESS, SAMPLES, STEEL_MODULUS, Statement
from p3dof.design.optimisation.task_measures import Duty
from p3dof.design.tasks import read_task


class ProblemSweep:
    """Designs that fill the bounds of a design problem, for `p3dof.sweep`.

    The columns are the variables by their full names, the objectives and the bounded measures by theirs,
    ``violation`` (0 for designs that keep all constraints) and ``status`` (a `DesignStatus`). Objectives of
    designs that miss constraints are NaN, so that reductions leave them out.
    """

    def __init__(
        self, problem: Statement, count: int, sampling: Method = "sobol", block_size: int = 5000
    ) -> None:
        bounds = zip(problem.variables.low.tolist(), problem.variables.high.tolist(), strict=True)
        spreads = (Uniform(low, high) for low, high in bounds)
        self.sampling = Samples(dict(zip(problem.variables.names, spreads, strict=True)), count, sampling)
        self.problem, self.block_size = problem, block_size

    @property
    def count(self) -> int:
        """How many designs there are."""
        return self.sampling.count

    @cached_property
    def _measures(self) -> dict[str, Measure]:
        named = {measure.name: measure for measure in self.problem.objectives}
        for index, item in enumerate(self.problem.constraints):
            simple = item.measure.name.replace("_", "").isalnum()
            named.setdefault(item.measure.name if simple else f"relation_{index}", item.measure)
        return named

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return (*self.problem.variables.names, *self._measures, "violation", "status")

    @property
    def units(self) -> dict[str, str]:
        """Units of the columns that have one."""
        known = dict(zip(self.problem.variables.names, self.problem.variables.units, strict=True))
        known |= {name: measure.unit for name, measure in self._measures.items()}
        return {name: unit for name, unit in known.items() if unit}

    @property
    def reductions(self) -> tuple[ParetoArchive, ...]:
        """What to find where nobody says: the Pareto front of the objectives."""
        ways: Any = {m.name: "min" if m.better == "small" else "max" for m in self.problem.objectives}
        return (ParetoArchive(ways),)

    def settings(self) -> dict[str, Any]:
        """Return everything that the results depend on."""
        return {"problem": self.problem.settings(), "sampling": dict(self.sampling.settings())}

    def compute(self, block: Block) -> dict[str, NDArray[Any]]:
        """Return the columns of a block."""
        drawn = self.sampling.draw(block)
        found = self.problem.evaluate(np.column_stack(list(drawn.values())))
        good, columns = found.feasible, dict[str, NDArray[Any]](drawn)
        objectives = {measure.name for measure in self.problem.objectives}
        values = np.concatenate([found.objectives, found.constraints], axis=1)
        measures = [*self.problem.objectives, *(item.measure for item in self.problem.constraints)]
        for name, measure in self._measures.items():
            column = values[:, next(k for k, each in enumerate(measures) if each is measure)]
            columns[name] = np.where(good, column, np.nan) if name in objectives else column
        return {**columns, "violation": found.violation, "status": found.status.astype(np.int64)}


class DesignProblem(Statement):
    """Find machines that are better: what may change, what is to become small, what must be kept.

    Parameters
    ----------
    variables : mapping of str to pair
        Lower and upper bound of each column of designs that may change (see `Designs`): lengths, sizes of
        solids, masses, the place of the motion (``offset.y`` and so on). Numbers in SI units, or texts with
        units such as ``"80 mm"``. ``{"one_of": [...]}`` instead of bounds for one of some values.
    motion : Motion, optional
        What every design does; the paper's with 201 samples by default.
    objectives : str, Measure, or sequence of these
        What to make small, or large where large is good: names of `p3dof.design.optimisation.MEASURES`, or
        measures of one's own, see `p3dof.design.optimisation.FunctionMeasure`.
    constraints : mapping or sequence
        By the name of a measure, ``{"min": ...}``, ``{"max": ...}`` or both, in its SI unit; in a sequence,
        besides, `Constraint` objects and relations of columns and measures, see
        `p3dof.design.optimisation.relation`. A mapping may have these by the name ``relations``.
    box : Box, optional
        Poses that every design must reach, for measures over poses.
    machine : Parameters, optional
        What has no column, and the design to begin with; the paper's machine by default.
    bodies : {"kept", "solids"} or mapping of str to these
        Keep the bodies of `machine`, or compute them anew from solids of each design; see `Designs`. Bodies
        of one's own, which are neither the paper's nor solids of the machine's lengths, are kept even
        then, unless a size of their solid varies. By kind (``slider``, ``leg``, ``crossbar``,
        ``platform``), those that are left out are kept.
    fixed : mapping of str to float, optional
        Columns that are the same for all designs, such as sizes of solids which would else be those given
        in `machine`, or scale with the lengths.
    wrench : array-like, shape (6,) or (N, 6), or callable, optional
        External force and moment on the platform at P [N, N m]; see `Manipulator.inverse_dynamics`.
    modulus : float
        Young's modulus of the rods [Pa].
    drive_stiffness : float
        Of one drive [N/m].
    surroundings : Surroundings, optional
        Payload and obstacles, for ``motion_clearance``, ``height`` and ``room``.
    level, threads
        What to run on, as of `MachineKernels`.
    tasks : Task, Duty, or sequence of these
        What every design does instead of a motion, with dwells and payloads.
    together : {"worst", "mean"}
        How several tasks count in objectives: the worst, or the mean by the weights of each `Duty`.
        Constraints hold in every task.
    drives : Catalogue or Drive, optional
        What the variables ``motor``, ``screw`` (or belt) and ``gear`` choose from, by ``"all"`` or a list of
        names; all axes have the same. The variable ``lead`` changes the lead of the screw.
    bearings : Bearings, optional
        For the measure ``life``.

    Raises
    ------
    InputError
        If an argument does not fit.
    """

    def minimise(
        self,
        objective: str | Measure | None = None,
        subject_to: Mapping[str, float | str] | None = None,
        *,
        method: Optimiser = "slsqp",
        starts: int = STARTS,
        generations: int = GENERATIONS,
        seed: int = 0,
        polish: bool = True,
        store: str | os.PathLike[str] | None = None,
        resume: bool = False,
        progress: Progress | None = None,
    ) -> Optimum:
        """Return the best design by one objective.

        Parameters
        ----------
        objective : str or Measure, optional
            What to make small, or large where large is good; the first objective by default.
        subject_to : mapping of str to float or str, optional
            The worst value that further measures may have, such as ``{"width": 0.5}`` or ``"500 mm"``.
        method : {"slsqp", "evolution"}
            Local optima from several starts by SLSQP with exact gradients, in epigraph form; or differential
            evolution, which needs no gradients.
        starts : int
            How many starts SLSQP has: the machine itself, and good designs of a Sobol sequence.
        generations : int
            Most generations of differential evolution.
        seed : int
            Of starts and random numbers.
        polish : bool
            Let SLSQP end what differential evolution found.
        store : path-like, optional
            Folder for what is finished, so that an interrupted optimisation can go on.
        resume : bool
            Go on with what is in the folder.
        progress : callable, optional
            Called with starts (or generations) done and all of them.

        Raises
        ------
        OptimisationError
            If no design satisfies all constraints: the message names them, and what is missing.
        InputError
            If an argument does not fit.
        SweepError
            If the folder holds another optimisation, or this one without `resume`.
        FileError
            If something cannot be read or written.
        """
        asked = asking(self, objective, subject_to)
        require_effort(method, starts, generations, seed)
        effort = {"method": method, "starts": starts, "generations": generations, "seed": int(seed)}
        with Journal(store, {"what": "minimise", "problem": asked.settings(), **effort}, resume) as journal:
            if asked.discrete:
                if method != "slsqp":
                    raise InputError("method: expected 'slsqp' for a problem with discrete variables")
                return by_combinations(asked, starts, seed, journal, progress)
            if method == "evolution":
                return by_evolution(asked, seed, generations, polish, journal, progress)
            return by_descents(asked, starts, seed, journal, progress)

    def pareto(
        self,
        objectives: Sequence[str | Measure] | None = None,
        *,
        method: FrontMethod = "epsilon",
        points: int = POINTS,
        population: int = POPULATION,
        generations: int = FRONT_GENERATIONS,
        polish: bool = True,
        seed: int = 0,
        store: str | os.PathLike[str] | None = None,
        resume: bool = False,
        progress: Progress | None = None,
    ) -> Front:
        """Return a Pareto front: designs that no other one beats in all objectives.

        Parameters
        ----------
        objectives : sequence of str or Measure, optional
            Two or more; those of the problem by default.
        method : {"epsilon", "nsga2", "nsga3"}
            The ε-constraint method, for two objectives: the first one as good as it can be for even bounds on
            the second. Or a genetic algorithm (extra ``studio``), whose designs are then polished.
        points : int
            Designs of the polished front.
        population, generations : int
            Of the genetic algorithm.
        polish : bool
            Make the first objective of its designs as good as the others allow; else take them as they are.
        seed : int
            Of all random numbers.
        store : path-like, optional
            Folder for what is finished, so that an interrupted front can go on.
        resume : bool
            Go on with what is in the folder.
        progress : callable, optional
            Called with generations, then points done and all of them.

        Raises
        ------
        OptimisationError
            If no design satisfies all constraints.
        InputError, SweepError, FileError
            As `minimise`.
        MissingExtraError
            If pymoo is needed and not installed.
        """
        asked = self if objectives is None else self.asking(tuple(objectives))
        effort = {"method": method, "points": points, "population": population, "generations": generations}
        _require_continuous(asked)
        require_front(asked, method, points, population, generations, seed)
        about = {"what": "pareto", "problem": asked.settings(), **effort}
        with Journal(store, {**about, "polish": bool(polish), "seed": int(seed)}, resume) as journal:
            numbers = points, population, generations
            return front_of(asked, method, numbers, polish, seed, journal, progress)

    def sweep(
        self,
        count: int,
        store: str | os.PathLike[str],
        *,
        client: Any = None,
        sampling: Method = "sobol",
        seed: int = 0,
        resume: bool = False,
        reductions: Sequence[Reduction] | None = None,
        progress: Progress | None = None,
        **options: Any,
    ) -> Sweep:
        """Evaluate designs that fill the bounds of the variables, block by block, here or on a cluster.

        Parameters
        ----------
        count : int
            How many designs.
        store : path-like
            Folder for the blocks.
        client : distributed.Client, p3dof._base.blocks.Processes or Executor, optional
            Who computes; this process by default.
        sampling : {"sobol", "random", "latin-hypercube"}
            How designs fill the bounds.
        seed : int
            Of the sampling.
        resume : bool
            Go on with the sweep that is in the folder.
        reductions : sequence of Reduction, optional
            What to find of all designs; the Pareto front of the objectives by default.
        progress : callable, optional
            Called with designs done and all.
        **options
            Further ones of `p3dof.sweep`: workers, keep, block_size, format, shared, in_flight.

        Raises
        ------
        InputError, SweepError, FileError
            As of `p3dof.sweep`.
        """
        _require_continuous(self)
        problem = ProblemSweep(self, count, sampling)
        options["reductions"] = problem.reductions if reductions is None else tuple(reductions)
        return sweep(problem, store, client=client, seed=seed, resume=resume, progress=progress, **options)


def _require_continuous(problem: Statement) -> None:
    if problem.discrete:
        label = problem.discrete[0].label
        raise InputError(f"variables: {label} is discrete, which only minimise takes")


FIELDS = (
    "machine",
    "motion",
    "tasks",
    "together",
    "drives",
    "bearings",
    "bodies",
    "wrench",
    "variables",
    "fixed",
    "box",
    "objectives",
    "constraints",
    "robust",
    "modulus",
    "drive_stiffness",
    "surroundings",
)
"""The fields of the file; `reference/problem.schema.json` has their forms."""

OF_SWEEPS = ("sampling", "count", "seed", "block_size", "keep", "format", "reductions")
"""Fields for `p3dof sweep`, which reads the same file."""

_LARGEST_FILE = 1_000_000


def read_problem(path: str | os.PathLike[str], any_size: bool = False) -> DesignProblem:
    """Read a design problem from a YAML file; files that it names are beside it.

    Parameters
    ----------
    path : path-like
        The file.
    any_size : bool
        Take a machine of more than 20 m or less than 1 mm too.

    Raises
    ------
    InputError
        If a field is missing, unknown, or does not fit; the message names file and field.
    FileError, ParameterError, MotionError
        If a file that it names cannot be read, or is not right.
    """
    name = called(path)
    data = mapping(parse_yaml(read_text(path, _LARGEST_FILE), name, InputError), name, (*FIELDS, *OF_SWEEPS))
    return problem_of(data, Path(name).parent, name, any_size)


def problem_of(data: Mapping[str, Any], folder: Path, name: str, any_size: bool = False) -> DesignProblem:
    """Return the problem that the fields of a file describe."""
    if "variables" not in data:
        raise InputError(f"{name}: the field 'variables' is missing")
    objectives = data.get("objectives", ["peak_force"])
    if isinstance(objectives, str):
        objectives = [objectives]
    variables = mapping(data["variables"], f"{name}: variables", None)
    robust = _robust(data["robust"], f"{name}: robust") if data.get("robust") is not None else {}
    made = named(
        name,
        lambda: DesignProblem(
            variables,
            None
            if "motion" not in data and "tasks" in data
            else motion_of(data.get("motion", {"paper": SAMPLES}), folder, f"{name}: motion"),
            [_as_built(item, robust) for item in listed(objectives, f"{name}: objectives")],
            _of_built(_constraints(data.get("constraints"), f"{name}: constraints"), robust),
            box=_box(data["box"], f"{name}: box") if data.get("box") is not None else None,
            machine=machine_of(data.get("machine"), folder, f"{name}: machine", any_size),
            bodies=data.get("bodies", "kept"),
            fixed=data.get("fixed"),
            wrench=wrench_of(data.get("wrench"), folder, f"{name}: wrench"),
            modulus=number_of(data.get("modulus", STEEL_MODULUS), PRESSURE, f"{name}: modulus"),
            drive_stiffness=number_of(
                data.get("drive_stiffness", DRIVE_STIFFNESS), STIFFNESS, f"{name}: drive_stiffness"
            ),
            surroundings=_surroundings(data.get("surroundings"), folder, f"{name}: surroundings"),
            tasks=_tasks(data.get("tasks"), folder, f"{name}: tasks"),
            together=data.get("together", "worst"),
            drives=_beside(read_catalogue, data.get("drives"), folder, f"{name}: drives"),
            bearings=_beside(read_bearings, data.get("bearings"), folder, f"{name}: bearings"),
        ),
    )
    measures = [*made.objectives, *(item.measure for item in made.constraints)]
    measures += [one for each in measures if isinstance(each, Formula) for one in each.measures.values()]
    used = {measure.name for measure in measures}
    for plain, measure in robust.items():
        if measure.name not in used:
            raise InputError(f"{name}: robust.measures: {plain} is no objective, and has no bound")
    return made


def _beside(read: Callable[[Path], Any], value: Any, folder: Path, where: str) -> Any:
    """Return what a file beside this one holds, if one is named."""
    if value is not None and not isinstance(value, str):
        raise InputError(f"{where}: expected the name of a file, got {shown(value)}")
    return None if value is None else read_beside(read, folder, value, where)


def _tasks(value: Any, folder: Path, where: str) -> tuple[Duty, ...]:
    """Return tasks of files, each its name or `file` with how it is done."""
    if value is None:
        return ()
    found = []
    for k, item in enumerate(listed([value] if isinstance(value, str) else value, where)):
        place = f"{where}[{k}]"
        fields = dict(
            mapping(
                {"file": item} if isinstance(item, str) else item,
                place,
                ("file", "duration", "rest", "weight", "samples"),
            )
        )
        task = _beside(read_task, fields.pop("file", None), folder, f"{place}.file")
        if task is None:
            raise InputError(f"{place}: the field 'file' is missing")
        for key in ("duration", "rest"):
            if key in fields:
                fields[key] = number_of(fields[key], TIME, f"{place}.{key}")
        try:
            found.append(named(place, partial(Duty, task, **fields)))
        except TaskError as error:
            raise TaskError(f"{place}: {error}") from error
    return tuple(found)


def _robust(value: Any, where: str) -> dict[str, Robust]:
    """Return measures of machines as they are built, by the names of the measures that they are made of."""
    fields = dict(mapping(value, where, ("sigma", "measures", "k", "kind", "points", "seed")))
    for key in ("sigma", "measures"):
        if key not in fields:
            raise InputError(f"{where}: the field {key!r} is missing")
    names = listed(fields.pop("measures"), f"{where}.measures")
    return {str(name): named(where, partial(Robust, name, **fields)) for name in names}


def _surroundings(value: Any, folder: Path, where: str) -> Surroundings | None:
    """Return what stands around the machine, in a file beside that of the problem."""
    if value is None:
        return None
    if not isinstance(value, str):
        raise InputError(f"{where}: expected the name of a file, got {shown(value)}")
    return read_surroundings(folder / value)


def _as_built(given: Any, robust: Mapping[str, Robust]) -> Any:
    return robust.get(given, given) if isinstance(given, str) else given


def _of_built(given: Any, robust: Mapping[str, Robust]) -> tuple[Constraint, ...]:
    """Return constraints, bounds on some measures being those on machines as they are built."""
    found = []
    for item in constraints_of(given):
        measure = _as_built(item.measure.name, robust) if item.measure.name in robust else item.measure
        if isinstance(measure, Formula):
            inside = {name: robust.get(name, each) for name, each in measure.measures.items()}
            measure = replace(measure, measures=inside)
        found.append(replace(item, measure=measure))
    return tuple(found)


def _constraints(given: Any, where: str) -> Any:
    if given is None:
        return ()
    return given if isinstance(given, list) else mapping(given, where, None)


def _box(value: Any, where: str) -> Box:
    fields = mapping(value, where, ("y", "theta", "grid"))
    ends = {}
    for key, quantity in (("y", LENGTH), ("theta", ANGLE)):
        if key not in fields:
            raise InputError(f"{where}: the field {key!r} is missing")
        try:
            pair = [
                number_of(end, quantity, f"{where}.{key}") for end in listed(fields[key], f"{where}.{key}")
            ]
        except P3dofError as error:
            raise InputError(str(error)) from error
        if len(pair) != 2:
            raise InputError(f"{where}.{key}: expected two ends, got {len(pair)}")
        ends[key] = (pair[0], pair[1])
    grid = fields.get("grid", list(GRID))
    return named(where, lambda: Box(**ends, grid=tuple(listed(grid, f"{where}.grid"))))
