"""Stiffness files: YAML.

The form of a file, in which everything may be left out::

    hinges: {radial: 100 N/um, axial: 50 N/um, tilt: 10 N m/mrad}
    slides: {lateral: 200 N/um, tilt: 20 N m/mrad, roll: 10 N m/mrad}
    universals: {force: 80 N/um, moment: 4 N m/mrad}
    rods: {diameter: 20 mm, young: 210 GPa, poisson: 0.3}    # or: rods: rigid
    joints:                                     # where one joint differs
      hinge_left: {radial: 60 N/um}
    misfit: {shift: 5 um, turn: 0.1 mrad}       # what assembly may be off by, in every joint
    cuts: paper                                 # or points: ball joints at the ends of the legs

Numbers are in SI units, or have one of their own. What is left out has the values of `Stiffness`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

from p3dof._base.errors import InputError, ParameterError
from p3dof._base.files import Source, called, parse_yaml, read_text
from p3dof.analysis.reactions.joints import JOINTS
from p3dof.analysis.reactions.stiffness import KINDS, Misfit, RodSection, Stiffness, kind_of
from p3dof.machine.parameters.plain import named, read_fields
from p3dof.machine.parameters.quantities import (
    ANGLE,
    LENGTH,
    PRESSURE,
    STIFFNESS,
    TURNING_STIFFNESS,
    Quantity,
)

_NUMBERS: Mapping[str, Quantity] = {
    "radial": STIFFNESS,
    "axial": STIFFNESS,
    "lateral": STIFFNESS,
    "force": STIFFNESS,
    "tilt": TURNING_STIFFNESS,
    "roll": TURNING_STIFFNESS,
    "moment": TURNING_STIFFNESS,
    "diameter": LENGTH,
    "young": PRESSURE,
    "shift": LENGTH,
    "turn": ANGLE,
}


def read_stiffness(path: Source) -> Stiffness:
    """Read how joints and rods give way; for the form see the module.

    Parameters
    ----------
    path : path-like or stream
        The YAML file.

    Returns
    -------
    Stiffness

    Raises
    ------
    ParameterError
        If a field is unknown, in a wrong unit or does not fit; the message names file and field.
    FileError
        If the file cannot be read.
    """
    source = called(path)
    known = tuple(item.name for item in fields(Stiffness))
    data = read_fields(parse_yaml(read_text(path), source, ParameterError), source, (), known)
    parts: dict[str, Any] = {
        name: _read(data[name], kind(), f"{source}: {name}") for name, kind in KINDS.items() if name in data
    }
    if "joints" in data:
        where = f"{source}: joints"
        own = read_fields(data["joints"], where, (), [joint.name for joint in JOINTS])
        alike = {name: parts.get(name, kind()) for name, kind in KINDS.items()}
        parts["joints"] = {
            name: _read(value, alike[kind_of(name)], f"{where}.{name}") for name, value in own.items()
        }
    if "rods" in data:
        rigid = data["rods"] == "rigid"
        parts["rods"] = None if rigid else _read(data["rods"], RodSection(), f"{source}: rods")
    if "misfit" in data:
        parts["misfit"] = _read(data["misfit"], Misfit(), f"{source}: misfit")
    if "cuts" in data:
        parts["cuts"] = data["cuts"]
    try:
        return named(source, lambda: Stiffness(**parts))
    except InputError as error:
        raise ParameterError(f"{source}: {error}") from error


def _read(data: Any, start: Any, where: str) -> Any:
    """Return a part with the numbers of a file in place of its own."""
    data = read_fields(data, where, (), [item.name for item in fields(start)])
    values = {
        key: _NUMBERS[key].read(value, f"{where}.{key}") if key in _NUMBERS else value
        for key, value in data.items()
    }
    return named(where, lambda: replace(start, **values))
