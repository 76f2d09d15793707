"""Files of friction that grows with loads.

The form::

    hinges: {mu: 0.1, radius: 8 mm}                        # of all hinges
    universals: {mu: 0.1, radius: 8 mm}                    # of both axes of each
    slides: {drag: 4 N, mu: 0.01, arm: 30 mm, screw: 0.1}
    joints:                                                # where one joint differs
      hinge_platform: {mu: 0.002}
      hinge_lower_right: none
    smoothing: 1 mm/s

Numbers are in SI units, or have one of their own. Kinds of joints that are left out have no such friction.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields, replace
from typing import Any

from p3dof._base.errors import ParameterError
from p3dof._base.files import Source, called, parse_yaml, read_text
from p3dof.analysis.load_friction.contacts import KINDS, LoadFriction, kind_of
from p3dof.machine.parameters import PASSIVE, SLIDES
from p3dof.machine.parameters.plain import named, read_fields
from p3dof.machine.parameters.quantities import FORCE, LENGTH, RATE, Quantity

_NUMBERS: Mapping[str, Quantity] = {"radius": LENGTH, "arm": LENGTH, "drag": FORCE}


def read_load_friction(path: Source) -> LoadFriction:
    """Read how friction of joints grows with their loads; for the form see the module.

    Parameters
    ----------
    path : path-like or stream
        The YAML file.

    Returns
    -------
    LoadFriction

    Raises
    ------
    ParameterError
        If a field is missing, unknown, in a wrong unit or does not fit; the message names file and field.
    FileError
        If the file cannot be read.
    """
    source = called(path)
    known = tuple(item.name for item in fields(LoadFriction))
    data = read_fields(parse_yaml(read_text(path), source, ParameterError), source, (), known)
    parts: dict[str, Any] = {
        name: _contact(data[name], kind, None, f"{source}: {name}")
        for name, kind in KINDS.items()
        if name in data
    }
    if "joints" in data:
        where = f"{source}: joints"
        own = read_fields(data["joints"], where, (), (*SLIDES, *PASSIVE))
        parts["joints"] = {
            name: _contact(value, KINDS[kind_of(name)], parts.get(kind_of(name)), f"{where}.{name}")
            for name, value in own.items()
        }
    if "smoothing" in data:
        parts["smoothing"] = RATE.read(data["smoothing"], f"{source}: smoothing")
    return named(source, lambda: LoadFriction(**parts))


def _contact(data: Any, kind: type[Any], alike: Any, where: str) -> Any:
    """Return a contact, with the numbers of its kind where a joint has none of its own; None for "none"."""
    if data == "none":
        return None
    needed = [item.name for item in fields(kind) if item.default is MISSING] if alike is None else []
    data = read_fields(data, where, needed, [item.name for item in fields(kind)])
    values = {
        key: _NUMBERS[key].read(value, f"{where}.{key}") if key in _NUMBERS else value
        for key, value in data.items()
    }
    return named(where, lambda: kind(**values) if alike is None else replace(alike, **values))
