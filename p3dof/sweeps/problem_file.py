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

or with ``rows: designs.csv`` for `variables`, `sampling` and `count`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from p3dof.blocks import (
    Distribution,
    Grid,
    Histogram,
    LogUniform,
    Moments,
    Normal,
    ParetoArchive,
    Reduction,
    Samples,
    Sampling,
    TopK,
    Uniform,
    sweep,
)
from p3dof.blocks.results import Sweep
from p3dof.checks import Progress, shown
from p3dof.designs.names import QUANTITIES, full_name
from p3dof.errors import InputError, P3dofError, ParameterError
from p3dof.files import called, parse_yaml, read_text
from p3dof.motion import Motion, WrenchHistory, paper_motion
from p3dof.parameters import Parameters, read_parameters
from p3dof.parameters.quantities import Quantity
from p3dof.sweeps.designs import DesignSweep
from p3dof.sweeps.rows import FileRows

_T = TypeVar("_T")

FIELDS = (
    "machine",
    "motion",
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

SPREADS: dict[str, Callable[..., Distribution]] = {
    "uniform": Uniform,
    "log-uniform": LogUniform,
    "normal": Normal,
}
_SAMPLES = 201
_LARGEST_FILE = 1_000_000


@dataclass(frozen=True)
class SweepPlan:
    """A sweep that a file describes.

    Parameters
    ----------
    problem : DesignSweep
        What to compute.
    options : mapping
        Arguments of `p3dof.sweep`: seed, block_size, keep, format, reductions.
    """

    problem: DesignSweep
    options: Mapping[str, Any] = field(default_factory=dict)

    def run(
        self,
        folder: str | os.PathLike[str],
        *,
        client: Any = None,
        resume: bool = False,
        shared: bool = True,
        progress: Progress | None = None,
    ) -> Sweep:
        """Compute it; parameters and errors as of `p3dof.sweep`."""
        return sweep(
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

    Returns
    -------
    SweepPlan

    Raises
    ------
    InputError
        If a field is missing, unknown, or does not fit; the message names file and field.
    FileError, ParameterError, MotionError
        If a file that it names cannot be read, or is not right.
    """
    name = called(path)
    data = _mapping(parse_yaml(read_text(path, _LARGEST_FILE), name, InputError), name, FIELDS)
    folder = Path(name).parent
    problem = _named(
        name,
        lambda: DesignSweep(
            _sampling(data, folder),
            _motion(data.get("motion", {"paper": _SAMPLES}), folder, f"{name}: motion"),
            _machine(data.get("machine"), folder, f"{name}: machine", any_size),
            data.get("bodies", "kept"),
            _wrench(data.get("wrench"), folder),
            data.get("figures", ("singularity",)),
        ),
    )
    options = {key: data[key] for key in ("seed", "block_size", "format") if key in data}
    keep = data.get("keep", "all")
    reductions = _list(data.get("reductions", []), f"{name}: reductions")
    options["keep"] = None if keep == "none" else keep
    options["reductions"] = [
        _reduction(item, f"{name}: reductions[{i}]") for i, item in enumerate(reductions)
    ]
    return SweepPlan(problem, options)


def _sampling(data: Mapping[str, Any], folder: Path) -> Sampling:
    if "rows" in data:
        others = [key for key in ("variables", "sampling", "count") if key in data]
        if others or not isinstance(data["rows"], str):
            got = f"with {others[0]!r}" if others else shown(data["rows"])
            raise InputError(f"rows: expected a file of designs and no other inputs, got {got}")
        return FileRows(folder / data["rows"])
    variables = _mapping(data.get("variables"), "variables", None)
    known = {full_name(str(key)): value for key, value in variables.items()}
    spreads = {key: _spread(value, key) for key, value in known.items()}
    method = data.get("sampling", "grid" if all(isinstance(s, tuple) for s in spreads.values()) else "random")
    grid = {key: item for key, item in spreads.items() if isinstance(item, tuple)}
    free = {key: item for key, item in spreads.items() if isinstance(item, Distribution)}
    if method == "grid":
        if free or "count" in data:
            what = f"{next(iter(free))} without" if free else "a count besides"
            raise InputError(f"variables: expected `values` of each variable of a grid, got {what} them")
        return Grid(grid)
    if grid:
        raise InputError(f"variables.{next(iter(grid))}: `values` belong to a grid (sampling: grid)")
    if "count" not in data:
        raise InputError("count: expected how many designs there are, got nothing")
    return Samples(free, data["count"], method)


def _spread(value: Any, key: str) -> Distribution | tuple[float, ...]:
    """Return how a variable is spread, or its values."""
    where = f"variables.{key}"
    spread = _mapping(value, where, (*SPREADS, "values"))
    if len(spread) != 1:
        known = ", ".join((*SPREADS, "values"))
        raise InputError(f"{where}: expected one of {known}, got {len(spread)} of them")
    ((kind, given),) = spread.items()
    quantity = QUANTITIES[key]
    numbers = [_number(item, quantity, f"{where}.{kind}") for item in _list(given, f"{where}.{kind}")]
    if kind == "values":
        return tuple(numbers)
    if len(numbers) != 2:
        raise InputError(f"{where}.{kind}: expected two numbers, got {len(numbers)}")
    return _named(where, lambda: SPREADS[kind](*numbers))


def _number(value: Any, quantity: Quantity, where: str) -> float:
    found = quantity.read(value, where)
    if isinstance(found, bool) or not isinstance(found, int | float):
        raise InputError(f"{where}: expected {quantity.name}, got {shown(value)}")
    return float(found)


def _machine(value: Any, folder: Path, where: str, any_size: bool) -> Parameters | None:
    if value is None:
        return None
    if isinstance(value, str):
        return read_parameters(folder / value, any_size)
    return Parameters.from_dict(value, where, any_size)


def _motion(value: Any, folder: Path, where: str) -> Motion:
    if isinstance(value, str):
        return Motion.from_csv(folder / value)
    data = _mapping(value, where, ("paper", "file", "samples"))
    if "paper" in data and len(data) == 1:
        return paper_motion(data["paper"])
    if "file" not in data or "paper" in data or not isinstance(data["file"], str):
        raise InputError(f"{where}: expected a motion file, {{file: ..., samples: ...}} or {{paper: ...}}")
    motion = Motion.from_csv(folder / data["file"])
    return motion.resampled(data["samples"]) if "samples" in data else motion


def _wrench(value: Any, folder: Path) -> Any:
    return WrenchHistory.from_csv(folder / value) if isinstance(value, str) else value


_REDUCTIONS: dict[str, tuple[tuple[str, ...], Callable[[dict[str, Any]], Reduction]]] = {
    "top": (("count", "largest", "columns"), lambda d: TopK(d.pop("top"), **d)),
    "pareto": (("resolution", "columns"), lambda d: ParetoArchive(d.pop("pareto"), **d)),
    "histogram": (
        ("from", "to", "bins"),
        lambda d: Histogram(d.pop("histogram"), d.pop("from"), d.pop("to"), **d),
    ),
    "moments": ((), lambda d: Moments(d["moments"])),
}
"""What a reduction may say beside its own name, and what it means."""


def _reduction(value: Any, where: str) -> Reduction:
    data = dict(_mapping(value, where, None))
    kinds = [kind for kind in _REDUCTIONS if kind in data]
    if len(kinds) != 1:
        raise InputError(f"{where}: expected one of {', '.join(_REDUCTIONS)}")
    others, make = _REDUCTIONS[kinds[0]]
    _mapping(data, where, (kinds[0], *others))
    for key in ("from", "to"):
        if kinds[0] == "histogram" and key not in data:
            raise InputError(f"{where}: the field {key!r} is missing")
    if kinds[0] in {"top", "histogram"} and not isinstance(data[kinds[0]], str):
        raise InputError(f"{where}.{kinds[0]}: expected the name of a column, got {shown(data[kinds[0]])}")
    return _named(where, lambda: make(data))


def _mapping(value: Any, where: str, fields: tuple[str, ...] | None) -> Mapping[str, Any]:
    if not isinstance(value, Mapping) or not value:
        raise InputError(f"{where}: expected fields, got {'nothing' if not value else shown(value)}")
    for key in value:
        if not isinstance(key, str) or (fields is not None and key not in fields):
            told = f", expected {', '.join(fields)}" if fields else ""
            raise InputError(f"{where}: unknown field {shown(key)}{told}")
    return value


def _list(value: Any, where: str) -> list[Any]:
    if not isinstance(value, list):
        raise InputError(f"{where}: expected a list, got {shown(value)}")
    return value


def _named(where: str, make: Callable[[], _T]) -> _T:
    """Return what a constructor makes; errors about arguments get the place in the file in front."""
    try:
        return make()
    except (InputError, ParameterError) as error:
        told = str(error.args[0])
        if told.startswith(where):
            raise
        raise type(error)(f"{where}: {told}") from error
    except TypeError as error:  # a value of a kind that no constructor expects
        raise InputError(f"{where}: {error}") from error
    except P3dofError:
        raise
