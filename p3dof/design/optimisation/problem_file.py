"""A design problem as a YAML file.

Such as this one::

    machine: machine.yaml               # a parameter file, or its content; the paper's machine without it
    motion: {paper: 201}                # samples of the paper's motion, or a motion file: motion.csv
    bodies: solids                      # computed anew for each design; or kept
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
      relations: [R >= r + 0.03]        # linear, in SI units
    robust:                             # of machines as they are built, by standard deviations
      sigma: {R: 0.5 mm, L: 0.5 mm}
      measures: [peak_force, singularity]
      k: 3
    count: 100000                       # how many designs, for `p3dof sweep` alone
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from p3dof._base.errors import InputError, P3dofError
from p3dof._base.files import called, parse_yaml, read_text
from p3dof.analysis.designs.fields import listed, machine_of, mapping, motion_of, named, number, wrench_of
from p3dof.design.optimisation.bounds import constraints_of
from p3dof.design.optimisation.box import GRID, Box
from p3dof.design.optimisation.constraints import Constraint
from p3dof.design.optimisation.problem import DesignProblem
from p3dof.design.optimisation.robust import Robust
from p3dof.design.optimisation.statement import DRIVE_STIFFNESS, SAMPLES, STEEL_MODULUS
from p3dof.machine.parameters.quantities import ANGLE, LENGTH, PRESSURE, STIFFNESS

FIELDS = (
    "machine",
    "motion",
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

    Returns
    -------
    DesignProblem

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
    """Return the problem that the fields of a file describe.

    Parameters
    ----------
    data : mapping
        The fields; others than those of a problem are left alone.
    folder : Path
        Where files are that it names.
    name : str
        What to call the file.
    any_size : bool
        Take a machine of more than 20 m or less than 1 mm too.

    Returns
    -------
    DesignProblem

    Raises
    ------
    InputError
        If a field does not fit.
    """
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
            motion_of(data.get("motion", {"paper": SAMPLES}), folder, f"{name}: motion"),
            [_as_built(item, robust) for item in listed(objectives, f"{name}: objectives")],
            _of_built(_constraints(data.get("constraints"), f"{name}: constraints"), robust),
            box=_box(data["box"], f"{name}: box") if data.get("box") is not None else None,
            machine=machine_of(data.get("machine"), folder, f"{name}: machine", any_size),
            bodies=data.get("bodies", "kept"),
            fixed=data.get("fixed"),
            wrench=wrench_of(data.get("wrench"), folder, f"{name}: wrench"),
            modulus=number(data.get("modulus", STEEL_MODULUS), PRESSURE, f"{name}: modulus"),
            drive_stiffness=number(
                data.get("drive_stiffness", DRIVE_STIFFNESS), STIFFNESS, f"{name}: drive_stiffness"
            ),
        ),
    )
    used = {measure.name for measure in (*made.objectives, *(item.measure for item in made.constraints))}
    for plain, measure in robust.items():
        if measure.name not in used:
            raise InputError(f"{name}: robust.measures: {plain} is no objective, and has no bound")
    return made


def _robust(value: Any, where: str) -> dict[str, Robust]:
    """Return measures of machines as they are built, by the names of the measures that they are made of."""
    fields = dict(mapping(value, where, ("sigma", "measures", "k", "kind", "points", "seed")))
    for key in ("sigma", "measures"):
        if key not in fields:
            raise InputError(f"{where}: the field {key!r} is missing")
    names = listed(fields.pop("measures"), f"{where}.measures")
    return {str(name): named(where, partial(Robust, name, **fields)) for name in names}


def _as_built(given: Any, robust: Mapping[str, Robust]) -> Any:
    return robust.get(given, given) if isinstance(given, str) else given


def _of_built(given: Any, robust: Mapping[str, Robust]) -> tuple[Constraint, ...]:
    """Return constraints, bounds on some measures being those on machines as they are built."""
    return tuple(
        replace(item, measure=_as_built(item.measure.name, robust)) if item.measure.name in robust else item
        for item in constraints_of(given)
    )


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
            pair = [number(end, quantity, f"{where}.{key}") for end in listed(fields[key], f"{where}.{key}")]
        except P3dofError as error:
            raise InputError(str(error)) from error
        if len(pair) != 2:
            raise InputError(f"{where}.{key}: expected two ends, got {len(pair)}")
        ends[key] = (pair[0], pair[1])
    grid = fields.get("grid", list(GRID))
    return named(where, lambda: Box(**ends, grid=tuple(listed(grid, f"{where}.grid"))))
