"""`Catalogue`: motors, gears, screws and belts to choose from; read, written, and a generic one.

The form of a file::

    motors:
      - name: M400
        rated_torque: 1.3 Nm
        peak_torque: 3.8 Nm
        rated_speed: 3000 rpm
        max_speed: 5000 rpm
        inertia: 0.3 kg cm^2
        brake_torque: 1.4 Nm
        winding:                             # optional: what the voltage of the drive allows
          {bus_voltage: 320 V, pole_pairs: 4, resistance: 1 ohm, inductance: 8 mH, measured: between lines,
           torque_constant_rms: 0.594, max_current_rms: 8.5 A, field_weakening: true}
    screws:
      - {name: 16x10, lead: 10 mm, diameter: 12.7 mm, length: 500 mm, efficiency: 0.9}
    belts: []
    racks: []                                # likewise
    life: 20000 h                            # optional: what nuts have to live; or '1e7 cycles', '5000 km'
    gears:                                   # optional; without it motors drive screws and belts directly
      - {name: direct, ratio: 1}
      - {name: i3, ratio: 3, efficiency: 0.96, inertia: 0.1 kg cm^2}

    amplifiers:                              # optional; a motor names its own by `amplifier: D4`
      - {name: D4, rated_current_rms: 3 A, max_current_rms: 9 A, max_current_time: 3 s, max_voltage: 400 V}
    supply:                                  # optional: the direct-current bus of the amplifiers
      {capacitance: 560 uF, voltage: 320 V, max_voltage: 380 V, resistance: 40 ohm, resistor_power: 200 W}
    stop: {deceleration: 8 m/s^2, jerk: 400 m/s^3, delay: 4 ms}    # optional: of sliders in an emergency
    axes:                                    # optional: what each axis may have, by names; else all
      A: {motors: [M400], screws: [16x10]}

Every motor is tried with every gear and every screw or belt. Numbers are in SI units, or have one of their
own. A list, or an item of it, may be a maker's table: see `makers.py`. A field of a part is one line in its
class, one in `_UNITS` if it has a unit, and one in the reference of the files.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from p3dof._base.checks import Readable, require, shown, warn_caller
from p3dof._base.errors import DriveError, ParameterError
from p3dof._base.files import Source, called, is_stream, parse_yaml, read_text, suffix_of, write_atomic
from p3dof._base.quantities import (
    ACCELERATION,
    CAPACITANCE,
    CURRENT,
    ENERGY,
    FLUX,
    FORCE,
    INDUCTANCE,
    INERTIA,
    JERK,
    LENGTH,
    MASS,
    MOMENT,
    POWER,
    RESISTANCE,
    ROTATION,
    TIME,
    TORQUE_CONSTANT,
    VOLTAGE,
    Quantity,
)
from p3dof.design.drives.makers import CURVE, parts_of_table
from p3dof.design.drives.margins import Ambient, Margins
from p3dof.design.drives.motor import Amplifier, Motor, Winding
from p3dof.design.drives.nuts import RequiredLife, required_life
from p3dof.design.drives.stopping import StopRamp
from p3dof.design.drives.supply import Supply
from p3dof.design.drives.transmission import LEAD_GRADES, Belt, Drive, Gear, Rack, Screw
from p3dof.machine.parameters import LEGS
from p3dof.machine.parameters.machine import read_fields

_MOST = 5000  # most drives of a catalogue: motors by gears by screws and belts
_UNITS: Mapping[str, Quantity] = {
    **dict.fromkeys(("rated_torque", "peak_torque", "max_torque", "brake_torque", "drag"), MOMENT),
    **dict.fromkeys(("max_power", "max_braking_power", "resistor_power", "max_feedback_power"), POWER),
    **dict.fromkeys(("max_speed", "rated_speed"), ROTATION),
    **dict.fromkeys(("inertia", "coupling_inertia"), INERTIA),
    **dict.fromkeys(("time_constant", "brake_time", "max_current_time", "delay"), TIME),
    **dict.fromkeys(("lead", "diameter", "nominal_diameter", "length", "altitude", "lead_accuracy"), LENGTH),
    "inductance": INDUCTANCE,
    "flux": FLUX,
    **dict.fromkeys(("torque_constant_rms", "torque_constant_peak"), TORQUE_CONSTANT),
    **dict.fromkeys(("phase_resistance", "resistance"), RESISTANCE),
    **{f"{most}_current_{kind}": CURRENT for most in ("rated", "max") for kind in ("rms", "peak")},
    **dict.fromkeys(("bus_voltage", "voltage_constant", "voltage", "max_voltage"), VOLTAGE),
    "capacitance": CAPACITANCE,
    "mass": MASS,
    "deceleration": ACCELERATION,
    "jerk": JERK,
    **dict.fromkeys(("dynamic", "static", "preload", "max_force", "pretension", "max_tension"), FORCE),
    "brake_energy": ENERGY,
}
"""Kinds of number by the names of fields, which mean one thing in all parts."""
_WRITTEN = {MOMENT: "Nm", ROTATION: "rpm", INERTIA: "kg cm^2", LENGTH: "mm", INDUCTANCE: "mH"}
"""In which units makers print; others are written in SI units."""
_KINDS: Mapping[str, type[Any]] = {
    "motors": Motor,
    "screws": Screw,
    "belts": Belt,
    "racks": Rack,
    "gears": Gear,
    "amplifiers": Amplifier,
}
"""Lists of a catalogue."""
_SELECTED = ("motors", "gears", "screws", "belts", "racks")
_SLOW = ("screws", "belts", "racks")
_INNER: Mapping[str, type[Any]] = {
    "winding": Winding,
    "margins": Margins,
    "ambient": Ambient,
    "supply": Supply,
    "stop": StopRamp,
}
"""Fields that are parts of their own, in other parts or in a catalogue."""
_CURVE = (ROTATION, MOMENT, MOMENT)
_PAIRS = ("derating_temperature", "derating_altitude")  # rows of numbers, which no table of a maker has


@dataclass(frozen=True, eq=False)
class Catalogue(Readable):
    """Motors, gears, screws and belts to choose from."""

    motors: Sequence[Motor]  # at least one
    transmissions: Sequence[Screw | Belt]  # at least one
    gears: Sequence[Gear] = (Gear(),)  # at least one; none but the direct one by default
    margins: Margins = field(default_factory=Margins)  # what of each rating must stay free
    ambient: Ambient = field(default_factory=Ambient)  # where motors work
    supply: Supply | None = None  # of the amplifiers; None if nothing is known
    stop: StopRamp | None = None  # how the drives stop in an emergency
    axes: Mapping[str, Mapping[str, Sequence[str]]] = field(default_factory=dict)
    """What axes A, B and C may have, by names of `motors`, `gears`, `screws` and `belts`; a kind that is left
    out is not restricted, but of screws and belts one that is named leaves the other out."""
    life: RequiredLife | None = None  # what nuts have to live

    def __post_init__(self) -> None:
        kinds: tuple[tuple[str, type[Any] | tuple[type[Any], ...]], ...] = (
            ("motors", Motor),
            ("transmissions", (Screw, Belt)),
            ("gears", Gear),
        )
        require("margins", self.margins, Margins, DriveError)
        require("ambient", self.ambient, Ambient, DriveError)
        for what, kind in kinds:
            parts = tuple(getattr(self, what))
            if not parts:
                raise DriveError(f"catalogue: expected at least one of the {what}, got none")
            for part in parts:
                if not isinstance(part, kind):
                    raise DriveError(f"catalogue: {what}: got {shown(part)}")
            names = [part.name for part in parts]
            twice = [name for name in names if names.count(name) > 1]
            if twice:
                raise DriveError(f"catalogue: {what}: the name {twice[0]!r} is given twice")
            object.__setattr__(self, what, parts)
        if len(self) > _MOST:
            raise DriveError(f"catalogue: expected at most {_MOST} drives, got {len(self)}")
        if not isinstance(self.supply, Supply | None):
            raise DriveError(f"catalogue: supply: expected a Supply, got {shown(self.supply)}")
        if not isinstance(self.stop, StopRamp | None):
            raise DriveError(f"catalogue: stop: expected a StopRamp, got {shown(self.stop)}")
        object.__setattr__(self, "life", required_life(self.life, "catalogue: life"))
        self._check_axes()

    def _check_axes(self) -> None:
        """Raise if an axis may have what is not in the catalogue, or nothing."""
        if not isinstance(self.axes, Mapping):
            raise DriveError(f"catalogue: axes: expected A, B or C with names, got {shown(self.axes)}")
        for leg, kinds in self.axes.items():
            where = f"catalogue: axes: {leg}"
            if leg not in LEGS:
                raise DriveError(f"catalogue: axes: expected A, B or C, got {shown(leg)}")
            if not isinstance(kinds, Mapping) or not set(kinds) <= set(_SELECTED):
                raise DriveError(f"{where}: expected lists of names under {', '.join(_SELECTED)}")
            for kind, names in kinds.items():
                known = [part.name for part in self._of_kind(kind)]
                if not isinstance(names, list | tuple) or not names:
                    raise DriveError(f"{where}: {kind}: expected a list of names, got {shown(names)}")
                for name in names:
                    if name not in known:
                        words = ", ".join(known) or "none"
                        raise DriveError(f"{where}: {kind}: expected one of {words}, got {shown(name)}")

    def _of_kind(self, kind: str) -> Sequence[Motor | Screw | Belt | Gear]:
        if kind in _SLOW:
            return [part for part in self.transmissions if type(part) is _KINDS[kind]]
        return self.motors if kind == "motors" else self.gears

    def of_axis(self, leg: str) -> list[Drive]:
        """Return the drives that an axis, A, B or C, may have."""
        kinds = self.axes.get(leg, {})
        slow = {kind: kinds[kind] for kind in _SLOW if kind in kinds}
        return [
            drive
            for drive in self
            if drive.motor.name in kinds.get("motors", (drive.motor.name,))
            and drive.gear.name in kinds.get("gears", (drive.gear.name,))
            and (not slow or drive.transmission.name in slow.get(_kind(drive), ()))
        ]

    def __len__(self) -> int:
        return len(self.motors) * len(self.transmissions) * len(self.gears)

    def __iter__(self) -> Iterator[Drive]:
        for motor in self.motors:
            for gear in self.gears:
                for transmission in self.transmissions:
                    yield Drive(motor, transmission, gear)


def _kind(drive: Drive) -> str:
    return next(kind for kind in _SLOW if type(drive.transmission) is _KINDS[kind])


def read_catalogue(path: Source) -> Catalogue:
    """Read a catalogue of drives.

    Parameters
    ----------
    path : path-like or stream
        The YAML file.

    Raises
    ------
    DriveError
        If a field is missing, unknown, in a wrong unit or does not fit; the message names file and field.
    FileError
        If the file cannot be read.
    """
    source = called(path)
    folder = Path() if is_stream(path) else Path(path).parent  # type: ignore[arg-type]  # it is a path
    data = parse_yaml(read_text(path), source, DriveError)
    single = [item.name for item in fields(Catalogue) if item.name in _INNER]
    try:
        data = read_fields(data, source, ("motors",), (*_KINDS, *single, "axes", "life"))
        amplifiers = _parts(data.get("amplifiers", []), "amplifiers", folder, f"{source}: amplifiers")
        fed = {one.name: one for one in amplifiers}
        if len(fed) < len(amplifiers):
            twice = [one.name for one in amplifiers]
            name = next(name for name in twice if twice.count(name) > 1)
            raise DriveError(f"{source}: amplifiers: the name {name!r} is given twice")
        parts = {
            kind: _parts(data.get(kind, []), kind, folder, f"{source}: {kind}", fed) for kind in _SELECTED
        }
        others = {
            name: _part(data[name], _INNER[name], f"{source}: {name}") for name in single if name in data
        }
    except ParameterError as error:
        raise DriveError(str(error)) from error
    try:
        gears = parts["gears"] or [Gear()]
        found = Catalogue(
            parts["motors"],
            [*parts["screws"], *parts["belts"], *parts["racks"]],
            gears,
            **others,
            axes=data.get("axes", {}),
            life=data.get("life"),
        )
    except DriveError as error:
        raise DriveError(f"{source}: {error}") from error
    _doubt(found, source)
    return found


def _doubt(catalogue: Catalogue, source: str) -> None:
    """Warn of numbers that seem to be in another unit: of the first part that has any."""
    for part in (*catalogue.motors, *catalogue.transmissions):
        told = [
            f"{name} = {value:g} {unit} ({other}?)"
            for name, (most, unit, other) in _MOST_OF.items()
            if (value := getattr(part, name, None)) is not None and most < value < math.inf
        ]
        if isinstance(part, Motor) and part.inertia > _SLUGGISH * part.peak_torque:
            told.append(f"inertia = {part.inertia:g} kg m^2 (kg cm^2?)")
        if told:
            return warn_caller(
                f"{source}: {part.name}: {'; '.join(told)}: a number without a unit is in SI units"
            )
    return None


_MOST_OF = {
    "max_speed": (2500.0, "rad/s", "rpm"), "lead": (1.0, "m", "mm"), "diameter": (1.0, "m", "mm"),
    "length": (50.0, "m", "mm"),
}  # fmt: skip
"""Numbers of motors, screws and belts that are believed, with their unit and the one that may be meant."""
_SLUGGISH = 0.02
"""Rotor inertia by peak torque that is believed [s²]: no motor needs a second to 50 rad/s."""


def _parts(
    data: Any, kind: str, folder: Path, where: str, amplifiers: Mapping[str, Amplifier] | None = None
) -> list[Any]:
    """Return the parts of a list: each is an item, or the row of a table that stands for it or is an item."""
    cls, found = _KINDS[kind], []
    if not isinstance(data, list | Mapping):
        raise DriveError(f"{where}: expected a list, got {shown(data)}")
    for k, item in enumerate(data if isinstance(data, list) else [data]):
        place = f"{where}[{k}]" if isinstance(data, list) else where
        if isinstance(data, Mapping) or (isinstance(item, Mapping) and "table" in item):
            rows = parts_of_table(item, _known(cls), _required(cls), folder, place)
            found += [_part(row, cls, line, ("name",), amplifiers) for line, row in rows]
        else:
            found.append(_part(item, cls, place, ("name",), amplifiers))
    return found


def _required(cls: type[Any]) -> list[str]:
    return [item.name for item in fields(cls) if item.default is item.default_factory]


def unit_of(cls: type[Any], name: str) -> Quantity | None:
    """Return what kind of number a field of a part is; None without a unit, as all margins."""
    return None if cls is Margins else _UNITS.get(name)


def _known(cls: type[Any]) -> dict[str, tuple[str, Quantity | None]]:
    """Return the fields that a row of a table may have, with their types and kinds of number."""
    found: dict[str, tuple[str, Quantity | None]] = {}
    for item in fields(cls):
        if item.name in _INNER:
            found |= {f"{item.name}.{name}": kind for name, kind in _known(_INNER[item.name]).items()}
        elif item.name in _PAIRS:
            continue
        elif item.name == "curve":
            found |= {name: ("float", unit) for name, unit in zip(CURVE, _CURVE, strict=True)}
        else:
            found[item.name] = (str(item.type), unit_of(cls, item.name))
    return found


def _part(
    data: Any,
    cls: type[Any],
    where: str,
    also: Sequence[str] = (),
    amplifiers: Mapping[str, Amplifier] | None = None,
) -> Any:
    """Return a part from plain data, which has the fields `also` whatever their default."""
    data = read_fields(data, where, (*also, *_required(cls)), [item.name for item in fields(cls)])
    values: dict[str, Any] = {}
    for key, value in data.items():
        place = f"{where}: {key}"
        if key == "curve":
            values[key] = _curve(value, place)
        elif key in _INNER:
            values[key] = _part(value, _INNER[key], place)
        elif key == "amplifier":
            values[key] = _fed(value, amplifiers or {}, place)
        elif _as_text(key, value):
            values[key] = value
        else:
            unit = unit_of(cls, key)
            values[key] = value if unit is None else unit.read(value, place)
    try:
        return cls(**values)
    except DriveError as error:
        raise DriveError(f"{where}: {error}") from error


def _as_text(key: str, value: Any) -> bool:
    """Whether a text is no number with a unit: a preload as a share, a tolerance grade of a lead."""
    share = key == "preload" and isinstance(value, str) and value.strip().endswith("%")
    return share or (key == "lead_accuracy" and isinstance(value, str) and value in LEAD_GRADES)


def _fed(name: Any, amplifiers: Mapping[str, Amplifier], where: str) -> Amplifier:
    """Return the amplifier of a name."""
    if isinstance(name, str) and name in amplifiers:
        return amplifiers[name]
    words = f"one of {', '.join(amplifiers)}" if amplifiers else "no name, as there are no amplifiers"
    raise DriveError(f"{where}: expected {words}, got {shown(name)}")


def _curve(data: Any, where: str) -> list[list[float]]:
    if not isinstance(data, list) or len(data) > 1000:
        raise DriveError(f"{where}: expected a list of [speed, continuous torque, peak torque]")
    rows = []
    for k, row in enumerate(data):
        if not isinstance(row, list) or len(row) != 3:
            raise DriveError(f"{where}[{k}]: expected [speed, continuous torque, peak torque]")
        rows.append([unit.read(value, f"{where}[{k}]") for unit, value in zip(_CURVE, row, strict=True)])
    return rows


def write_catalogue(catalogue: Catalogue, path: str | os.PathLike[str]) -> Path:
    """Write a catalogue to a YAML file, from which the same catalogue is read to the last bit.

    Parameters
    ----------
    catalogue : Catalogue
        Of this module, a maker's tables read in, or your own.
    path : path-like
        The file, or its name before ``.yaml``.

    Returns
    -------
    pathlib.Path
        The path written.

    Raises
    ------
    DriveError
        If it is something else, or more than a file of YAML may have.
    FileError
        If the file cannot be written.
    """
    require("catalogue", catalogue, Catalogue, DriveError)
    suffix_of(path, "parameters")
    text = dump(catalogue)
    parse_yaml(text, called(path), DriveError)
    return write_atomic(path, text)


def dump(catalogue: Catalogue) -> str:
    """Return the text of a catalogue, in the units that makers print, without what follows from the rest."""
    screws = [part for part in catalogue.transmissions if isinstance(part, Screw)]
    racks = [part for part in catalogue.transmissions if isinstance(part, Rack)]
    belts = [part for part in catalogue.transmissions if type(part) is Belt]
    gears = [] if list(map(_plain, catalogue.gears)) == [_plain(Gear())] else catalogue.gears
    lists: dict[str, Sequence[Any]] = {
        "motors": catalogue.motors,
        "screws": screws,
        "belts": belts,
        "racks": racks,
        "gears": gears,
        "amplifiers": list(
            {motor.amplifier.name: motor.amplifier for motor in catalogue.motors if motor.amplifier}.values()
        ),
    }
    data: dict[str, Any] = {
        kind: [{"name": part.name} | _plain(part) for part in parts] for kind, parts in lists.items() if parts
    }
    for name in ("margins", "ambient", "supply", "stop"):
        part = getattr(catalogue, name)
        if part is not None and (plain := _plain(part)):
            data[name] = plain
    if catalogue.life is not None:
        data["life"] = str(catalogue.life)
    if catalogue.axes:
        data["axes"] = {
            leg: {kind: list(names) for kind, names in kinds.items()} for leg, kinds in catalogue.axes.items()
        }
    text: str = yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=110, allow_unicode=True)
    return text


def _plain(part: Any) -> dict[str, Any]:
    """Return the fields of a part as a file has them, but those that are the same when they are left out."""
    values = {item.name: getattr(part, item.name) for item in fields(part)}
    for name in [name for name in values if name not in _required(type(part))]:
        fewer = {each: value for each, value in values.items() if each != name}
        try:
            bare = type(part)(**fewer)
        except DriveError:
            continue
        if all(np.array_equal(getattr(bare, item.name), getattr(part, item.name)) for item in fields(part)):
            values = fewer
    return {name: _told(type(part), name, value) for name, value in values.items()}


def _told(cls: type[Any], name: str, value: Any) -> Any:
    if name in _INNER:
        return _plain(value)
    if name in _PAIRS:
        return np.asarray(value).tolist()
    if name == "amplifier":
        return value.name
    if isinstance(value, str):
        return value
    if name == "curve":
        return [
            [_number(float(number), unit) for number, unit in zip(row, _CURVE, strict=True)] for row in value
        ]
    unit = unit_of(cls, name)
    return value if unit is None else _number(value, unit)


def _number(value: float, quantity: Quantity) -> str:
    """Return a number with the fewest digits that are read as the same, in the unit that makers print."""
    unit = _WRITTEN.get(quantity, quantity.unit)
    size = quantity.read(f"1 {unit}", "")
    texts = (f"{value / size:.{digits}g} {unit}" for digits in (6, 15, 16, 17))
    exact = f"{value!r} {quantity.unit}"
    return next((text for text in texts if quantity.read(text, "") == value), exact)


def _generic() -> Catalogue:
    """Return sizes that are typical of servo motors and ball screws; no maker's.

    Powers at 3000 rpm with flanges of 40 mm (to 100 W), 60 mm (to 400 W), 80 mm (to 1 kW) and 130 mm. Screws
    of nominal diameters and leads of ISO 3408-2; their roots are smaller by little more than a ball.

    Load ratings grow with number and diameter of the balls as those of thrust bearings (ISO 281, ISO 76):
    C_a as Z^(2/3) D_w^1.8, C_0a as Z D_w², with Z = π d / D_w balls in a turn, and both with the cosine of
    the lead angle. Their factors are a little less than those of makers' nuts with three turns of balls.
    """
    rpm = math.pi / 30
    sizes = [
        ("50 W", 0.16, 4e-6),
        ("100 W", 0.32, 7e-6),
        ("200 W", 0.64, 2.5e-5),
        ("400 W", 1.27, 4.5e-5),
        ("750 W", 2.4, 1.2e-4),
        ("1 kW", 3.18, 2e-4),
        ("1.5 kW", 4.8, 6e-4),
        ("2 kW", 6.37, 9e-4),
        ("3 kW", 9.6, 1.5e-3),
    ]
    motors = [
        Motor(
            rated_torque=torque,
            peak_torque=round(3 * torque, 2),
            rated_speed=3000 * rpm,
            max_speed=6000 * rpm if torque < 3 else 5000 * rpm,
            inertia=inertia,
            brake_torque=torque,
            name=f"generic {name}",
        )
        for name, torque, inertia in sizes
    ]
    diameters: list[tuple[int, float, float, tuple[float, ...]]] = [  # nominal, core, ball, leads [mm]
        (8, 6.5, 1.5, (2.5, 5)),
        (12, 9.5, 2.381, (5, 10)),
        (16, 12.7, 3.175, (5, 10, 16)),
        (20, 16.7, 3.175, (5, 10, 20)),
        (25, 21.7, 3.175, (5, 10, 25)),
        (32, 27.0, 4.763, (10, 20, 32)),
    ]
    screws = [
        Screw(
            lead=lead / 1e3,
            diameter=core / 1e3,
            nominal_diameter=size / 1e3,
            length=0.5,
            efficiency=0.9,
            dynamic=_rounded(300 * size ** (2 / 3) * ball ** (17 / 15), size, lead),
            static=_rounded(250 * size * ball, size, lead),
            name=f"generic {size}x{lead:g}",
        )
        for size, core, ball, leads in diameters
        for lead in leads
    ]
    return Catalogue(motors, screws)


def _rounded(rating: float, size: float, lead: float) -> float:
    """Return a load rating [N] of a screw with this lead, rounded down to half a kilonewton."""
    return 500.0 * math.floor(rating * math.cos(math.atan(lead / (math.pi * size))) / 500)


GENERIC = _generic()
"""Generic sizes, with numbers of our own that are typical of their class: for a first look only."""
