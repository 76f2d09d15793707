"""Bearings files: YAML.

The form of a file::

    hinges:                                    # of every hinge and universal joint that `joints` leaves out
      {name: 6001, dynamic: 5.1 kN, static: 2.4 kN, X: 0.56, Y: 1.6, e: 0.27}
    guides:
      {name: size 15, dynamic: 10 kN, basis: 50 km, static: 16 kN, moments: [120 Nm, 120 Nm, 150 Nm]}
    joints:
      hinge_left: {name: needle, dynamic: 6 kN, kind: roller}

Numbers are in SI units, or have one of their own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from p3dof._base.errors import ParameterError
from p3dof._base.files import Source, called, parse_yaml, read_text
from p3dof.design.bearings.catalogue import SLIDES, TURNING, Bearing, Bearings, Guide
from p3dof.machine.parameters.plain import named, read_fields
from p3dof.machine.parameters.quantities import ANGLE, FORCE, LENGTH, MOMENT, Quantity

_NUMBERS: Mapping[str, Quantity] = {
    "dynamic": FORCE,
    "static": FORCE,
    "basis": LENGTH,
    "moments": MOMENT,
    "centre": LENGTH,
    "turn": ANGLE,
}


def read_bearings(path: Source) -> Bearings:
    """Read what the joints run in; for the form see the module.

    Parameters
    ----------
    path : path-like or stream
        The YAML file.

    Returns
    -------
    Bearings

    Raises
    ------
    ParameterError
        If a field is missing, unknown, in a wrong unit or does not fit; the message names file and field.
    FileError
        If the file cannot be read.
    """
    source = called(path)
    known = [item.name for item in fields(Bearings)]
    data = read_fields(parse_yaml(read_text(path), source, ParameterError), source, (), known)
    parts: dict[str, Any] = {}
    for name, kind in (("hinges", Bearing), ("guides", Guide)):
        if name in data:
            parts[name] = _read(data[name], kind, f"{source}: {name}")
    if "joints" in data:
        where = f"{source}: joints"
        own = read_fields(data["joints"], where, (), (*SLIDES, *TURNING))
        parts["joints"] = {
            name: _read(value, Guide if name in SLIDES else Bearing, f"{where}.{name}")
            for name, value in own.items()
        }
    return named(source, lambda: Bearings(**parts))


def _read(data: Any, kind: type[Any], where: str) -> Any:
    required = ("dynamic", "basis", "moments") if kind is Guide else ("dynamic",)
    data = read_fields(data, where, required, [item.name for item in fields(kind)])
    values = {
        key: _NUMBERS[key].read(value, f"{where}.{key}") if key in _NUMBERS else value
        for key, value in data.items()
    }
    return named(where, lambda: kind(**values))
