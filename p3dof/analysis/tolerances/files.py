"""What is uncertain about a machine, as a YAML file for `p3dof tolerance` and `p3dof sensitivity`.

Such as this one::

    sigma:                        # standard deviations, for `tolerance`
      R: 0.1 mm
      platform.mass: 2 %
      encoder: 10 um              # for poses only
    variables:                    # ranges, for `sensitivity`
      R: 10 %                     # evenly spread from 90 to 110 %
      L: [380 mm, 420 mm]
      platform.mass: {normal: [8 kg, 200 g]}
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any, NamedTuple

from p3dof._base.checks import shown
from p3dof._base.errors import InputError
from p3dof._base.files import called, parse_yaml, read_text

FIELDS = ("sigma", "variables")
"""The fields of the file; `reference/uncertainty.schema.json` has their forms."""

_LARGEST_FILE = 1_000_000


class Uncertainty(NamedTuple):
    """What a file says is uncertain.

    Parameters
    ----------
    sigma : dict
        Standard deviations by names of parameters, as of `p3dof.tolerance`.
    variables : dict
        How parameters are spread, as of `p3dof.sensitivity`.
    """

    sigma: dict[str, Any]
    variables: dict[str, Any]


def read_uncertainty(path: str | os.PathLike[str] | Any) -> Uncertainty:
    """Read what is uncertain about a machine from a YAML file.

    Parameters
    ----------
    path : path-like or stream
        The file.

    Returns
    -------
    Uncertainty
        As it stands there: names and numbers are looked at where they are used.

    Raises
    ------
    InputError
        If a field is unknown, or is no mapping; the message names file and field.
    FileError
        If the file cannot be read.
    """
    name = called(path)
    data = parse_yaml(read_text(path, _LARGEST_FILE), name, InputError)
    if not isinstance(data, Mapping) or not data:
        raise InputError(f"{name}: expected the fields sigma or variables, got nothing of the kind")
    for key in data:
        if key not in FIELDS:
            raise InputError(f"{name}: unknown field {shown(key)}, expected {', '.join(FIELDS)}")
    found = []
    for key in FIELDS:
        given = data.get(key, {})
        if not isinstance(given, Mapping):
            raise InputError(f"{name}: {key}: expected names of parameters with numbers, got {shown(given)}")
        found.append({str(each): value for each, value in given.items()})
    return Uncertainty(*found)


def plain_of(result: Any) -> dict[str, Any]:
    """Return a result of this room as plain data for JSON: arrays as lists, NaN as None.

    Parameters
    ----------
    result : ForceTolerance, PoseTolerance, SobolIndices or LocalSensitivity
        Without the machines drawn.

    Returns
    -------
    dict
        By the names of its fields; SI units.
    """
    left_out = ("peaks", "drawn", "errors", "values")
    found = {name: value for name, value in vars(result).items() if name not in left_out}
    for name in ("machines", "impossible", "normalised"):
        if hasattr(result, name):
            found[name] = getattr(result, name)
    return {name: _plain(value) for name, value in found.items()}


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and value != value else value  # noqa: PLR0124 - NaN
