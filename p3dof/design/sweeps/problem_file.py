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
`p3dof.design.optimisation.problem_file`), with `count` and what else says how to sweep it.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from p3dof._base.blocks import Sweep, sweep
from p3dof._base.blocks.problem import not_among
from p3dof._base.checks import Progress
from p3dof._base.errors import InputError
from p3dof._base.files import called, parse_yaml, read_text
from p3dof.analysis.designs.fields import listed, machine_of, mapping, motion_of, named, wrench_of
from p3dof.design.optimisation import ProblemSweep
from p3dof.design.optimisation.problem_file import FIELDS as OF_PROBLEM
from p3dof.design.optimisation.problem_file import OF_SWEEPS, problem_of
from p3dof.design.sweeps.designs import DesignSweep
from p3dof.design.sweeps.inputs import OF_DESIGNS, OF_RUNS, reduction_of, sampling_of
from p3dof.design.sweeps.run_fields import run_sweep
from p3dof.design.sweeps.runs import RunSweep

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
class SweepPlan:
    """A sweep that a file describes.

    Parameters
    ----------
    problem : DesignSweep, RunSweep or ProblemSweep
        What to compute.
    options : mapping
        Arguments of `p3dof.sweep`: seed, block_size, keep, format, reductions.
    """

    problem: DesignSweep | RunSweep | ProblemSweep
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
    data = mapping(parse_yaml(read_text(path, _LARGEST_FILE), name, InputError), name, None)
    folder = Path(name).parent
    if "objectives" in data:
        mapping(data, name, (*OF_PROBLEM, *OF_SWEEPS))
        problem: Any = _design_problem(data, folder, name, any_size)
    else:
        mapping(data, name, FIELDS)
        problem = named(name, lambda: _problem(data, folder, name, any_size))
    options = {key: data[key] for key in ("seed", "block_size", "format") if key in data}
    keep = data.get("keep", "all")
    reductions = listed(data.get("reductions", []), f"{name}: reductions")
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
    return named(name, lambda: ProblemSweep(problem, data["count"], data.get("sampling", "sobol")))


def _problem(data: Mapping[str, Any], folder: Path, name: str, any_size: bool) -> DesignSweep | RunSweep:
    """Return what the fields describe."""
    machine = machine_of(data.get("machine"), folder, f"{name}: machine", any_size)
    if "run" in data:
        for key in ("bodies", "figures"):
            if key in data:
                raise InputError(f"{key}: expected none with `run`: runs keep their bodies, and have figures")
        return run_sweep(data, sampling_of(data, folder, name, OF_RUNS, any_size), machine, folder, name)
    return DesignSweep(
        sampling_of(data, folder, name, OF_DESIGNS, any_size),
        motion_of(data.get("motion", {"paper": _SAMPLES}), folder, f"{name}: motion"),
        machine,
        data.get("bodies", "kept"),
        wrench_of(data.get("wrench"), folder, f"{name}: wrench"),
        data.get("figures", ("singularity",)),
    )
