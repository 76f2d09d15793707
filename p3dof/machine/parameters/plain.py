"""Plain data to the parts of a machine: what a parameter file, JSON or a program holds.

`p3dof.machine.parameters.serialization` describes the fields.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, fields
from typing import Any, TypeVar

from p3dof._base.checks import shown
from p3dof._base.errors import ParameterError
from p3dof.machine.parameters.actuators import Actuators
from p3dof.machine.parameters.bodies import Bodies
from p3dof.machine.parameters.body import Body
from p3dof.machine.parameters.friction import Friction
from p3dof.machine.parameters.geometry import Geometry
from p3dof.machine.parameters.limits import Limits
from p3dof.machine.parameters.names import LINKS, SLIDES
from p3dof.machine.parameters.quantities import (
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
    STIFFNESS,
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
_ACTUATORS = {"armature": MASS, "counterbalance": FORCE, "spring": STIFFNESS, "counterweight": MASS}
_SLIDES = {"sliders", *SLIDES}
_KINDS = ("slider", "leg", "crossbar", "platform")
_T = TypeVar("_T")


def read_parts(data: Any, source: str, any_size: bool) -> tuple[dict[str, Any], list[Body]]:
    """Return the parts of a machine, and what it carries.

    Parameters
    ----------
    data : mapping
        What a parameter file holds.
    source : str
        What to call it in an error: usually the file name.
    any_size : bool
        Take a machine of more than 20 m or less than 1 mm too.

    Returns
    -------
    parts : dict
        Arguments of `Parameters`.
    payloads : list of Body
        To be fixed to the platform, one after the other.

    Raises
    ------
    ParameterError
        If a field is missing, unknown, in a wrong unit or not physical, or the machine is too large or too
        small; the message names `source` and the field.
    """
    data = read_fields(
        data,
        source,
        required=("geometry", "bodies"),
        optional=("limits", "gravity", "friction", "actuators", "payload"),
    )
    geometry = _record(data["geometry"], f"{source}: geometry", Geometry, _GEOMETRY, ("r", "R", "L"))
    if not any_size:
        _require_size(geometry, f"{source}: geometry")
    bodies = _bodies(data["bodies"], f"{source}: bodies")
    parts: dict[str, Any] = {"geometry": geometry, "bodies": bodies}
    if "limits" in data:
        parts["limits"] = _record(data["limits"], f"{source}: limits", Limits, _LIMITS)
    if "gravity" in data:
        parts["gravity"] = ACCELERATION.read(data["gravity"], f"{source}: gravity")
    if "friction" in data:
        parts["friction"] = _friction(data["friction"], f"{source}: friction")
    if "actuators" in data:
        parts["actuators"] = _actuators(data["actuators"], f"{source}: actuators")
    payloads = _payloads(data.get("payload", []), f"{source}: payload")
    if not any_size:
        for name, body in (*bodies.items(), *(("payload", payload) for payload in payloads)):
            require_near(body, f"{source}: {name}: com")
    return parts, payloads


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
    data = read_fields(data, where, required=names)
    bodies = {name: read_body(data[name], f"{where}.{name}") for name in names}
    return named(where, lambda: Bodies.alike(**bodies) if kinds else Bodies(**bodies))


def read_body(data: Any, where: str) -> Body:
    """Return a body from the fields mass, com, inertia and perhaps about.

    Parameters
    ----------
    data : mapping
        Plain data.
    where : str
        What to call it in an error.

    Returns
    -------
    Body

    Raises
    ------
    ParameterError
        If a field is missing, unknown, in a wrong unit or not physical.
    """
    data = read_fields(data, where, required=("mass", "com", "inertia"), optional=("about",))
    values = {key: _BODY[key].read(value, f"{where}.{key}") for key, value in data.items()}
    point = values.pop("about", None)
    return named(where, lambda: Body(**values) if point is None else Body.about(point, **values))


def _payloads(data: Any, where: str) -> list[Body]:
    """Read one payload, or a list of them."""
    if isinstance(data, list):
        return [read_body(item, f"{where}[{i}]") for i, item in enumerate(data)]
    return [read_body(data, where)]


def _friction(data: Any, where: str) -> Friction:
    data = read_fields(data, where, optional=("viscous", "coulomb", "smoothing"))
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
    return named(where, lambda: Friction(**values))


def _actuators(data: Any, where: str) -> Actuators:
    data = read_fields(data, where, optional=_ACTUATORS)
    values: dict[str, Any] = {}
    for key, value in data.items():
        values[key] = value
        if isinstance(value, Mapping):
            quantity = _ACTUATORS[key]
            values[key] = {name: quantity.read(of, f"{where}.{key}.{name}") for name, of in value.items()}
    return named(where, lambda: Actuators(**values))


def _record(
    data: Any,
    where: str,
    kind: Callable[..., _T],
    quantities: Mapping[str, Quantity],
    required: Iterable[str] = (),
) -> _T:
    """Make a flat dataclass from a mapping."""
    known = [item.name for item in fields(kind)]  # type: ignore[arg-type]
    data = read_fields(data, where, required, known)
    values = {key: quantities[key].read(value, f"{where}.{key}") for key, value in data.items()}
    return named(where, lambda: kind(**values))


def read_fields(
    data: Any, where: str, required: Iterable[str] = (), optional: Iterable[str] = ()
) -> Mapping[str, Any]:
    """Return a mapping whose fields have been checked.

    Parameters
    ----------
    data : mapping
        Plain data.
    where : str
        What to call it in an error.
    required, optional : iterable of str
        Fields that there must be, and that there may be.

    Returns
    -------
    mapping

    Raises
    ------
    ParameterError
        If it is something else, or a field is missing or unknown.
    """
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


def named(where: str, make: Callable[[], _T]) -> _T:
    """Return what a constructor makes; its error gets the place in the data in front.

    Parameters
    ----------
    where : str
        The place.
    make : callable
        Without arguments.

    Returns
    -------
    object

    Raises
    ------
    ParameterError
        Of `make`, with the place.
    """
    try:
        return make()
    except ParameterError as error:
        raise ParameterError(f"{where}: {error}") from error
