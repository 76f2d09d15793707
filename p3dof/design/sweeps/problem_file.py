"""A sweep as a YAML file.

Such as this one::

    machine: machine.yaml               # a parameter file, or its content; the paper's machine without it
    motion: {paper: 201}                # samples of the paper's motion, or a motion file: motion.csv
    variables:                          # named as the columns of `p3dof designs`
      R: {uniform: [240 mm, 280 mm]}
      L: {uniform: [380 mm, 500 mm]}
      platform.mass: {normal: [8 kg, 200 g]}    # mean and standard deviation
    sampling: sobol                     # or random, latin-hypercube, grid (of variables with `values`)
    count: 100000
    figures: [singularity, sliders]
    reductions:
      - {top: peak_force, count: 20}
      - {pareto: {peak_force: min, reach: max}}
      - {histogram: peak_force, from: 0, to: 500, bins: 50}
      - {moments: [peak_force]}

or with ``rows: designs.csv`` for `variables`, `sampling` and `count`. A field ``run`` makes them runs in
time, which follow the motion under a controller, with variables named as the columns of `p3dof runs`::

    run: {controller: pd, rate: 1000, noise: {position: 2 um, velocity: 0.1 mm/s}}

A file with a field ``objectives`` is a design problem, as `p3dof optimise` takes it (see
`p3dof.design.optimisation.problem`), with `count` and what else says how to sweep it.
"""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from p3dof._base import blocks
from p3dof._base.blocks.problem import not_among
from p3dof._base.blocks.sampling import METHODS
from p3dof._base.checks import FloatArray, Progress, Readable, positive, shown
from p3dof._base.errors import FileError, InputError
from p3dof._base.files import called, parse_yaml, read_text
from p3dof._base.files.reading import reason
from p3dof._base.quantities import FORCE, LENGTH, SPEED, TIME, Quantity
from p3dof.analysis.designs import files
from p3dof.analysis.designs.columns import LENGTHS, QUANTITIES, columns_of, full_name
from p3dof.design.optimisation import ProblemSweep
from p3dof.design.optimisation.problem import FIELDS as OF_PROBLEM
from p3dof.design.optimisation.problem import OF_SWEEPS, problem_of
from p3dof.design.sweeps.designs import DesignSweep, RunSweep
from p3dof.machine.motion import Motion, WrenchHistory
from p3dof.machine.motion.core import load_along, natural_ramp
from p3dof.machine.parameters import PAPER, Parameters
from p3dof.machine.parameters.machine import LARGEST
from p3dof.runs import KINDS, ControlLoop, InitialState, Integration, Noise
from p3dof.runs.controllers import CONTROLLERS
from p3dof.runs.many.columns import run_columns_of, variable_of

LARGEST_CSV = 500_000_000
"""Largest CSV file that is taken, which each worker holds as a whole [bytes]; Parquet may be larger."""

_ROWS = 100_000


class FileRows:
    """The rows of a file of designs, one after the other; the workers must see the file.

    `meaning`: returns the columns that headers mean: those of designs by default, or of runs.
    """

    def __init__(
        self, path: str | os.PathLike[str], meaning: files.Meaning = columns_of, any_size: bool = True
    ) -> None:
        self.path = Path(called(path)).absolute()
        self.sha256 = _sha256(self.path)
        self._meaning = meaning
        self.names, self.count = _look(self.path, meaning, any_size)

    def settings(self) -> dict[str, Any]:
        """Return what the columns depend on."""
        return {"kind": "rows", "rows": self.count, "columns": list(self.names), "sha256": self.sha256}

    def draw(self, block: blocks.Block) -> dict[str, FloatArray]:
        """Return the columns of a block, in the units of the file."""
        _require_same(self.path, self.sha256)
        if self.path.suffix.lower() == ".parquet":
            return _rows_of_parquet(self.path, self.names, block.start, block.stop)
        columns = _whole(self.path, self.sha256, self._meaning)
        return {name: columns[name][block.start : block.stop] for name in self.names}


def _look(path: Path, meaning: files.Meaning, any_size: bool) -> tuple[tuple[str, ...], int]:
    """Return names and number of rows, after a look at each of them."""
    if path.suffix.lower() != ".parquet" and path.stat().st_size > LARGEST_CSV:
        raise InputError(f"{path}: expected at most {LARGEST_CSV} bytes of CSV; Parquet may be larger")
    names: tuple[str, ...] = ()
    count = 0
    for rows in files.read_designs(path, _ROWS, meaning):
        names = tuple(rows.columns)
        if not any_size:
            files.require_size(meaning(names), rows, path.name)
        count += len(next(iter(rows.columns.values())))
    return names, count


@lru_cache(maxsize=2)
def _whole(path: Path, _sha256: str, meaning: files.Meaning) -> dict[str, FloatArray]:
    parts = [rows.columns for rows in files.read_designs(path, _ROWS, meaning)]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


@lru_cache(maxsize=8)
def _require_same(path: Path, sha256: str) -> None:
    """Raise if a worker sees another file, or none; looked at once by each process."""
    if _sha256(path) != sha256:
        raise InputError(f"{path}: the file has changed since the sweep was begun")


def _sha256(path: Path) -> str:
    found = hashlib.sha256()
    try:
        with path.open("rb") as stream:
            for chunk in iter(partial(stream.read, 1 << 20), b""):
                found.update(chunk)
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({reason(error)})") from error
    return found.hexdigest()


def _rows_of_parquet(path: Path, names: tuple[str, ...], start: int, stop: int) -> dict[str, FloatArray]:
    """Read some rows: only the groups of rows that they are in."""
    import pyarrow.parquet

    with pyarrow.parquet.ParquetFile(path) as file:
        groups: list[int] = []
        first = 0
        for group, (begin, end) in enumerate(_groups(file)):
            if begin < stop and end > start:
                first = begin if not groups else first
                groups.append(group)
        table = file.read_row_groups(groups, columns=list(names)).slice(start - first, stop - start)
        return {name: np.asarray(table.column(name).to_numpy(), dtype=np.float64) for name in names}


def _groups(file: Any) -> Iterator[tuple[int, int]]:
    begin = 0
    for group in range(file.metadata.num_row_groups):
        end = begin + file.metadata.row_group(group).num_rows
        yield begin, end
        begin = end


class Naming(NamedTuple):
    """What may differ between the items of a sweep."""

    variable: Callable[[str], tuple[str, Quantity | None]]
    """Returns the full name of a variable, and the quantity that it is; None for plain numbers."""
    columns: files.Meaning  # returns the columns that the headers of a table mean


def _design_variable(name: str) -> tuple[str, Quantity | None]:
    known = full_name(name)
    return known, QUANTITIES[known]


OF_DESIGNS, OF_RUNS = Naming(_design_variable, columns_of), Naming(variable_of, run_columns_of)

SPREADS: dict[str, Callable[..., blocks.Distribution]] = {
    "uniform": blocks.Uniform,
    "log-uniform": blocks.LogUniform,
    "normal": blocks.Normal,
}


def sampling_of(
    data: Mapping[str, Any], folder: Path, name: str, naming: Naming, any_size: bool = False
) -> blocks.Sampling:
    """Return where the inputs come from: the fields `rows`, or `variables`, `sampling` and `count`."""
    if "rows" in data:
        others = [key for key in ("variables", "sampling", "count") if key in data]
        if others or not isinstance(data["rows"], str):
            got = f"with {others[0]!r}" if others else shown(data["rows"])
            raise InputError(f"rows: expected a file of designs and no other inputs, got {got}")
        return files.read_beside(
            lambda path: FileRows(path, naming.columns, any_size), folder, data["rows"], f"{name}: rows"
        )
    variables = files.mapping(data.get("variables"), "variables", None)
    spreads = {}
    for given, value in variables.items():
        key, quantity = naming.variable(str(given))
        spreads[key] = _spread(value, key, quantity, any_size)
    method = data.get("sampling", "grid" if all(isinstance(s, tuple) for s in spreads.values()) else "random")
    grid = {key: item for key, item in spreads.items() if isinstance(item, tuple)}
    free = {key: item for key, item in spreads.items() if isinstance(item, blocks.Distribution)}
    if method == "grid":
        if free or "count" in data:
            what = f"{next(iter(free))} without" if free else "a count besides"
            raise InputError(f"variables: expected `values` of each variable of a grid, got {what} them")
        return blocks.Grid(grid)
    if method not in METHODS:
        raise InputError(f"sampling: expected {', '.join(METHODS)} or grid, got {shown(method)}")
    if grid:
        raise InputError(f"variables.{next(iter(grid))}: `values` belong to a grid (sampling: grid)")
    if "count" not in data:
        raise InputError("count: expected how many items there are, got nothing")
    return blocks.Samples(free, data["count"], method)


def _spread(
    value: Any, key: str, quantity: Quantity | None, any_size: bool
) -> blocks.Distribution | tuple[float, ...]:
    """Return how a variable is spread, or its values."""
    where = f"variables.{key}"
    spread = files.mapping(value, where, (*SPREADS, "values"))
    if len(spread) != 1:
        known = ", ".join((*SPREADS, "values"))
        raise InputError(f"{where}: expected one of {known}, got {len(spread)} of them")
    ((kind, given),) = spread.items()
    numbers = [
        files.number_of(item, quantity, f"{where}.{kind}") for item in files.listed(given, f"{where}.{kind}")
    ]
    large = max(numbers, default=0.0)
    if key in LENGTHS and large > LARGEST and not any_size:
        raise InputError(
            f"{where}.{kind}: {large:g} m is more than {LARGEST:g} m: lengths are in metres; did you mean "
            f"'{large:g} mm'? (--any-size takes it as it is)"
        )
    if kind == "values":
        return tuple(numbers)
    if len(numbers) != 2:
        raise InputError(f"{where}.{kind}: expected two numbers, got {len(numbers)}")
    return files.named(where, lambda: SPREADS[kind](*numbers))


_REDUCTIONS: dict[str, tuple[tuple[str, ...], Callable[[dict[str, Any]], blocks.Reduction]]] = {
    "top": (("count", "largest", "columns"), lambda d: blocks.TopK(d.pop("top"), **d)),
    "pareto": (("resolution", "columns"), lambda d: blocks.ParetoArchive(d.pop("pareto"), **d)),
    "histogram": (
        ("from", "to", "bins"),
        lambda d: blocks.Histogram(d.pop("histogram"), d.pop("from"), d.pop("to"), **d),
    ),
    "moments": ((), lambda d: blocks.Moments(d["moments"])),
}
"""What a reduction may say beside its own name, and what it means."""


def reduction_of(value: Any, where: str, columns: tuple[str, ...]) -> blocks.Reduction:
    """Return one of the field `reductions`, for a problem with these columns."""
    data = dict(files.mapping(value, where, None))
    kinds = [kind for kind in _REDUCTIONS if kind in data]
    if len(kinds) != 1:
        raise InputError(f"{where}: expected one of {', '.join(_REDUCTIONS)}")
    others, make = _REDUCTIONS[kinds[0]]
    files.mapping(data, where, (kinds[0], *others))
    for key in ("from", "to"):
        if kinds[0] == "histogram" and key not in data:
            raise InputError(f"{where}: the field {key!r} is missing")
    if kinds[0] in {"top", "histogram"} and not isinstance(data[kinds[0]], str):
        raise InputError(f"{where}.{kinds[0]}: expected the name of a column, got {shown(data[kinds[0]])}")
    return files.named(where, lambda: make(data).over(columns))


SAMPLES = 1001  # of the paper's motion, where nobody says what is followed

STEP = 1e-3  # longest step of RK4, where nobody says so [s]

_NO_LIMIT = 1e9  # how long a block may take [s]: a sweep can be interrupted

_NUMBERS: dict[str, Quantity | None] = {
    "rate": None,
    "frequency": None,
    "damping": None,
    "integral_time": TIME,
    "saturation": FORCE,
    "resolution": LENGTH,
    "delay": TIME,
    "bandwidth": None,
    "ramp": TIME,
    "duration": TIME,
    "step": TIME,
}
RUN_FIELDS = ("controller", *_NUMBERS, "noise", "differencing", "stop_at")  # fields of `run`


def run_sweep(
    data: Mapping[str, Any], sampling: blocks.Sampling, machine: Parameters | None, folder: Path, name: str
) -> RunSweep:
    """Return the runs that a file describes."""
    where = f"{name}: run"
    fields = files.mapping(data["run"], where, RUN_FIELDS)
    given = {
        key: files.number_of(fields[key], quantity, f"{where}.{key}")
        for key, quantity in _NUMBERS.items()
        if key in fields
    }
    followed = files.motion_of(data.get("motion", {"paper": SAMPLES}), folder, f"{name}: motion")
    ramp = given.get("ramp", natural_ramp(followed))
    motion = files.named(where, lambda: followed.from_rest(ramp)) if ramp else followed
    load = files.wrench_of(data.get("wrench"), folder, f"{name}: wrench")
    model = PAPER if machine is None else machine
    return RunSweep(
        sampling,
        files.named(where, lambda: positive("duration", given.get("duration", motion.duration), InputError)),
        machine,
        start=InitialState(motion.pose[0], motion.velocity[0]),
        controller=files.named(where, lambda: _controller(fields, given, model, motion)),
        control=files.named(where, lambda: _control(fields, given, where)),
        wrench=load_along(load, followed, ramp) if isinstance(load, WrenchHistory) else load,
        stop_at=_stop_at(fields, where),
        integration=files.named(
            where, lambda: Integration(scheme="rk4", step=given.get("step", STEP), time_limit=_NO_LIMIT)
        ),
    )


def _stop_at(fields: Mapping[str, Any], where: str) -> list[Any]:
    found = files.listed(fields.get("stop_at", list(KINDS)), f"{where}.stop_at")
    for kind in found:
        if kind not in KINDS:
            raise InputError(f"{where}.stop_at: expected some of {', '.join(KINDS)}, got {shown(kind)}")
    return found


def _controller(
    fields: Mapping[str, Any], given: Mapping[str, float], machine: Parameters, motion: Motion
) -> Any:
    kind = fields.get("controller", "pd")
    if not isinstance(kind, str) or kind not in CONTROLLERS:
        raise InputError(f"controller: expected {', '.join(CONTROLLERS)}, got {shown(kind)}")
    return CONTROLLERS[kind](
        machine,
        motion,
        given.get("frequency", 5.0),
        given.get("damping", 1.0),
        integral_time=given.get("integral_time", math.inf),
    )


def _control(fields: Mapping[str, Any], given: Mapping[str, float], where: str) -> ControlLoop:
    noise = None
    if "noise" in fields:
        told = files.mapping(fields["noise"], f"{where}.noise", ("position", "velocity", "seed"))
        noise = Noise(
            files.number_of(told.get("position", 0.0), LENGTH, f"{where}.noise.position"),
            files.number_of(told.get("velocity", 0.0), SPEED, f"{where}.noise.velocity"),
            told.get("seed", 0),
        )
    return ControlLoop(
        given.get("rate", 1000.0),
        given.get("saturation", False),
        noise,
        resolution=given.get("resolution", 0.0),
        differencing=fields.get("differencing", False),
        delay=given.get("delay", 0.0),
        bandwidth=given.get("bandwidth", math.inf),
    )


FIELDS = (
    "machine",
    "motion",
    "run",
    "bodies",
    "wrench",
    "figures",
    "variables",
    "sampling",
    "count",
    "rows",
    "seed",
    "block_size",
    "keep",
    "format",
    "reductions",
)
"""The fields of the file; `reference/sweep.schema.json` has their forms."""

_SAMPLES = 201
_LARGEST_FILE = 1_000_000


@dataclass(frozen=True)
class SweepPlan(Readable):
    """A sweep that a file describes."""

    problem: DesignSweep | RunSweep | ProblemSweep  # what to compute
    options: Mapping[str, Any] = field(default_factory=dict)
    """Arguments of `p3dof.sweep`: seed, block_size, keep, format, reductions."""

    def run(
        self,
        folder: str | os.PathLike[str],
        *,
        client: Any = None,
        resume: bool = False,
        shared: bool = True,
        progress: Progress | None = None,
    ) -> blocks.Sweep:
        """Compute it; parameters and errors as of `p3dof.sweep`."""
        return blocks.sweep(
            self.problem,
            folder,
            client=client,
            resume=resume,
            shared=shared,
            progress=progress,
            **self.options,
        )


def read_sweep(path: str | os.PathLike[str], any_size: bool = False) -> SweepPlan:
    """Read a sweep from a YAML file; files that it names are beside it.

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
    data = files.mapping(parse_yaml(read_text(path, _LARGEST_FILE), name, InputError), name, None)
    folder = Path(name).parent
    if "objectives" in data:
        files.mapping(data, name, (*OF_PROBLEM, *OF_SWEEPS))
        problem: Any = _design_problem(data, folder, name, any_size)
    else:
        files.mapping(data, name, FIELDS)
        problem = files.named(name, lambda: _problem(data, folder, name, any_size))
    options = {key: data[key] for key in ("seed", "block_size", "format") if key in data}
    keep = data.get("keep", "all")
    reductions = files.listed(data.get("reductions", []), f"{name}: reductions")
    options["keep"] = None if keep == "none" else keep
    for column in keep if isinstance(keep, list) else ():
        if column not in problem.columns:
            raise InputError(f"{name}: keep: {not_among(column, problem.columns)}")
    options["reductions"] = [
        reduction_of(item, f"{name}: reductions[{i}]", problem.columns) for i, item in enumerate(reductions)
    ]
    if not options["reductions"] and isinstance(problem, ProblemSweep):
        options["reductions"] = list(problem.reductions)
    return SweepPlan(problem, options)


def _design_problem(data: Mapping[str, Any], folder: Path, name: str, any_size: bool) -> ProblemSweep:
    """Return the designs of a problem that has objectives and constraints."""
    if "count" not in data:
        raise InputError(f"{name}: count: expected how many designs there are, got nothing")
    problem = problem_of(data, folder, name, any_size)
    return files.named(name, lambda: ProblemSweep(problem, data["count"], data.get("sampling", "sobol")))


def _problem(data: Mapping[str, Any], folder: Path, name: str, any_size: bool) -> DesignSweep | RunSweep:
    """Return what the fields describe."""
    machine = files.machine_of(data.get("machine"), folder, f"{name}: machine", any_size)
    if "run" in data:
        for key in ("bodies", "figures"):
            if key in data:
                raise InputError(f"{key}: expected none with `run`: runs keep their bodies, and have figures")
        return run_sweep(data, sampling_of(data, folder, name, OF_RUNS, any_size), machine, folder, name)
    return DesignSweep(
        sampling_of(data, folder, name, OF_DESIGNS, any_size),
        files.motion_of(data.get("motion", {"paper": _SAMPLES}), folder, f"{name}: motion"),
        machine,
        data.get("bodies", "kept"),
        files.wrench_of(data.get("wrench"), folder, f"{name}: wrench"),
        data.get("figures", ("singularity",)),
    )
