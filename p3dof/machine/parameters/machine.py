"""`Parameters`: one machine of the paper's kind.

Plain data to the parts of a machine: what a parameter file, JSON or a program holds.

`p3dof.machine.parameters.machine` describes the fields.

Parameter files: YAML in and out.

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
    actuators:                                                                      # optional
      armature: {sliders: 14.8}             # kg, inertia of motor and screw reflected to the slider
      counterbalance: {slide_a: 48, slide_b: 52, slide_c: 55}   # N, force on the slider along z0 at home
      spring: {slide_a: 100}                # N/m, how fast that force falls as the slider rises
      counterweight: {slide_b: 2}           # kg, on a rope over a pulley
    payload: {mass: 5, com: [0, 0, -0.1], inertia: [0.02, 0.02, 0.02]}    # optional, fixed to the platform;
                                                                          # or a list of several

``bodies`` names either these four kinds or all ten links, each on its own. An inertia is a diagonal or a full
matrix, about the mass centre; with ``about: [x, y, z]`` it is about that point instead. A payload may be a
mass alone, ``payload: 2 kg``, at P or at its ``com``. Or the bodies are computed from solids::

    geometry: {r: 100 mm, R: 250 mm, L: 400 mm}
    bodies: solids
    density: 2700 kg/m^3                        # optional: of all, or {platform: 2700, ...}; steel by default
    dimensions: {rod_radius: 8 mm}              # optional: the others in proportion to the paper's

Beside bodies that are given, these two change no force: parts are drawn and have their distances by them, and
designs are made of solids by them.

Numbers are in SI units, or have one of their own, in lists each by itself::

    geometry: {r: 100 mm, R: 250 mm, L: 40 cm, b: 50 mm}
    payload: {mass: 950 g, com: [0, 0, -100 mm], inertia: [410 kg mm^2, 410 kg mm^2, 380 kg mm^2]}
    limits: {speed: 1500 mm/s, force: 0.5 kN, tilt: [-45 deg, 45 deg]}

Millimetres are not to be taken for metres: a machine whose longest length is above 20 m or below 1 mm is
refused unless the caller says ``any_size``.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, TypeVar

import numpy as np
import yaml

from p3dof._base.checks import (
    FloatArray,
    FrozenArrays,
    frozen_array,
    got_of,
    shown,
    unknown_field,
    warn_caller,
)
from p3dof._base.errors import P3dofError, ParameterError
from p3dof._base.files import Source, called, parse_yaml, read_text, suffix_of, write_atomic
from p3dof._base.quantities import (
    ACCELERATION,
    ANGLE,
    FORCE,
    HINGE_DAMPING,
    INERTIA,
    LENGTH,
    MASS,
    MASS_DENSITY,
    MOMENT,
    RATE,
    SLIDE_DAMPING,
    SPEED,
    STIFFNESS,
    Quantity,
)
from p3dof._base.tables import ShownInNotebook
from p3dof.machine.parameters.actuators import Actuators, Friction, Geometry, Limits
from p3dof.machine.parameters.body import LINKS, SLIDES, Bodies, Body
from p3dof.machine.parameters.solids import (
    KINDS,
    STEEL_DENSITY,
    Dimensions,
    bodies_of_solids,
    density_by_kind,
    sizes_given,
)

_ANYWAY = "--any-size, or any_size=True, takes it as it is"
_METRES = f"lengths are in metres; did you mean '{{:g}} mm'? ({_ANYWAY})"
LARGEST, SMALLEST = 20.0, 1e-3
"""Largest and smallest machine that is believed, by its longest length [m]."""
_THIN, _FAR, _WIDE, _BEYOND = 1e-3, 3.0, 1.5, 10.0
"""Masses that are believed: by (R + L)³ [kg/m³], at least [kg], by all other bodies, a payload by these."""
_DENSEST, _LIGHT, _OTHERS, _HEAVY = 2e4, 100.0, 100.0, 40.0
"""Masses that are believed: by (R + L)³ [kg/m³], always [kg], by all other bodies, of a payload by these."""
_LIGHTEST, _NONE = 20.0, 1e5
"""Density that is believed of a whole machine [kg/m³]; what a limit is that stands for none."""
_GEOMETRY = dict.fromkeys(("r", "R", "L", "b"), LENGTH)
_LIMITS = {"travel": LENGTH, "speed": SPEED, "force": FORCE, "tilt": ANGLE}
_BODY = {"mass": MASS, "com": LENGTH, "inertia": INERTIA, "about": LENGTH}
_WHOLE = ("mass", "com", "inertia")
_FRICTION = {"viscous": (SLIDE_DAMPING, HINGE_DAMPING), "coulomb": (FORCE, MOMENT)}
_ACTUATORS = {"armature": MASS, "counterbalance": FORCE, "spring": STIFFNESS, "counterweight": MASS}
_SLIDES = {"sliders", *SLIDES}
_T = TypeVar("_T")


def read_parts(data: Any, source: str, any_size: bool) -> tuple[dict[str, Any], list[Body]]:
    """Return the parts of a machine, and what it carries."""
    parts_of = ("geometry", "bodies", "limits", "gravity", "friction", "actuators", "payload")
    data = read_fields(data, source, ("geometry",), (*parts_of, "density", "dimensions"))
    geometry = _record(data["geometry"], f"{source}: geometry", Geometry, _GEOMETRY, ("r", "R", "L"))
    if not any_size:
        _require_size(geometry, f"{source}: geometry")
    parts: dict[str, Any] = {"geometry": geometry, **_solids(data, source)}
    if data["bodies"] == "solids":
        bodies = named(source, lambda: bodies_of_solids(**parts))
    else:
        bodies = _bodies(data["bodies"], f"{source}: bodies")
    parts["bodies"] = bodies
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
    """Raise if a mass centre is so far away that millimetres were meant."""
    far = float(abs(body.com).max())
    if far > LARGEST:
        raise ParameterError(f"{where}: {far:g} m is more than {LARGEST:g} m: {_METRES.format(far)}")


def doubt(machine: Parameters, where: str = "") -> None:
    """Warn of numbers that seem to be in another unit, and raise for an inertia that no unit explains.

    By ratios alone: lengths to the longest one, masses to the machine's size and to each other, inertias to
    mass and size.
    """
    geometry, bodies = asdict(machine.geometry), machine.unladen.bodies
    size, longest = machine.geometry.R + machine.geometry.L, max(geometry.values())
    told = [
        f"geometry.{name} = {length:g} m beside {longest:g} m (mm?)"
        for name, length in geometry.items()
        if length < _THIN * longest
    ]
    for name, most, unit, other in (
        ("travel", max(10.0, _FAR * size), "m", "mm"),
        ("tilt", 2 * math.pi, "rad", "degrees"),
        ("speed", 100.0, "m/s", "mm/s"),
    ):
        limit = getattr(machine.limits, name)
        if most < (far := limit if name == "speed" else max(map(abs, limit))) < _NONE:
            told.append(f"limits.{name} = {far:g} {unit} ({other}?)")
    name, body = max(bodies.items(), key=lambda item: item[1].mass)
    if bodies.mass > max(_LIGHT, _DENSEST * size**3) or body.mass > max(
        _LIGHT, _OTHERS * (bodies.mass - body.mass)
    ):
        told.append(f"{name}.mass = {body.mass:g} kg in a machine of {size:.3g} m (g?)")
    each = {id(body): (name, body) for name, body in bodies.items()}  # equal ones once
    for name, body in (*each.values(), *(("payload", payload) for payload in machine.payloads)):
        if (far := float(abs(body.com).max())) > _FAR * size:
            told.append(f"{name}.com = {far:g} m in a machine of {size:.3g} m (mm?)")
        inertia = float(body.inertia.trace())
        if inertia > 2 * body.mass * (_WIDE * size) ** 2:
            words = (
                f"{name}.inertia = {inertia / 2:g} kg m^2 of {body.mass:g} kg in a machine of {size:.3g} m"
            )
            if inertia > 2 * body.mass * (_BEYOND * size) ** 2:
                raise ParameterError(f"{where}{words}: no such body is; did you mean kg mm^2? ({_ANYWAY})")
            told.append(f"{words} (kg mm^2?)")
    if told:
        warn_caller(f"{where}{'; '.join(told)}: units are m, kg, rad, kg m^2 ({_ANYWAY})")


def _require_size(geometry: Geometry, where: str) -> None:
    """Raise if lengths are so large or so small that another unit was meant."""
    name, longest = max(asdict(geometry).items(), key=lambda item: float(item[1]))
    if longest > LARGEST:
        told = _METRES.format(longest)
        raise ParameterError(f"{where}: {name} = {longest:g} m is more than {LARGEST:g} m: {told}")
    if longest < SMALLEST:
        raise ParameterError(
            f"{where}: the longest length, {name} = {longest:g} m, is less than {SMALLEST:g} m: "
            f"lengths are in metres ({_ANYWAY})"
        )


def _solids(data: Mapping[str, Any], source: str) -> dict[str, Mapping[str, float]]:
    """Return sizes of solids that a file gives, and the densities of all kinds."""
    if "bodies" not in data:
        raise ParameterError(
            f"{source}: the field 'bodies' is missing: give mass, com and inertia of each, or "
            "'bodies: solids' for bodies of steel in proportion to the paper's"
        )
    density = data.get("density", STEEL_DENSITY)
    if isinstance(density, Mapping):
        density = {
            kind: MASS_DENSITY.read(each, f"{source}: density.{kind}") for kind, each in density.items()
        }
    else:
        density = MASS_DENSITY.read(density, f"{source}: density")
    if not isinstance(density, Mapping) and 0 < density < _LIGHTEST:
        warn_caller(f"{source}: density = {density:g} kg/m^3 (g/cm^3?)")
    sizes = read_sizes(data.get("dimensions", {}), source)
    return {"dimensions": sizes, "density": named(source, lambda: density_by_kind(density))}


def read_sizes(data: Any, source: str) -> Mapping[str, float]:
    """Return some sizes of solids [m]."""
    where = f"{source}: dimensions"
    data = read_fields(data, where, (), [item.name for item in fields(Dimensions)])
    sizes = {name: LENGTH.read(value, f"{where}.{name}") for name, value in data.items()}
    return named(source, lambda: sizes_given(sizes))


def _bodies(data: Any, where: str) -> Bodies:
    if isinstance(data, str):
        raise ParameterError(
            f"{where}: expected 'solids', or mass, com and inertia of each, got {shown(data)}"
        )
    kinds = isinstance(data, Mapping) and not set(data) - set(KINDS)
    names = KINDS if kinds else LINKS
    data = read_fields(data, where, required=names)
    bodies = {name: read_body(data[name], f"{where}.{name}", alone=False) for name in names}
    return named(where, lambda: Bodies.alike(**bodies) if kinds else Bodies(**bodies))


def body_of(value: Any, where: str, error: type[P3dofError] = ParameterError) -> Body:
    """Return a body, or the point mass at its origin that a mass alone is: 2, or '2 kg'."""
    try:
        if isinstance(value, str | int | float) and not isinstance(value, bool):
            mass = MASS.read(value, where)
            return named(where, lambda: Body(mass))
    except ParameterError as problem:
        raise error(str(problem)) from problem
    if not isinstance(value, Body):
        raise error(f"{where}: expected a Body or a mass, got {shown(value)}")
    return value


def read_body(data: Any, where: str, alone: bool = True) -> Body:
    """Return a body from the fields mass, com, inertia and perhaps about; `alone`, a mass will do."""
    if alone and isinstance(data, str | int | float) and not isinstance(data, bool):
        return body_of(data, where)
    needed = ("mass",) if alone and not (isinstance(data, Mapping) and "about" in data) else _WHOLE
    data = read_fields(data, where, needed, ("mass", "com", "inertia", "about"))
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
    """Return a mapping whose fields have been checked."""
    required = list(required)
    known = [*required, *(name for name in optional if name not in required)]
    if not isinstance(data, Mapping):
        raise ParameterError(f"{where}: expected the fields {', '.join(known)}, got {got_of(data)}")
    unknown = [str(key) for key in data if key not in known]
    if unknown:
        raise ParameterError(f"{where}: {unknown_field(unknown[0], data, known)}")
    missing = [key for key in required if key not in data]
    if missing:
        raise ParameterError(f"{where}: the field {missing[0]!r} is missing")
    return data


def named(where: str, make: Callable[[], _T]) -> _T:
    """Return what a constructor makes; its error gets the place in the data in front."""
    try:
        return make()
    except ParameterError as error:
        raise ParameterError(f"{where}: {error}") from error


@dataclass(frozen=True, eq=False)
class Parameters(FrozenArrays, ShownInNotebook):
    """One machine: geometry, bodies, limits and gravity.

    Parameters
    ----------
    geometry : Geometry
        Lengths.
    bodies : Bodies
        Inertial parameters.
    limits : Limits
        Actuator limits.
    gravity : array-like, shape (3,)
        Acceleration of gravity in the fixed frame [m/s²].
    friction : Friction
        What the joints lose; nothing by default.
    actuators : Actuators
        Reflected inertia and counterbalance at the sliders; none by default.
    dimensions : mapping of str to float
        Sizes of the solids that are given, by the names of `Dimensions` [m]; the others are the paper's,
        scaled to the geometry.
    density : mapping of str to float
        Densities of solids by kind (slider, leg, crossbar, platform), steel else [kg/m³]. Neither changes
        `bodies`: parts are drawn and have their distances by them, and designs are made of solids by them.

    Raises
    ------
    ParameterError
        If a field has the wrong type, gravity is not three finite numbers, or a size or density is not
        positive.
    """

    geometry: Geometry
    bodies: Bodies
    limits: Limits = field(default_factory=Limits)
    gravity: FloatArray = (0.0, 0.0, -9.806)  # type: ignore[assignment]
    friction: Friction = field(default_factory=Friction)
    actuators: Actuators = field(default_factory=Actuators)
    dimensions: Mapping[str, float] = field(default_factory=dict)
    density: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        kinds = {
            "geometry": Geometry,
            "bodies": Bodies,
            "limits": Limits,
            "friction": Friction,
            "actuators": Actuators,
        }
        for name, kind in kinds.items():
            if not isinstance(getattr(self, name), kind):
                got = type(getattr(self, name)).__name__
                raise ParameterError(f"{name}: expected {kind.__name__}, got {got}")
        object.__setattr__(self, "gravity", frozen_array("gravity", self.gravity, (3,), ParameterError))
        object.__setattr__(self, "dimensions", sizes_given(self.dimensions))
        object.__setattr__(self, "density", density_by_kind(self.density))

    @property
    def sizes(self) -> Dimensions:
        """Sizes of the solids: those given, and the paper's, scaled to the geometry [m]."""
        return Dimensions.scaled(self.geometry, **self.dimensions)

    @property
    def solid(self) -> Parameters:
        """The machine with every body computed from its solid, and what it carries."""
        made = replace(self, bodies=bodies_of_solids(self.geometry, self.dimensions, self.density))
        for payload in self.payloads:
            made = made._laden(payload)
        return made

    def carrying(self, payload: Body | float | str) -> Parameters:
        """Return the machine with a payload fixed to its platform, besides what it carries already.

        Parameters
        ----------
        payload : Body, float or str
            In the platform's body frame: origin P, axes parallel to the fixed frame at θ = 0. A mass alone,
            ``3`` [kg] or ``"950 g"``, is a point mass at P.

        Raises
        ------
        ParameterError
            If `payload` is something else.
        """
        body, moving = body_of(payload, "payload"), self.unladen.bodies.mass
        if body.mass > max(_LIGHT, _HEAVY * moving):
            warn_caller(f"payload of {body.mass:g} kg on a machine of {moving:.3g} kg (g?): masses are in kg")
        return self._laden(body)

    def _laden(self, payload: Body) -> Parameters:
        platform = self.bodies.platform.joined(payload)
        return replace(self, bodies=replace(self.bodies, platform=platform))

    @property
    def payloads(self) -> tuple[Body, ...]:
        """What the platform carries, in its frame, one after the other as `carrying` joined them."""
        return self.bodies.platform.parts[1:]

    @property
    def unladen(self) -> Parameters:
        """The machine without its payloads."""
        if not self.payloads:
            return self
        return replace(self, bodies=replace(self.bodies, platform=self.bodies.platform.parts[0]))

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers, lists and texts: what the parameter file holds, ready for JSON.

        Returns
        -------
        dict
            With the names and the nesting of the parameter file, in SI units; each link has its own entry. No
            friction, no actuators and no payload if the machine has none; of solids only what is given.
        """
        limits = {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self.limits).items()
        }
        data: dict[str, Any] = {
            "geometry": asdict(self.geometry),
            "gravity": self.gravity.tolist(),
            "limits": limits,
            "bodies": {name: body.to_dict() for name, body in self.unladen.bodies.items()},
        }
        if self.friction.to_dict() != Friction().to_dict():
            data["friction"] = self.friction.to_dict()
        if self.actuators:
            data["actuators"] = self.actuators.to_dict()
        if self.dimensions:
            data["dimensions"] = dict(self.dimensions)
        if (density := dict(self.density)) != dict.fromkeys(KINDS, STEEL_DENSITY):
            data["density"] = density
        payloads = [body.to_dict() for body in self.payloads]
        if payloads:
            data["payload"] = payloads[0] if len(payloads) == 1 else payloads
        return data

    @classmethod
    def from_dict(
        cls, data: Mapping[str, Any], source: str = "parameters", any_size: bool = False
    ) -> Parameters:
        """Make a machine from plain data: what `to_dict` returns, or anything that a parameter file may hold.

        Parameters
        ----------
        data : mapping
            With the names and the nesting of the parameter file; units in texts (``"120 mm"``) too.
        source : str
            What to call it in an error.
        any_size : bool
            Take a machine of more than 20 m or less than 1 mm too.

        Returns
        -------
        machine : Parameters
            `to_dict` of a machine gives the same numbers back to the last bit.

        Raises
        ------
        ParameterError
            If a field is missing, unknown, in a wrong unit or not physical, or the machine is too large or
            too small; the message names `source` and the field.
        """
        parts, payloads = read_parts(data, source, any_size)
        machine = named(source, lambda: cls(**parts))
        for payload in payloads:
            machine = machine._laden(payload) if any_size else machine.carrying(payload)
        if not any_size:
            doubt(machine, f"{source}: ")
        return machine


def read_parameters(path: Source, any_size: bool = False) -> Parameters:
    """Read a parameter file.

    Parameters
    ----------
    path : path-like or stream
        The YAML file. Its numbers are in SI units, or texts with a unit: ``r: 120 mm``, ``mass: 950 g``,
        ``tilt: [-45 deg, 45 deg]``, ``inertia: [410 kg mm^2, ...]``, ``force: 0.5 kN``.
    any_size : bool
        Take a machine of more than 20 m or less than 1 mm too. Such a file is usually one in millimetres.

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
    """Read parameters from YAML text; as `Parameters.from_dict` reads plain data."""
    return Parameters.from_dict(parse_yaml(text, source, ParameterError), source, any_size)


def dump(parameters: Parameters) -> str:
    """Return the YAML text of parameters; `parse` gives the same numbers back to the last bit."""
    header = "# p3dof parameters: m, kg, kg m² about the mass centre, m/s, N, rad, m/s²\n"
    return header + yaml.safe_dump(parameters.to_dict(), sort_keys=False, default_flow_style=None, width=110)


def of_solids(
    geometry: Geometry | None = None,
    dimensions: Dimensions | None = None,
    density: float | Mapping[str, float] = STEEL_DENSITY,
    limits: Limits | None = None,
) -> Parameters:
    """Compute every body from its solid: cubes, round rods and the rounded plate.

    Parameters
    ----------
    geometry : Geometry, optional
        Lengths; the paper's by default.
    dimensions : Dimensions, optional
        Sizes of the solids; those of the paper, scaled to the geometry, by default.
    density : float or mapping of str to float
        Density of all solids, or of some kinds (slider, leg, crossbar, platform), steel else [kg/m³].
    limits : Limits, optional
        Actuator limits.

    Raises
    ------
    ParameterError
        If an argument has the wrong type, or the sizes do not make bodies.
    """
    for name, value, kind in (
        ("geometry", geometry, Geometry),
        ("dimensions", dimensions, Dimensions),
        ("limits", limits, Limits),
    ):
        if value is not None and not isinstance(value, kind):
            raise ParameterError(f"{name}: expected {kind.__name__}, got {type(value).__name__}")
    geometry, given = geometry or Geometry(), {} if dimensions is None else asdict(dimensions)
    by_kind = density_by_kind(density)
    made = bodies_of_solids(geometry, given, by_kind)
    return Parameters(geometry, made, limits or Limits(), dimensions=given, density=by_kind)


def _paper() -> Parameters:
    """Return the printed numbers, with the mass centres and axes that the paper leaves to the reader.

    The printed J2 is about the leg's upper joint, x along the leg. The printed J3 = diag(.0269, .0658, .0501)
    is about C5 in the axes of T5 (x0, -z0, y0). Mass centres are those of the solids, which reproduce the
    printed masses; sliders only translate, so that the inertia of the cube stands in for the one not given.
    """
    geometry = Geometry()
    solids = of_solids(geometry).bodies
    slider_mass, leg_mass, platform_mass = 0.9751, 0.9803, 8.1573
    bodies = Bodies.alike(
        slider=Body(slider_mass, np.zeros(3), np.full(3, slider_mass * Dimensions().slider_edge ** 2 / 6)),
        leg=Body.about(np.zeros(3), leg_mass, solids.leg_a.com, np.array([0.0006, 0.0524, 0.0524])),
        crossbar=Body.massless(),
        platform=Body.about(
            np.array([-geometry.r, 0.0, 0.0]),
            platform_mass,
            solids.platform.com,
            np.array([0.0269, 0.0501, 0.0658]),
        ),
    )
    return Parameters(geometry, bodies)


PAPER = _paper()
"""The printed numbers of the paper, completed by the reconstructed mass centres; massless cross-bars."""

SOLIDS = of_solids()
"""Every body computed from its steel solid; the masses, rounded, are those of the paper."""
