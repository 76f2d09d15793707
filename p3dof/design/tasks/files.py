"""Task files: YAML in and out.

The form::

    name: pick and place
    path: straight                       # or spline
    profile: quintic                     # or septic, s-curve
    smoothness: 2                        # or 3, of the path at the ends of blends
    turning_length: 100 mm               # what a turn of 1 rad counts as
    carrying: {mass: 200 g, com: [0, 0, 0], inertia: [0, 0, 0]}           # at the beginning
    limits: {force: 300 N, jerk: [500, 500, 300 m/s^3]}   # besides the machine's
    waypoints:
      - {name: home, pose: [0, 0, 0 deg]}
      - name: pick
        pose: [-150 mm, 0, -15 deg]
        dwell: 200 ms
        pick_up: {mass: 950 g, com: [0, 0, -40 mm], inertia: [0, 0, 0]}
      - {pose: [-150 mm, 25 mm], blend: 25 mm}          # passed: θ goes smoothly from stop to stop
      - {pose: [150 mm, 25 mm], blend: 25 mm}
      - {name: place, pose: [150 mm, 0, 15 deg], dwell: 0.2, put_down: true}
      - {name: back, pose: [0, 0, 0], duration: 1.5, wrench: [0, 10 N, -50 N, 0, 0, 0]}

Only ``waypoints`` is needed, and ``pose`` in each. Numbers are in SI units, or have one of their own. The
waypoints may stand in any order of fields; what is carried is a body as in a parameter file.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
import yaml

from p3dof._base.checks import shown, warn_caller
from p3dof._base.errors import ParameterError, TaskError
from p3dof._base.files import Source, called, parse_yaml, read_text, suffix_of, write_atomic
from p3dof._base.quantities import ANGLE, FORCE, JERK, LENGTH, MASS, MOMENT, POWER, SPEED, TIME, Quantity
from p3dof.design.tasks.paths import Waypoint
from p3dof.design.tasks.task import MotionTask, Task
from p3dof.machine.parameters import LEGS
from p3dof.machine.parameters.machine import read_body, read_fields

_TASK = ("name", "path", "profile", "smoothness", "turning_length", "carrying", "limits", "waypoints")
_WAYPOINT = (
    "pose",
    "name",
    "blend",
    "dwell",
    "duration",
    "pick_up",
    "put_down",
    "wrench",
    "blend_range",
    "tolerance",
)
_POSE = (LENGTH, LENGTH, ANGLE)
_ROWS: Mapping[str, tuple[Quantity, ...]] = {
    "pose": _POSE,
    "wrench": (FORCE,) * 3 + (MOMENT,) * 3,
    "blend_range": (LENGTH,) * 2,
    "tolerance": _POSE,
}
_LIMITS: Mapping[str, Quantity] = {
    "force": FORCE,
    "speed": SPEED,
    "power": POWER,
    "reflected_mass": MASS,
    "jerk": JERK,
    "nut_force": FORCE,
}
_PLAIN: Mapping[str, Quantity] = {"blend": LENGTH, "dwell": TIME, "duration": TIME}


_LONG = 60.0
"""Times of a waypoint above this may be in ms [s]."""


def read_task(path: Source) -> Task:
    """Read a task file.

    Parameters
    ----------
    path : path-like or stream
        The YAML file.

    Raises
    ------
    TaskError
        If a field is missing, unknown, in a wrong unit or does not fit; the message names file and field.
    FileError
        If the file cannot be read.
    """
    return parse(read_text(path), called(path))


def write_task(task: Task, path: str | os.PathLike[str]) -> None:
    """Write a task file that `read_task` reads back to the same numbers.

    Parameters
    ----------
    task : Task
        What to write.
    path : path-like
        The YAML file; replaced whole or not at all.

    Raises
    ------
    InputError
        If its name ends neither in ``.yaml`` nor in ``.yml``.
    TaskError
        If it is the path of a motion.
    FileError
        If the file cannot be written.
    """
    if isinstance(task, MotionTask):
        raise TaskError("the path of a motion has no form as a task file: Motion.to_csv writes the motion")
    suffix_of(path, "parameters")
    write_atomic(path, dump(task))


def parse(text: str, source: str = "task") -> Task:
    """Read a task from YAML text."""
    try:
        data = read_fields(parse_yaml(text, source, TaskError), source, ("waypoints",), _TASK)
        points = data["waypoints"]
        if not isinstance(points, list):
            raise TaskError(f"{source}: waypoints: expected a list, got {shown(points)}")
        values: dict[str, Any] = {
            key: data[key] for key in ("name", "path", "profile", "smoothness") if key in data
        }
        if "turning_length" in data:
            values["turning_length"] = LENGTH.read(data["turning_length"], f"{source}: turning_length")
        if "carrying" in data:
            values["carrying"] = read_body(data["carrying"], f"{source}: carrying")
        if "limits" in data:
            values["limits"] = _limits(data["limits"], f"{source}: limits")
        found = [_waypoint(point, f"{source}: waypoint {k + 1}") for k, point in enumerate(points)]
    except ParameterError as error:
        raise TaskError(str(error)) from error
    try:
        return Task(found, **values)
    except TaskError as error:
        raise TaskError(f"{source}: {error}") from error


def dump(task: Task) -> str:
    """Return the YAML text of a task; `parse` gives the same numbers back to the last bit."""
    data: dict[str, Any] = {"name": task.name, "path": task.path, "profile": task.profile}
    data["smoothness"] = task.smoothness
    data["turning_length"] = task.turning_length
    if task.carrying is not None:
        data["carrying"] = task.carrying.to_dict()
    if task.limits:
        data["limits"] = {
            name: list(value) if isinstance(value, tuple) else value for name, value in task.limits.items()
        }
    data["waypoints"] = [_plain(point) for point in task.waypoints]
    header = "# p3dof task: m, rad, s, kg, N, N m\n"
    return header + yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=110)


def _limits(data: Any, where: str) -> dict[str, Any]:
    """Return limits, each one number or those of A, B, C."""
    data = read_fields(data, where, (), (*_LIMITS, "curve"))
    found: dict[str, Any] = {}
    for name, value in data.items():
        place = f"{where}: {name}"
        if name == "curve":
            found[name] = _curve(value, place)
        elif isinstance(value, list):
            if len(value) != len(LEGS):
                raise TaskError(f"{place}: expected a number, or those of A, B and C, got {shown(value)}")
            found[name] = [_LIMITS[name].read(one, f"{place}[{k}]") for k, one in enumerate(value)]
        else:
            found[name] = _LIMITS[name].read(value, place)
    return found


def _curve(data: Any, where: str) -> list[Any]:
    """Return rows of speed and force, or those of A, B and C."""
    if not isinstance(data, list) or not all(isinstance(row, list) and row for row in data):
        raise TaskError(f"{where}: expected rows of speed and force, or those of A, B and C")
    if all(isinstance(rows[0], list) for rows in data):
        return [_curve(rows, f"{where}[{k}]") for k, rows in enumerate(data)]
    for k, row in enumerate(data):
        if len(row) != 2:
            raise TaskError(f"{where}[{k}]: expected speed and force, got {len(row)} values")
    return [_row(row, (SPEED, FORCE), f"{where}[{k}]") for k, row in enumerate(data)]


def _waypoint(data: Any, where: str) -> Waypoint:
    data = read_fields(data, where, ("pose",), _WAYPOINT)
    values: dict[str, Any] = {}
    for key, value in data.items():
        place = f"{where}: {key}"
        if key in _PLAIN:
            values[key] = _PLAIN[key].read(value, place)
            if key != "blend" and isinstance(value, int | float) and value > _LONG:
                warn_caller(f"{place} = {value:g} s (ms? then write '{value:g} ms')")
        elif key in _ROWS:
            values[key] = _row(value, _ROWS[key], place)
        else:
            values[key] = read_body(value, place) if key == "pick_up" else value
    try:
        return Waypoint(**values)
    except TaskError as error:
        name = values.get("name")
        words = str(error).removeprefix(f"waypoint {name}: ")  # the file's line has its number too
        raise TaskError(f"{where}{f' ({name})' * isinstance(name, str)}: {words}") from error


def _row(values: Any, kinds: tuple[Quantity, ...], where: str) -> Any:
    """Return a list of numbers whose units differ."""
    if not isinstance(values, list):
        raise TaskError(f"{where}: expected a list of numbers, got {shown(values)}")
    if len(values) > len(kinds):
        raise TaskError(f"{where}: expected at most {len(kinds)} numbers, got {len(values)}")
    return [
        kind.read(value, f"{where}[{k}]") for k, (kind, value) in enumerate(zip(kinds, values, strict=False))
    ]


def _plain(point: Waypoint) -> dict[str, Any]:
    """Return a waypoint as plain data, without what is as usual."""
    data: dict[str, Any] = {"name": point.name} if point.name else {}
    data["pose"] = point.pose.tolist()
    data |= {
        key: getattr(point, key) for key in ("blend", "dwell", "duration", "put_down") if getattr(point, key)
    }
    if point.pick_up is not None:
        data["pick_up"] = point.pick_up.to_dict()
    if np.any(point.wrench):
        data["wrench"] = point.wrench.tolist()
    for key in ("blend_range", "tolerance"):
        if getattr(point, key) is not None:
            data[key] = getattr(point, key).tolist()
    return data
