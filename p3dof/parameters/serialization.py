"""Parameter files: YAML in and out.

The form::

    geometry: {r: 0.1, R: 0.25, L: 0.4, b: 0.05}        # m
    bodies:
      slider:   {mass: 0.9751, com: [0, 0, 0], inertia: [4.1e-4, 4.1e-4, 4.1e-4]}   # kg, m, kg m² about com
      leg:      {...}
      crossbar: {...}
      platform: {...}
    limits: {travel: [-0.2, 0.2], speed: 2, force: 500, tilt: [-0.785, 0.785]}      # optional: m, m/s, N, rad
    gravity: [0, 0, -9.806]                                                         # optional: m/s²
    friction:                                                                       # optional
      viscous: {sliders: 20, joints: 0.01}                                          # N s/m, N m s/rad
      coulomb: {sliders: 5, hinge_platform: 0.05}                                   # N, N m
      smoothing: 0.001                                                              # m/s, rad/s
    payload: {mass: 5, com: [0, 0, -0.1], inertia: [0.02, 0.02, 0.02]}    # optional, fixed to the platform;
                                                                          # or a list of several

``bodies`` names either these four kinds or all ten links, each on its own. An inertia is a diagonal or a full
matrix, about the mass centre; with ``about: [x, y, z]`` it is about that point instead.

Numbers are in SI units, or have one of their own, in lists each by itself::

    geometry: {r: 100 mm, R: 250 mm, L: 40 cm, b: 50 mm}
    payload: {mass: 950 g, com: [0, 0, -100 mm], inertia: [410 kg mm^2, 410 kg mm^2, 380 kg mm^2]}
    limits: {speed: 1500 mm/s, force: 0.5 kN, tilt: [-45 deg, 45 deg]}

Millimetres are not to be taken for metres: a machine whose longest length is above 20 m or below 1 mm is
refused unless the caller says ``any_size``.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, fields
from typing import Any, TypeVar

import yaml

from p3dof.checks import shown
from p3dof.errors import ParameterError
from p3dof.files import Source, called, parse_yaml, read_text, suffix_of, write_atomic
from p3dof.parameters.body import Body
from p3dof.parameters.friction import SLIDES, Friction
from p3dof.parameters.machine import LINKS, Bodies, Geometry, Limits, Parameters
from p3dof.parameters.quantities import (
    ACCELERATION,
    ANGLE,
    FORCE,
    HINGE_DAMPING,
    INERTIA,
    LENGTH,
    MASS,
    MOMENT,
    RATE,
    SLIDE_DAMPING,
    SPEED,
    Quantity,
)

_ANYWAY = "--any-size, or any_size=True, takes it as it is"
_METRES = f"lengths are in metres; did you mean mm? Write '120 mm' ({_ANYWAY})"
LARGEST, SMALLEST = 20.0, 1e-3
"""Largest and smallest machine that is believed, by its longest length [m]."""
_GEOMETRY = dict.fromkeys(("r", "R", "L", "b"), LENGTH)
_LIMITS = {"travel": LENGTH, "speed": SPEED, "force": FORCE, "tilt": ANGLE}
_BODY = {"mass": MASS, "com": LENGTH, "inertia": INERTIA, "about": LENGTH}
_FRICTION = {"viscous": (SLIDE_DAMPING, HINGE_DAMPING), "coulomb": (FORCE, MOMENT)}
_SLIDES = {"sliders", *SLIDES}
_KINDS = ("slider", "leg", "crossbar", "platform")
_T = TypeVar("_T")


def read_parameters(path: Source, any_size: bool = False) -> Parameters:
    """Read a parameter file.

    Parameters
    ----------
    path : path-like or stream
        The YAML file. Its numbers are in SI units, or texts with a unit: ``r: 120 mm``, ``mass: 950 g``,
        ``tilt: [-45 deg, 45 deg]``, ``inertia: [410 kg mm^2, ...]``, ``force: 0.5 kN``.
    any_size : bool
        Take a machine of more than 20 m or less than 1 mm too. Such a file is usually one in millimetres.

    Returns
    -------
    parameters : Parameters

    Raises
    ------
    ParameterError
        If a field is missing, unknown, in a wrong unit or not physical, or the machine is too large or too
        small; the message names file and field.
    FileError
        If the file cannot be read.
    """
    return parse(read_text(path), called(path), any_size)


def write_parameters(parameters: Parameters, path: str | os.PathLike[str]) -> None:
    """Write a parameter file that `read_parameters` reads back to the same numbers.

    Parameters
    ----------
    parameters : Parameters
        What to write.
    path : path-like
        The YAML file; replaced whole or not at all.

    Raises
    ------
    FileError
        If the file cannot be written.
    InputError
        If its name ends neither in ``.yaml`` nor in ``.yml``.
    ParameterError
        If `parameters` is something else.
    """
    if not isinstance(parameters, Parameters):
        raise ParameterError(f"parameters: expected Parameters, got {type(parameters).__name__}")
    suffix_of(path, "parameters")
    write_atomic(path, dump(parameters))


def parse(text: str, source: str = "parameters", any_size: bool = False) -> Parameters:
    """Read parameters from YAML text.

    Parameters
    ----------
    text : str
        The YAML text.
    source : str
        What to call it in an error: usually the file name.
    any_size : bool
        As for `read_parameters`.

    Returns
    -------
    parameters : Parameters

    Raises
    ------
    ParameterError
        As `read_parameters`; the message names `source` and the field.
    """
    data = _mapping(
        parse_yaml(text, source, ParameterError),
        source,
        required=("geometry", "bodies"),
        optional=("limits", "gravity", "friction", "payload"),
    )
    geometry = _record(data["geometry"], f"{source}: geometry", Geometry, _GEOMETRY, ("r", "R", "L"))
    if not any_size:
        _require_size(geometry, f"{source}: geometry")
    bodies = _bodies(data["bodies"], f"{source}: bodies")
    rest: dict[str, Any] = {}
    if "limits" in data:
        rest["limits"] = _record(data["limits"], f"{source}: limits", Limits, _LIMITS)
    if "gravity" in data:
        rest["gravity"] = ACCELERATION.read(data["gravity"], f"{source}: gravity")
    if "friction" in data:
        rest["friction"] = _friction(data["friction"], f"{source}: friction")
    machine = _named(source, lambda: Parameters(geometry, bodies, **rest))
    payloads = _payloads(data.get("payload", []), f"{source}: payload")
    if not any_size:
        for name, body in (*bodies.items(), *(("payload", payload) for payload in payloads)):
            require_near(body, f"{source}: {name}: com")
    for payload in payloads:
        machine = machine.carrying(payload)
    return machine


def dump(parameters: Parameters) -> str:
    """Return the YAML text of parameters; `parse` gives the same numbers back to the last bit.

    Parameters
    ----------
    parameters : Parameters
        What to write.

    Returns
    -------
    str
    """
    limits = {
        key: list(value) if isinstance(value, tuple) else value
        for key, value in asdict(parameters.limits).items()
    }
    data = {
        "geometry": asdict(parameters.geometry),
        "gravity": parameters.gravity.tolist(),
        "limits": limits,
        "bodies": {name: body.to_dict() for name, body in parameters.unladen.bodies.items()},
    }
    if parameters.friction:
        data["friction"] = parameters.friction.to_dict()
    payloads = [body.to_dict() for body in parameters.payloads]
    if payloads:
        data["payload"] = payloads[0] if len(payloads) == 1 else payloads
    header = "# p3dof parameters: m, kg, kg m² about the mass centre, m/s, N, rad, m/s²\n"
    return header + yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=110)


def require_near(body: Body, where: str) -> None:
    """Raise if a mass centre is so far away that millimetres were meant.

    Parameters
    ----------
    body : Body
        The body.
    where : str
        What to call the mass centre in an error.

    Raises
    ------
    ParameterError
        If it is more than 20 m from the origin of the body.
    """
    far = float(abs(body.com).max())
    if far > LARGEST:
        raise ParameterError(f"{where}: {far:g} m is more than {LARGEST:g} m: {_METRES}")


def _require_size(geometry: Geometry, where: str) -> None:
    """Raise if lengths are so large or so small that another unit was meant."""
    name, longest = max(asdict(geometry).items(), key=lambda item: float(item[1]))
    if longest > LARGEST:
        raise ParameterError(f"{where}: {name} = {longest:g} m is more than {LARGEST:g} m: {_METRES}")
    if longest < SMALLEST:
        raise ParameterError(
            f"{where}: the longest length, {name} = {longest:g} m, is less than {SMALLEST:g} m: "
            f"lengths are in metres ({_ANYWAY})"
        )


def _bodies(data: Any, where: str) -> Bodies:
    kinds = isinstance(data, Mapping) and not set(data) - set(_KINDS)
    names = _KINDS if kinds else LINKS
    data = _mapping(data, where, required=names)
    bodies = {name: _body(data[name], f"{where}.{name}") for name in names}
    return _named(where, lambda: Bodies.alike(**bodies) if kinds else Bodies(**bodies))


def _body(data: Any, where: str) -> Body:
    data = _mapping(data, where, required=("mass", "com", "inertia"), optional=("about",))
    values = {key: _BODY[key].read(value, f"{where}.{key}") for key, value in data.items()}
    point = values.pop("about", None)
    return _named(where, lambda: Body(**values) if point is None else Body.about(point, **values))


def _payloads(data: Any, where: str) -> list[Body]:
    """Read one payload, or a list of them."""
    if isinstance(data, list):
        return [_body(item, f"{where}[{i}]") for i, item in enumerate(data)]
    return [_body(data, where)]


def _friction(data: Any, where: str) -> Friction:
    data = _mapping(data, where, optional=("viscous", "coulomb", "smoothing"))
    values: dict[str, Any] = {}
    for key, value in data.items():
        if isinstance(value, Mapping) and key in _FRICTION:
            of_slide, of_hinge = _FRICTION[key]
            values[key] = {
                name: (of_slide if name in _SLIDES else of_hinge).read(number, f"{where}.{key}.{name}")
                for name, number in value.items()
            }
        else:
            values[key] = RATE.read(value, f"{where}.{key}") if key == "smoothing" else value
    return _named(where, lambda: Friction(**values))


def _record(
    data: Any,
    where: str,
    kind: Callable[..., _T],
    quantities: Mapping[str, Quantity],
    required: Iterable[str] = (),
) -> _T:
    """Make a flat dataclass from a mapping."""
    known = [item.name for item in fields(kind)]  # type: ignore[arg-type]
    data = _mapping(data, where, required, known)
    values = {key: quantities[key].read(value, f"{where}.{key}") for key, value in data.items()}
    return _named(where, lambda: kind(**values))


def _mapping(
    data: Any, where: str, required: Iterable[str] = (), optional: Iterable[str] = ()
) -> Mapping[str, Any]:
    required = list(required)
    known = [*required, *(name for name in optional if name not in required)]
    if not isinstance(data, Mapping):
        raise ParameterError(f"{where}: expected the fields {', '.join(known)}, got {_kind(data)}")
    unknown = [str(key) for key in data if key not in known]
    if unknown:
        raise ParameterError(f"{where}: unknown field {unknown[0]!r}, expected {', '.join(known)}")
    missing = [key for key in required if key not in data]
    if missing:
        raise ParameterError(f"{where}: the field {missing[0]!r} is missing")
    return data


def _kind(value: Any) -> str:
    return "nothing" if value is None else shown(value)


def _named(where: str, make: Callable[[], _T]) -> _T:
    """Put the place in the file before the error of a constructor."""
    try:
        return make()
    except ParameterError as error:
        raise ParameterError(f"{where}: {error}") from error
