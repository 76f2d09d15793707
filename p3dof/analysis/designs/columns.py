"""`Designs`: many machines as columns of what differs between them."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, fields, replace
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from p3dof._base import quantities
from p3dof._base.checks import FloatArray, meant, shown
from p3dof._base.errors import InputError, ParameterError
from p3dof.machine.parameters import (
    LINKS,
    PAPER,
    PASSIVE,
    SLIDES,
    Actuators,
    Bodies,
    Body,
    Dimensions,
    Friction,
    Geometry,
    Limits,
    Parameters,
    of_solids,
)
from p3dof.machine.parameters.body import JOINT_GROUPS

KINDS = {
    "slider": ("slider_a", "slider_b", "slider_c"),
    "leg": ("leg_a", "leg_b", "rod_left", "rod_right"),
    "crossbar": ("crossbar_upper", "crossbar_lower"),
    "platform": ("platform",),
}
"""The kinds of bodies of a parameter file, and the links of each."""

LENGTHS = ("geometry.r", "geometry.R", "geometry.L", "geometry.b")
SIZES = tuple(f"dimensions.{item.name}" for item in fields(Dimensions))
OFFSETS = ("offset.y", "offset.z", "offset.theta")
GRAVITY = ("gravity.x", "gravity.y", "gravity.z")
DENSITY = "density"

ACTUATORS = "actuators."  # what the names of motors and counterbalances begin with
_ACTUATOR = {
    "armature": quantities.MASS,
    "counterbalance": quantities.FORCE,
    "spring": quantities.STIFFNESS,
    "counterweight": quantities.MASS,
}

_BODY = {
    "mass": quantities.MASS,
    **{f"com.{axis}": quantities.LENGTH for axis in "xyz"},
    **{f"inertia.{axes}": quantities.INERTIA for axes in ("xx", "yy", "zz", "xy", "xz", "yz")},
}
COMPONENTS = tuple(_BODY)  # the numbers of a body


def _quantities() -> dict[str, quantities.Quantity]:
    known = dict.fromkeys((*LENGTHS, *SIZES), quantities.LENGTH) | {DENSITY: quantities.MASS_DENSITY}
    known |= {name: quantities.ANGLE if name.endswith("theta") else quantities.LENGTH for name in OFFSETS}
    known |= dict.fromkeys(GRAVITY, quantities.ACCELERATION)
    for body in ("payload", *(f"bodies.{name}" for name in dict.fromkeys((*KINDS, *LINKS)))):
        known |= {f"{body}.{name}": quantity for name, quantity in _BODY.items()}
    for joint in (*JOINT_GROUPS, *SLIDES, *PASSIVE):
        slide = joint == "sliders" or joint in SLIDES
        known[f"friction.viscous.{joint}"] = quantities.SLIDE_DAMPING if slide else quantities.HINGE_DAMPING
        known[f"friction.coulomb.{joint}"] = quantities.FORCE if slide else quantities.MOMENT
    known["friction.smoothing"] = quantities.RATE
    for name in ("sliders", *SLIDES):
        known |= {f"{ACTUATORS}{what}.{name}": quantity for what, quantity in _ACTUATOR.items()}
    for end in ("low", "high"):
        known |= {f"limits.travel.{end}": quantities.LENGTH, f"limits.tilt.{end}": quantities.ANGLE}
    return known | {"limits.speed": quantities.SPEED, "limits.force": quantities.FORCE}


QUANTITIES = _quantities()  # every column by its full name

_PREFIXES = ("", "geometry.", "dimensions.", "bodies.", ACTUATORS)  # what may be left out in front of a name


class Column(NamedTuple):
    """A column of designs: its full name, and what takes its numbers to SI units."""

    name: str
    multiply: float = 1.0
    divide: float = 1.0

    def in_si(self, values: FloatArray) -> FloatArray:
        """Return numbers of the column in SI units."""
        if self.multiply == self.divide == 1.0:
            return values
        return values * self.multiply / self.divide


def full_name(name: str) -> str:
    """Return the full name of a column; it may lack ``geometry``, ``actuators`` and the like in front."""
    for prefix in _PREFIXES:
        if f"{prefix}{name}" in QUANTITIES:
            return f"{prefix}{name}"
    if name in _ACTUATOR:  # of all sliders alike
        return f"{ACTUATORS}{name}.sliders"
    ends = {known.removeprefix(prefix): known for known in QUANTITIES for prefix in _PREFIXES}
    hint = meant(name, ends, 0.5) or "."
    raise InputError(
        f"designs: unknown column {shown(name)}{hint} Expected names as in parameter files, with dots: R, "
        "rod_radius, platform.mass, payload.com.x, friction.viscous.sliders, armature.sliders, limits.force, "
        "offset.y"
    )


def column_of(header: object) -> Column:
    """Return the column that a header such as ``R [mm]`` means."""
    if not isinstance(header, str):
        raise InputError(f"designs: expected names of columns, got {shown(header)}")
    name, bracket, unit = header.strip().rpartition("[")
    if not bracket or not unit.endswith("]"):
        return Column(full_name(header.strip()))
    known = full_name(name.strip())
    try:
        factor = QUANTITIES[known].read(f"1 {unit[:-1].strip()}", f"designs: column {shown(header.strip())}")
    except ParameterError as error:
        raise InputError(str(error)) from error
    if factor < 1 and abs(1 / factor - round(1 / factor)) < 1e-9 / factor:  # dividing rounds correctly
        return Column(known, divide=float(round(1 / factor)))
    return Column(known, multiply=float(factor))


def columns_of(headers: Iterable[object]) -> list[Column]:
    """Return what headers mean, each once."""
    told = list(headers)
    found = [column_of(header) for header in told]
    if not found:
        raise InputError("designs: expected at least one column, got none")
    first: dict[str, object] = {}
    for column, header in zip(found, told, strict=True):
        if column.name in first:
            both = f"{shown(first[column.name])} and {shown(header)}"
            raise InputError(f"designs: two columns are {column.name}: {both}; leave one of them out")
        first[column.name] = header
    return found


def as_column(name: str, values: object) -> FloatArray:
    """Return the numbers of a column as they are, NaN and infinities included; ndarray, shape (D,) or ()."""
    to_numpy = getattr(values, "to_numpy", None)
    try:
        array = np.asarray(values if to_numpy is None else to_numpy())
    except ValueError as error:  # of lists that are no array
        raise InputError(
            f"designs: column {shown(name)}: expected real numbers, one a design, got {shown(values)}"
        ) from error
    if array.dtype.kind not in "iuf" or array.ndim > 1:
        got = (
            f"shape {array.shape}"
            if array.dtype.kind in "iuf"
            else shown(array.ravel()[0] if array.size else values)
        )
        raise InputError(f"designs: column {shown(name)}: expected real numbers, one a design, got {got}")
    return array.astype(np.float64)


BodiesOfDesigns: TypeAlias = Literal["kept", "solids"]  # where the bodies of designs come from


class Designs:
    """Many machines: columns of what differs, and the machine that they have all else from.

    Parameters
    ----------
    columns : mapping, table or sequence of Parameters
        Numbers by name, one for each design or one for all: a mapping, a DataFrame of pandas or polars, a
        Dataset of xarray, a table of pyarrow, a structured array. Names are those of the parameter file with
        dots (``bodies.platform.mass``, ``friction.viscous.sliders``, ``limits.travel.low``), in which
        ``geometry``, ``dimensions``, ``bodies`` and ``actuators`` may be left out (``R``, ``rod_radius``,
        ``leg.mass``, ``armature.sliders``, ``counterbalance.slide_a``);
        components of vectors and inertias are ``com.x``, ``inertia.xy``. ``payload.mass`` and so on are a
        payload besides that of the machine, ``offset.y``, ``offset.z`` and ``offset.theta`` move the whole
        motion. A unit in brackets may follow a name (``R [mm]``); SI units without one.
    machine : Parameters, optional
        What has no column; the paper's machine by default.
    bodies : {"kept", "solids"}
        Keep the bodies of `machine`, whatever the lengths are, or compute them anew from their solids, as
        `p3dof.of_solids` does, by columns of ``slider_edge``, ``rod_radius``, ``plate_thickness``,
        ``corner_radius`` and ``density``. Without a column they are those given in `machine`, else the
        paper's sizes, scaled to the lengths of each design, and steel. Columns of ``bodies`` replace numbers
        of either.

    Raises
    ------
    InputError
        If a column has an unknown name or unit, holds something else than real numbers, or columns are of
        different lengths.
    """

    def __init__(
        self, columns: Any, machine: Parameters | None = None, bodies: BodiesOfDesigns = "kept"
    ) -> None:
        machine = PAPER if machine is None else machine
        if not isinstance(machine, Parameters):
            raise InputError(f"machine: expected Parameters, got {shown(machine)}")
        if bodies not in ("kept", "solids"):
            raise InputError(f"bodies: expected 'kept' or 'solids', got {shown(bodies)}")
        if _is_machines(columns):
            if bodies != "kept":
                raise InputError("bodies: expected 'kept' for a sequence of Parameters, which have their own")
            columns = _of_machines(columns)
        given = by_header(columns)
        names = columns_of(given)
        found = {
            column.name: column.in_si(as_column(str(header), values))
            for column, (header, values) in zip(names, given.items(), strict=True)
        }
        sizes = {array.shape[0] for array in found.values() if array.ndim}
        if len(sizes) > 1:
            told = ", ".join(f"{name} {len(array)}" for name, array in found.items() if array.ndim)
            raise InputError(f"designs: expected columns of one length, got {told}")
        count = sizes.pop() if sizes else 1
        self.columns: dict[str, FloatArray] = {}
        for name, array in found.items():
            column = np.ascontiguousarray(np.broadcast_to(array, (count,)))
            self.columns[name] = column
        self.machine, self.bodies = machine, bodies
        self._count = count
        self._check_names()

    def __len__(self) -> int:
        return self._count

    def __repr__(self) -> str:
        return f"Designs({len(self)} designs by {', '.join(self.columns)})"

    def _check_names(self) -> None:
        sized = [name for name in self.columns if name in (*SIZES, DENSITY)]
        if sized and self.bodies == "kept":
            raise InputError(f"designs: the column {sized[0]} needs bodies of solids: bodies='solids'")

    def __getitem__(self, index: int) -> Parameters:
        """Return one design as a machine."""
        index = range(len(self))[index]
        numbers = {name: float(column[index]) for name, column in self.columns.items()}
        return _machine(numbers, self.machine, self.bodies)

    def part(self, start: int, stop: int) -> Designs:
        """Return some of the designs.

        Parameters
        ----------
        start, stop : int
            The first of them, and the first that is left out.
        """
        return Designs(
            {name: column[start:stop] for name, column in self.columns.items()}, self.machine, self.bodies
        )


def _is_machines(columns: Any) -> bool:
    return (
        isinstance(columns, Sequence)
        and not isinstance(columns, str)
        and len(columns) > 0
        and isinstance(columns[0], Parameters)
    )


def by_header(columns: Any) -> Mapping[Any, Any]:
    """Return the columns of whatever kind of table, by what they are called, units included."""
    if isinstance(columns, Mapping):
        _require_one_dimension(columns)
        return {
            _with_units(name, values): getattr(values, "values", values) for name, values in columns.items()
        }
    names = getattr(getattr(columns, "dtype", None), "names", None)
    if names is None:
        names = getattr(columns, "column_names", getattr(columns, "columns", None))
    if names is None or callable(names) or not hasattr(columns, "__getitem__"):
        raise InputError(
            f"designs: expected columns by name, a table or a sequence of Parameters, got {shown(columns)}"
        )
    return {name: columns[name] for name in names}


def _require_one_dimension(columns: Mapping[Any, Any]) -> None:
    """Raise if arrays of xarray have dimensions that xarray would make a grid of."""
    along = dict.fromkeys(dim for values in columns.values() for dim in getattr(values, "dims", ()))
    if len(along) > 1:
        raise InputError(
            f"designs: expected columns along one dimension, got {', '.join(map(str, along))}; to take every "
            f"combination, stack them: xarray.broadcast(...), then .stack(run={[str(dim) for dim in along]})"
        )
    if not columns and getattr(columns, "coords", None):
        raise InputError("designs: expected columns, got coordinates only; data variables are columns")


def _with_units(name: Any, values: Any) -> Any:
    """Return what a column is called, with the unit that an array of xarray has as an attribute."""
    attributes = getattr(values, "attrs", None)
    unit = attributes.get("units", "") if isinstance(attributes, Mapping) else ""
    bare = isinstance(name, str) and not name.rstrip().endswith("]")
    return f"{name} [{unit.strip()}]" if bare and isinstance(unit, str) and unit.strip() else name


def _of_machines(machines: Sequence[Parameters]) -> dict[str, FloatArray]:
    """Return all numbers of machines as columns, by the names of one that they all replace."""
    for machine in machines:
        if not isinstance(machine, Parameters):
            raise InputError(f"designs: expected Parameters, got {shown(machine)}")
    rows = [numbers_of(machine) for machine in machines]
    joints = dict.fromkeys(name for row in rows for name in row if name.startswith(("friction.", ACTUATORS)))
    return {
        name: np.array([row.get(name, 0.0) for row in rows]) for name in dict.fromkeys((*rows[0], *joints))
    }


def numbers_of(machine: Parameters) -> dict[str, float]:
    """Return all numbers of a machine by the names of columns, those of every link; in SI units."""
    found = {f"geometry.{name}": value for name, value in asdict(machine.geometry).items()}
    found |= {f"gravity.{axis}": float(g) for axis, g in zip("xyz", machine.gravity, strict=True)}
    for link, body in machine.bodies.items():
        values = (body.mass, *body.com, *np.diag(body.inertia), *body.inertia[[0, 0, 1], [1, 2, 2]])
        found |= {f"bodies.{link}.{name}": float(v) for name, v in zip(COMPONENTS, values, strict=True)}
    for kind in ("viscous", "coulomb"):
        found |= {f"friction.{kind}.{joint}": v for joint, v in getattr(machine.friction, kind).items()}
    for what, by_slide in machine.actuators.to_dict().items():
        found |= {f"{ACTUATORS}{what}.{slide}": value for slide, value in by_slide.items()}
    limits = machine.limits
    found |= {"friction.smoothing": machine.friction.smoothing}
    for name in ("travel", "tilt"):
        low, high = getattr(limits, name)
        found |= {f"limits.{name}.low": low, f"limits.{name}.high": high}
    return found | {"limits.speed": limits.speed, "limits.force": limits.force}


def members_of(name: str) -> list[str]:
    """Return the columns of the links or joints that a name stands for."""
    room, _, rest = name.partition(".")
    if room == "bodies":
        kind, _, what = rest.partition(".")
        links = (kind,) if kind in LINKS else KINDS[kind]
        return [f"bodies.{link}.{what}" for link in links]
    if room in ("friction", "actuators") and rest != "smoothing":
        law, _, joint = rest.partition(".")
        return [f"{room}.{law}.{member}" for member in JOINT_GROUPS.get(joint, (joint,))]
    return [name]


def numbers_of_solids(machine: Parameters) -> dict[str, float]:
    """Return sizes and density of a machine's solids by the names of columns; NaN where densities differ."""
    found = {f"dimensions.{name}": size for name, size in asdict(machine.sizes).items()}
    some = {*machine.density.values()}
    return found | {DENSITY: some.pop() if len(some) == 1 else math.nan}


def number_in(machine: Parameters, name: str) -> float:
    """Return what a column replaces in a machine, the first of several; NaN where they differ."""
    none = 0.0 if name.partition(".")[0] in ("payload", "offset", "friction", "actuators") else np.nan
    return (numbers_of(machine) | numbers_of_solids(machine)).get(members_of(name)[0], none)


SIZES_OF = {
    "slider": ("dimensions.slider_edge",),
    "leg": ("dimensions.rod_radius",),
    "crossbar": ("dimensions.rod_radius",),
    "platform": ("dimensions.plate_thickness", "dimensions.corner_radius"),
}
"""Sizes of the solid of each kind of bodies."""


def solids_among(
    bodies: BodiesOfDesigns | Mapping[str, BodiesOfDesigns],
    machine: Parameters,
    fixed: Mapping[str, float],
    varied: Collection[str],
) -> tuple[str, ...]:
    """Return which kinds of bodies are computed anew from solids of each design.

    Those that are told, by kind; else all that somebody did not give: the paper's, those that are what
    solids of the machine's lengths are, and those of which a size varies. Nobody's own bodies are replaced
    without a word.
    """
    if isinstance(bodies, str) and bodies in get_args(BodiesOfDesigns):
        if bodies == "kept":
            return ()
        sizes = {name.partition(".")[2]: size for name, size in fixed.items() if name in SIZES}
        told = _of_sizes(machine.unladen, sizes, fixed.get(DENSITY))
        likely = [PAPER.bodies, of_solids(machine.geometry).bodies]
        likely += [machine.unladen.solid.bodies, told.solid.bodies]
        own = machine.unladen.bodies
        return tuple(
            kind
            for kind, links in KINDS.items()
            if set(SIZES_OF[kind]) & set(varied)
            or any(all(_alike(getattr(own, n), getattr(other, n)) for n in links) for other in likely)
        )
    if not isinstance(bodies, Mapping):
        kinds = ", ".join(KINDS)
        raise InputError(f"bodies: expected 'kept' or 'solids', or these by {kinds}, got {shown(bodies)}")
    for kind, given in bodies.items():
        if kind not in KINDS:
            raise InputError(f"bodies: unknown kind {shown(kind)}, expected one of {', '.join(KINDS)}")
        if not isinstance(given, str) or given not in get_args(BodiesOfDesigns):
            raise InputError(f"bodies.{kind}: expected 'kept' or 'solids', got {shown(given)}")
    return tuple(kind for kind in KINDS if bodies.get(kind) == "solids")


def kept_columns(machine: Parameters, solids: Collection[str], known: Collection[str]) -> dict[str, float]:
    """Return the columns that keep all other bodies of a machine, but for those that are columns already."""
    numbers, found = numbers_of(machine), dict[str, float]()
    for kind, links in KINDS.items():
        if kind in solids:
            continue
        for part in COMPONENTS:
            whole = f"bodies.{kind}.{part}"
            values = {f"bodies.{link}.{part}": numbers[f"bodies.{link}.{part}"] for link in links}
            if len(set(values.values())) == 1:
                values = {whole: next(iter(values.values()))}
            if whole not in known:
                found |= {name: value for name, value in values.items() if name not in known}
    return found


def _of_sizes(machine: Parameters, sizes: Mapping[str, float], density: float | None) -> Parameters:
    """Return a machine with other sizes and perhaps another density of its solids."""
    by_kind = machine.density if density is None else dict.fromkeys(KINDS, density)
    return replace(machine, dimensions={**machine.dimensions, **sizes}, density=by_kind)


def _alike(one: Body, other: Body) -> bool:
    """Whether two bodies are the same but for rounding in a file."""
    rows = [(b.mass, *b.com, *b.inertia.ravel()) for b in (one, other)]
    return all(
        bool(np.allclose(*part, rtol=1e-4, atol=1e-4 * float(np.abs(part[1]).max())))
        for part in ((rows[0][:1], rows[1][:1]), (rows[0][1:4], rows[1][1:4]), (rows[0][4:], rows[1][4:]))
    )


def _machine(numbers: dict[str, float], base: Parameters, bodies: BodiesOfDesigns) -> Parameters:
    def parts(prefix: str) -> dict[str, float]:
        return {name.removeprefix(prefix): v for name, v in numbers.items() if name.startswith(prefix)}

    geometry = Geometry(**asdict(base.geometry) | parts("geometry."))
    limits = _limits(base.limits, parts("limits."))
    machine = replace(base, geometry=geometry, limits=limits)
    if bodies == "solids":
        machine = _of_sizes(machine, parts("dimensions."), numbers.get(DENSITY)).solid
    links = {
        name: _replaced(body, {**_of_kind(name, parts), **parts(f"bodies.{name}.")})
        for name, body in machine.bodies.items()
    }
    gravity = [parts("gravity.").get(axis, float(g)) for axis, g in zip("xyz", base.gravity, strict=True)]
    machine = replace(
        machine,
        bodies=Bodies(**links),
        gravity=np.array(gravity),
        friction=_friction(base.friction, parts("friction.")),
        actuators=_actuators(base.actuators, parts(ACTUATORS)),
    )
    load = parts("payload.")
    return machine.carrying(_replaced(Body.massless(), load)) if load else machine


def _of_kind(link: str, parts: Any) -> dict[str, float]:
    kind = next(kind for kind, links in KINDS.items() if link in links)
    found: dict[str, float] = parts(f"bodies.{kind}.")
    return found


def _replaced(body: Body, numbers: dict[str, float]) -> Body:
    if not numbers:
        return body
    com, inertia = body.com.copy(), body.inertia.copy()
    for name, value in numbers.items():
        what, _, axes = name.partition(".")
        places = ["xyz".index(axis) for axis in axes]
        if what == "com":
            com[places[0]] = value
        elif what == "inertia":
            inertia[places[0], places[1]] = inertia[places[1], places[0]] = value
    return Body(numbers.get("mass", body.mass), com, inertia)


def _limits(base: Limits, numbers: dict[str, float]) -> Limits:
    pairs = {
        name: (
            numbers.get(f"{name}.low", getattr(base, name)[0]),
            numbers.get(f"{name}.high", getattr(base, name)[1]),
        )
        for name in ("travel", "tilt")
    }
    return Limits(speed=numbers.get("speed", base.speed), force=numbers.get("force", base.force), **pairs)


def _friction(base: Friction, numbers: dict[str, float]) -> Friction:
    if not numbers:
        return base
    by_joint = {
        kind: {**getattr(base, kind), **by_joint_of(numbers, kind)} for kind in ("viscous", "coulomb")
    }
    return Friction(smoothing=numbers.get("smoothing", base.smoothing), **by_joint)


def _actuators(base: Actuators, numbers: dict[str, float]) -> Actuators:
    given = {what: by_joint_of(numbers, what) for what in (item.name for item in fields(base))}
    return replace(base, **{what: {**getattr(base, what), **own} for what, own in given.items() if own})


def by_joint_of(numbers: Mapping[str, Any], kind: str) -> dict[str, Any]:
    """Return numbers by joint, from names such as `viscous.sliders`, `armature.slide_a`; groups give way."""
    given = {name.removeprefix(f"{kind}."): v for name, v in numbers.items() if name.startswith(f"{kind}.")}
    found: dict[str, Any] = {}
    for name in sorted(given, key=lambda name: name not in JOINT_GROUPS):
        for joint in JOINT_GROUPS.get(name, (name,)):
            found[joint] = given[name]
    return found
