"""Fields of files about designs: what they may hold, and the files that they name."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from p3dof._base.checks import real, shown
from p3dof._base.errors import FileError, InputError, MotionError, ParameterError
from p3dof._base.files import called
from p3dof.machine.motion import Motion, WrenchHistory, paper_motion
from p3dof.machine.parameters import Parameters, read_parameters
from p3dof.machine.parameters.quantities import Quantity

_T = TypeVar("_T")


def mapping(value: Any, where: str, fields: tuple[str, ...] | None) -> Mapping[str, Any]:
    """Return a mapping that is not empty, and has no fields but these if they are told."""
    if not isinstance(value, Mapping) or not value:
        raise InputError(f"{where}: expected fields, got {'nothing' if not value else shown(value)}")
    for key in value:
        if not isinstance(key, str) or (fields is not None and key not in fields):
            told = f", expected {', '.join(fields)}" if fields else ""
            raise InputError(f"{where}: unknown field {shown(key)}{told}")
    return value


def listed(value: Any, where: str) -> list[Any]:
    """Return a list."""
    if not isinstance(value, list):
        raise InputError(f"{where}: expected a list, got {shown(value)}")
    return value


def named(where: str, make: Callable[[], _T]) -> _T:
    """Return what a constructor makes; errors about arguments get the place in the file in front."""
    try:
        return make()
    except (InputError, MotionError, ParameterError) as error:
        told = str(error.args[0])
        if told.startswith(where):
            raise
        raise type(error)(f"{where}: {told}") from error
    except TypeError as error:  # a value of a kind that no constructor expects
        raise InputError(f"{where}: {error}") from error


def number(value: Any, quantity: Quantity | None, where: str) -> float:
    """Return a number in SI units of one that may have a unit, where there is one."""
    found = value if quantity is None else quantity.read(value, where)
    if isinstance(found, bool) or not isinstance(found, int | float):
        what = "a number without a unit" if quantity is None else quantity.name
        raise InputError(f"{where}: expected {what}, got {shown(value)}")
    return real(where, found)


def machine_of(value: Any, folder: Path, where: str, any_size: bool) -> Parameters | None:
    """Return the machine of a file or of fields, if there is one."""
    if value is None:
        return None
    if isinstance(value, str):
        return read_beside(lambda path: read_parameters(path, any_size), folder, value, where)
    return Parameters.from_dict(value, where, any_size)


def motion_of(value: Any, folder: Path, where: str) -> Motion:
    """Return the paper's motion or that of a file."""
    if isinstance(value, str):
        return read_beside(Motion.from_csv, folder, value, where)
    data = mapping(value, where, ("paper", "file", "samples"))
    if "paper" in data and len(data) == 1:
        return paper_motion(data["paper"])
    if "file" not in data or "paper" in data or not isinstance(data["file"], str):
        raise InputError(f"{where}: expected a motion file, {{file: ..., samples: ...}} or {{paper: ...}}")
    motion = read_beside(Motion.from_csv, folder, data["file"], where)
    return motion.resampled(data["samples"]) if "samples" in data else motion


def wrench_of(value: Any, folder: Path, where: str) -> Any:
    """Return the load of a file, or what else the field holds."""
    return read_beside(WrenchHistory.from_csv, folder, value, where) if isinstance(value, str) else value


def read_beside(read: Callable[[Path], _T], folder: Path, name: str, where: str) -> _T:
    """Return what a file holds that is named in this one; say so if it is not there."""
    path = folder / name
    if not os.path.exists(path):  # noqa: PTH110 - Path.exists fails where a name is too long
        raise FileError(f"{where}: there is no file {called(path)}; names count from the folder of this file")
    return read(path)
